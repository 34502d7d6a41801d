# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of what moves the normals of materials: Normal Map and Bump nodes."""

import bpy
import pytest

from addon.core.material_feeds import LUMINANCE, BumpFeed, NormalMapFeed
from tests.support.shader_nodes import add, image, principled, read, texture


def connect(material, output):
    material.node_tree.links.new(output, principled(material).inputs["Normal"])
    return read(material)


def normal_map(material, color, **properties):
    return add(material, "NormalMap", {"Color": color}, **properties)


def test_a_normal_map(material):
    node = texture(material, image(space="Non-Color"))
    found = connect(material, normal_map(material, node.outputs[0], uv_map="UVMap").outputs[0])
    assert isinstance(found.detail, NormalMapFeed)
    assert (found.detail.uv_layer, found.detail.strength, found.detail.is_green_down) == ("UVMap", 1.0, False)
    assert (found.detail.image.channel, found.detail.image.uv_layer) == (None, "")
    assert found.notes == {}


def test_the_strength(material):
    node = texture(material, image(space="Non-Color"))
    mapped = normal_map(material, node.outputs[0])
    for value, expected in ((0.5, 0.5), (3.0, 3.0)):
        mapped.inputs["Strength"].default_value = value
        assert connect(material, mapped.outputs[0]).detail.strength == expected
    mapped.inputs["Strength"].default_value = 0.0
    assert connect(material, mapped.outputs[0]).detail is None


def test_a_map_whose_green_nodes_invert(material):
    """Separate, invert green, combine: the usual nodes for maps of DirectX."""
    node = texture(material, image(space="Non-Color"))
    parts = add(material, "SeparateColor", {"Color": node.outputs[0]})
    over = add(material, "Invert", {"Color": parts.outputs["Green"]})
    inputs = {"Red": parts.outputs["Red"], "Green": over.outputs[0], "Blue": parts.outputs["Blue"]}
    joined = add(material, "CombineColor", inputs)
    detail = connect(material, normal_map(material, joined.outputs[0]).outputs[0]).detail
    assert detail.is_green_down
    assert detail.image.scale == (1.0, 1.0, 1.0)
    assert detail.image.offset == (0.0, 0.0, 0.0)


def test_a_map_whose_green_a_curve_inverts(material):
    node = texture(material, image(space="Non-Color"))
    curves = add(material, "RGBCurve", {"Color": node.outputs[0]})
    points = curves.mapping.curves[1].points
    points[0].location, points[1].location = (0.0, 1.0), (1.0, 0.0)
    curves.mapping.update()
    detail = connect(material, normal_map(material, curves.outputs[0]).outputs[0]).detail
    assert detail.is_green_down
    assert detail.image.scale == pytest.approx((1.0, 1.0, 1.0), abs=1e-4)
    assert detail.image.offset == pytest.approx((0.0, 0.0, 0.0), abs=1e-4)


def test_the_convention_of_the_node(material):
    node = texture(material, image(space="Non-Color"))
    mapped = normal_map(material, node.outputs[0], convention="DIRECTX")
    assert connect(material, mapped.outputs[0]).detail.is_green_down


