# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that materials become the feeds that Cycles' emission bake of the same nodes shows."""

import json
import random
import struct

import bpy
import numpy as np
import pytest

from addon.core.material_feeds import (
    AVERAGE,
    LUMINANCE,
    AttributeFeed,
    BumpFeed,
    Constant,
    Extension,
    ImageFeed,
    Limits,
    NormalMapFeed,
)
from addon.scene.materials.material_reading import read_materials
from addon.scene.mesh_elements import attribute_by_corner
from addon.scene.textures import ImageTextures
from tests.support import feeds, random_cases
from tests.support.random_nodes import FOLLOWED, OTHERS, SHADERS, grow
from tests.support.shader_nodes import add, feed_color, image, principled, read, texture

SIZE = 64
TOLERANCE = 2 / 255
"""The issue's limit for colors."""
BORDERS = 0.03
"""The largest share of texels on borders of pixels, where rounding decides."""
UV = ((0.03, 0.02), (1.9, -0.3), (2.4, 1.7), (0.53, 2.02))


def assert_like_cycles(material, output, socket="Base Color", *, prepare=None, tolerance=TOLERANCE):
    """The feed of a socket is what Cycles bakes, and nothing is noted. Returns the feed."""
    found = feed_color(material, output, socket)
    assert found.notes == {}
    obj = feeds.square(material, UV)
    if prepare:
        prepare(obj.data)
    mine = feeds.evaluate(found.feeds[socket], ImageTextures(), obj.data, SIZE)
    links = material.node_tree.links
    if principled(material).inputs[socket].type == "VALUE":  # Blender's conversion to a number belongs to the socket
        number = add(material, "Math", {"Value": output, "Value_001": 0.0}, operation="ADD")
        output = number.outputs[0]
    theirs = feeds.cycles(obj, output, SIZE)
    for link in list(links):
        if link.to_socket == principled(material).inputs[socket]:
            links.remove(link)
    wrong = np.abs(mine - theirs).max(axis=-1) > tolerance
    assert wrong.mean() < BORDERS
    assert theirs.max() > 0.0
    return found.feeds[socket]


@pytest.mark.parametrize("extension", list(Extension))
@pytest.mark.parametrize("interpolation", ["Closest", "Linear"])
def test_an_image_extends_as_in_cycles(material, extension, interpolation):
    node = texture(material, image(space="Non-Color"), extension=extension)
    node.interpolation = interpolation
    assert_like_cycles(material, node.outputs["Color"])


MAPPING = {"Location": (0.3, -0.2, 0.5), "Rotation": (0.2, 0.4, 0.7), "Scale": (1.7, -0.6, 2.0)}


@pytest.mark.parametrize("kind", ["POINT", "TEXTURE", "VECTOR"])
def test_a_mapping_moves_as_in_cycles(material, kind):
    uv = add(material, "UVMap", uv_map="UVMap")
    mapping = add(material, "Mapping", {"Vector": uv.outputs[0]}, vector_type=kind)
    for name, value in MAPPING.items():
        if name in mapping.inputs:
            mapping.inputs[name].default_value = value
    node = texture(material)
    material.node_tree.links.new(mapping.outputs[0], node.inputs[0])
    assert_like_cycles(material, node.outputs["Color"])


def test_mapping_divides_by_zero_as_cycles_does(material):
    uv = add(material, "UVMap", uv_map="UVMap")
    mapping = add(material, "Mapping", {"Vector": uv.outputs[0], "Scale": (0.0, 2.0, 1.0)}, vector_type="TEXTURE")
    node = texture(material)
    material.node_tree.links.new(mapping.outputs[0], node.inputs[0])
    assert_like_cycles(material, node.outputs["Color"])


def test_mappings_follow_each_other(material):
    coordinates = add(material, "TexCoord")
    first = add(material, "Mapping", {"Vector": coordinates.outputs["UV"], **MAPPING})
    second = add(material, "Mapping", {"Vector": first.outputs[0], "Rotation": (0, 0, 1.0)}, vector_type="TEXTURE")
    node = texture(material)
    material.node_tree.links.new(second.outputs[0], node.inputs[0])
    assert_like_cycles(material, node.outputs["Color"])


def test_coordinates_through_vector_arithmetic(material):
    """V is turned over, as in materials from other programs, and U gains half of V."""
    uv = add(material, "UVMap", uv_map="UVMap")
    parts = add(material, "SeparateXYZ", {"Vector": uv.outputs[0]})
    over = add(material, "Math", {"Value": 1.0, "Value_001": parts.outputs["Y"]}, operation="SUBTRACT")
    half = add(material, "Math", {"Value": parts.outputs["Y"], "Value_001": 0.5}, operation="MULTIPLY")
    moved = add(material, "Math", {"Value": parts.outputs["X"], "Value_001": half.outputs[0]}, operation="ADD")
    vector = add(material, "CombineXYZ", {"X": moved.outputs[0], "Y": over.outputs[0]})
    scaled = add(material, "VectorMath", {"Vector": vector.outputs[0], "Scale": 1.5}, operation="SCALE")
    node = texture(material)
    material.node_tree.links.new(scaled.outputs[0], node.inputs[0])
    assert_like_cycles(material, node.outputs["Color"])


def test_a_vector_that_feeds_a_coordinate_is_its_mean(material):
    uv = add(material, "UVMap", uv_map="UVMap")
    mean = add(material, "Math", {"Value": uv.outputs[0], "Value_001": 3.0}, operation="MULTIPLY")
    vector = add(material, "CombineXYZ", {"X": mean.outputs[0], "Y": 0.3})
    node = texture(material)
    material.node_tree.links.new(vector.outputs[0], node.inputs[0])
    assert_like_cycles(material, node.outputs["Color"])


def test_coordinates_of_two_layers_are_named(material):
    first, second = (add(material, "UVMap", uv_map=name) for name in ("UVMap", feeds.BAKED))
    both = add(material, "VectorMath", {"Vector": first.outputs[0], "Vector_001": second.outputs[0]}, operation="ADD")
    node = texture(material)
    material.node_tree.links.new(both.outputs[0], node.inputs[0])
    (note,) = feed_color(material, node.outputs[0]).notes["Base Color"]
    assert note.endswith('because the node "Vector Math" combines two UV maps.')


@pytest.mark.parametrize("is_used", [True, False])
def test_the_use_of_alpha_decides_whether_colors_are_multiplied_with_it(material, is_used):
    node = texture(material, image(alpha=True, seed=8))
    if is_used:
        material.node_tree.links.new(node.outputs["Alpha"], principled(material).inputs["Alpha"])
    found = assert_like_cycles(material, node.outputs["Color"], tolerance=0.05)
    assert found.image.endswith(":premultiplied") != is_used


def test_an_unconnected_mapping_has_one_point(material):
    mapping = add(material, "Mapping", {"Location": (0.25, 0.35, 0.0)})
    node = texture(material)
    material.node_tree.links.new(mapping.outputs[0], node.inputs[0])
    assert_like_cycles(material, node.outputs["Color"])


@pytest.mark.parametrize("kind", ["UVMap", "Attribute"])
def test_another_uv_layer(material, kind):
    names = {"UVMap": {"uv_map": feeds.BAKED}, "Attribute": {"attribute_name": feeds.BAKED}}[kind]
    uv = add(material, kind, **names)
    node = texture(material)
    material.node_tree.links.new(uv.outputs["UV" if kind == "UVMap" else "Vector"], node.inputs[0])
    found = assert_like_cycles(material, node.outputs["Color"])
    assert found.uv_layer == feeds.BAKED


