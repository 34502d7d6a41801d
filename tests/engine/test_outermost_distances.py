# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that the outermost hit is the outermost surface that belongs to the low mesh, without set distances."""

import numpy as np
import pytest

from tests.support import maps, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 32
HIGHEST = 0.17
"""6 % of the diagonal of the plane."""
WRONG = 0.005
"""Share of the texels that may show another leaf: those above which the highest of many ends. Nearly all did."""
SAME = 1e-3
"""Heights of one leaf. Two leaves over a texel differ by more, nearly everywhere."""
FAR = 1.5
"""The distance between two walls that face each other."""


def leaves(seed, count, half, heights):
    """Squares over a plane at random places, each at one of `heights`. Returns the object and its corners (count, 4, 3)."""
    rng = np.random.default_rng(seed)
    z = heights(rng, count)
    centers = np.c_[rng.uniform(-1.0, 1.0, (count, 2)), z]
    corners = centers[:, None] + half * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    base = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
    every = np.concatenate([base[None], corners])
    return zoo.build("high", every.reshape(-1, 3), np.arange(4 * len(every)).reshape(-1, 4), smooth=False), corners


def highest(corners):
    """The height (SIZE, SIZE) of what lies highest over each texel of the plane -1..1."""
    places = 2.0 * maps.texel_uv(SIZE, SIZE)[:, :, None] - 1.0
    is_above = (places > corners[:, 0, :2]).all(axis=-1) & (places < corners[:, 2, :2]).all(axis=-1)
    return np.where(is_above, corners[:, 0, 2], 0.0).max(axis=-1)


FOLIAGE = {
    "leaves": (300, 0.25, lambda rng, count: rng.uniform(0.01, HIGHEST, count)),
    "few leaves": (12, 0.2, lambda rng, count: rng.uniform(0.01, HIGHEST, count)),
    "two storeys": (150, 0.2, lambda rng, count: np.where(np.arange(count) % 2, 0.005, HIGHEST)),
}


@pytest.mark.parametrize("name", FOLIAGE)
def test_the_outermost_hit_is_the_highest_of_many_leaves(name):
    high, corners = leaves(1, *FOLIAGE[name])
    values = {"method": "CAST", "hit": "OUTERMOST", "keep_faces": True, "space": "OBJECT"}
    report, found = maps.bake_all_maps(zoo.plane("low"), high, maps=["POSITION"], size=SIZE, **values)
    wrong = np.abs(found["position"][..., 2] - highest(corners)) > SAME
    print(f"{name}: {wrong.mean():.2%} show another leaf, extrusion {report.distances['extrusion']:.3f}")
    assert wrong.mean() <= WRONG
    assert report.distances["extrusion"] < 2.0 * HIGHEST


def test_another_wall_is_not_what_is_outermost():
    """The walls face each other: a ray from beyond the other one meets its front or back first."""
    points = np.array([(0, -1, -1), (0, 1, -1), (0, 1, 1), (0, -1, 1)], float)
    other = points[::-1] + (FAR, 0.0, 0.0)
    uv = np.array([[(0, 0), (0.4, 0), (0.4, 1), (0, 1)], [(0.6, 0), (1, 0), (1, 1), (0.6, 1)]])
    faces = np.arange(8).reshape(2, 4)
    low = zoo.build("low", np.concatenate([points, other]), faces, uv)
    high = zoo.build("high", np.concatenate([points + (0.02, 0, 0), other - (0.02, 0, 0)]), faces)
    values = {"method": "CAST", "hit": "OUTERMOST", "space": "OBJECT"}
    report, found = maps.bake_all_maps(low, high, maps=["POSITION"], size=SIZE, **values)
    assert report.distances["extrusion"] < 0.1
    covered = found["position"][..., 3] > 0.0
    x = found["position"][..., 0][covered]
    assert np.minimum(np.abs(x - 0.02), np.abs(x - FAR + 0.02)).max() < SAME
