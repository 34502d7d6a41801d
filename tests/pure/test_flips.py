# SPDX-License-Identifier: GPL-3.0-or-later
"""Edges of coarse meshes flip to where the surface is, and nothing else changes."""

import numpy as np
import pytest

from addon.mesh import fitting, flips
from addon.mesh.closest import Surface
from addon.mesh.flips import FlipOptions
from addon.mesh.topology import EdgeTable
from addon.mesh.triangles import unit_normals
from tests.pure.test_fitting import sphere
from tests.pure.test_folds import grid

ROOF = np.array([(0, 0, 0), (1, 0, 0.3), (1, 1, 0), (0, 1, 0.3)], float)
"""A square that is bent along a diagonal: along that from 0 to 2 it is a valley, along the other one a ridge."""
VALLEY, RIDGE = np.array([(0, 1, 2), (0, 2, 3)]), np.array([(0, 1, 3), (1, 2, 3)])


def flipped(points, triangles, surface, *options):
    nearest, _, _ = Surface(points.astype(np.float32), triangles).closest(surface.points.astype(np.float32))
    return flips.flip(points, triangles, surface, nearest, *options)


def sorted_corners(triangles):
    """Triangles that start with their least corner, in order."""
    turned = [np.roll(triangle, -int(triangle.argmin())).tolist() for triangle in triangles]
    return sorted(turned)


@pytest.mark.parametrize("height", [1.0, 3.0])
@pytest.mark.parametrize(("wanted", "other"), [(VALLEY, RIDGE), (RIDGE, VALLEY)])
def test_the_edge_of_a_bent_square_is_that_of_the_surface(wanted, other, height):
    points = ROOF * (1.0, 1.0, height)
    surface = fitting.surface_samples(points, wanted, 500)
    for start in (wanted, other):
        found, nearest = flipped(points, start, surface)
        assert sorted_corners(found) == sorted_corners(wanted)
        corners = points[found[nearest]]
        off = np.abs(((surface.points - corners[:, 0]) * unit_normals(corners)[0]).sum(axis=1))
        assert off.max() < 1e-12


def test_no_edge_flips_without_rounds_or_for_too_little():
    surface = fitting.surface_samples(ROOF, VALLEY, 500)
    for options in (FlipOptions(rounds=0), FlipOptions(gain=1.0)):
        assert (flipped(ROOF, RIDGE, surface, options)[0] == RIDGE).all()


def test_a_flat_mesh_stays_as_it_is():
    """Its distances are rounding alone."""
    points, triangles = grid(8)
    points = points @ np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    surface = fitting.surface_samples(points, triangles, 2000)
    assert (flipped(points, triangles, surface)[0] == triangles).all()


def test_a_folded_square_has_no_new_triangle_that_turns_over():
    """The fourth corner lies within the triangle of the others, seen from above, so that the other diagonal folds."""
    points = np.array([(0, 0, 0), (1, 0, 0), (0.3, 0.3, 0.0), (0, 1, 0)], float)
    triangles = np.array([(0, 1, 2), (0, 2, 3)])
    surface = fitting.surface_samples(points + (0, 0, 0.1), np.array([(1, 2, 3)])[:, ::-1], 300)
    assert (flipped(points, triangles, surface)[0] == triangles).all()


def test_an_edge_that_is_there_is_not_made_again():
    """Each edge of a tetrahedron would become the opposite one."""
    points = np.array([(0, 0, 0), (1, 0, 0), (0.5, 1, 0), (0.5, 0.4, 0.05)], float)
    triangles = np.array([(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)])
    surface = fitting.surface_samples(points + (0.0, 0.0, 0.02), triangles, 500)
    assert (flipped(points, triangles, surface)[0] == triangles).all()