def test_constants(material):
    principled(material).inputs["Base Color"].default_value = (0.1, 0.2, 0.3, 1.0)
    principled(material).inputs["Roughness"].default_value = 0.25
    found = read(material)
    assert found.feeds["Base Color"].color == pytest.approx((0.1, 0.2, 0.3, 1.0))
    assert found.feeds["Roughness"].color == pytest.approx((0.25, 0.25, 0.25, 1.0))
    assert found.feeds["Emission Color"].color == pytest.approx((0.0, 0.0, 0.0, 1.0))
    assert (found.name, found.notes, found.detail) == ("Rust", {}, None)


def test_a_color_that_feeds_a_number_is_its_luminance(material):
    node = texture(material)
    assert assert_like_cycles(material, node.outputs["Color"], "Roughness").channel == LUMINANCE


@pytest.mark.parametrize("channel", ["Red", "Green", "Blue"])
def test_separated_channels(material, channel):
    node = texture(material, image(space="Non-Color"))
    parts = add(material, "SeparateColor", {"Color": node.outputs[0]})
    found = assert_like_cycles(material, parts.outputs[channel], "Roughness")
    assert found.channel == ["Red", "Green", "Blue"].index(channel)


def test_a_vector_that_feeds_a_number_is_its_mean(material):
    node = texture(material)
    vector = add(material, "VectorMath", {"Vector": node.outputs[0], "Vector_001": (0.1, 0.2, 0.3)}, operation="ADD")
    assert_like_cycles(material, vector.outputs[0], "Roughness")


BLENDS = [
    ("MIX", 0.3), ("ADD", 0.6), ("SUBTRACT", 0.2), ("MULTIPLY", 0.7), ("SCREEN", 0.4), ("DIVIDE", 0.5),
    ("LINEAR_LIGHT", 0.5), ("SOFT_LIGHT", 0.6), ("OVERLAY", 0.8),
]  # fmt: skip


@pytest.mark.parametrize(("blend", "factor"), BLENDS)
@pytest.mark.parametrize("image_first", [True, False])
def test_an_image_mixed_with_a_color(material, blend, factor, image_first):
    node = texture(material)
    color = (0.9, 0.5, 0.7, 1.0)
    first, second = ("A_Color", "B_Color") if image_first else ("B_Color", "A_Color")
    inputs = {"Factor_Float": factor, first: node.outputs[0], second: color}
    mix = add(material, "Mix", data_type="RGBA", blend_type=blend)
    for name, value in inputs.items():
        socket = next(s for s in mix.inputs if s.identifier == name)
        if isinstance(value, bpy.types.NodeSocket):
            material.node_tree.links.new(value, socket)
        else:
            socket.default_value = value
    if (blend in {"SOFT_LIGHT", "OVERLAY"} and image_first) or (blend == "DIVIDE" and not image_first):
        assert "Base Color" not in feed_color(material, mix.outputs[2]).feeds
    else:
        assert_like_cycles(material, mix.outputs[2])


def test_a_mask_between_two_colors(material):
    mask = texture(material, image(space="Non-Color"))
    colors = {"A_Color": (0.8, 0.1, 0.2, 1.0), "B_Color": (0.1, 0.6, 0.9, 1.0)}
    mix = add(material, "Mix", data_type="RGBA")
    for name, value in colors.items():
        next(s for s in mix.inputs if s.identifier == name).default_value = value
    material.node_tree.links.new(mask.outputs[0], next(s for s in mix.inputs if s.identifier == "Factor_Float"))
    assert_like_cycles(material, mix.outputs[2])


@pytest.mark.parametrize(
    ("kind", "inputs", "properties"),
    [
        ("Invert", {"Fac": 0.7}, {}),
        ("BrightContrast", {"Bright": 0.3, "Contrast": 0.2}, {}),
        ("HueSaturation", {"Value": 0.6, "Fac": 0.5}, {}),
        ("Gamma", {"Gamma": 1.0}, {}),
        ("MixRGB", {"Fac": 0.4, "Color2": (0.2, 0.9, 0.4, 1.0)}, {"blend_type": "MULTIPLY"}),
    ],
)
def test_nodes_that_change_colors_evenly(material, kind, inputs, properties):
    node = texture(material)
    name = "Color1" if kind == "MixRGB" else "Color"
    changed = add(material, kind, {name: node.outputs[0], **inputs}, **properties)
    assert_like_cycles(material, changed.outputs[0])


MATHS = [("ADD", 0.2), ("SUBTRACT", 0.1), ("MULTIPLY", 0.6), ("DIVIDE", 1.7), ("MULTIPLY_ADD", 0.5), ("MAXIMUM", -1.0)]


@pytest.mark.parametrize(("operation", "value"), MATHS)
def test_arithmetic_with_a_constant(material, operation, value):
    node = texture(material, image(space="Non-Color"))
    parts = add(material, "SeparateColor", {"Color": node.outputs[0]})
    inputs = {"Value": parts.outputs["Green"], "Value_001": value, "Value_002": 0.25}
    changed = add(material, "Math", inputs, operation=operation)
    assert_like_cycles(material, changed.outputs[0], "Roughness")


@pytest.mark.parametrize("operation", ["POWER", "SQRT", "LESS_THAN", "ROUND", "FRACT", "SINE", "ABSOLUTE", "SIGN"])
def test_arithmetic_with_constants_alone(material, operation):
    changed = add(material, "Math", {"Value": 0.3, "Value_001": 0.4}, operation=operation)
    found = feed_color(material, changed.outputs[0], "Roughness").feeds["Roughness"]
    expected = {
        "POWER": 0.3**0.4, "SQRT": 0.3**0.5, "LESS_THAN": 1.0, "ROUND": 0.0, "FRACT": 0.3, "SINE": np.sin(0.3),
        "ABSOLUTE": 0.3, "SIGN": 1.0,
    }[operation]  # fmt: skip
    assert found.color[0] == pytest.approx(expected, rel=1e-6)


def test_map_range(material):
    node = texture(material, image(space="Non-Color"))
    parts = add(material, "SeparateColor", {"Color": node.outputs[0]})
    inputs = {"Value": parts.outputs["Red"], "To Min": 0.8, "To Max": 0.3}
    assert_like_cycles(material, add(material, "MapRange", inputs).outputs["Result"], "Roughness")


def test_an_empty_range_is_named(material):
    """Cycles and EEVEE divide by zero in several ways."""
    parts = add(material, "SeparateColor", {"Color": texture(material).outputs[0]})
    empty = add(material, "MapRange", {"Value": parts.outputs["Red"], "From Min": 0.5, "From Max": 0.5})
    (note,) = feed_color(material, empty.outputs["Result"], "Roughness").notes["Roughness"]
    assert note.endswith('because the node "Map Range" maps an empty range.')


def mix_color(material, factor, first, second, **properties):
    mix = add(material, "Mix", data_type="RGBA", **properties)
    for name, value in (("Factor_Float", factor), ("A_Color", first), ("B_Color", second)):
        socket = next(s for s in mix.inputs if s.identifier == name)
        if isinstance(value, bpy.types.NodeSocket):
            material.node_tree.links.new(value, socket)
        else:
            socket.default_value = value
    return mix.outputs[2]


