# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender's two renderers make of normal maps: passes of a picture hold the outputs of Normal Map nodes."""

import bpy
import numpy as np
from mathutils import Vector

from tests.support import pictures

ENGINES = ("CYCLES", "BLENDER_EEVEE")
NEAR = 0.03
"""Of a texel: how far pixels may be from its center along u and v."""
PLACE = "place"


def camera_on(low, direction):
    """A parallel camera that sees all of `low` from a direction."""
    corners = [low.matrix_world @ Vector(corner) for corner in low.bound_box]
    center = sum(corners, Vector()) / 8
    radius = max((corner - center).length for corner in corners)
    data = bpy.data.cameras.new("eye")
    data.type, data.ortho_scale = "ORTHO", 2.0 * radius
    data.clip_start, data.clip_end = 0.1 * radius, 10.0 * radius
    camera = bpy.data.objects.new("eye", data)
    bpy.context.scene.collection.objects.link(camera)
    towards = Vector(direction).normalized()
    camera.location = center + 4.0 * radius * towards
    camera.rotation_euler = towards.to_track_quat("Z", "Y").to_euler()
    bpy.context.scene.camera = camera


def normals(low, spaces, inside, engine, *, path, pixels):
    """The unit normals (N, 3) that Normal Map nodes give, in world space, by the name of the image that each reads.

    spaces: of these images, by name. N: the pixels that see the front of `low` next to the center of a texel whose color is 1
    in the image `inside`. Elsewhere, the texel and the pixel have other tangent spaces, and textures between texels have mips
    in EEVEE. pixels: along each side of the picture, which is written into the folder `path`.
    """
    material = bpy.data.materials.new("seen")
    material.node_tree.nodes.clear()
    # Cycles sees through materials without a surface, and adds up the passes of what is behind.
    surface, output = (material.node_tree.nodes.new(f"ShaderNode{kind}") for kind in ("Emission", "OutputMaterial"))
    material.node_tree.links.new(surface.outputs[0], output.inputs["Surface"])
    uv_map = low.data.uv_layers.active.name
    for name, space in spaces.items():
        _show(material.node_tree, name, _normal(material.node_tree, bpy.data.images[name], space, uv_map))
    _show(material.node_tree, PLACE, _place(material.node_tree, bpy.data.images[inside], uv_map))
    low.data.materials.clear()
    low.data.materials.append(material)
    low.data.polygons.foreach_set("material_index", np.zeros(len(low.data.polygons), np.int32))
    found = _rendered(low, [*spaces, PLACE], engine, path / "seen.exr", pixels)
    place = found[PLACE]
    kept = (place[..., 2] > 0.99) & (np.abs(place[..., :2] - 0.5).max(axis=-1) < NEAR)
    shown = {name: found[name][kept][:, :3].astype(np.float64) for name in spaces}
    return {name: vectors / np.linalg.norm(vectors, axis=-1, keepdims=True) for name, vectors in shown.items()}


def _rendered(low, passes, engine, path, pixels):
    """A picture of `low`, one ray for each pixel: passes (pixels, pixels, 4) by name."""
    scene, layer = bpy.context.scene, bpy.context.view_layer
    for obj in scene.objects:
        obj.hide_render = obj.type == "MESH" and obj != low
    while layer.aovs:
        layer.aovs.remove(layer.aovs[0])
    for name in passes:
        layer.aovs.add().name = name
    scene.render.engine = engine
    scene.render.resolution_x = scene.render.resolution_y = pixels
    scene.render.resolution_percentage = 100
    scene.render.filter_size = 0.01
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.filter_width = 1, False, 0.01
    scene.cycles.pixel_filter_type, scene.eevee.taa_render_samples = "BOX", 1
    settings = scene.render.image_settings
    settings.media_type, settings.color_depth = "MULTI_LAYER_IMAGE", "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return pictures.read_passes(path)


def _show(tree, name, output):
    node = tree.nodes.new("ShaderNodeOutputAOV")
    node.aov_name = name
    tree.links.new(output, node.inputs["Color"])


def _color(tree, image):
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image, texture.interpolation = image, "Closest"
    return texture.outputs["Color"]


def _normal(tree, image, space, uv_map):
    node = tree.nodes.new("ShaderNodeNormalMap")
    node.space, node.uv_map = space, uv_map
    tree.links.new(_color(tree, image), node.inputs["Color"])
    return node.outputs["Normal"]


def _place(tree, inside, uv_map):
    """Where a pixel is in its texel: 0 to 1 along u and v; and the color of `inside`, less 1 on the back."""
    uv, scaled, fraction = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("UVMap", "VectorMath", "VectorMath"))
    parts, joined, front = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("SeparateXYZ", "CombineXYZ", "Math"))
    uv.uv_map = uv_map
    scaled.operation, fraction.operation, front.operation = "MULTIPLY", "FRACTION", "SUBTRACT"
    scaled.inputs[1].default_value = (*inside.size, 0.0)
    tree.links.new(uv.outputs[0], scaled.inputs[0])
    tree.links.new(scaled.outputs[0], fraction.inputs[0])
    tree.links.new(fraction.outputs[0], parts.inputs[0])
    tree.links.new(_color(tree, inside), front.inputs[0])
    tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"], front.inputs[1])
    for number, part in enumerate((parts.outputs[0], parts.outputs[1], front.outputs[0])):
        tree.links.new(part, joined.inputs[number])
    return joined.outputs[0]
