# SPDX-License-Identifier: GPL-3.0-or-later
"""No texel is wrong: at the center of each one, a reader decodes the normal that the object-space map of the same pair has."""

import bpy
import numpy as np
import pytest

from tests.engine.test_blender_readers import PAIRS, triangulated
from tests.support import angles, decoders, raster, zoo
from tests.support.covering import covering
from tests.support.maps import bake

pytestmark = pytest.mark.usefixtures("gpu_context")

ROUNDING = 1.0 / 128.0
"""In texels. Rasterizers round corners to 1/256 of a texel, and so decide on which side of an edge a closer center is. Mostly
this changes nothing, but at a fold of the UVs, two triangles that are not neighbors share the texel."""
EXACT = 0.001
"""Degrees, in the worst texel."""
EXACT_FOLDED = 0.2
"""Degrees, in the worst texel of a real mesh: single precision counts where low normals point behind their faces."""
BASIS = "CYCLES"


def most_off(low, high, size, **settings):
    """The most degrees by which a texel is off, if it is read by the last triangle over its center, or, where this is a matter
    of rounding, by the best one. And how many texels these are: all, those of several triangles, those of rounding."""
    size = size, size
    normals, objects = (
        bake(low, high, size=size, image=space, space=space, basis=BASIS, **settings).reshape(-1, 4)
        for space in ("TANGENT", "OBJECT")
    )
    mesh = raster.corners(low)
    over = covering(mesh.uv, size, ROUNDING)
    is_written = (normals[over.texel, 3] > 0.0) & (objects[over.texel, 3] > 0.0)
    assert not ((over.inside >= ROUNDING) & (objects[over.texel, 3] > 0.0) & ~is_written).any()
    vectors = mesh.normal, mesh.tangent, decoders.bitangents(mesh.normal, mesh.tangent)
    shown = decoders.decoded(normals[over.texel, :3] * 2.0 - 1.0, BASIS, *map(over.between, vectors))
    off = angles.degrees(raster.unit(shown), raster.unit(objects[over.texel, :3] * 2.0 - 1.0))
    texels, number = np.unique(over.texel[is_written], return_inverse=True)
    off, triangle, inside = off[is_written], over.triangle[is_written], over.inside[is_written]
    best, last, rounded = np.full(len(texels), np.inf), np.zeros(len(texels), int), np.zeros(len(texels), bool)
    np.minimum.at(best, number, off)
    np.maximum.at(last, number, triangle)
    np.logical_or.at(rounded, number, np.abs(inside) < ROUNDING)
    by_last = np.zeros(len(texels))
    is_last = triangle == last[number]
    by_last[number[is_last]] = off[is_last]
    several = np.bincount(number) > 1
    counts = len(texels), np.count_nonzero(several & ~rounded), np.count_nonzero(several & rounded)
    return np.where(rounded, best, by_last).max(), counts


def folded(size):
    """A wavy sheet whose UVs are folded twice along u: from there, three layers share texels. The first fold is by 1/2000 of a
    texel on one side of the centers of a column of texels, the second one on the other."""
    low = triangulated(zoo.terrain("low", n=8, height=0.3))
    layer = low.data.uv_layers[0].uv
    values = np.empty((len(layer), 2), np.float32)
    layer.foreach_get("vector", values.reshape(-1))
    columns = np.linspace(0.05, 0.95, 9)
    columns[4:6] = (0.7 * size // 1 + 0.5 - 0.0005) / size, (0.4 * size // 1 + 0.5 + 0.0005) / size
    values[:, 0] = columns[np.round(values[:, 0] * 8).astype(int)]
    layer.foreach_set("vector", values.reshape(-1))
    return low


@pytest.mark.parametrize("size", [64, 256])
def test_each_texel_of_folded_uvs_has_the_normal_and_the_tangents_of_one_triangle(size):
    low, high = folded(size), zoo.terrain("high", n=64, height=0.35)
    off, (_, several, rounded) = most_off(low, high, size, method="CAST")
    assert several > size * size / 8
    assert rounded > size
    assert off < EXACT


@pytest.mark.slow
@pytest.mark.shared
@pytest.mark.parametrize("method", ["AUTO", "CAST"])
@pytest.mark.parametrize("name", PAIRS)
def test_each_texel_of_a_real_pair_is_right(shared_assets, name, method):
    bpy.ops.wm.open_mainfile(filepath=str(shared_assets / "pairs" / f"{name}.blend"))
    low, high = triangulated(bpy.data.objects["lo"]), bpy.data.objects["hi"]
    off, counts = most_off(low, high, 1024, method=method)
    print(name, method, round(off, 4), counts)
    assert off < EXACT_FOLDED