@pytest.mark.parametrize("clamps", [True, False])
def test_the_factor_of_a_mix_is_clamped_if_it_says_so(material, clamps):
    three = add(material, "Value")
    three.outputs[0].default_value = 1.8
    colors = ((0.2, 0.4, 0.6, 1.0), (0.3, 0.3, 0.7, 1.0))
    output = mix_color(material, three.outputs[0], *colors, clamp_factor=clamps)
    expected = (0.3, 0.3, 0.7) if clamps else (0.38, 0.22, 0.78)
    assert assert_like_cycles(material, output).color[:3] == pytest.approx(expected)


@pytest.mark.parametrize("clamps", [True, False])
def test_the_result_of_a_mix_is_clamped_if_it_says_so(material, clamps):
    colors = ((0.2, 0.4, 0.6, 1.0), (0.3, 0.9, 0.7, 1.0))
    output = mix_color(material, 1.0, *colors, blend_type="ADD", clamp_result=clamps)
    expected = (0.5, 1.0, 1.0) if clamps else (0.5, 1.3, 1.3)
    assert assert_like_cycles(material, output).color[:3] == pytest.approx(expected)


@pytest.mark.parametrize("clamps", [True, False])
def test_arithmetic_is_clamped_if_it_says_so(material, clamps):
    double = add(material, "Math", {"Value": 0.8, "Value_001": 2.0}, operation="MULTIPLY", use_clamp=clamps)
    found = assert_like_cycles(material, double.outputs[0], "Roughness")
    assert found.color[0] == pytest.approx(1.0 if clamps else 1.6)


def wide_image():
    return image("wide", seed=11, space="Non-Color", ends=(-2.0, 3.0))


def wide_attribute(kind, domain="CORNER", seed=12):
    """A function that gives a mesh the attribute "wide", of values from -2 to 3."""

    def prepare(data):
        attribute = data.attributes.new("wide", kind, domain)
        width, name = {"FLOAT_VECTOR": (3, "vector"), "FLOAT_COLOR": (4, "color")}.get(kind, (1, "value"))
        values = np.random.default_rng(seed).uniform(-2.0, 3.0, len(attribute.data) * width)
        attribute.data.foreach_set(name, np.rint(values).astype(np.int32) if kind == "INT" else values.astype("f4"))

    return prepare


def wide_number(material, source):
    """An output with numbers from -2 to 3, and what prepares the mesh for it."""
    if source == "IMAGE":
        parts = add(material, "SeparateColor", {"Color": texture(material, wide_image()).outputs[0]})
        return parts.outputs["Green"], None
    node = add(material, "Attribute", attribute_name="wide")
    return next(s for s in node.outputs if s.identifier == "Fac"), wide_attribute(source)


def limiting(material, kind, value):
    """A node that limits the number of an output."""
    match kind:
        case "MINIMUM" | "MAXIMUM":
            return add(material, "Math", {"Value": 0.4, "Value_001": value}, operation=kind).outputs[0]
        case "USE_CLAMP":
            inputs = {"Value": value, "Value_001": -0.7, "Value_002": 0.6}
            return add(material, "Math", inputs, operation="MULTIPLY_ADD", use_clamp=True).outputs[0]
        case "MAP_RANGE":
            inputs = {"Value": value, "From Min": -0.5, "From Max": 1.5, "To Min": 0.9, "To Max": 0.2}
            return add(material, "MapRange", inputs).outputs["Result"]
        case "RANGE":
            inputs = {"Value": value, "Min": 1.5, "Max": 0.3}
            return add(material, "Clamp", inputs, clamp_type="RANGE").outputs[0]
        case "MINMAX":
            return add(material, "Clamp", {"Value": value, "Min": 0.8, "Max": 0.3}).outputs[0]
        case "TWICE":
            first = add(material, "Clamp", {"Value": value, "Min": -1.0, "Max": 2.0})
            over = add(material, "Math", {"Value": 1.0, "Value_001": first.outputs[0]}, operation="SUBTRACT")
            return add(material, "Clamp", {"Value": over.outputs[0], "Min": 0.1, "Max": 1.6}).outputs[0]
        case "RAMP":
            ramp = add(material, "ValToRGB", {"Fac": value})
            ramp.color_ramp.elements[0].color = (0.9, 0.2, 0.1, 1.0)
            ramp.color_ramp.elements[1].color = (0.1, 0.4, 0.8, 1.0)
            return ramp.outputs["Color"]
        case "MIX_FACTOR":
            return mix_color(material, value, (0.8, 0.1, 0.2, 1.0), (0.1, 0.6, 0.9, 1.0))
    raise ValueError(kind)


@pytest.mark.parametrize("source", ["IMAGE", "FLOAT"])
@pytest.mark.parametrize(
    "kind",
    ["MINIMUM", "MAXIMUM", "USE_CLAMP", "MAP_RANGE", "RANGE", "MINMAX", "TWICE", "RAMP", "MIX_FACTOR"],
)
def test_limits_of_values_outside_0_to_1(material, source, kind):
    value, prepare = wide_number(material, source)
    assert_like_cycles(material, limiting(material, kind, value), prepare=prepare)


def test_limits_of_a_mixed_color(material):
    """The result is limited, multiplied, and its luminance feeds a number."""
    colors = (texture(material, wide_image()).outputs[0], (0.7, 0.7, 0.7, 1.0))
    mixed = mix_color(material, 1.0, *colors, blend_type="MULTIPLY", clamp_result=True)
    halved = mix_color(material, 1.0, mixed, (0.5, 0.5, 0.5, 1.0), blend_type="MULTIPLY")
    assert_like_cycles(material, halved)
    assert assert_like_cycles(material, halved, "Roughness").channel == LUMINANCE


def test_limits_of_single_channels(material):
    parts = add(material, "SeparateColor", {"Color": texture(material, wide_image()).outputs[0]})
    ends = (("Red", 0.0, 1.0), ("Green", 0.2, 0.7), ("Blue", -1.0, 5.0))
    outputs = {}
    for name, low, high in ends:
        limit = add(material, "Clamp", {"Value": parts.outputs[name], "Min": low, "Max": high})
        outputs[name] = limit.outputs[0]
    joined = add(material, "CombineColor", outputs)
    larger = add(
        material, "VectorMath", {"Vector": joined.outputs[0], "Vector_001": (0.1, 0.3, 0.0)}, operation="MAXIMUM"
    )
    assert_like_cycles(material, larger.outputs[0])
    feed_color(material, joined.outputs[0], "Roughness")
    (note,) = read(material).notes["Roughness"]
    assert "weighs the channels of a texture" in note


@pytest.mark.parametrize("extend", ["HORIZONTAL", "EXTRAPOLATED"])
def test_a_straight_curve_of_values_outside_0_to_1(material, extend):
    curves = add(material, "RGBCurve", {"Color": texture(material, wide_image()).outputs[0]})
    points = curves.mapping.curves[1].points
    points[0].location, points[1].location = (0.0, 1.0), (1.0, 0.0)
    curves.mapping.extend = extend
    curves.mapping.update()
    assert_like_cycles(material, curves.outputs[0])


def test_limits_that_bytes_cannot_reach_are_left_out(material):
    """The feed of bytes is the one without a limit, so it can be weighed further."""
    node = texture(material)
    mixed = mix_color(material, 1.0, node.outputs[0], (0.9, 0.5, 0.2, 1.0), blend_type="MULTIPLY", clamp_result=True)
    assert assert_like_cycles(material, mixed).limits == Limits()


