# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that Flatten draws into a gpu.types.GPUOffScreen, with the same bits as in a framebuffer of textures."""

import bpy
import gpu
import numpy as np
import pytest

from addon.core import udim
from addon.passes import high_in_uv, mesh_upload, target
from tests.support import maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = (48, 32)


def triangle(into):
    """Draw one triangle with different normals at its corners into `into`. Returns the texels."""
    mesh = mesh_upload.upload(
        np.array([[0, 1, 2]], np.int32),
        uv=np.array([(0.1, 0.1), (0.9, 0.2), (0.4, 0.95)], np.float32),
        normal=np.array([(0.0, 0.1, 1.0), (0.7, -0.2, 0.4), (-0.3, 0.5, 0.6)], np.float32),
    )
    high_in_uv.draw_normals(into, [(mesh, np.eye(3))], udim.uv_to_clip(1001))
    return texels_of(into)


def texels_of(drawn):
    texels = np.empty((drawn.height, drawn.width, 4), np.float32)
    drawn.read(texels)
    return texels


@pytest.fixture
def made(monkeypatch):
    """All GPUOffScreens that the test creates."""
    found, make = [], gpu.types.GPUOffScreen

    def spy(*arguments, **options):
        found.append(make(*arguments, **options))
        return found[-1]

    monkeypatch.setattr(gpu.types, "GPUOffScreen", spy)
    target.common.free()
    yield found
    target.common.free()


@pytest.mark.parametrize("samples", [1, 4])
def test_flatten_draws_into_a_gpuoffscreen(made, samples):
    low, high = zoo.plane("lo"), zoo.terrain("hi")
    stored = maps.bake(low, high, space="OBJECT", size=SIZE, samples=samples, adaptive=False)
    assert [(one.width, one.height) for one in made] == [SIZE]
    held = np.empty((*SIZE[::-1], 4), np.float32)
    target.read(made[0].texture_color, held)
    assert len(np.unique(held)) > 1000
    assert np.allclose(stored[..., :3], held[..., :3] * 0.5 + 0.5, rtol=0, atol=1e-6)


def test_cast_creates_no_gpuoffscreen(made):
    maps.bake(zoo.plane("lo"), zoo.plane("hi"), method="CAST")
    assert made == []


def test_an_offscreen_and_a_framebuffer_get_the_same_bits():
    drawn = [triangle(kind(*SIZE, ("RGBA32F",))) for kind in (target.Target, target.Offscreen)]
    assert 0 < np.count_nonzero(drawn[0][..., 3]) < SIZE[0] * SIZE[1]
    assert np.array_equal(*drawn)


def test_the_depth_buffer_hides_nothing_after_a_script_left_depth_tests_on():
    expected = triangle(target.Offscreen(*SIZE, ("RGBA32F",)))
    gpu.state.depth_test_set("EQUAL")
    gpu.state.depth_mask_set(True)
    try:
        assert np.array_equal(triangle(target.Offscreen(*SIZE, ("RGBA32F",))), expected)
        assert gpu.state.depth_test_get() == "EQUAL"
    finally:
        gpu.state.depth_test_set("NONE")
        gpu.state.depth_mask_set(False)


def test_an_offscreen_is_kept_for_its_role_and_not_mixed_with_other_targets():
    with target.using(target.TargetPool()):
        plain = target.get("high", *SIZE, "RGBA32F")
        own = target.offscreen("high", *SIZE, "RGBA32F")
        assert own is not plain
        assert target.offscreen("high", *SIZE, "RGBA32F") is target.get("high", *SIZE, "RGBA32F") is own
        assert target.offscreen("high", *SIZE[::-1], "RGBA32F") is not own


def test_the_texture_stays_valid_after_the_offscreen_is_freed():
    own = target.Offscreen(*SIZE, ("RGBA32F",))
    expected, texture = triangle(own), own.texture
    del own
    found = np.empty_like(expected)
    target.read(texture, found)
    assert np.array_equal(found, expected)


def test_the_previous_framebuffer_is_bound_again():
    outer, own = target.Target(8, 8, ("RGBA32F",)), target.Offscreen(*SIZE, ("RGBA32F",))
    with target.drawing(outer):
        triangle(own)
        gpu.state.active_framebuffer_get().clear(color=(1.0, 2.0, 3.0, 4.0))
    assert (texels_of(outer) == (1.0, 2.0, 3.0, 4.0)).all()


def test_normals_that_compute_shaders_change_are_not_in_a_gpuoffscreen(made):
    """Its texture cannot be written by compute shaders on Vulkan and Metal."""
    low, high = zoo.plane("lo"), zoo.plane("hi")
    material = bpy.data.materials.new("bumpy")
    node = material.node_tree.nodes.new("ShaderNodeNormalMap")
    image = scenes.image("bumps", np.full((4, 4, 3), (0.6, 0.5, 0.9)), space="Non-Color")
    material.node_tree.links.new(scenes.texture(material, image).outputs["Color"], node.inputs["Color"])
    scenes.set_inputs(material, Normal=node.outputs["Normal"])
    high.data.materials.append(material)
    assert np.ptp(maps.bake(low, high, space="OBJECT", size=SIZE)[..., 0]) < 1e-6
    assert made == []
