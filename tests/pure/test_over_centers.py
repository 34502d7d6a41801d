# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests which triangles reach the center of a texel."""

import numpy as np
import pytest

from addon.core import udim
from addon.mesh import uv_layout
from addon.mesh.triangle_mesh import Mesh

SIZE = 24, 16


def mesh(corners):
    """Triangles (T, 3, 2) in UV space."""
    uv = np.asarray(corners, np.float32).reshape(-1, 2)
    numbers = np.arange(len(uv), dtype=np.int32)
    flat = np.zeros((len(uv), 3), np.float32)
    return Mesh("m", flat, numbers, flat, numbers.reshape(-1, 3), np.eye(4), uv=uv)


def box(x, y, width, height, size=SIZE):
    """A triangle whose box begins at the texel coordinates x and y."""
    return np.array([(x, y), (x + width, y), (x, y + height)]) / size


def over(*corners, uv_to_clip=None, **options):
    return uv_layout.over_centers(mesh(corners), uv_to_clip or udim.uv_to_clip(), SIZE, **options).tolist()


@pytest.mark.parametrize("axis", [0, 1])
def test_only_a_triangle_beside_all_centers_is_left_out(axis):
    def at(start, extent):
        return box(*((start, 2.0) if axis == 0 else (2.0, start)), *((extent, 1.0) if axis == 0 else (1.0, extent)))

    beside, around, touching = at(3.6, 0.8), at(3.6, 1.0), at(3.6, 0.9)
    assert over(beside, around, beside, touching) == [1, 3]


@pytest.mark.parametrize("start", [3.5, 3.5 + 0.9 / 32, 4.5 - 0.5 - 0.9 / 32])
def test_what_rounding_may_move_onto_a_center_stays(start):
    assert over(box(start, 2.0, 0.5, 1.0)) == [0]


def test_triangles_outside_the_texels_are_left_out():
    inside, left, above = box(0.2, 0.2, 1, 1), box(-5, 2, 4, 1), box(2, 17, 1, 4)
    assert over(left, inside, above) == [1]
    shifted = udim.uv_to_clip(1001, SIZE, (0, 8), (SIZE[0], SIZE[1]))
    assert over(inside, box(0.2, 9.2, 1, 1), uv_to_clip=shifted) == [1]
    assert over(inside + (1.0, 0.0), uv_to_clip=udim.uv_to_clip(1002)) == [0]


def test_a_part_has_the_numbers_of_the_whole():
    small, large = box(3.6, 2, 0.5, 1), box(3, 2, 2, 2)
    assert over(large, small, large, large, part=slice(1, 3)) == [2]


def test_values_that_are_not_finite_are_left_out():
    assert over(box(2, 2, 3, 3), box(2, np.nan, 3, 3), box(np.inf, 2, 3, 3)) == [0]


@pytest.mark.parametrize("seed", range(4))
def test_random_triangles_over_a_center_stay(seed):
    random = np.random.default_rng(seed)
    corners = random.uniform(-0.1, 1.1, (4000, 1, 2)) + random.normal(0, 0.03, (4000, 3, 2))
    offset = random.uniform(-0.5, 0.5, 2)
    uv_to_clip = udim.uv_to_clip(1001, SIZE, offset, SIZE)
    kept = uv_layout.over_centers(mesh(corners), uv_to_clip, SIZE)
    x, y = np.meshgrid(*(np.arange(size) + 0.5 for size in SIZE))
    centers = np.stack([x.ravel(), y.ravel()], axis=1) + offset
    a, b, c = (np.asarray(corners, np.float32).astype(np.float64) * SIZE).transpose(1, 0, 2)[:, :, None]
    sides = [_cross(end - start, centers - start) for start, end in ((a, b), (b, c), (c, a))]
    covers = (np.all([side >= 0 for side in sides], axis=0) | np.all([side <= 0 for side in sides], axis=0)).any(axis=1)
    assert 0.1 < covers.mean() < 0.8
    assert np.isin(np.flatnonzero(covers), kept).all()
    assert len(kept) < 0.9 * len(corners)


def _cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
