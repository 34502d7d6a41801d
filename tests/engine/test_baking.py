# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the engine's door: arrays in, maps out, without objects of Blender."""

import math

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.progress import finish
from addon.core.settings import Run, Settings
from addon.engine.baking import bake
from addon.mesh.inputs import Meshes
from addon.mesh.triangle_mesh import Mesh

FLAT = np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
ANGLE = 0.3

pytestmark = pytest.mark.usefixtures("gpu_context")


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_a_tilted_plane(method):
    tilted = FLAT + FLAT[:, 1:2] * (0.0, 0.0, math.tan(ANGLE))
    uv = (FLAT[:, :2] + 1) / 2
    meshes = Meshes.of(Mesh.of_arrays("low", FLAT, TRIANGLES, uv), [Mesh.of_arrays("high", tilted, TRIANGLES, uv)])
    before = len(bpy.data.meshes), len(bpy.data.images)
    settings = Settings(method=method, space="WORLD", width=32, height=32, maps=("HEIGHT",))
    maps = finish(bake(meshes, Run(settings)))[1001]
    texels, state = maps["NORMAL"]
    assert state.all()
    assert np.abs(texels[..., :3] - (0.5, 0.5 - 0.5 * math.sin(ANGLE), 0.5 + 0.5 * math.cos(ANGLE))).max() < 1e-3
    rows = (np.arange(32) + 0.5) / 16 - 1
    assert np.abs(maps["HEIGHT"][0][..., 0] - rows[:, None] * math.tan(ANGLE)).max() < 1e-3
    assert (len(bpy.data.meshes), len(bpy.data.images)) == before


def test_meshes_that_share_no_texel_are_named():
    uv = (FLAT[:, :2] + 1) / 2
    meshes = Meshes.of(Mesh.of_arrays("low", FLAT, TRIANGLES, uv), [Mesh.of_arrays("high", FLAT, TRIANGLES, uv + 2)])
    with pytest.raises(BakeError, match="'high'"):
        finish(bake(meshes, Run(Settings(method="FLATTEN", space="WORLD", width=8, height=8))))
