# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests curvature and thickness against closed forms."""

import numpy as np
import pytest

from addon.passes.hemisphere import curvature, thickness
from tests.support import oracle
from tests.support.hemisphere import COUNT, Probes, flipped, polygon, rectangle, tables

pytestmark = pytest.mark.usefixtures("gpu_context")

CURVATURE = 0.02
"""The largest relative error of the mean curvature at 128 rays: of the median texel, and of the mean."""
THICKNESS = 0.01
"""The largest relative error of the mean thickness."""
UP = np.array((0.0, 0.0, 1.0))


def sphere(level=6):
    """A fine unit sphere and COUNT random points on it."""
    return oracle.icosphere(level)


def on_sphere(rng):
    points = rng.normal(size=(COUNT, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.mark.parametrize("is_hollow", [False, True])
@pytest.mark.parametrize("rho", [0.1, 0.25, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("share", [0.1, 0.2, 0.5, 1.0, 1.8])
def test_curvature_of_spheres_of_five_radii_and_balls_of_five_sizes_seed_1(rho, share, is_hollow):
    """A ball of radius R around a point on a sphere of radius rho is inside it by 1/2 - 3 R / (16 rho)."""
    rng = np.random.default_rng(1)
    ball, points = share * rho, on_sphere(rng)
    triangles = sphere() * rho
    probes = Probes(
        tables(flipped(triangles) if is_hollow else triangles), points * rho, -points if is_hollow else points
    )
    found = probes.measured(curvature, radius=ball)
    mean_curvature = (found - 0.5) * curvature.mean_curvature_scale(ball) * (-1.0 if is_hollow else 1.0)
    print(f"H rho: mean {mean_curvature.mean() * rho:.4f}, RMS {(mean_curvature * rho).std():.4f}")
    assert abs(mean_curvature.mean() * rho - 1.0) < CURVATURE
    assert abs(np.median(mean_curvature) * rho - 1.0) < CURVATURE
