# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks what an older Blender has in other ways than 5.2: no GPU in the background, Normal Map nodes, materials without nodes.

test_same_versions.py starts this in each version, from the root of the checkout.
"""

import os
import sys
from pathlib import Path

import bpy
import numpy as np

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import bake_pair
from tests.support import maps

FOLDER = Path(sys.argv[1])
COLOR = (0.8, 0.1, 0.2, 1.0)
SAME = 1e-3
"""The most by which two renders of the same normals may differ, in channels from 0 to 1."""


def pair():
    """A flat low plane and a tilted high one, in an empty file with a camera above and a light at the side."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.mesh.primitive_plane_add(rotation=(0.5, 0.3, 0.0))
    high = bpy.context.object
    bpy.ops.mesh.primitive_plane_add()
    low = bpy.context.object
    bpy.ops.object.light_add(type="SUN", rotation=(0.9, 0.0, 0.4))
    bpy.ops.object.camera_add(location=(0.0, 0.0, 3.0))
    bpy.context.scene.camera = bpy.context.object
    high.hide_render = True
    return low, high


def bake(low, high, **values):
    settings = {"method": "FLATTEN", "width": 16, "height": 16, "storage": "MEMORY", "depth": 32, "image": "map"}
    return bake_pair(bpy.context, low, [high], Settings(**{**settings, **values}))


def render():
    """The pixels of a render by Cycles."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.seed = "CYCLES", 4, 1
    scene.render.resolution_x = scene.render.resolution_y = 16
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.filepath = str(FOLDER / "render.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    found = maps.pixels(image)
    bpy.data.images.remove(image)
    return found


def green_that_points_down_renders_as_green_that_points_up():
    low, high = pair()
    bare = render()
    found = []
    for green in ("+Y", "-Y", "+Y"):  # the last one goes through the nodes of the second
        bake(low, high, green=green)
        found.append(render())
    assert np.abs(found[0] - bare).max() > 0.02, "the map is not shown"
    assert np.abs(found[1] - found[0]).max() < SAME, np.abs(found[1] - found[0]).max()
    assert np.abs(found[2] - found[0]).max() < SAME, np.abs(found[2] - found[0]).max()
    textures = [node for node in low.data.materials[0].node_tree.nodes if node.bl_idname == "ShaderNodeTexImage"]
    assert len(textures) == 1, textures
    shown = next(n for n in low.data.materials[0].node_tree.nodes if n.bl_idname == "ShaderNodeNormalMap")
    assert shown.inputs["Color"].links[0].from_node == textures[0], "the last map needs no other node"
    bake(low, high, green="-Y")
    assert np.abs(render() - found[0]).max() < SAME


def an_artists_own_image_node_stays():
    low, high = pair()
    bake(low, high)
    tree = low.data.materials[0].node_tree
    texture = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeTexImage")
    del texture["imprint"]
    bake(low, high, green="-Y")
    assert [node for node in tree.nodes if node.bl_idname == "ShaderNodeTexImage"] == [texture]
    assert texture.outputs["Color"].is_linked


def materials_without_nodes_get_them_with_their_color():
    low, high = pair()
    material = bpy.data.materials.new("plain")
    material.diffuse_color, material.roughness, material.metallic = COLOR, 0.3, 0.6
    low.data.materials.append(material)
    report = bake(low, high)
    values = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeBsdfPrincipled").inputs
    found = [*values["Base Color"].default_value, values["Roughness"].default_value, values["Metallic"].default_value]
    assert np.allclose(found, [*COLOR, 0.3, 0.6]), found
    assert any('"plain" had no nodes' in warning for warning in report.warnings), report.warnings
    assert values["Normal"].is_linked


def nodes_that_are_switched_off_are_switched_on():
    low, high = pair()
    material = bpy.data.materials.new("off")
    material.use_nodes = True
    material.use_nodes = False
    low.data.materials.append(material)
    report = bake(low, high)
    assert material.use_nodes
    assert any("switched off" in warning for warning in report.warnings), report.warnings


def nodes_that_are_switched_off_are_not_read():
    low, high = pair()
    material = bpy.data.materials.new("off")
    material.use_nodes = True
    material.use_nodes = False
    material.diffuse_color = COLOR
    high.data.materials.append(material)
    report = bake(low, high, maps=("BASE_COLOR",))
    texel = maps.pixels(bpy.data.images[report.maps["base_color"]["image"]])[8, 8, :3]
    assert np.allclose(texel, COLOR[:3], atol=1e-5), texel


def errors_come_out_of_the_engine():
    low, high = pair()
    low.data.uv_layers.remove(low.data.uv_layers[0])
    try:
        bake(low, high)
    except BakeError as error:
        assert "UV" in str(error), error
    else:
        raise AssertionError("no error")


def nothing_of_the_engine_stays():
    low, high = pair()
    before = scene_data()
    bake(low, high, material=False)
    assert scene_data() == before | {"map"}
    assert not hasattr(bpy.types, "IMPRINT_GPU")


def scene_data():
    kinds = (bpy.data.scenes, bpy.data.cameras, bpy.data.objects, bpy.data.images)
    return {each.name for kind in kinds for each in kind}


if __name__ == "__main__":
    checks = [
        green_that_points_down_renders_as_green_that_points_up,
        an_artists_own_image_node_stays,
        errors_come_out_of_the_engine,
        nothing_of_the_engine_stays,
    ]
    if bpy.app.version < (5, 0):
        checks += [
            materials_without_nodes_get_them_with_their_color,
            nodes_that_are_switched_off_are_switched_on,
            nodes_that_are_switched_off_are_not_read,
        ]
    for check in checks:
        check()
        print(check.__name__, flush=True)
    print("all as promised", flush=True)
    os._exit(0)  # the wheel of 4.5 hangs where its process ends
