# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests collapsing edges within a UV layout: flat islands keep their affine UVs, borders and labels stay, nothing folds."""

from dataclasses import replace

import numpy as np
import pytest

from addon.mesh.carried_normals import carried_normals
from addon.mesh.collapse import CollapseOptions
from addon.mesh.layout_collapse import Charted, collapse_layout
from addon.mesh.topology import EdgeTable
from addon.mesh.triangles import face_normals, unit
from tests.pure.test_collapse import grid
from tests.pure.test_fitting import sphere

ROOM = 0.05


def charted(points, triangles, islands, *uvs, labels=None):
    """A mesh whose islands (T,) have affine UVs: uvs has a matrix (2, 4) for each. The values have the island as well."""
    matrices = np.array(uvs)
    corners = np.concatenate([points[triangles], np.ones((len(triangles), 3, 1))], axis=2)
    uv = np.einsum("tij,tcj->tci", matrices[islands], corners)
    values = np.concatenate([uv, np.broadcast_to(islands[:, None, None], (len(triangles), 3, 1))], axis=2)
    return Charted(points, triangles, values, np.zeros(len(triangles), int) if labels is None else labels)


def uv_areas(mesh):
    uv = mesh.values[..., :2]
    return 0.5 * np.linalg.det(uv[:, 1:] - uv[:, :1])


LEFT = [[0.2, 0.0, 0.0, 0.2], [0.0, 0.2, 0.0, 0.2]]
RIGHT = [[0.0, -0.2, 0.0, 0.7], [0.2, 0.0, 0.0, 0.7]]
MIRRORED = [[-0.2, 0.0, 0.0, 0.2], [0.0, 0.2, 0.0, 0.2]]


@pytest.mark.parametrize("right", [LEFT, RIGHT, MIRRORED])
def test_a_flat_mesh_keeps_its_islands(right):
    """Of one island, of two, and of two that are mirrored and lie on each other."""
    points, triangles = grid(16)
    islands = (points[triangles].mean(axis=1)[:, 0] > 0.0).astype(int)
    mesh = charted(points, triangles, islands, LEFT, right)
    coarse = collapse_layout(mesh, CollapseOptions(40), ROOM)
    assert len(coarse.triangles) <= 40 and (face_normals(coarse.points, coarse.triangles)[:, 2] > 0.0).all()
    if right is LEFT:
        islands = np.zeros(len(coarse.triangles), int)
    else:
        assert np.ptp(coarse.values[..., 2], axis=1).max() == 0.0
        islands = coarse.values[:, 0, 2].astype(int)
        sides = coarse.points[coarse.triangles][..., 0] * np.where(islands, 1.0, -1.0)[:, None]
        assert sides.min() > -1e-6 and np.array_equal(mesh.values[coarse.faces, 0, 2], islands)
    expected = charted(coarse.points, coarse.triangles, islands, LEFT, right)
    assert coarse.values[..., :2] == pytest.approx(expected.values[..., :2], abs=1e-6)
    assert np.abs(uv_areas(coarse)).sum() == pytest.approx(np.abs(uv_areas(mesh)).sum(), rel=1e-3)


def test_labels_and_corners_of_their_border_stay():
    points, triangles = grid(16)
    middles = points[triangles].mean(axis=1)
    labels = ((middles[:, 0] > 0.0) & (middles[:, 1] > 0.0)).astype(int)
    mesh = charted(points, triangles, np.zeros(len(triangles), int), LEFT, labels=labels)
    coarse = collapse_layout(mesh, CollapseOptions(30), ROOM)
    areas = 0.5 * np.linalg.norm(face_normals(coarse.points, coarse.triangles), axis=1)
    assert len(coarse.triangles) <= 30 and areas[coarse.labels == 1].sum() == pytest.approx(1.0, abs=1e-3)
    assert np.linalg.norm(coarse.points, axis=1).min() < 1e-3  # where the border turns


