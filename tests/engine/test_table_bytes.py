# SPDX-License-Identifier: GPL-3.0-or-later
"""How many bytes the tables of high meshes take on the GPU."""

import bpy
import numpy as np
import pytest

from addon.core.progress import Timings
from addon.core.settings import Settings
from addon.engine import tree_cache
from addon.mesh import bvh
from addon.passes import data_texture
from addon.scene import reading
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

QUADS = 128
TRIANGLES, VERTICES = 2 * QUADS**2, (QUADS + 1) ** 2
TEXEL = 16
"""Bytes: each triangle has one for its numbers, each vertex one for its place, and each normal one."""
ROW = 4096 * TEXEL
"""Bytes: a texture has whole rows."""


def bytes_of(high):
    """The bytes of the tables, without those of the tree."""
    tree_cache.trees.free()
    meshes = reading.read(bpy.context, zoo.plane("low"), [high], None, Settings(method="CAST"))
    tables = tree_cache.trees.ray_scene_of(meshes.highs, Timings()).tables
    found = tables.bytes - data_texture.size_of(tables.tree.nodes)
    tree_cache.trees.free()
    return found


def test_a_tree_takes_16_bytes_a_triangle_where_it_is_full():
    tree = bvh.build(np.zeros((3, 3), np.float32), np.tile(np.arange(3), (4**7, 1)))
    assert tree.nodes.nbytes <= 16 * 4**7


def test_a_smooth_mesh_takes_48_bytes_a_triangle_with_its_tree():
    high = zoo.terrain("high", QUADS)
    high.data.shade_smooth()
    found = bytes_of(high)
    assert found <= TRIANGLES * TEXEL + 2 * VERTICES * TEXEL + 3 * ROW
    assert 2 * VERTICES < TRIANGLES * 1.02  # 32 bytes and a border, beside the tree


def test_a_flat_mesh_has_one_normal_for_each_triangle():
    high = zoo.terrain("high", QUADS)
    high.data.shade_flat()
    assert bytes_of(high) <= (2 * TRIANGLES + VERTICES) * TEXEL + 3 * ROW


def test_normals_that_no_corners_share_take_no_more_than_three_a_triangle_seed_1():
    high = zoo.terrain("high", QUADS)
    normals = np.random.default_rng(1).normal(size=(4 * QUADS**2, 3)) * 0.2 + (0.0, 0.0, 1.0)
    high.data.normals_split_custom_set(normals / np.linalg.norm(normals, axis=1, keepdims=True))
    assert bytes_of(high) <= (4 * TRIANGLES + 2 * VERTICES) * TEXEL + 3 * ROW
