# SPDX-License-Identifier: GPL-3.0-or-later
"""Mix Shader of Principled BSDFs: each input is the mix of both, by Flatten and Cast, as its nodes say in numbers."""

import numpy as np
import pytest

from tests.support import maps, scenes
from tests.support.shader_nodes import add, principled

pytestmark = pytest.mark.usefixtures("gpu_context")

MOST_OFF = 2.0 / 255.0
SIDE = 16
NAMES = {"Base Color": "BASE_COLOR", "Roughness": "ROUGHNESS", "Metallic": "METALLIC", "Emission Color": "EMISSION"}
DICE = np.random.default_rng(8)
MASK, RUST, OTHER = (np.round(DICE.random((4, 4)), 3).repeat(4, 0).repeat(4, 1).astype(np.float32) for _ in range(3))
"""Of each texel: the images have one pixel for 4 x 4 of them."""


def closest(material, values, name):
    data = np.repeat(values[::4, ::4, None], 3, axis=2)
    shown = scenes.image(name, data, space="Non-Color", is_float=True)
    return add(material, "TexImage", image=shown, interpolation="Closest").outputs["Color"]


def second(material, **values):
    node = add(material, "BsdfPrincipled")
    for name, value in values.items():
        socket = node.inputs[name.replace("_", " ")]
        if hasattr(value, "is_output"):
            material.node_tree.links.new(value, socket)
        else:
            socket.default_value = value
    return node.outputs[0]


def gray(values):
    return np.repeat(np.broadcast_to(np.asarray(values, np.float32), (SIDE, SIDE))[..., None], 3, axis=2)


def constants(material):
    """Two colors and numbers, by an image."""
    principled(material).inputs["Base Color"].default_value = (0.6, 0.05, 0.05, 1)
    other = second(material, Base_Color=(0.05, 0.05, 0.6, 1), Roughness=0.9, Metallic=1.0)
    mix = add(material, "MixShader", {0: closest(material, MASK, "mask"), 1: principled(material).outputs[0], 2: other})
    color = np.array([0.6, 0.05, 0.05]) + gray(MASK) * np.array([-0.55, 0.0, 0.55])
    return mix, {
        "Base Color": color,
        "Roughness": gray(0.5 + 0.4 * MASK),
        "Metallic": gray(MASK),
        "Emission Color": gray(0),
    }


def images(material):
    """Images in both, by an image, which Cycles alone can evaluate. The emission has a strength."""
    tree = material.node_tree
    for name in ("Base Color", "Emission Color"):
        tree.links.new(closest(material, RUST, "rust"), principled(material).inputs[name])
    principled(material).inputs["Emission Strength"].default_value = 0.5
    other = second(
        material,
        Base_Color=closest(material, OTHER, "other"),
        Emission_Color=closest(material, OTHER, "glow"),
        Emission_Strength=1.5,
    )
    mix = add(material, "MixShader", {0: closest(material, MASK, "mask"), 1: principled(material).outputs[0], 2: other})
    color, glow = gray(RUST + (OTHER - RUST) * MASK), gray(0.5 * RUST + (1.5 * OTHER - 0.5 * RUST) * MASK)
    return mix, {"Base Color": color, "Roughness": gray(0.5), "Metallic": gray(0), "Emission Color": glow}


def nested(material):
    """A mix in a mix, with a third shader."""
    inner, found = constants(material)
    third = second(material, Base_Color=(0.2, 0.4, 0.2, 1), Roughness=0.1)
    mix = add(material, "MixShader", {0: closest(material, OTHER, "outer"), 1: inner.outputs[0], 2: third})
    to = {"Base Color": np.array([0.2, 0.4, 0.2]), "Roughness": 0.1, "Metallic": 0.0, "Emission Color": 0.0}
    return mix, {name: values + (to[name] - values) * gray(OTHER) for name, values in found.items()}


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
@pytest.mark.parametrize("setup", [constants, images, nested])
def test_each_input_is_the_mix(setup, method):
    low, high = scenes.planes("low", "high", height=0.01, slope=0.1)
    material = scenes.material("layered", high)
    mix, truth = setup(material)
    material.node_tree.links.new(mix.outputs[0], material.node_tree.get_output_node("CYCLES").inputs["Surface"])
    report, found = maps.bake_all_maps(low, high, maps=tuple(NAMES.values()), method=method, size=(SIDE, SIDE))
    assert report.warnings == []
    off = {
        name: float(np.abs(found[map_name.lower()][..., :3] - truth[name]).max()) for name, map_name in NAMES.items()
    }
    assert max(off.values()) < MOST_OFF, off


@pytest.mark.parametrize("exact", ["OFF", "AUTO"])
def test_what_cannot_be_followed_shows_one_and_names_it(exact):
    """Fresnel is not known at a point, and without Cycles an image by an image is not either."""
    low, high = scenes.planes("low", "high", height=0.01, slope=0.1)
    material = scenes.material("layered", high)
    mix, _ = images(material)
    if exact == "AUTO":
        material.node_tree.links.new(add(material, "Fresnel").outputs[0], mix.inputs[0])
    principled(material).label = "Paint"
    material.node_tree.links.new(mix.outputs[0], material.node_tree.get_output_node("CYCLES").inputs["Surface"])
    report, found = maps.bake_all_maps(low, high, maps=("BASE_COLOR",), size=(SIDE, SIDE), exact_materials=exact)
    (warning,) = report.warnings
    assert 'the map has that of "Paint" (Principled BSDF)' in warning
    assert np.abs(found["base_color"][..., :3] - gray(RUST)).max() < MOST_OFF
