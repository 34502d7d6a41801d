# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests attributes at hits against float64 numpy."""

import numpy as np
import pytest

from addon.core.material_feeds import LUMINANCE, LUMINANCE_WEIGHTS, AttributeFeed, Limits
from addon.passes import surface_tables, surface_values
from tests.support.seen_surface import SeenSurface, grid

pytestmark = pytest.mark.usefixtures("gpu_context")

EXACT = 1e-5


def shown(seen, values, feed, materials):
    seen.begin(materials)
    table = surface_tables.upload_values(np.asarray(values, np.float32), seen.corners)
    surface_values.add_attribute(seen.sums, seen.hits, table, feed, 1, labels=seen.labels, materials=materials)
    return seen.read()


def test_attributes_are_interpolated_in_each_triangle_seed_1():
    """Values that jump at each edge: an attribute of any domain, by corner."""
    rng = np.random.default_rng(1)
    triangles = grid(4, 5)
    values = rng.random((len(triangles), 3, 4))
    seen = SeenSurface(triangles, (64, 64))
    sums = shown(seen, values.reshape(-1, 4), AttributeFeed("a"), surface_tables.upload_materials(np.ones(2)))
    points = np.stack([seen.x, seen.y], axis=-1).reshape(-1, 1, 2).astype(float)
    a, b, c = (triangles[None, :, i, :2] for i in range(3))

    def area(p, q, r):
        return (q - p)[..., 0] * (r - p)[..., 1] - (q - p)[..., 1] * (r - p)[..., 0]

    weights = np.stack([area(b, c, points), area(c, a, points), area(a, b, points)], -1) / area(a, b, c)[..., None]
    inside = weights.min(axis=-1)
    found = inside.argmax(axis=1)
    clear = inside.max(axis=1) > 1e-4  # a texel on an edge may show either triangle
    picked = np.arange(len(found))
    truth = np.einsum("nk,nkc->nc", weights[picked, found], values[found])
    assert clear.mean() > 0.9
    assert np.abs(sums.reshape(-1, 4)[clear, :3] - truth[clear, :3]).max() < EXACT
    assert (sums[..., 3] == 1.0).all()


@pytest.mark.parametrize(
    ("value", "channel", "expected"),
    [
        ((0.25,), None, (0.25, 0.25, 0.25)),
        ((0.25, 0.5), None, (0.25, 0.5, 0.0)),
        ((0.25, 0.5, 0.75), 1, (0.5, 0.5, 0.5)),
        ((0.25, 0.5, 0.75), 3, (1.0, 1.0, 1.0)),
        ((0.25, 0.5, 0.75, 0.1), 3, (0.1, 0.1, 0.1)),
        ((1.0, 0.0, 0.0), LUMINANCE, (0.212639, 0.212639, 0.212639)),
    ],
)
def test_attributes_have_one_to_four_channels(value, channel, expected):
    triangles = grid(1, 1)
    seen = SeenSurface(triangles, (8, 8))
    feed = AttributeFeed("a", channel, (2.0, 2.0, 2.0), (0.5, 0.0, 0.0))
    sums = shown(seen, np.broadcast_to(value, (6, len(value))), feed, surface_tables.upload_materials(np.ones(2)))
    assert np.allclose(sums[..., :3], np.array(expected) * 2.0 + (0.5, 0.0, 0.0))


def test_limits_count_at_the_hit_before_scale_and_offset_seed_2():
    """What is interpolated is limited, and not the corners."""
    values = np.random.default_rng(2).uniform(-2.0, 3.0, (6, 3))
    limits = Limits((0.2, 0.0, -1.0), (0.9, 1.0, 5.0))
    triangles = grid(1, 1)
    seen = SeenSurface(triangles, (32, 32))
    free, limited = (
        shown(seen, values, AttributeFeed("a", limits=found), surface_tables.upload_materials(np.ones(2)))[..., :3]
        for found in (Limits(), limits)
    )
    assert free.min() < -1.0
    assert np.array_equal(limited, free.clip(np.float32(limits.low), np.float32(limits.high)))
    luminance = AttributeFeed("a", LUMINANCE, limits=Limits(least=0.0, most=1.0))
    found = shown(seen, values, luminance, surface_tables.upload_materials(np.ones(2)))[..., 0]
    assert np.abs(found - free.clip(0.0, 1.0) @ np.array(LUMINANCE_WEIGHTS)).max() < EXACT


def test_only_materials_of_the_feed_show_the_attribute():
    triangles = grid(2, 2)
    seen = SeenSurface(triangles, (8, 8), materials=1 + (triangles.mean(axis=1)[:, 0] > 0.5))
    sums = shown(seen, np.ones((24, 3)), AttributeFeed("a"), surface_tables.upload_materials(np.array([0, 1, 2])))
    assert (sums[:, :4] == 1.0).all()
    assert (sums[:, 4:] == 0.0).all()