def test_a_factor_of_shaders_is_limited(material):
    value, prepare = wide_number(material, "FLOAT")
    mix = add(material, "MixShader", {0: value, 1: add(material, "BsdfTransparent").outputs[0]})
    material.node_tree.links.new(principled(material).outputs[0], mix.inputs[2])
    surface(material, mix.outputs[0])
    alpha = read(material).feeds["Alpha"]
    obj = feeds.square(material)
    prepare(obj.data)
    shown = feeds.evaluate(alpha, ImageTextures(), obj.data, 16)
    assert (shown.min(), shown.max()) == (0.0, 1.0)


@pytest.mark.parametrize("is_float", [True, False])
def test_a_value_of_colors_below_0_is_named(material, is_float):
    """Blender computes hue and saturation of them, which do not come back."""
    inputs = {"Vector": texture(material).outputs[0], "Vector_001": (0.5,) * 3}
    lower = add(material, "VectorMath", inputs, operation="SUBTRACT")
    source = texture(material, wide_image()).outputs[0] if is_float else lower.outputs[0]
    changed = add(material, "HueSaturation", {"Color": source, "Value": 0.6})
    found = feed_color(material, changed.outputs[0])
    assert "Base Color" not in found.feeds
    (note,) = found.notes["Base Color"]
    assert note.endswith('because the node "Hue/Saturation/Value" changes colors below 0.')


def test_a_value_of_bright_colors(material):
    bright = wide_image()
    pixels = np.abs(np.array(bright.pixels[:]))
    bright.pixels[:] = pixels
    changed = add(material, "HueSaturation", {"Color": texture(material, bright).outputs[0], "Value": 0.6})
    assert_like_cycles(material, changed.outputs[0])


@pytest.mark.parametrize("kind", ["Cubic", "Smart"])
def test_an_interpolation_that_the_map_does_not_have_is_named(material, kind):
    node = texture(material)
    node.interpolation = kind
    assert feed_color(material, node.outputs[0]).notes["Base Color"] == (
        f'Material "Rust": Base Color: the {kind.lower()} interpolation of the node "Image Texture" is linear in the map.',
    )


def test_a_straight_ramp(material):
    node = texture(material, image(space="Non-Color"))
    parts = add(material, "SeparateColor", {"Color": node.outputs[0]})
    ramp = add(material, "ValToRGB", {"Fac": parts.outputs["Blue"]})
    ramp.color_ramp.elements[0].color = (0.9, 0.2, 0.1, 1.0)
    ramp.color_ramp.elements[1].color = (0.1, 0.4, 0.8, 1.0)
    assert_like_cycles(material, ramp.outputs["Color"])


def test_a_bent_ramp_is_named(material):
    node = texture(material)
    ramp = add(material, "ValToRGB", {"Fac": node.outputs[0]})
    ramp.color_ramp.elements.new(0.2).color = (1, 0, 0, 1)
    found = feed_color(material, ramp.outputs["Color"])
    assert "Base Color" not in found.feeds
    (note,) = found.notes["Base Color"]
    assert note == (
        'Material "Rust": Base Color is left out, because the node "Color Ramp" changes a texture along a curve.'
    )


@pytest.mark.parametrize("is_byte", [True, False])
def test_color_attributes(material, is_byte):
    node = add(material, "VertexColor", layer_name="paint")

    def prepare(data):
        data.color_attributes.new("paint", "BYTE_COLOR" if is_byte else "FLOAT_COLOR", "CORNER")
        colors = np.random.default_rng(3).uniform(0, 1, (4, 4)).astype(np.float32)
        data.color_attributes["paint"].data.foreach_set("color", colors.ravel())

    assert assert_like_cycles(material, node.outputs["Color"], prepare=prepare) == AttributeFeed("paint")


@pytest.mark.parametrize("output", ["Color", "Vector", "Fac", "Alpha"])
@pytest.mark.parametrize(
    ("kind", "domain"),
    [("FLOAT", "POINT"), ("INT", "FACE"), ("BOOLEAN", "CORNER"), ("FLOAT_VECTOR", "POINT"), ("FLOAT_COLOR", "CORNER")]
    + [("FLOAT_COLOR", "POINT"), ("FLOAT_COLOR", "FACE"), ("FLOAT2", "CORNER")],
)
def test_attributes(material, output, kind, domain):
    if (kind, output) == ("FLOAT2", "Fac"):
        return  # Cycles takes the mean of two components, EEVEE that of three
    node = add(material, "Attribute", attribute_name="own")

    def prepare(data):
        attribute = data.attributes.new("own", kind, domain)
        random = np.random.default_rng(4).uniform(0.2, 1.0, (len(attribute.data), 4))
        width, name = {"FLOAT_VECTOR": (3, "vector"), "FLOAT2": (2, "vector"), "FLOAT_COLOR": (4, "color")}.get(
            kind, (1, "value")
        )
        values = random[:, :width].ravel()
        values = {"INT": np.rint(values * 3).astype(np.int32), "BOOLEAN": values > 0.5}.get(kind, values.astype("f4"))
        attribute.data.foreach_set(name, values)

    assert_like_cycles(material, next(s for s in node.outputs if s.identifier == output), prepare=prepare)


def test_groups_reroutes_and_muted_nodes(material):
    """An image passes a reroute, two levels of a group and a muted node, and is multiplied in the group."""
    inner = bpy.data.node_groups.new("inner", "ShaderNodeTree")
    inner.interface.new_socket("In", in_out="INPUT", socket_type="NodeSocketColor")
    inner.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketColor")
    start, end = inner.nodes.new("NodeGroupInput"), inner.nodes.new("NodeGroupOutput")
    invert = add(inner, "Invert", {"Color": start.outputs[0]})
    muted = add(inner, "Gamma", {"Color": invert.outputs[0], "Gamma": 3.0})
    muted.mute = True
    inner.links.new(muted.outputs[0], end.inputs[0])
    outer = bpy.data.node_groups.new("outer", "ShaderNodeTree")
    outer.interface.new_socket("In", in_out="INPUT", socket_type="NodeSocketColor")
    outer.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketColor")
    start, end = outer.nodes.new("NodeGroupInput"), outer.nodes.new("NodeGroupOutput")
    group = add(outer, "Group", node_tree=inner)
    outer.links.new(start.outputs[0], group.inputs[0])
    outer.links.new(group.outputs[0], end.inputs[0])
    node = texture(material)
    reroute = material.node_tree.nodes.new("NodeReroute")
    material.node_tree.links.new(node.outputs[0], reroute.inputs[0])
    once, twice = (add(material, "Group", node_tree=outer) for _ in range(2))
    material.node_tree.links.new(reroute.outputs[0], once.inputs[0])
    material.node_tree.links.new(once.outputs[0], twice.inputs[0])
    assert_like_cycles(material, once.outputs[0])
    assert assert_like_cycles(material, twice.outputs[0]).scale == (1.0, 1.0, 1.0)


def test_the_sockets_of_a_group_do_not_convert(material):
    group = bpy.data.node_groups.new("gray", "ShaderNodeTree")
    group.interface.new_socket("In", in_out="INPUT", socket_type="NodeSocketFloat")
    group.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketColor")
    start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    group.links.new(start.outputs[0], end.inputs[0])
    node = texture(material)
    used = add(material, "Group", node_tree=group)
    material.node_tree.links.new(node.outputs[0], used.inputs[0])
    assert assert_like_cycles(material, used.outputs[0]).channel is None


def test_a_reroute_or_a_muted_node_has_no_value_of_its_own(material):
    """A link from one without an input does not count: the value of the connected socket does."""
    reroute = material.node_tree.nodes.new("NodeReroute")
    muted = add(material, "Invert", {"Color": (1.0, 0.0, 0.0, 1.0)})
    muted.mute = True
    for output in (reroute.outputs[0], muted.outputs[0]):
        found = assert_like_cycles(material, output)
        assert found.color == pytest.approx((0.8, 0.8, 0.8, 1.0))


