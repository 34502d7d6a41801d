# SPDX-License-Identifier: GPL-3.0-or-later
"""The closest point of a surface, by all of its triangles."""

import numpy as np
import pytest

from addon.mesh.closest import Surface


@pytest.mark.parametrize("far", [0.0, 1e4])
@pytest.mark.parametrize("seed", range(3))
def test_places_a_rounding_beside_a_triangle_have_a_closest_one(seed, far):
    """In the planes of two squares that are axis-aligned, up to 1e-8 of their side outside of them."""
    rng = np.random.default_rng(seed)
    flat = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
    points = flat + rng.normal(scale=1e-9, size=flat.shape) * (1.0, 1.0, 0.0) + (far, 0.0, 0.0)
    triangles = np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)])
    places = np.tile(flat, (200, 1))
    places += rng.normal(scale=1e-8, size=places.shape) * (1.0, 1.0, 0.0) + (far, 0.0, 0.0)
    found, where, squares = Surface(points.astype(np.float32), triangles).closest(places.astype(np.float32))
    assert np.array_equal(found // 2, np.tile(np.repeat([0, 1], 4), 200))
    assert np.abs(where - places).max() <= 1e-6 * max(far, 1.0) and squares.max() <= (1e-6 * max(far, 1.0)) ** 2