def globe(n=24):
    """A sphere whose UVs are its longitude and its height, cut along one meridian and apart from its poles."""
    points, triangles = sphere(n)
    corners = points[triangles]
    longitude = np.arctan2(corners[..., 1], corners[..., 0]) / (2.0 * np.pi)
    middles = corners.mean(axis=1)
    reference = np.arctan2(middles[:, 1], middles[:, 0]) / (2.0 * np.pi)
    longitude += np.round(reference[:, None] - longitude)
    at_pole = np.hypot(corners[..., 0], corners[..., 1]) < 1e-6
    longitude = np.where(at_pole, reference[:, None], longitude)
    uv = np.stack([0.5 + 0.9 * longitude, 0.5 + 0.2 * corners[..., 2]], axis=2)
    return Charted(points, triangles, uv, np.zeros(len(triangles), int))


def test_a_globe_stays_closed_and_its_map_in_place():
    mesh = globe()
    coarse = collapse_layout(mesh, CollapseOptions(160), ROOM)
    assert len(coarse.triangles) == 160 and (EdgeTable.of(coarse.triangles).counts == 2).all()
    assert (np.sign(uv_areas(coarse)) == np.sign(uv_areas(mesh)[coarse.faces])).all()
    corners = coarse.points[coarse.triangles]
    away = np.hypot(corners[..., 0], corners[..., 1]) > 0.5
    longitude = np.arctan2(corners[..., 1], corners[..., 0]) / (2.0 * np.pi)
    off = (coarse.values[..., 0] - 0.5) / 0.9 - longitude
    assert np.abs(off - np.round(off))[away].max() < 0.05
    assert np.abs(coarse.values[..., 1] - 0.5 - 0.2 * corners[..., 2]).max() < 0.03


def annulus(n=48):
    """A ring with radii 1 and 2 in three rows of quads, whose UVs are a tenth of its places."""
    angles = np.arange(n) * 2.0 * np.pi / n
    radii = np.array([1.0, 4 / 3, 5 / 3, 2.0])
    points = np.stack([np.outer(radii, np.cos(angles)), np.outer(radii, np.sin(angles)), np.zeros((4, n))], axis=-1)
    a = np.add.outer(np.arange(3) * n, np.arange(n)).reshape(-1)
    b = np.add.outer(np.arange(3) * n, np.roll(np.arange(n), -1)).reshape(-1)
    triangles = np.concatenate([np.stack([a, a + n, b + n], axis=1), np.stack([a, b + n, b], axis=1)])
    points = points.reshape(-1, 3)
    return Charted(points, triangles, 0.5 + 0.1 * points[triangles][..., :2], np.zeros(len(triangles), int))


@pytest.mark.parametrize("room", [0.0, 0.0008, 0.002, 1.0])
def test_borders_move_outwards_within_their_room(room):
    """The chords of the hole's border lie outside the island, and those of its outer border inside it."""
    mesh = annulus()
    coarse = collapse_layout(mesh, CollapseOptions(40), room)
    edges = EdgeTable.of(coarse.triangles)
    flat = 0.1 * coarse.points[np.stack([edges.first[edges.alone], edges.last[edges.alone]], axis=1)][..., :2]
    middles = np.linalg.norm(flat.mean(axis=1), axis=1)
    inner = middles[middles < 0.13]
    farthest = 0.1 * np.cos(np.pi / 48) - inner.min()
    assert -1e-9 <= farthest <= room + 1e-9
    assert (len(inner) == 48) == (room == 0.0)


def test_nothing_folds_in_a_layout_that_is_a_swirl():
    """It turns by three radians from the middle to the corners of a flat square."""
    points, triangles = grid(24)
    turned = points[:, 0] + 1j * points[:, 1]
    turned *= np.exp(3j * np.abs(turned) / np.sqrt(2.0))
    uv = 0.5 + 0.3 * np.stack([turned.real, turned.imag], axis=1)
    mesh = Charted(points, triangles, uv[triangles], np.zeros(len(triangles), int))
    assert uv_areas(mesh).min() > 0.0
    for count in (300, 100, 30):
        assert uv_areas(collapse_layout(mesh, CollapseOptions(count), 1.0)).min() > 0.0


