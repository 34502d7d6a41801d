# SPDX-License-Identifier: GPL-3.0-or-later
"""A map of materials was asked for, and the high meshes have none: one value, which is said."""

import bpy
import numpy as np
import pytest

from tests.support import scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


def said(*highs, maps=("BASE_COLOR",), **settings):
    low = zoo.plane("lo")
    report = scenes.bake(low, *highs, method="CAST", maps=maps, size=16, **settings)
    return [text for text in report.warnings if text.startswith("Nothing was found")]


def with_attribute(obj, name, kind="FLOAT", domain="POINT"):
    layer = obj.data.attributes.new(name, kind, domain)
    width = {"FLOAT": 1, "FLOAT_COLOR": 4}[kind]
    values = np.linspace(0.0, 1.0, width * len(layer.data), dtype=np.float32)
    layer.data.foreach_set("value" if width == 1 else "color", values)
    return obj


def high(name="hi"):
    return zoo.terrain(name, 8, height=0.05)


def test_a_high_mesh_without_material_and_colors():
    assert said(high()) == [
        "Nothing was found for the base color map, which is one value: 'hi' has no material and no colors. Give it one."
    ]
    assert said(high(), high("other"), maps=("BASE_COLOR", "ROUGHNESS")) == [
        "Nothing was found for the base color map, roughness map, which are one value: 'hi.001', 'other' have no material and "
        "no colors. Give them one."
    ]


def test_colors_under_other_names_are_named():
    """As files of scans have them. By its name, the attribute map shows one."""
    scan = with_attribute(with_attribute(high(), "diffuse_red"), "diffuse_green")
    (sentence,) = said(scan)
    assert sentence.endswith(
        "'hi' has no material. The attribute map shows one of its attributes: 'diffuse_red', 'diffuse_green'."
    )
    assert not said(scan, maps=("ATTRIBUTE",), attribute="diffuse_red")


def test_what_has_something_is_left_alone():
    colored = with_attribute(high(), "Col", "FLOAT_COLOR")
    assert not said(colored)  # shown without a material
    plain, painted = high("plain"), high("painted")
    scenes.material("paint", painted, Base_Color=(0.2, 0.4, 0.6))
    assert not said(painted)
    assert not said(plain, painted)


def test_maps_that_need_no_material_are_left_alone():
    assert not said(high(), maps=("AO", "HEIGHT"))
    assert not said(high(), maps=())


def test_a_packed_image_may_have_constants():
    """A preset packs occlusion with roughness and metallic, whatever the high mesh has."""
    assert not said(high(), maps=("AO",), pack="UNREAL")


def test_an_instance_and_a_curve_count():
    data = bpy.data.curves.new("pipe", "CURVE")
    data.dimensions, data.bevel_depth = "3D", 0.2
    data.splines.new("POLY").points.add(1)
    data.splines[0].points[0].co, data.splines[0].points[1].co = (-2.0, 0, 0, 1), (2.0, 0, 0, 1)
    (sentence,) = said(scenes.link(bpy.data.objects.new("pipe", data)))
    assert "'pipe' has no material" in sentence
