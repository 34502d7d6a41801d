# SPDX-License-Identifier: GPL-3.0-or-later
"""Open borders to which those of coarse meshes come near: closed forms of disks, and borders that are others."""

import numpy as np
import pytest

from addon.mesh import fitting
from addon.mesh.fitting import FitOptions, Samples
from addon.mesh.open_borders import Border

SQUARE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
FACES = np.array([(0, 1, 2), (0, 2, 3)])
ALMOST = 0.06
"""The relative error of radii that springs between vertices, and edges that end between places, make."""


def disk(corners, radius=1.0):
    """A fan around the middle."""
    angles = np.arange(corners) / corners * 2.0 * np.pi
    rim = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros(corners)], axis=1)
    first = np.arange(corners)
    fan = np.stack([np.full(corners, corners), first, (first + 1) % corners], axis=1)
    return np.concatenate([rim, np.zeros((1, 3))]), fan


def test_places_are_even_along_the_border():
    border = Border.of(SQUARE, FACES, 40)
    assert border.length == pytest.approx(0.1)
    steps = np.linalg.norm(border.points - np.roll(border.points, 1, axis=0), axis=1)
    assert np.allclose(np.sort(steps), [*4 * [np.sqrt(0.005)], *36 * [0.1]])  # shorter around corners
    assert np.allclose(border.normals, (0.0, 0.0, 1.0))
    ways = border.points - 0.5
    assert np.allclose(np.abs(ways[:, :2]).max(axis=1), 0.5)
    assert np.allclose((ways * border.outwards).sum(axis=1), 0.5)


def test_a_closed_surface_has_no_border():
    faces = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)])
    assert Border.of(np.concatenate([SQUARE[:3], [(0, 0, 1)]]), faces) is None


def test_a_closed_mesh_has_no_edges_on_a_border():
    faces = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    found = Border.of(SQUARE, FACES).on(np.concatenate([SQUARE[:3], [(0, 0, 1)]]), faces)
    assert [len(each) for each in found] == [0, 0, 0, 0]


def test_places_are_on_the_nearest_edges():
    """Of a square that is a tenth wider: each is a twentieth away. Those of a side count as a strip as wide as it is long."""
    points = 1.1 * SQUARE - (0.05, 0.05, 0.0)
    beside, shares, places, areas = Border.of(SQUARE, FACES, 400).on(points, FACES)
    there = (points[FACES[beside]] * shares[..., None]).sum(axis=1)
    assert len(places) == 400 and np.allclose(np.linalg.norm(there - places, axis=1), 0.05, atol=1e-6)
    assert np.allclose(areas, 1.1 * 0.01) and ((shares == 0.0).sum(axis=1) > 0).all()


@pytest.mark.parametrize(
    ("moved", "faces", "share"),
    [
        ((0.0, 0.0, 0.9), FACES, 1.0),
        ((0.0, 0.0, 1.1), FACES, 0.0),  # farther than its edges are long
        ((0.0, 0.0, 0.1), FACES[:, ::-1], 0.0),  # of a sheet that points down
        ((1.05, 0.0, 0.0), FACES, 0.5),  # beyond a gap, of which the other side is nearer
    ],
)
def test_other_borders_are_left_out(moved, faces, share):
    _, _, places, _ = Border.of(SQUARE, FACES, 400).on(SQUARE + moved, faces)
    assert len(places) == pytest.approx(400 * share, abs=20)


def fitted_radius(corners, start, **options):
    """The radius of a coarse disk that was fitted to a fine one of radius 1."""
    around = fitting.surface_samples(*disk(180), 4_000)
    moved, _ = fitting.fit(*disk(corners, start), around, FitOptions(smooth=1e-4, pull=1e-4, **options))
    return np.linalg.norm(moved[:corners], axis=1)


@pytest.mark.parametrize("start", [1.0, 1.0 / np.cos(np.pi / 8)])
def test_edges_of_a_disk_lie_as_far_within_it_as_beyond(start):
    """Of chords with the half angle a, the squares of ways to the circle are least where their middles have the radius
    sin(a) / a: their ends have tan(a) / a. Without the border, what sticks out stays."""
    angle = np.pi / 8
    border = Border.of(*disk(180), 1_000)
    with_border = fitted_radius(8, start, border=border)
    assert with_border - 1.0 == pytest.approx(np.full(8, np.tan(angle) / angle - 1.0), rel=ALMOST)
    assert fitted_radius(8, 1.0 / np.cos(angle)) == pytest.approx(np.full(8, 1.0 / np.cos(angle)), rel=1e-3)


def test_edges_stay_on_the_border_where_vertices_slide_beyond_it():
    """On a disk whose texels belong a fifth farther out than its border."""
    points, triangles = disk(64)
    which = np.repeat(np.arange(64), 3)
    shares = np.tile(np.array([(0.0, 0.75, 0.25), (0.0, 0.25, 0.75), (0.2, 0.4, 0.4)]), (64, 1))
    there = 1.2 * (points[triangles[which]] * shares[..., None]).sum(axis=1)
    places = Samples(there, np.tile((0.0, 0.0, 1.0), (192, 1)), which, np.full(192, 1e-3))
    alone = fitting.slid(points, triangles, (which, shares), places)
    held = fitting.slid(
        points, triangles, (which, shares), places, fitting.FitOptions(border=Border.of(points, triangles))
    )
    assert np.linalg.norm(alone[:64], axis=1) == pytest.approx(np.full(64, 1.2), abs=1e-3)
    assert 1.0 < np.linalg.norm(held[:64], axis=1).max() < 1.1
