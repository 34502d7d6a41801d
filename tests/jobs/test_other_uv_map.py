# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes of an object onto itself, from one UV map to another."""

import bpy
import numpy as np
import pytest

from addon.scene import object_checks
from tests.support import feeds, maps, scenes

pytestmark = pytest.mark.usefixtures("gpu_context")

TURNED = ((1, 0), (1, 1), (0, 1), (0, 0))
"""The UVs of the corners of `feeds.square`, turned by a quarter: u is along -y, and v along x."""
SIZE = 64


def textured(texels, *, is_normal=False):
    """A square whose material shows an image by the turned UV map; the active one is the other."""
    image = bpy.data.images.new("shown", SIZE, SIZE, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(np.ascontiguousarray(texels, np.float32).ravel())
    material = bpy.data.materials.new("material")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    principled = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    texture = nodes.new("ShaderNodeTexImage")
    texture.image, texture.interpolation = image, "Closest"
    if is_normal:
        normal_map = nodes.new("ShaderNodeNormalMap")
        links.new(texture.outputs["Color"], normal_map.inputs["Color"])
        links.new(normal_map.outputs["Normal"], principled.inputs["Normal"])
    else:
        links.new(texture.outputs["Color"], principled.inputs["Base Color"])
    made = feeds.square(material, TURNED, "turned")
    made.data.uv_layers.active = made.data.uv_layers[feeds.BAKED]
    return made


def test_colors_move_from_one_uv_map_to_another():
    uv = maps.texel_uv(SIZE, SIZE)
    square = textured(np.dstack([uv, uv[..., :1] * uv[..., 1:], np.ones((SIZE, SIZE))]))
    assert object_checks.own_highs(square) == [square]
    _, found = maps.bake_all_maps(square, square, maps=["BASE_COLOR"])
    x, y = uv[..., 0], uv[..., 1]
    expected = np.stack([1.0 - y, x, x * (1.0 - y)], axis=-1)
    assert np.abs(found["base_color"][..., :3] - expected).max() < 1e-5


def test_a_normal_map_is_turned_with_its_uv_map():
    tilted = np.array([0.6, 0.0, 0.8])
    square = textured(np.broadcast_to([*(0.5 + 0.5 * tilted), 1.0], (SIZE, SIZE, 4)), is_normal=True)
    texels = maps.bake(square, square, detail_maps=True)[..., :3] * 2.0 - 1.0
    assert np.abs(texels - (0.0, -0.6, 0.8)).max() < 1e-5


@pytest.mark.parametrize("map_name", ["BASE_COLOR", "ROUGHNESS", "ATTRIBUTE"])
def test_a_flat_normal_map_beside_maps_of_materials_is_as_it_should_be(map_name):
    """From one UV map to another, nothing but materials can differ."""
    square = textured(np.ones((SIZE, SIZE, 4)))
    square.data.attributes.new("mask", "FLOAT", "POINT")
    report = scenes.bake(square, square, method="AUTO", maps=(map_name,), attribute="mask", size=16)
    assert report.warnings == []
    alone = scenes.bake(square, square, method="AUTO", size=16)
    assert [text.split(":")[0] for text in alone.warnings] == ["The map is flat"]
