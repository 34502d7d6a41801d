# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests curvature and thickness against closed forms."""

import functools

import numpy as np
import pytest

from addon.passes import hemisphere
from tests.support import lanes, oracle
from tests.support.hemisphere import COUNT, Probes, flipped, polygon, rectangle, tables

pytestmark = pytest.mark.usefixtures("gpu_context")

CURVATURE = 0.02
"""The largest relative error of the mean curvature of a sphere at 128 rays, of 95 % of the texels."""
MEAN = 0.001
"""The same of the mean of all texels."""
ROUNDING = 1e-4
"""On a plane that single precision rounds."""
EDGE = 0.002
"""The largest mean error at an edge: the points are a little away from it."""
THICKNESS = 0.01
"""The largest relative error of the mean thickness."""
RMS = 2.5 / 255
"""The largest root mean square error of a texel at 128 rays."""
UP = np.array((0.0, 0.0, 1.0))
SLAB = 0.05
"""The thickness of a plate."""


@functools.cache
def sphere(level=5):
    """The triangles of a fine unit sphere."""
    return oracle.icosphere(level)


def on_sphere(rng):
    points = rng.normal(size=(COUNT, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.mark.parametrize("is_hollow", [False, True])
@pytest.mark.parametrize("rho", lanes.slow_but([0.5], [0.1, 0.5, 1.0]))
def test_curvature_of_spheres_with_balls_of_several_sizes_seed_1(rho, is_hollow):
    """A ball of radius R around a point on a sphere of radius rho is inside it by 1/2 - 3 R / (16 rho)."""
    triangles = sphere(5 if is_hollow else 6) * rho  # finer than the smallest ball
    points, side = on_sphere(np.random.default_rng(1)), -1.0 if is_hollow else 1.0
    probes = Probes(tables(flipped(triangles) if is_hollow else triangles), points * rho, points * side)
    for share in (0.5,) if is_hollow else (0.1, 0.5, 1.8):
        ball = share * rho
        mean_curvature = (probes.curvature(radius=ball) - 0.5) * hemisphere.mean_curvature_scale(ball) * side
        error = mean_curvature * rho - 1.0
        print(f"R = {share} rho: mean {error.mean():+.4f}, RMS {error.std():.4f}")
        assert abs(error.mean()) < MEAN
        assert np.percentile(np.abs(error), 95) < CURVATURE


def test_a_plane_of_many_triangles_is_flat_exactly_seed_2():
    rng = np.random.default_rng(2)
    quads = [rectangle((x, y, 0.0), (0.05, 0, 0), (0, 0.05, 0)) for x in grid(20) for y in grid(20)]
    triangles = np.concatenate([polygon(quad) for quad in quads])
    at = np.c_[rng.uniform(-0.9, 0.9, (COUNT, 2)), np.zeros(COUNT)]
    at[: COUNT // 2, 0] = np.round(at[: COUNT // 2, 0] * 10.0) / 10.0  # on edges
    probes = Probes(tables(triangles), at, UP)
    assert (probes.curvature(radius=0.2) == 0.5).all()
    assert (probes.curvature(radius=0.2, value=hemisphere.CONVEXITY) == 0.0).all()
    assert (probes.curvature(radius=0.2, value=hemisphere.CAVITY) == 0.0).all()
    matrix = oracle.rotation(rng)
    turned = Probes(tables(triangles @ matrix.T), at @ matrix.T, matrix @ UP).curvature(radius=0.2)
    np.testing.assert_allclose(turned, 0.5, atol=ROUNDING)


def grid(n):
    return (np.arange(n) + 0.5) * 2.0 / n - 1.0


def edge(rng, is_convex):
    """Points next to an edge of 90 degrees between two squares, where the box or the corner is turned at random."""
    squares = [rectangle((0.5, 0.0, 0.0), (0.5, 0, 0), (0, 1.0, 0)), rectangle((0, 0, -0.5), (0, 0, 0.5), (0, 1.0, 0))]
    triangles = np.concatenate([*map(polygon, squares)])
    points = np.c_[np.full(COUNT, 1e-5), rng.uniform(-0.5, 0.5, COUNT), np.zeros(COUNT)]
    matrix, up = oracle.rotation(rng), UP
    if not is_convex:
        triangles, up = flipped(triangles), -UP
    return Probes(tables(triangles @ matrix.T), points @ matrix.T, matrix @ up)


@pytest.mark.parametrize("is_convex", [True, False])
def test_an_edge_of_90_degrees_is_1_if_convex_and_0_if_concave_seed_3(is_convex):
    probes = edge(np.random.default_rng(3), is_convex)
    values, convexity, cavity = (
        probes.curvature(radius=0.3, value=value)
        for value in (hemisphere.CURVATURE, hemisphere.CONVEXITY, hemisphere.CAVITY)
    )
    truth = 1.0 if is_convex else 0.0
    assert abs(values.mean() - truth) < EDGE
    assert np.sqrt(((values - truth) ** 2).mean()) < RMS
    np.testing.assert_allclose(convexity, np.maximum(0.0, 2.0 * values - 1.0), atol=1e-6)
    np.testing.assert_allclose(cavity, np.maximum(0.0, 1.0 - 2.0 * values), atol=1e-6)


def on_slab(rng):
    """Probes on one side of a plate that is SLAB thick, at a random angle."""
    slab = [rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0)), rectangle((0, 0, -SLAB), (0, 1, 0), (1, 0, 0))]
    matrix = oracle.rotation(rng)
    points = np.c_[rng.uniform(-0.3, 0.3, (COUNT, 2)), np.zeros(COUNT)]
    return Probes(tables(np.concatenate([*map(polygon, slab)]) @ matrix.T), points @ matrix.T, matrix @ UP)


@pytest.mark.parametrize("radius", [0.04, 0.06, 0.1, 0.4])
def test_a_plate_that_is_thinner_than_the_radius_is_convex_seed_7(radius):
    """With the ratio x of its thickness to the radius, the inner half of the ball holds 3/2 x - x^3 / 2 of it."""
    found, x = on_slab(np.random.default_rng(7)).curvature(radius=radius), min(1.0, SLAB / radius)
    truth = 1.5 - 1.5 * x + 0.5 * x**3
    assert abs(found.mean() - truth) < EDGE
    assert np.sqrt(((found - truth) ** 2).mean()) < RMS


@pytest.mark.parametrize("farthest", [0.06, 0.1, 0.4])
def test_thickness_of_a_slab_seed_4(farthest):
    """With the ratio x of the slab's thickness to the limit, 2 x - x^2."""
    found, x = on_slab(np.random.default_rng(4)).thickness(farthest=farthest), SLAB / farthest
    check_thickness(found, 2.0 * x - x * x)


@pytest.mark.parametrize("inner", [0.5, 0.8, 0.95])
@pytest.mark.parametrize("farthest", lanes.slow_but([0.5], [0.1, 0.5, 2.5]))
def test_thickness_of_shells_seed_5(inner, farthest):
    """Rays leave the shell into its hollow, or beside it."""
    points = on_sphere(np.random.default_rng(5))
    triangles = np.concatenate([sphere(), flipped(sphere()) * inner])
    found = Probes(tables(triangles, np.concatenate([sphere()] * 2)), points, points).thickness(farthest=farthest)
    sine = np.sqrt((np.arange(100_000) + 0.5) / 100_000)  # the cosine's distribution
    cosine = np.sqrt(1.0 - sine**2)
    leaves = np.where(sine < inner, cosine - np.sqrt(np.maximum(inner**2 - sine**2, 0.0)), 2.0 * cosine)
    check_thickness(found, np.minimum(leaves / farthest, 1.0).mean())


def check_thickness(found, truth):
    print(f"{truth:.4f}: mean {found.mean() / truth - 1.0:+.4%}, RMS {(found - truth).std() * 255:.2f}/255")
    assert abs(found.mean() / truth - 1.0) < THICKNESS
    assert np.sqrt(((found - truth) ** 2).mean()) < RMS


def test_nothing_behind_is_thick_and_rays_that_start_outwards_are_thin_seed_6():
    """Normals that lean by 60 degrees: a quarter of the rays, weighted by the cosine, starts on the outer side."""
    rng = np.random.default_rng(6)
    plane = polygon(rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    points = np.c_[rng.uniform(-0.5, 0.5, (COUNT, 2)), np.zeros(COUNT)]
    assert (Probes(tables(plane), points, UP).thickness(farthest=0.5) == 1.0).all()
    leaning = np.broadcast_to((np.sqrt(0.75), 0.0, 0.5), plane.shape)
    found = Probes(tables(plane, leaning), points, UP).thickness(farthest=0.5)
    check_thickness(found, 0.75)