def test_the_active_output_of_a_group_counts(material):
    group = bpy.data.node_groups.new("two", "ShaderNodeTree")
    group.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketColor")
    ends = [group.nodes.new("NodeGroupOutput") for _ in range(3)]
    for place, end in enumerate(ends):
        group.links.new(add(group, "Value").outputs[0], end.inputs[0])
        end.inputs[0].links[0].from_node.outputs[0].default_value = place / 4
    ends[1].is_active_output = True
    used = add(material, "Group", node_tree=group)
    assert assert_like_cycles(material, used.outputs[0]).color[0] == 0.25


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_number_of_an_image_of_which_one_channel_is_left(material, place):
    tint = [0.0, 0.0, 0.0, 1.0]
    tint[place] = 0.5
    inputs = {"Fac": 1.0, "Color1": texture(material).outputs[0], "Color2": tint}
    mix = add(material, "MixRGB", inputs, blend_type="MULTIPLY")
    assert assert_like_cycles(material, mix.outputs[0], "Roughness").channel == place


def test_a_number_of_an_image_with_a_tint_is_named(material):
    inputs = {"Fac": 1.0, "Color1": texture(material).outputs[0], "Color2": (0.9, 0.5, 0.2, 1.0)}
    mix = add(material, "MixRGB", inputs, blend_type="MULTIPLY")
    found = feed_color(material, mix.outputs[0], "Roughness")
    assert "Roughness" not in found.feeds
    assert found.notes["Roughness"] == (
        'Material "Rust": Roughness is left out, because the shader "Principled BSDF" weighs the channels of a texture.',
    )


def test_a_muted_link_does_not_count(material):
    node = texture(material)
    material.node_tree.links.new(node.outputs[0], principled(material).inputs["Base Color"]).is_muted = True
    assert isinstance(read(material).feeds["Base Color"], Constant)


def test_a_product_of_two_textures_is_named(material):
    node = texture(material)
    paint = add(material, "VertexColor", layer_name="paint")
    mix = add(
        material, "MixRGB", {"Fac": 1.0, "Color1": paint.outputs[0], "Color2": node.outputs[0]}, blend_type="MULTIPLY"
    )
    found = feed_color(material, mix.outputs[0])
    assert isinstance(found.feeds["Base Color"], ImageFeed)
    (note,) = found.notes["Base Color"]
    assert note == (
        'Material "Rust": Base Color: the node "Mix (Legacy)" multiplies two textures, of which the map has the image.'
    )


def test_a_mix_of_two_images_is_left_out(material):
    mix = add(material, "MixRGB", {"Fac": 0.5, "Color1": texture(material).outputs[0]})
    material.node_tree.links.new(texture(material, image("other", seed=2)).outputs[0], mix.inputs[2])
    found = feed_color(material, mix.outputs[0])
    assert "Base Color" not in found.feeds
    assert found.notes["Base Color"] == (
        'Material "Rust": Base Color is left out, because the node "Mix (Legacy)" combines two textures.',
    )


def test_an_input_without_influence_may_be_anything(material):
    noise = add(material, "TexNoise")
    node = texture(material)
    mix = add(material, "MixRGB", {"Fac": 0.0, "Color1": node.outputs[0], "Color2": noise.outputs["Color"]})
    assert_like_cycles(material, mix.outputs[0])


def test_emission_is_color_times_strength(material):
    node = texture(material)
    principled(material).inputs["Emission Strength"].default_value = 2.5
    found = feed_color(material, node.outputs[0], "Emission Color")
    assert found.feeds["Emission Color"].scale == (2.5, 2.5, 2.5)
    assert found.notes == {}


@pytest.mark.parametrize("image_is_color", [True, False])
def test_emission_of_two_textures_is_named(material, image_is_color):
    outputs = [texture(material).outputs[0], add(material, "VertexColor", layer_name="paint").outputs[0]]
    color, strength = outputs if image_is_color else outputs[::-1]
    material.node_tree.links.new(strength, principled(material).inputs["Emission Strength"])
    found = feed_color(material, color, "Emission Color")
    assert isinstance(found.feeds["Emission Color"], ImageFeed)
    assert found.notes["Emission Color"] == (
        'Material "Rust": Emission Color: two textures are multiplied, of which the map has one.',
    )


def test_emission_without_strength_is_black_whatever_feeds_it(material):
    found = feed_color(material, add(material, "TexNoise").outputs["Color"], "Emission Color")
    assert found.feeds["Emission Color"].color[:3] == (0.0, 0.0, 0.0)
    assert found.notes == {}


def test_what_cannot_be_followed_is_named_for_its_socket_alone(material):
    noise = add(material, "TexNoise")
    feed_color(material, noise.outputs[0], "Roughness")
    found = feed_color(material, texture(material).outputs[0])
    assert set(found.notes) == {"Roughness"}
    assert found.notes["Roughness"] == (
        'Material "Rust": Roughness is left out, because Imprint cannot follow the node "Noise Texture".',
    )
    assert "Roughness" not in found.feeds
    assert isinstance(found.feeds["Base Color"], ImageFeed)


def test_other_coordinates_are_named(material):
    node = texture(material)
    material.node_tree.links.new(add(material, "TexCoord").outputs["Object"], node.inputs[0])
    (note,) = feed_color(material, node.outputs[0]).notes["Base Color"]
    assert note.endswith('because the node "Texture Coordinate" gives Object coordinates.')


@pytest.mark.parametrize(
    ("name", "value"),
    [("translation", (0, 0.1, 0)), ("rotation", (0, 0, 0.1)), ("scale", (2, 1, 1)), ("use_min", True), ("use_max", True),
     ("mapping_x", "Y"), ("mapping_y", "NONE")],
)  # fmt: skip
def test_a_mapping_in_the_image_node_is_named(material, name, value):
    node = texture(material)
    setattr(node.texture_mapping, name, value)
    (note,) = feed_color(material, node.outputs[0]).notes["Base Color"]
    assert note.endswith('because the node "Image Texture" has a texture mapping of its own.')


def test_a_vector_mapping_has_no_location(material):
    """Blender hides it, and keeps its value."""
    mapping = add(material, "Mapping", {"Vector": add(material, "UVMap", uv_map="UVMap").outputs[0]})
    mapping.inputs["Location"].default_value = (0.3, 0.4, 0.0)
    mapping.vector_type = "VECTOR"
    node = texture(material)
    material.node_tree.links.new(mapping.outputs[0], node.inputs[0])
    assert_like_cycles(material, node.outputs["Color"])


def test_only_the_wanted_sockets_are_read(material):
    """Images of formats whose header Imprint does not read are loaded for their size."""
    node = texture(material)
    bump = add(material, "Bump", {"Height": node.outputs["Color"]})
    for name, output in (("Base Color", node.outputs["Color"]), ("Normal", bump.outputs["Normal"])):
        material.node_tree.links.new(output, principled(material).inputs[name])
    images = ImageTextures()
    (found,) = read_materials([material], images, {"Roughness"})
    assert list(found.feeds) == ["Roughness"]
    assert found.detail is None
    assert images == ImageTextures()
    (found,) = read_materials([material], images, {"Normal"})
    assert found.feeds == {}
    assert found.detail is not None


