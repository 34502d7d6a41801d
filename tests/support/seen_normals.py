# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender's two renderers make of normal maps: an emission shows the output of a Normal Map node, pixel by pixel."""

import bpy
import numpy as np
from mathutils import Vector

from tests.support import angles

ENGINES = ("CYCLES", "BLENDER_EEVEE")
PIXELS = 384
NEAR = 0.15
"""Of a texel: how far pixels may be from its center along u and v."""


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


def normals(low, image, engine, path, *, space="TANGENT"):
    """The normals (PIXELS, PIXELS, 3) that a Normal Map node gives for the pixels, and where `low` is."""
    texels = _rendered(low, image, engine, path, space)
    return angles.decode(texels), texels[..., 3] == 1.0


def near_centers(low, image, engine, path):
    """The pixels (PIXELS, PIXELS) that see the front of `low` next to the center of a texel whose color is 1 in the image.

    Elsewhere, the texel and the pixel have other tangent spaces. Textures between texels have mips in EEVEE.
    """
    texels = _rendered(low, image, engine, path, None)
    return (texels[..., 3] == 1.0) & (texels[..., 2] > 0.99) & (np.abs(texels[..., :2] - 0.5).max(axis=-1) < NEAR)


def _rendered(low, image, engine, path, space):
    """A picture of `low` that shines with an image, or with the normals of a Normal Map node: (PIXELS, PIXELS, 4)."""
    image.use_half_precision = False
    low.data.materials.clear()
    low.data.materials.append(_material(low, image, space))
    low.data.polygons.foreach_set("material_index", np.zeros(len(low.data.polygons), np.int32))
    scene = bpy.context.scene
    for obj in scene.objects:
        obj.hide_render = obj.type == "MESH" and obj != low
    scene.render.engine = engine
    scene.render.use_high_quality_normals = True  # otherwise EEVEE has 10 bits of each
    scene.render.resolution_x = scene.render.resolution_y = PIXELS
    scene.render.resolution_percentage = 100
    scene.render.film_transparent, scene.render.filter_size = True, 0.01
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.filter_width = 1, False, 0.01
    scene.cycles.pixel_filter_type, scene.eevee.taa_render_samples = "BOX", 1
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth, scene.render.image_settings.color_mode = "32", "RGBA"
    scene.render.filepath = str(path / "seen.exr")
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(scene.render.filepath)
    texels = np.empty(PIXELS * PIXELS * 4, np.float32)
    picture.pixels.foreach_get(texels)
    bpy.data.images.remove(picture)
    return texels.reshape(PIXELS, PIXELS, 4)


def _material(low, image, space):
    material = bpy.data.materials.new("seen")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    texture, emission = nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeEmission")
    texture.image, texture.interpolation = image, "Closest"
    color = texture.outputs["Color"]
    if space is None:
        uv, place, fraction = (nodes.new(f"ShaderNode{kind}") for kind in ("UVMap", "VectorMath", "VectorMath"))
        parts, joined, front = (nodes.new(f"ShaderNode{kind}") for kind in ("SeparateXYZ", "CombineXYZ", "Math"))
        uv.uv_map = low.data.uv_layers.active.name
        place.operation, fraction.operation, front.operation = "MULTIPLY", "FRACTION", "SUBTRACT"
        place.inputs[1].default_value = (*image.size, 0.0)
        links.new(uv.outputs[0], place.inputs[0])
        links.new(place.outputs[0], fraction.inputs[0])
        links.new(fraction.outputs[0], parts.inputs[0])
        links.new(color, front.inputs[0])
        links.new(nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"], front.inputs[1])
        for number, part in enumerate((parts.outputs[0], parts.outputs[1], front.outputs[0])):
            links.new(part, joined.inputs[number])
        color = joined.outputs[0]
    else:
        node, stored = nodes.new("ShaderNodeNormalMap"), nodes.new("ShaderNodeVectorMath")
        node.space, node.uv_map = space, low.data.uv_layers.active.name
        stored.operation = "MULTIPLY_ADD"
        stored.inputs[1].default_value = stored.inputs[2].default_value = (0.5, 0.5, 0.5)
        links.new(color, node.inputs["Color"])
        links.new(node.outputs["Normal"], stored.inputs[0])
        color = stored.outputs["Vector"]
    links.new(color, emission.inputs["Color"])
    links.new(emission.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material
