# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the engine's door: arrays in, maps out, without objects of Blender."""

import math

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.progress import Pace, finish
from addon.core.settings import Run, Settings
from addon.engine.baking import bake
from addon.mesh.inputs import Meshes
from addon.mesh.triangle_mesh import Mesh
from addon.passes import allocation, target

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


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_the_pictures_of_a_bake_begin_with_nothing(monkeypatch, method):
    """Vulkan and Metal do not clear new memory, and the last bake's picture may be in it."""
    made = allocation.texture

    def poisoned(size, texel, *values):
        found = made(size, texel, *values)
        if texel == "RGBA16F":
            found.clear(format="FLOAT", value=(math.nan,) * 4)
        return found

    monkeypatch.setattr(allocation, "texture", poisoned)
    half = (FLAT[:, :2] + 1) / 4
    meshes = Meshes.of(Mesh.of_arrays("low", FLAT, TRIANGLES, half), [Mesh.of_arrays("high", FLAT, TRIANGLES, half)])
    settings = Settings(method=method, space="WORLD", width=32, height=32, extrusion=0.1, max_distance=0.2)
    shown = []
    with target.using(target.TargetPool()):
        for step in bake(meshes, Run(settings, Pace(0.0))):
            if step.picture is not None:
                shown.append(np.array(step.picture.read().to_list(), np.float32).reshape(32, 32, 4))
    assert shown
    assert all((texels[16:] == 0.0).all() and (texels[:, 16:] == 0.0).all() for texels in shown)
    assert (shown[-1][:16, :16, 3] == 1.0).all()