def test_no_material_is_blenders_gray():
    (found,) = read_materials([None], ImageTextures())
    assert found.name == "none"
    assert found.feeds["Base Color"].color == (0.8, 0.8, 0.8, 1.0)
    assert found.feeds["Roughness"].color[0] == 0.5
    assert found.feeds["Metallic"].color[0] == 0.0


def test_a_material_without_a_shader_is_named(material):
    material.node_tree.nodes.clear()
    assert read(material).notes == {
        "": ('Material "Rust": its shader is left out, because it has no Material Output.',)
    }
    add(material, "OutputMaterial")
    assert read(material).notes == {"": ('Material "Rust": its shader is left out, because it has no shader.',)}


def surface(material, output):
    material.node_tree.links.new(output, material.node_tree.get_output_node("CYCLES").inputs["Surface"])


def test_diffuse_and_emission_shaders_count_as_base_color(material):
    node = texture(material)
    surface(material, add(material, "BsdfDiffuse", {"Color": node.outputs[0]}).outputs[0])
    found = read(material)
    assert isinstance(found.feeds["Base Color"], ImageFeed)
    assert found.feeds["Roughness"].color[0] == 1.0
    assert found.notes[""] == (
        'Material "Rust": the shader "Diffuse BSDF" is no Principled BSDF; its color counts as base color.',
    )
    surface(material, add(material, "Emission", {"Color": node.outputs[0], "Strength": 3.0}).outputs[0])
    found = read(material)
    assert found.feeds["Emission Color"].scale == (3.0, 3.0, 3.0)
    assert found.feeds["Base Color"].scale == (1.0, 1.0, 1.0)


@pytest.mark.parametrize("transparent_first", [True, False])
def test_a_mix_with_transparency_is_alpha(material, transparent_first):
    node = texture(material, image(alpha=True))
    clear = add(material, "BsdfTransparent")
    mix = add(material, "MixShader", {0: node.outputs["Alpha"]})
    shaders = (clear.outputs[0], principled(material).outputs[0])
    for place, output in enumerate(shaders if transparent_first else shaders[::-1]):
        material.node_tree.links.new(output, mix.inputs[1 + place])
    surface(material, mix.outputs[0])
    found = feed_color(material, node.outputs[0])
    alpha = found.feeds["Alpha"]
    assert (alpha.channel, alpha.scale[0], alpha.offset[0]) == ((3, 1.0, 0.0) if transparent_first else (3, -1.0, 1.0))
    assert isinstance(found.feeds["Base Color"], ImageFeed)
    assert found.notes == {}


def test_a_mix_of_two_shaders_is_followed(material):
    principled(material).inputs["Roughness"].default_value = 0.2
    mix = add(material, "MixShader", {0: 0.25, 1: add(material, "BsdfDiffuse", {"Color": (0.4, 0, 0, 1)}).outputs[0]})
    material.node_tree.links.new(principled(material).outputs[0], mix.inputs[2])
    surface(material, mix.outputs[0])
    found = read(material)
    assert found.feeds["Roughness"].color[0] == pytest.approx(0.75 + 0.25 * 0.2)
    assert found.feeds["Base Color"].color[:3] == pytest.approx((0.75 * 0.4 + 0.25 * 0.8, 0.2, 0.2))
    assert found.feeds["Specular IOR Level"].color[0] == pytest.approx(0.5)
    assert found.notes == {
        "": ('Material "Rust": the shader "Diffuse BSDF" is no Principled BSDF; its color counts as base color.',)
    }


@pytest.mark.parametrize("kind", ["AddShader", "MixShader"])
def test_a_sum_and_a_mix_with_an_emission_are_named_by_label_and_name(material, kind):
    principled(material).label = "Paint"
    node = add(material, kind)
    sockets = [socket for socket in node.inputs if socket.type == "SHADER"]
    other = add(material, "Emission") if kind == "MixShader" else add(material, "BsdfPrincipled", label="Paint")
    for socket, shader in zip(sockets, (principled(material), other), strict=True):
        material.node_tree.links.new(shader.outputs[0], socket)
    surface(material, node.outputs[0])
    (note,) = read(material).notes[""]
    assert note.endswith('of which the maps have "Paint" (Principled BSDF).')


def test_normals_of_two_shaders_are_named(material):
    bump = add(material, "Bump", {"Height": texture(material).outputs["Color"]})
    other = add(material, "BsdfPrincipled", {"Normal": bump.outputs[0]}, label="Rust")
    mix = add(material, "MixShader", {0: 0.5, 1: principled(material).outputs[0], 2: other.outputs[0]})
    surface(material, mix.outputs[0])
    (note,) = read(material).notes["Normal"]
    assert '"Mix Shader" mixes normals, of which the map has those of "Rust" (Principled BSDF.001).' in note
    material.node_tree.links.new(bump.outputs[0], principled(material).inputs["Normal"])
    assert read(material).notes == {}
    assert read(material).detail is not None


def test_many_mixes_of_each_other_end(material):
    """Each leads to the two before it: without an end, 40 of them would be 10^8 shaders."""
    first, second = principled(material).outputs[0], add(material, "BsdfPrincipled").outputs[0]
    for _ in range(29):
        first, second = second, add(material, "MixShader", {0: 0.5, 1: first, 2: second}).outputs[0]
    surface(material, second)
    assert "Base Color" in read(material).feeds


def test_transparency_is_multiplied(material):
    """A mix in a mix, and the alpha of the Principled BSDF."""
    output = principled(material).outputs[0]
    principled(material).inputs["Alpha"].default_value = 0.9
    for factor in (0.5, 0.25):
        mix = add(material, "MixShader", {0: factor, 1: output, 2: add(material, "BsdfTransparent").outputs[0]})
        output = mix.outputs[0]
    surface(material, output)
    assert read(material).feeds["Alpha"].color[0] == pytest.approx(0.9 * 0.5 * 0.75)
    assert read(material).notes == {}


def test_mixes_that_share_shaders_are_read_once(material):
    """Without memory, 25 mixes that use the one before twice would take 2^25 steps."""
    output = principled(material).outputs[0]
    for _ in range(25):
        output = add(material, "MixShader", {0: 0.5, 1: output, 2: output}).outputs[0]
    surface(material, output)
    assert "Base Color" in read(material).feeds
    for _ in range(25):
        output = add(material, "AddShader", {0: output, 1: output}).outputs[0]
    surface(material, output)
    (note,) = read(material).notes[""]
    assert note.endswith("because more than 30 shaders follow each other.")


def test_circles_end(material):
    first, second = (add(material, "Invert") for _ in range(2))
    material.node_tree.links.new(first.outputs[0], second.inputs["Color"])
    material.node_tree.links.new(second.outputs[0], first.inputs["Color"])
    own = add(material, "Invert")
    material.node_tree.links.new(own.outputs[0], own.inputs["Color"])
    assert "Base Color" in feed_color(material, own.outputs[0]).feeds
    feed_color(material, first.outputs[0])


def test_nodes_that_share_inputs_are_read_once(material):
    """Without memory, 50 nodes that use the one before twice would take 2^50 steps."""
    output = add(material, "Value").outputs[0]
    vector = add(material, "UVMap").outputs[0]
    for _ in range(50):
        output = add(material, "Math", {"Value": output, "Value_001": output}, operation="MAXIMUM").outputs[0]
        vector = add(material, "VectorMath", {"Vector": vector, "Vector_001": vector}, operation="SUBTRACT").outputs[0]
    node = texture(material)
    material.node_tree.links.new(vector, node.inputs[0])
    feed_color(material, output, "Roughness")
    assert "Base Color" in feed_color(material, node.outputs[0]).feeds