def test_a_noisy_sphere_comes_nearer_and_stays_closed_seed_4():
    points, triangles = sphere(12)
    dice = np.random.default_rng(4)
    points = points + dice.normal(0.0, 0.03, points.shape)
    surface = fitting.surface_samples(*sphere(48), 8000)
    squares = []
    for rounds in (0, 1, 4):
        found, nearest = flipped(points, triangles, surface, FlipOptions(rounds=rounds))
        edges = EdgeTable.of(found)
        assert (edges.counts == 2).all() and not edges.is_against.any()
        assert len(np.unique(np.sort(found, axis=1), axis=0)) == len(found)
        squares.append(float(flips._squares(surface.points, points[found[nearest]]).sum()))
        old, _ = unit_normals(points, triangles)
        new, _ = unit_normals(points, found)
        assert (new * old)[(found == triangles).all(axis=1)].sum(axis=1).min() > 0.999
    assert squares[2] < squares[1] < squares[0]
    _, _, nearest_squares = Surface(points.astype(np.float32), found).closest(surface.points.astype(np.float32))
    assert float(nearest_squares.sum()) < 0.8 * squares[0]


def test_samples_know_the_nearest_triangle_beside_them_seed_5():
    points, triangles = sphere(10)
    points = points + np.random.default_rng(5).normal(0.0, 0.03, points.shape)
    surface = fitting.surface_samples(*sphere(40), 4000)
    found, nearest = flipped(points, triangles, surface)
    _, _, least = Surface(points.astype(np.float32), found).closest(surface.points.astype(np.float32))
    own = flips._squares(surface.points, points[found[nearest]])
    assert np.mean(own > least + 1e-6) < 0.02


def test_a_fit_goes_on_from_known_triangles():
    points, triangles = sphere(10)
    surface = fitting.surface_samples(*sphere(40), 4000)
    anew, nearest = fitting.fit(0.9 * points, triangles, surface)
    known, same = fitting.fit(0.9 * points, triangles, surface, known=nearest)
    assert np.abs(known - anew).max() < 1e-3
    assert np.mean(same == nearest) > 0.95


def test_no_sliver_is_made():
    """The first corner lies close to the other diagonal."""
    points = np.array([(-0.01, 0, 0.005), (1, 0, 0), (0, 1, 0), (0, -1, 0)], float)
    triangles = np.array([(0, 1, 2), (1, 0, 3)])
    surface = fitting.surface_samples(points, np.array([(3, 1, 2)]), 500)
    assert (flipped(points, triangles, surface)[0] == triangles).all()


@pytest.mark.parametrize("seed", range(8))
def test_of_two_edges_of_a_triangle_the_better_one_flips(seed):
    dice, angles = np.random.default_rng(seed), 0.4 * np.pi * np.arange(5)
    points = np.stack([np.cos(angles), np.sin(angles), dice.uniform(0.0, 0.3, 5)], axis=1)
    fans = [np.array(each) for each in ([(0, 1, 2), (0, 2, 3), (0, 3, 4)], [(0, 1, 3), (1, 2, 3), (0, 3, 4)])]
    fans.append(np.array([(0, 1, 2), (0, 2, 4), (2, 3, 4)]))
    surface = fitting.surface_samples(points, np.array([(1, 2, 3), (1, 3, 4), (1, 4, 0)]), 1000)
    places = surface.points.astype(np.float32)
    sums = [float(Surface(points.astype(np.float32), fan).closest(places)[2].sum()) for fan in fans]
    found, _ = flipped(points, fans[0], surface, FlipOptions(rounds=1))
    assert sorted_corners(found) == sorted_corners(fans[int(np.argmin(sums))])


def test_two_flips_do_not_make_the_same_edge():
    """On both sides of an octahedron, an edge could become the axis."""
    points = np.array([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], float)
    ring = np.arange(4)
    triangles = np.concatenate([np.stack([ring, (ring + 1) % 4, ring * 0 + 4], axis=1)])
    triangles = np.concatenate([triangles, np.stack([(ring + 1) % 4, ring, ring * 0 + 5], axis=1)])
    axis = np.repeat(np.linspace(-0.9, 0.9, 50), 4)[:, None] * (0.0, 0.0, 1.0)
    surface = fitting.Samples(axis, np.tile((0.0, 0.0, 1.0), (200, 1)), np.zeros(200, int), np.ones(200))
    nearest = np.where(axis[:, 2] > 0.0, 0, 4) + np.tile(ring, 50)
    found, _ = flips.flip(points, triangles, surface, nearest)
    assert (found != triangles).any()
    assert (EdgeTable.of(found).counts == 2).all()
    assert set(nearest.tolist()) == set(range(8))  # the argument stays