def test_borders_of_three_islands_meet_where_they_met():
    points, triangles = grid(12)
    middles = points[triangles].mean(axis=1)
    islands = np.where(middles[:, 0] < 0.0, 0, np.where(middles[:, 1] > 0.0, 1, 2))
    far = [[0.2, 0.0, 0.0, 0.7], [0.0, 0.2, 0.0, 0.2]]
    coarse = collapse_layout(charted(points, triangles, islands, LEFT, RIGHT, far), CollapseOptions(30), ROOM)
    areas = 0.5 * np.linalg.norm(face_normals(coarse.points, coarse.triangles), axis=1)
    assert len(coarse.triangles) <= 30
    assert np.bincount(coarse.values[:, 0, 2].astype(int), areas) == pytest.approx([2.0, 1.0, 1.0], abs=1e-3)


def test_wedges_are_what_lines_divide():
    points, triangles = grid(2)
    islands = (points[triangles].mean(axis=1)[:, 0] > 0.0).astype(int)
    mesh = charted(points, triangles, islands, LEFT, RIGHT)
    assert len(np.unique(mesh.wedges)) == 9 + 3
    assert mesh.on_line.all()  # at the rim, or between the islands
    two = replace(mesh, values=np.concatenate([np.zeros_like(mesh.values[..., :2]), mesh.values], axis=2), layers=2)
    assert len(np.unique(two.wedges)) == 9 + 3  # the second layer counts, too
    assert len(np.unique(replace(two, layers=1).wedges)) == 9


def test_normals_of_a_sphere_point_away_from_its_middle():
    points, triangles = sphere(32)
    coarse, few = (each for each in sphere(8))
    found = carried_normals((points[triangles], points[triangles]), coarse[few], coarse[few], few)
    off = np.degrees(np.arccos(np.clip((found * unit(coarse[few])).sum(axis=2), -1.0, 1.0)))
    assert off.max() < 3.0


def test_normals_interpolate_with_the_least_squares():
    """z = x^2 with normals (-2x, 0, 1): on one quad from x = 0 to 1, those of a straight line through them are best, and not
    those at its ends."""
    places = np.linspace(0.0, 1.0, 33)
    x, y = np.meshgrid(places, [0.0, 1.0], indexing="ij")
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    a = 2 * np.arange(32)
    triangles = np.concatenate([np.stack([a, a + 2, a + 3], axis=1), np.stack([a, a + 3, a + 1], axis=1)])
    bent = np.maximum(points[:, 0] - 0.9, 0.0) * 10.0  # flat but for a rim
    normals = unit(np.stack([bent, 0.0 * bent, 1.0 - 0.9 * bent], axis=1))[triangles]
    quad = points[[0, 1, -2, -1]]
    corners = np.array([[0, 2, 3], [0, 3, 1]])
    found = carried_normals((points[triangles], normals), quad[corners], quad[corners], corners)
    at_rim = found[0, 1]
    assert np.degrees(np.arccos(at_rim[2])) < 45.0  # at the vertices of the fine mesh: 84
    assert found[:, 0, 2] == pytest.approx(1.0, abs=0.05)


def test_normals_of_a_thin_wall_are_of_their_own_side():
    points, triangles = grid(8)
    back = points + [0.0, 0.0, -0.01]
    whole, both = np.concatenate([points, back]), np.concatenate([triangles, triangles[:, ::-1] + len(points)])
    normals = unit(face_normals(whole, both))[:, None].repeat(3, axis=1)
    coarse, few = grid(2)
    below = np.concatenate([coarse + [0.0, 0.0, -0.006], coarse + [0.0, 0.0, -0.004]])  # nearer to the other side
    twice = np.concatenate([few, few[:, ::-1] + len(coarse)])
    found = carried_normals((whole[both], normals), below[twice], below[twice], twice)
    assert found[: len(few), :, 2] == pytest.approx(1.0) and found[len(few) :, :, 2] == pytest.approx(-1.0)