def test_long_chains_are_named(material):
    output = texture(material).outputs[0]
    for _ in range(200):
        output = add(material, "Invert", {"Color": output}).outputs[0]
    (note,) = feed_color(material, output).notes["Base Color"]
    assert note.endswith("because more than 60 nodes follow each other.")


# Detail normals


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


# Random materials


RANDOM_SIZE = 48
RANDOM_BORDERS = 0.05
"""The largest share of texels on borders of pixels, where rounding decides."""


def images_for(source):
    found = [image(f"image {place}", (4 + place, 3), seed=source.randrange(1000), space=space)
             for place, space in enumerate(("sRGB", "Non-Color"))]  # fmt: skip
    gone = bpy.data.images.new("gone", 1, 1)
    gone.source, gone.filepath = "FILE", "//gone.png"
    return [*found, gone]


@random_cases.seeds(60, fast=2)
def test_each_socket_is_a_feed_or_a_note_seed(seed, material):
    source = random.Random(seed)
    images = images_for(source)
    for name in ("inner", "outer"):
        group = bpy.data.node_groups.new(name, "ShaderNodeTree")
        for place in range(3):
            kind = source.choice(["NodeSocketColor", "NodeSocketFloat", "NodeSocketVector"])
            group.interface.new_socket(str(place), in_out=source.choice(["INPUT", "OUTPUT"]), socket_type=kind)
        start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
        grow(group, source, FOLLOWED + OTHERS, 6, images)
        for socket in end.inputs[:-1]:
            group.links.new(source.choice([out for node in group.nodes for out in node.outputs]), socket)
        assert start.outputs
    grow(material.node_tree, source, FOLLOWED * 3 + OTHERS + SHADERS, 30, images)
    shader = principled(material)
    outputs = [output for node in material.node_tree.nodes for output in node.outputs]
    for socket in shader.inputs:
        if source.random() < 0.7:
            material.node_tree.links.new(source.choice(outputs), socket)
    if source.random() < 0.5:
        surface = material.node_tree.get_output_node("ALL").inputs["Surface"]
        material.node_tree.links.new(source.choice([o for o in outputs if o.type == "SHADER"]), surface)
    found = read(material)
    assert all(
        note.startswith('Material "Rust": ') and note.endswith(".") for notes in found.notes.values() for note in notes
    )
    if "" not in found.notes:
        # Another Principled BSDF of the tree may be the surface, with other settings.
        inputs = [s for n in material.node_tree.nodes if n.bl_idname == shader.bl_idname for s in n.inputs]
        sockets = {socket.name for socket in inputs if socket.enabled and socket.type in {"RGBA", "VALUE"}}
        assert set(found.feeds) | set(found.notes) >= sockets - {"Subsurface IOR"}
        assert set(found.feeds) <= sockets
    images = ImageTextures()
    for feed in found.feeds.values():
        if hasattr(feed, "image"):
            assert images.load(feed.image).values.size


@random_cases.seeds(100, fast=2)
def test_feeds_without_notes_are_what_cycles_shows_seed(seed, material):
    source = random.Random(seed)
    images = [*images_for(source)[:2], image("wide", (4, 3), seed=seed, space="Non-Color", ends=(-1.0, 2.0))]
    grow(material.node_tree, source, ["TexImage"], 2, images, is_sound=True)
    grow(material.node_tree, source, FOLLOWED, source.randrange(1, 6), images, is_sound=True)
    outputs = [o for node in material.node_tree.nodes for o in node.outputs if o.enabled and o.type != "SHADER"]
    output = outputs[-1 - source.randrange(min(3, len(outputs)))]
    material.node_tree.links.new(output, principled(material).inputs["Base Color"])
    found = read(material)
    if "Base Color" in found.notes:
        return
    obj = feeds.square(material, ((0.03, 0.02), (1.9, -0.3), (2.4, 1.7), (0.53, 2.02)))
    colors = np.random.default_rng(seed).uniform(0.1, 2, (4, 4)).astype(np.float32)
    obj.data.color_attributes.new("paint", "FLOAT_COLOR", "CORNER").data.foreach_set("color", colors.ravel())
    feed = found.feeds["Base Color"]
    if getattr(feed, "name", "paint") == "missing":
        return
    if (getattr(feed, "name", ""), getattr(feed, "channel", 0)) == ("UVMap", AVERAGE):
        return  # Cycles takes the mean of two components, EEVEE that of three
    mine = feeds.evaluate(feed, ImageTextures(), obj.data, RANDOM_SIZE)
    theirs = feeds.cycles(obj, output, RANDOM_SIZE)
    # Emission has no negative light.
    scale = max(1.0, np.abs(mine).max())
    wrong = np.abs(mine.clip(0.0, None) - theirs.clip(0.0, None)).max(axis=-1) > TOLERANCE * scale
    assert wrong.mean() < RANDOM_BORDERS, (output.node.name, output.name, feed, mine[10, 10], theirs[10, 10])


# Imported materials


def png(path, seed, channels=3):
    values = np.random.default_rng(seed).integers(0, 256, (4, 6, channels)).astype(np.uint8)
    feeds.write_png(path, values)
    return values


def stored(feed) -> np.ndarray:
    """The pixels of a feed's image, as 8 bits if it is data."""
    return ImageTextures().load(feed.image).values[..., :3] * 255


OBJ = """mtllib scan.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl one
f 1/1 2/2 3/3 4/4
usemtl two
f 1/1 3/3 4/4
usemtl three
f 1/1 2/2 4/4
"""
MTL = """newmtl one
Kd 0.8 0.7 0.6
Ke 1 1 1
map_Kd -s 2 3 1 -o 0.25 0.5 0 color.png
map_Bump -bm 0.4 normal.png
map_d alpha.png
map_Ke emission.png
map_Pr rough.png
newmtl two
Kd 0.2 0.3 0.4
Pr 0.3
Pm 1.0
newmtl three
map_Kd gone.png
"""


@pytest.fixture
def scan(tmp_path):
    """The materials of an OBJ file, by name."""
    (tmp_path / "scan.obj").write_text(OBJ)
    (tmp_path / "scan.mtl").write_text(MTL)
    for seed, name in enumerate(("color", "normal", "alpha", "emission", "rough")):
        png(tmp_path / f"{name}.png", seed, 4 if name == "alpha" else 3)
    bpy.ops.wm.obj_import(filepath=str(tmp_path / "scan.obj"))
    return {material.name: read(material) for material in bpy.data.materials}


def test_the_textures_of_an_obj_file(scan):
    found = scan["one"]
    assert found.notes == {}
    images = ("Base Color", "Emission Color", "Roughness", "Alpha")
    assert all(isinstance(found.feeds[name], ImageFeed) for name in images)
    assert len({found.feeds[name].image for name in images}) == 4
    assert found.feeds["Base Color"].mapping == ((2.0, 0.0, 0.25), (0.0, 3.0, 0.5))
    assert found.feeds["Alpha"].channel == 3
    assert isinstance(found.detail, NormalMapFeed)
    assert found.detail.strength == pytest.approx(0.4)


def test_the_numbers_of_an_obj_file(scan):
    found = scan["two"]
    assert found.notes == {}
    assert found.feeds["Base Color"].color[:3] == pytest.approx((0.2, 0.3, 0.4))
    assert found.feeds["Roughness"].color[0] == pytest.approx(0.3)
    assert found.feeds["Metallic"].color[0] == 1.0


