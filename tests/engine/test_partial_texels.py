# SPDX-License-Identifier: GPL-3.0-or-later
"""Texels of which only some samples are on the low mesh: all maps are the means of the same samples."""

import numpy as np
import pytest

from tests.support import angles, layouts, scenes, zoo
from tests.support.layouts import Layout
from tests.support.maps import bake_all_maps

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 48
LOW = Layout(degrees=24.0, scale=0.34)
MAPS = ("AO", "THICKNESS", "CURVATURE", "BENT_NORMAL", "ROUGHNESS", "HEIGHT")


@pytest.mark.parametrize(("space", "has_detail"), [("TANGENT", True), ("WORLD", False)])
@pytest.mark.parametrize(("method", "samples", "rays"), [("FLATTEN", 4, 16), ("FLATTEN", 16, 17), ("CAST", 16, 17)])
def test_borders_are_means_of_the_samples_on_the_mesh(method, samples, rays, space, has_detail):
    """On a flat high mesh that reaches beyond the low one, each map has one value, also at its border."""
    low = layouts.square("lo", {zoo.LAYER: LOW})
    wide = Layout(LOW.degrees, scale=1.4 * LOW.scale)
    high = layouts.square("hi", {zoo.LAYER: wide})
    high.scale = (1.4, 1.4, 1.0)
    material = scenes.material("skin", Roughness=0.3)
    high.data.materials.append(material)
    if has_detail:
        node = material.node_tree.nodes.new("ShaderNodeNormalMap")
        flat = scenes.image("flat", np.full((4, 4, 3), (0.5, 0.5, 1.0)), space="Non-Color", is_float=True)
        material.node_tree.links.new(scenes.texture(material, flat).outputs[0], node.inputs["Color"])
        scenes.set_inputs(material, Normal=node.outputs[0])
    _, maps = bake_all_maps(low, high, maps=MAPS, size=SIZE, method=method, samples=samples, rays=rays, space=space)
    known = maps["height"][..., 3] == 1.0
    expected = {"ao": 1.0, "thickness": 1.0, "curvature": 0.5, "roughness": 0.3, "height": 0.0}
    assert known.mean() > 0.4
    for name, value in expected.items():
        found = maps[name]
        if space == "TANGENT" or method == "CAST":
            assert np.array_equal(found[..., 3] == 1.0, known), name
        assert np.abs(found[known, 0] - value).max() < 1e-3, (name, found[known, 0].min(), found[known, 0].max())
    whole = angles.eroded(known, 1)
    assert np.abs(maps["bent_normal"][whole, 2] - 1.0).max() < 0.02
    assert np.abs(np.linalg.norm(maps["bent_normal"][known, :3] * 2.0 - 1.0, axis=-1) - 1.0).max() < 1e-5
