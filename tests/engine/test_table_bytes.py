# SPDX-License-Identifier: GPL-3.0-or-later
"""How many bytes the tables of high meshes take on the GPU."""

import bpy
import numpy as np
import pytest

from addon.core.settings import Settings
from addon.core.timings import Timings
from addon.engine.rays import tree_cache
from addon.scene import reading
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

QUADS = 128
TREE, CORNERS, NORMAL = 16, 3 * 16, 16
"""Bytes of a triangle: of the tree, of its corners; and of a normal."""
ROOM = 3 * 4096 * 16
"""Bytes: a texture has whole rows."""


def bytes_of(high, monkeypatch, most=None):
    tree_cache.trees.free()
    if most:
        monkeypatch.setattr(tree_cache, "most_in_one_part", lambda: most)
    meshes = reading.read(bpy.context, zoo.plane("low"), [high], None, Settings(method="CAST"))
    tables = tree_cache.trees.ray_scene_of(meshes.highs, Timings(), takes_parts=most is not None).tables
    found = [part.tables.bytes for part in tables.parts()] if most else [tables.bytes]
    tree_cache.trees.free()
    return sum(found), len(found)


@pytest.mark.parametrize("most", [None, 2**14])
def test_a_smooth_mesh_has_one_normal_for_each_vertex(monkeypatch, most):
    high = zoo.terrain("high", QUADS)
    high.data.shade_smooth()
    found, parts = bytes_of(high, monkeypatch, most)
    triangles, vertices = 2 * QUADS**2, (QUADS + 1) ** 2
    # Parts have the vertices on their border both.
    border = 4 * QUADS * NORMAL if most else 0
    assert parts == (triangles // most if most else 1)
    assert (
        triangles * (TREE + CORNERS) < found <= triangles * (TREE + CORNERS) + vertices * NORMAL + border + parts * ROOM
    )


def test_a_flat_mesh_has_one_normal_for_each_triangle(monkeypatch):
    high = zoo.terrain("high", QUADS)
    high.data.shade_flat()
    found, _ = bytes_of(high, monkeypatch)
    assert found <= 2 * QUADS**2 * (TREE + CORNERS + NORMAL) + ROOM


def test_normals_that_no_corners_share_take_no_more_than_three_a_triangle_seed_1(monkeypatch):
    high = zoo.terrain("high", QUADS)
    normals = np.random.default_rng(1).normal(size=(4 * QUADS**2, 3)) * 0.2 + (0.0, 0.0, 1.0)
    high.data.normals_split_custom_set(normals / np.linalg.norm(normals, axis=1, keepdims=True))
    found, _ = bytes_of(high, monkeypatch)
    assert found <= 2 * QUADS**2 * (TREE + CORNERS + 3 * NORMAL) + ROOM