def test_a_missing_texture_of_an_obj_file_is_named(scan, tmp_path):
    found = scan["three"]
    assert "Base Color" not in found.feeds
    assert found.notes["Base Color"] == (
        'Material "three": Base Color is left out, because the image "gone.png" has no pixels: '
        f"{tmp_path / 'gone.png'} cannot be read.",
    )


def gltf(tmp_path, material, extensions=(), *, has_colors=False):
    """The material of a glTF file of one triangle with two UV sets, as Blender imports it."""
    positions = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    uv = struct.pack("<6f", 0, 0, 1, 0, 0, 1)
    colors = struct.pack("<12f", *(0.25,) * 12)
    buffer = positions + uv + colors
    (tmp_path / "data.bin").write_bytes(buffer)
    attributes = {"POSITION": 0, "TEXCOORD_0": 1, "TEXCOORD_1": 1} | ({"COLOR_0": 2} if has_colors else {})
    images = ("base", "orm", "normal", "emission")
    for seed, name in enumerate(images):
        png(tmp_path / f"{name}.png", seed, 4 if name == "base" else 3)
    views = [(0, 36), (36, 24), (60, 48)]
    accessors = [("VEC3", {"min": [0, 0, 0], "max": [1, 1, 0]}), ("VEC2", {}), ("VEC4", {})]
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": list(extensions),
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "material": 0}]}],
        "materials": [{"name": "Rust", **material}],
        "textures": [{"source": place} for place in range(len(images))],
        "images": [{"uri": f"{name}.png"} for name in images],
        "buffers": [{"uri": "data.bin", "byteLength": len(buffer)}],
        "bufferViews": [{"buffer": 0, "byteOffset": start, "byteLength": length} for start, length in views],
        "accessors": [
            {"bufferView": place, "componentType": 5126, "count": 3, "type": kind, **limits}
            for place, (kind, limits) in enumerate(accessors)
        ],
    }
    (tmp_path / "scan.gltf").write_text(json.dumps(document))
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "scan.gltf"))
    return read(bpy.data.materials["Rust"])


def test_all_textures_of_a_gltf_file(tmp_path):
    found = gltf(
        tmp_path,
        {
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": 0},
                "metallicRoughnessTexture": {"index": 1, "texCoord": 1},
            },
            "normalTexture": {"index": 2, "scale": 0.7},
            "occlusionTexture": {"index": 1, "texCoord": 1},
            "emissiveTexture": {"index": 3},
            "emissiveFactor": [1, 1, 1],
            "alphaMode": "BLEND",
        },
    )
    assert found.notes == {}
    assert (found.feeds["Roughness"].channel, found.feeds["Metallic"].channel) == (1, 2)
    assert found.feeds["Roughness"].image == found.feeds["Metallic"].image
    assert found.feeds["Roughness"].uv_layer == "UVMap.001"
    assert found.feeds["Base Color"].image == found.feeds["Alpha"].image
    assert found.feeds["Alpha"].channel == 3
    assert isinstance(found.feeds["Emission Color"], ImageFeed)
    assert isinstance(found.detail, NormalMapFeed)
    assert found.detail.strength == pytest.approx(0.7)
    orm = np.random.default_rng(1).integers(0, 256, (4, 6, 3))
    assert np.abs(stored(found.feeds["Roughness"]) - orm).max() < 0.01


def test_factors_of_a_gltf_file(tmp_path):
    found = gltf(
        tmp_path,
        {
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": 0},
                "baseColorFactor": [0.5, 0.25, 1.0, 0.5],
                "metallicRoughnessTexture": {"index": 1},
                "roughnessFactor": 0.4,
                "metallicFactor": 0.6,
            },
            "emissiveTexture": {"index": 3},
            "emissiveFactor": [1.0, 0.5, 0.25],
            "alphaMode": "BLEND",
        },
    )
    assert found.notes == {}
    assert found.feeds["Base Color"].scale == pytest.approx((0.5, 0.25, 1.0))
    assert found.feeds["Alpha"].scale[0] == pytest.approx(0.5)
    assert found.feeds["Roughness"].scale[0] == pytest.approx(0.4)
    assert found.feeds["Metallic"].scale[0] == pytest.approx(0.6)
    assert found.feeds["Emission Color"].scale == pytest.approx((1.0, 0.5, 0.25))


def test_a_moved_texture_of_a_gltf_file(tmp_path):
    """The extension turns about the upper left corner; the images of glTF begin there."""
    moved = {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.5, "scale": [2.0, 3.0]}}
    found = gltf(
        tmp_path,
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": moved}}},
        moved,
    ).feeds["Base Color"]
    cos, sin = np.cos(0.5), np.sin(0.5)
    # The extension's matrix, on (u, 1 - v), and 1 - v of the result.
    matrix = np.array([[2.0 * cos, 3.0 * sin, 0.1], [-2.0 * sin, 3.0 * cos, 0.2], [0.0, 0.0, 1.0]])
    over = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]])
    assert np.array(found.mapping) == pytest.approx((over @ matrix @ over)[:2], abs=1e-5)


def test_a_cut_off_alpha_of_a_gltf_file_is_named(tmp_path):
    found = gltf(
        tmp_path,
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "alphaMode": "MASK", "alphaCutoff": 0.3},
    )
    alpha = found.feeds["Alpha"]
    assert (alpha.channel, alpha.scale[0], alpha.offset[0]) == (3, 1.0, 0.0)
    assert set(found.notes) == {"Alpha"}
    (note,) = found.notes["Alpha"]
    assert note.endswith("makes steps of a texture, of which the map has the values.")


def test_vertex_colors_of_a_gltf_file(tmp_path):
    found = gltf(tmp_path, {"pbrMetallicRoughness": {"baseColorFactor": [1.0, 0.5, 1.0, 1.0]}}, has_colors=True)
    assert found.notes == {}
    assert isinstance(found.feeds["Base Color"], AttributeFeed)
    assert found.feeds["Base Color"].scale == pytest.approx((1.0, 0.5, 1.0))


def test_a_product_of_texture_and_vertex_colors_is_named(tmp_path):
    found = gltf(tmp_path, {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}, has_colors=True)
    assert isinstance(found.feeds["Base Color"], ImageFeed)
    (note,) = found.notes["Base Color"]
    assert note.endswith("multiplies two textures, of which the map has the image.")


def test_an_unlit_material_of_a_gltf_file(tmp_path):
    """Scans often have it: its color is in the texture, and no light belongs to it."""
    found = gltf(
        tmp_path,
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "extensions": {"KHR_materials_unlit": {}}},
        ["KHR_materials_unlit"],
    )
    assert isinstance(found.feeds["Base Color"], ImageFeed)
    assert found.feeds["Base Color"] == found.feeds["Emission Color"]


def test_ply_vertex_colors(tmp_path):
    lines = ["ply", "format ascii 1.0", "element vertex 3", *(f"property float {axis}" for axis in "xyz")]
    lines += [*(f"property uchar {name}" for name in ("red", "green", "blue")), "element face 1"]
    lines += ["property list uchar int vertex_indices", "end_header"]
    lines += ["0 0 0 255 0 0", "1 0 0 0 255 0", "0 1 0 0 0 255", "3 0 1 2"]
    (tmp_path / "scan.ply").write_text("\n".join(lines) + "\n")
    bpy.ops.wm.ply_import(filepath=str(tmp_path / "scan.ply"))
    colors = attribute_by_corner(bpy.context.object.data, "")
    assert np.abs(colors[:, :3] - np.eye(3)).max() < 1e-6
