# SPDX-License-Identifier: GPL-3.0-or-later
"""Notches and what it costs to fill them, by closed forms: combs, teeth, tubes, plates with windows."""

import numpy as np
import pytest

from addon.mesh import plane_collapse, polygons
from addon.mesh.notches import Notches, closing_costs, vertex_counts
from addon.mesh.plane_collapse import collapse_on_planes
from addon.mesh.planes import planes
from addon.mesh.triangles import face_areas, unit_normals
from tests.pure.test_hard_surfaces import band, is_closed, plate_with_hole, plate_with_round, soup, turned, volume

DEPTH = 2.0


def extruded(outline):
    """A solid along y of an outline (N, 2) in x and z, clockwise as seen along y."""
    outline, count = np.asarray(outline, float), len(outline)
    near, far = (np.column_stack([outline[:, 0], np.full(count, y), outline[:, 1]]) for y in (0.0, DEPTH))
    here = np.arange(count)
    lid, _ = polygons.triangulated(near, here, np.roll(here, -1), np.zeros(count, int), np.array([(0.0, -1.0, 0.0)]))
    return soup(turned(band(near, far)), (near, lid), (far, lid[:, ::-1]))


def comb(fins, tip=1.0):
    """The outline of a block of height 1 with fins of height 1 and width 1 on it, and gaps as wide between them; tip: how wide
    these are at their tips."""
    rows = [(0.0, 0.0), (2.0 * fins - 1.0, 0.0)]
    for number in reversed(range(fins)):
        middle = 2.0 * number + 0.5
        rows += [(middle + 0.5, 1.0), (middle + tip / 2.0, 2.0), (middle - tip / 2.0, 2.0), (middle - 0.5, 1.0)]
    rows = np.array(rows)
    return rows[np.append(True, (np.abs(np.diff(rows, axis=0)) > 0.0).any(axis=1))]


def notches_of(mesh):
    points, triangles = mesh
    found = planes(points, triangles)
    return Notches.of(points.astype(np.float64), triangles, found.of, found.normals), found


def test_gaps_between_fins_are_filled():
    mesh = extruded(comb(4))
    assert is_closed(mesh[1]) and volume(*mesh) == pytest.approx(11.0 * DEPTH)
    notches, found = notches_of(mesh)
    assert notches.is_closable.sum() == 3
    assert notches.vertex_counts[notches.is_closable].tolist() == [8, 8, 8]
    assert notches.gains()[notches.is_closable].tolist() == [0, 0, 0]
    caps, beside = notches.caps_of(notches.is_closable)
    whole = np.concatenate([mesh[1][~notches.is_closable[notches.labels]], caps])
    assert is_closed(whole) and volume(mesh[0], whole) == pytest.approx(14.0 * DEPTH)
    own, _ = unit_normals(mesh[0].astype(np.float64), caps)
    assert own == pytest.approx(found.normals[found.of[beside]], abs=1e-6)


def test_a_slot_between_two_planes_needs_no_third_cap():
    """Its walls meet in a line, from one side of an edge to the other."""
    points = np.array([(0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0), (0, 0, 4), (1, 0, 4), (3, 0, 4), (4, 0, 4)], float)
    points = np.concatenate([points, [(4, 4, 4), (0, 4, 4), (2, 0, 3), (2, 1, 4)]])
    faces = [(0, 2, 1), (0, 3, 2), (1, 2, 8), (1, 8, 7), (2, 3, 9), (2, 9, 8), (3, 0, 4), (3, 4, 9)]
    faces += [(0, 1, 10), (0, 10, 5), (0, 5, 4), (1, 6, 10), (1, 7, 6), (4, 5, 9), (5, 11, 9), (11, 8, 9)]
    faces += [(11, 6, 8), (6, 7, 8), (5, 10, 11), (6, 11, 10)]
    mesh = points, np.array(faces)
    assert is_closed(mesh[1])
    notches, _ = notches_of(mesh)
    assert notches.is_closable.sum() == 1
    caps, _ = notches.caps_of(notches.is_closable)
    whole = np.concatenate([mesh[1][~notches.is_closable[notches.labels]], caps])
    assert len(caps) == 2 and is_closed(whole) and volume(points, whole) == pytest.approx(64.0)


