# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of open low meshes that share textures: their borders come near those of the low mesh, which samples do not hold."""

import bpy
import numpy as np
import pytest

from addon.jobs.simplify import decimation, low_meshes, shared_levels
from addon.jobs.simplify.shared_levels import LayoutSource
from addon.mesh.fitting import surface_samples
from addon.mesh.open_borders import Border
from addon.mesh.topology import EdgeTable
from tests.support import zoo

NEARER = 0.9
"""The share of the way from the border that is left at most. Measured: 0.72."""


def dish(name, around=48, rings=6):
    """A shallow bowl over the unit disk with a hole in the middle, whose UVs are seen from above."""
    radii, angles = np.linspace(0.1, 1.0, rings), np.arange(around) / around * 2.0 * np.pi
    heights = np.repeat(0.3 * radii[:, None] ** 2, around, axis=1)
    points = np.stack([np.outer(radii, np.cos(angles)), np.outer(radii, np.sin(angles)), heights], axis=-1).reshape(
        -1, 3
    )
    ring, at = np.mgrid[: rings - 1, :around].reshape(2, -1)
    first, beside = ring * around + at, ring * around + (at + 1) % around
    faces = np.concatenate(
        [np.stack([first, first + around, beside + around], axis=1), np.stack([first, beside + around, beside], axis=1)]
    )
    return zoo.build(name, points, faces, 0.5 + 0.5 * points[faces][..., :2])


def off_border(points, triangles):
    """The mean distance of open edges from the outer circle."""
    edges = EdgeTable.of(triangles)
    ends = points[edges.ends[edges.counts == 1]].astype(np.float64)
    shares = np.linspace(0.0, 1.0, 20)[:, None, None]
    radii = np.linalg.norm(((1.0 - shares) * ends[:, 0] + shares * ends[:, 1])[..., :2], axis=2)
    outer = radii.max(axis=0) > 0.5
    weights = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[outer]
    return np.average(np.abs(radii[:, outer] - 1.0).mean(axis=0), weights=weights)


def level(obj):
    points, triangles = low_meshes.arrays(obj.data)
    mesh = decimation.read_original(bpy.context, obj, "", True, with_normals=True, is_own_base=False)
    coarse, _ = LayoutSource(mesh, surface_samples(points, triangles, 5_000), 0.01)._shaped(48)
    return coarse.points, coarse.triangles


def unslid_level(obj):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shared_levels, "SHOWN", 2.0)
        return level(obj)


@pytest.mark.parametrize("make", [level, unslid_level])
def test_borders_of_levels_come_near_that_of_the_low_mesh(monkeypatch, make):
    obj = dish("dish")
    bpy.context.view_layer.update()
    near = off_border(*make(obj))
    monkeypatch.setattr(Border, "of", lambda *_: None)
    far = off_border(*make(obj))
    assert near < NEARER * far
