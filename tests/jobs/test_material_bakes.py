# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole bakes of the colors of high meshes, against Cycles' emission bake of the same nodes."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core import map_types
from addon.core.material_feeds import HighMaterial
from addon.core.settings import Settings
from addon.jobs import bake
from tests.support import feeds, scenes
from tests.support.maps import bake_all_maps
from tests.support.shader_nodes import add, image, principled

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 64
TOLERANCE = 2 / 255
UV = ((0.03, 0.02), (1.2, -0.3), (1.4, 1.1), (0.13, 1.02))


def low_square():
    data = bpy.data.meshes.new("low")
    data.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [], [(0, 1, 2, 3)])
    data.uv_layers.new(name="UVMap").uv.foreach_set("vector", np.array([0, 0, 1, 0, 1, 1, 0, 1], np.float32))
    return scenes.link(bpy.data.objects.new("low", data))


def baked(high, name):
    """The texels of a map of `high`, on a square that covers it."""
    bpy.context.view_layer.update()
    report, maps = bake_all_maps(
        low_square(), high, maps=(name,), size=SIZE, method="CAST", extrusion=0.1, max_distance=0.5
    )
    return report, maps[name.lower()]


@pytest.mark.parametrize("alpha_is_used", [True, False])
@pytest.mark.parametrize("has_alpha", [True, False])
@pytest.mark.parametrize("space", ["sRGB", "Non-Color", "Display P3"])
def test_base_color(space, has_alpha, alpha_is_used):
    material = bpy.data.materials.new("Rust")
    found = image(size=(9, 7), space=space)
    pixels = np.random.default_rng(5).uniform(0.5 if has_alpha else 1.0, 1.0, (63, 4)).astype(np.float32)
    pixels[:, :3] = np.random.default_rng(6).uniform(0.0, 1.0, (63, 3))
    if not has_alpha:
        pixels[:, 3] = 1.0
    found.pixels.foreach_set(pixels.ravel())
    mapping = add(material, "Mapping", {"Vector": add(material, "UVMap", uv_map="UVMap").outputs[0]})
    mapping.inputs["Rotation"].default_value = (0.0, 0.0, 0.6)
    node = add(material, "TexImage", {"Vector": mapping.outputs[0]}, image=found, interpolation="Closest")
    if alpha_is_used:
        material.node_tree.links.new(node.outputs["Alpha"], principled(material).inputs["Alpha"])
    scaled = add(material, "MixRGB", {"Fac": 1.0, "Color1": node.outputs[0]}, blend_type="MULTIPLY")
    scaled.inputs["Color2"].default_value = (0.9, 0.7, 1.0, 1.0)
    material.node_tree.links.new(scaled.outputs[0], principled(material).inputs["Base Color"])
    high = feeds.square(material, UV)
    report, mine = baked(high, "BASE_COLOR")
    theirs = feeds.cycles(high, scaled.outputs[0], SIZE)
    wrong = np.abs(mine[..., :3] - theirs).max(axis=-1) > TOLERANCE * (2 if has_alpha else 1)
    assert wrong.mean() < 0.06  # borders of pixels, which Imprint smooths
    assert not [note for note in report.warnings if "Rust" in note]


def test_notes_have_the_order_of_the_maps():
    chosen = [map_type for map_type in map_types.OTHERS if map_type.socket]
    sockets = list(dict.fromkeys(map_type.socket for map_type in chosen))  # two maps are of the same roughness
    notes = {socket: (f"{socket} is left out",) for socket in reversed(sockets)} | {
        "": ("shader",),
        "Normal": ("detail",),
    }
    meshes = SimpleNamespace(materials=[HighMaterial("Rust", notes=notes)])
    names = tuple(map_type.name for map_type in chosen)
    found = bake.material_notes(meshes, Settings(maps=names).map)
    assert found == [*(f"{socket} is left out" for socket in sockets), "shader", "detail"]
    widened = bake.material_notes(meshes, Settings(maps=(map_types.WIDENED_ROUGHNESS.name,)).map)
    assert widened[0] == "Roughness is left out"
    assert bake.material_notes(meshes, Settings(detail_maps=False).map) == []