def test_a_map_of_two_channels(material):
    node = texture(material, image(space="Non-Color"))
    parts = add(material, "SeparateColor", {"Color": node.outputs[0]})
    joined = add(material, "CombineColor", {"Red": parts.outputs[0], "Green": parts.outputs[1], "Blue": 1.0})
    found = connect(material, normal_map(material, joined.outputs[0]).outputs[0]).detail.image
    assert (found.channel, found.scale, found.offset) == (None, (1.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def test_limits_of_heights_and_of_stored_normals(material):
    node = texture(material, image(space="Non-Color", ends=(-2.0, 3.0)))
    parts = add(material, "SeparateColor", {"Color": node.outputs[0]})
    limit = add(material, "Clamp", {"Value": parts.outputs["Green"], "Min": 0.25, "Max": 0.75})
    bump = connect(material, add(material, "Bump", {"Height": limit.outputs[0]}).outputs[0]).detail
    assert (bump.image.limits.low[0], bump.image.limits.high[0]) == (0.25, 0.75)
    several = add(material, "CombineColor", {"Red": limit.outputs[0], "Green": parts.outputs["Green"], "Blue": 1.0})
    found = connect(material, normal_map(material, several.outputs[0]).outputs[0])
    assert found.detail is None
    assert found.notes["Normal"] == (
        'Material "Rust": Normal: the detail is left out, because the channels of the normal map have several limits.',
    )


@pytest.mark.parametrize("space", ["OBJECT", "WORLD"])
def test_other_spaces_are_named(material, space):
    node = texture(material, image(space="Non-Color"))
    found = connect(material, normal_map(material, node.outputs[0], space=space).outputs[0])
    assert found.detail is None
    assert found.notes["Normal"] == (
        'Material "Rust": Normal: the detail is left out, because the node "Normal Map" is not in tangent space.',
    )


def test_no_detail(material):
    assert connect(material, add(material, "NormalMap").outputs[0]).detail is None
    assert connect(material, add(material, "NewGeometry").outputs["Normal"]).detail is None
    assert connect(material, add(material, "Bump").outputs[0]).detail is None
    assert read(material).notes == {}


def test_a_bump_map(material):
    node = texture(material)
    bump = add(material, "Bump", {"Height": node.outputs[0], "Strength": 0.5, "Distance": 0.25})
    found = connect(material, bump.outputs[0])
    assert isinstance(found.detail, BumpFeed)
    assert (found.detail.strength, found.detail.distance, found.detail.below) == (0.5, 0.25, None)
    assert found.detail.image.channel == LUMINANCE
    bump.invert = True
    assert read(material).detail.distance == -0.25


def test_a_bump_map_on_a_normal_map(material):
    node, height = texture(material, image(space="Non-Color")), texture(material)
    below = normal_map(material, node.outputs[0])
    bump = add(material, "Bump", {"Height": height.outputs[0], "Normal": below.outputs[0]})
    found = connect(material, bump.outputs[0])
    assert isinstance(found.detail.below, NormalMapFeed)
    assert found.detail.image.image != found.detail.below.image.image
    bump.mute = True
    assert read(material).detail == found.detail.below


@pytest.mark.parametrize("name", ["Strength", "Distance"])
def test_a_bump_map_without_height_leaves_what_is_below(material, name):
    node, height = texture(material, image(space="Non-Color")), texture(material)
    below = normal_map(material, node.outputs[0])
    bump = add(material, "Bump", {"Height": height.outputs[0], "Normal": below.outputs[0], name: 0.0})
    assert isinstance(connect(material, bump.outputs[0]).detail, NormalMapFeed)


def test_a_bump_map_on_another_is_named(material):
    first = add(material, "Bump", {"Height": texture(material).outputs[0], "Distance": 3.0})
    second = add(material, "Bump", {"Height": texture(material).outputs[0], "Normal": first.outputs[0]})
    found = connect(material, second.outputs[0])
    assert (found.detail.distance, found.detail.below) == (second.inputs["Distance"].default_value, None)
    assert found.notes["Normal"] == (
        'Material "Rust": Normal: the node "Bump.001" lies on another Bump node, which the map does not have.',
    )


@pytest.mark.parametrize("kind", ["TexNoise", "VertexColor"])
def test_heights_that_are_no_image_are_named(material, kind):
    bump = add(material, "Bump", {"Height": add(material, kind).outputs[0]})
    found = connect(material, bump.outputs[0])
    assert found.detail is None
    assert len(found.notes["Normal"]) == 1


def test_displacement_is_named(material):
    displacement = add(material, "Displacement")
    output = material.node_tree.get_output_node("CYCLES")
    material.node_tree.links.new(displacement.outputs[0], output.inputs["Displacement"])
    assert read(material).notes == {"Normal": ('Material "Rust": Normal: the displacement is left out.',)}


def test_detail_in_a_group(material):
    """The group of a character's skin: an image outside, the Normal Map node inside."""
    group = bpy.data.node_groups.new("skin", "ShaderNodeTree")
    group.interface.new_socket("In", in_out="INPUT", socket_type="NodeSocketColor")
    group.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketVector")
    start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    group.links.new(add(group, "NormalMap", {"Color": start.outputs[0]}).outputs[0], end.inputs[0])
    used = add(material, "Group", node_tree=group)
    material.node_tree.links.new(texture(material, image(space="Non-Color")).outputs[0], used.inputs[0])
    assert isinstance(connect(material, used.outputs[0]).detail, NormalMapFeed)