@pytest.mark.parametrize(
    "outline",
    [
        [(0, 0), (2, 0), (2, 2), (1, 2), (1, 1), (0, 1)],  # a step: no plane goes on across it
        [(0, 0), (5, 0), (5, 2.5), (3.5, 2), (3.5, 1), (1.5, 1), (1.5, 2), (0, 2.5)],  # tips that lean
    ],
)
def test_no_plane_goes_on_across(outline):
    assert not notches_of(extruded(outline))[0].is_closable.any()


def test_what_others_lie_beside_is_not_filled_with_them():
    notches, _ = notches_of(extruded(comb(3)))
    one, other = np.flatnonzero(notches.is_closable)
    assert notches.apart(notches.is_closable).tolist() == notches.is_closable.tolist()
    notches.around[0] = one, other
    assert np.flatnonzero(notches.apart(notches.is_closable)).tolist() == [min(one, other)]


def test_surfaces_that_end_have_no_notches_there():
    points, triangles = extruded(comb(2))
    (notch,) = np.flatnonzero(notches_of((points, triangles))[0].is_closable)
    labels = notches_of((points, triangles))[0].labels
    open_there = np.delete(triangles, np.flatnonzero(labels == notch)[0], axis=0)
    assert not notches_of((points, open_there))[0].is_closable.any()


def test_fins_go_whole():
    """With triangles for four of six fins, all that stay lie in planes that were there."""
    mesh = extruded(comb(6))
    wanted = len(mesh[1]) - 2 * 16
    made = collapse_on_planes(*mesh, planes(*mesh), wanted)
    assert len(made.triangles) <= wanted and is_closed(made.triangles)
    assert volume(made.points, made.triangles) == pytest.approx((17.0 + 2.0) * DEPTH, rel=1e-5)
    assert np.abs(made.points - np.round(made.points)).max() < 1e-5


@pytest.mark.parametrize(("height", "least"), [(0.1, 0.05**2), (5.0, 0.25)])
def test_closing_costs_of_a_square_tube(height, least):
    """All corners are half its width and half its height away from the middle: the less counts, along its axis the width."""
    corners = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    points, triangles = band(*(np.column_stack([corners, np.full(4, z)]) for z in (0.0, height)))
    labels = np.zeros(len(triangles), int)
    counts = vertex_counts(triangles, labels, 1)
    assert counts.tolist() == [8]
    area = 4.0 * height
    assert closing_costs(points, triangles, labels, counts) == pytest.approx([2.0 * area * least / 8.0])
    across = closing_costs(points, triangles, labels, counts, np.array([(0.0, 0.0, 1.0)]))
    assert across == pytest.approx([2.0 * area * 0.25 / 8.0])


def test_a_hole_costs_by_its_width_however_thin_its_plate_is():
    """And a pocket by its depth."""
    for mesh, square, count in (
        (plate_with_hole(0.6, 0.02), 0.6**2 / 2.0, 64),
        (plate_with_round(0.6, 0.02), None, 65),
    ):
        points, triangles = mesh[0].astype(np.float64), mesh[1]
        found = planes(points, triangles)
        inside = np.linalg.norm(points[triangles][..., :2], axis=2).max(axis=1) < 0.7
        inside &= points[triangles][..., 2].max(axis=1) > 0.0
        groups = np.zeros(len(triangles), int)
        openings = plane_collapse._Openings.of(points, triangles, inside, groups, found.normals[found.of])
        area = float(face_areas(points, triangles[inside]).sum())
        (cost,) = openings.costs()
        assert openings.vertex_counts.tolist() == [count]
        if square is None:
            assert cost < 2.0 * area * 0.02**2 / count
        else:
            assert cost == pytest.approx(2.0 * area * square / count, rel=1e-4)
