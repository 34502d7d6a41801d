# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole bakes of widened roughness, compared with the closed form of a roof whose slopes are finer than a texel."""

import bpy
import numpy as np
import pytest
from mathutils import Euler

from addon.core.map_types import WIDENED_ROUGHNESS
from tests.support import scenes, zoo
from tests.support.maps import bake, bake_all_maps, raw_maps

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 16
SLOPE = 0.3
EXACT = 1e-3
NAME = WIDENED_ROUGHNESS.name
METHODS = ("FLATTEN", "CAST")


def roof(roughness=None, *, periods=2 * SIZE, slope=SLOPE):
    """The square from -1 to 1 with ridges along y, and a Principled BSDF of this roughness."""

    def surface(u, v):
        along = 2 * periods * u
        z = slope * np.abs(along - 2 * np.round(along / 2)) / periods
        return np.stack([2 * u - 1, 2 * v - 1, z], axis=1)

    high = zoo.sheet("high", surface, 2 * periods, 1, smooth=False)
    if roughness is not None:
        high.data.materials.append(scenes.material("rough", Roughness=roughness))
    return high


def widened(roughness, slope=SLOPE):
    """Roughness with the variance of two slopes of this size."""
    return (roughness**4 + slope**2) ** 0.25


@pytest.mark.parametrize("space", ["TANGENT", "OBJECT", "WORLD"])
@pytest.mark.parametrize("method", METHODS)
def test_a_roof_in_a_texel_is_rough(method, space):
    low, high = zoo.plane("low"), roof(0.4)
    for obj in (low, high):
        obj.rotation_euler = 0.4, 0.8, -0.3
    found = raw_maps(low, high, maps=[NAME], size=SIZE, method=method, space=space, samples=16)[1001][NAME]
    assert np.abs(found[..., :3] - widened(0.4)).max() < EXACT
    assert (found[..., 3] == 1.0).all()


@pytest.mark.parametrize("method", METHODS)
def test_spaces_agree_seed_1(method):
    """Steep bumps, whose slopes count against the low surface in its own frame."""
    rng, low = np.random.default_rng(1), zoo.plane("low")
    high = zoo.sheet("high", lambda u, v: np.stack([2 * u - 1, 2 * v - 1, 0.01 * rng.normal(size=len(u))], 1), 160, 160)
    for obj in (low, high):
        obj.data.transform(Euler((0.7, -0.5, 0.2)).to_matrix().to_4x4())
        obj.rotation_euler = 0.4, 1.2, -0.3
    first, *others = (
        raw_maps(low, high, maps=[NAME], size=SIZE, method=method, space=space, samples=16)[1001][NAME][..., 0]
        for space in ("TANGENT", "OBJECT", "WORLD")
    )
    assert first.mean() > 0.6
    assert all(np.abs(other - first).max() < EXACT for other in others)


@pytest.mark.parametrize("method", METHODS)
def test_one_sample_cannot_know(method):
    low, high = zoo.plane("low"), roof(0.4)
    found = raw_maps(low, high, maps=[NAME], size=SIZE, method=method, samples=1)[1001][NAME]
    assert np.abs(found[..., :3] - 0.4).max() < EXACT


def test_faces_without_a_material_are_half_rough():
    found = raw_maps(zoo.plane("low"), roof(), maps=[NAME], size=SIZE, samples=16)[1001][NAME]
    assert np.abs(found[..., 0] - widened(0.5)).max() < EXACT


def test_roughness_itself_stays_as_it_is():
    """Both maps draw the same input, into sums of their own."""
    found = raw_maps(zoo.plane("low"), roof(0.4), maps=["ROUGHNESS", NAME], size=SIZE, samples=16)[1001]
    assert np.abs(found["ROUGHNESS"][..., 0] - 0.4).max() < EXACT
    assert np.abs(found[NAME][..., 0] - widened(0.4)).max() < EXACT


def test_an_image_of_roughness_is_widened():
    high = roof()
    image = scenes.image("rough", np.full((8, 8, 3), 0.2), space="Non-Color", is_float=True)
    material = bpy.data.materials.new("rough")
    scenes.set_inputs(material, Roughness=scenes.texture(material, image).outputs["Color"])
    high.data.materials.append(material)
    found = raw_maps(zoo.plane("low"), high, maps=[NAME], size=SIZE, samples=16)[1001][NAME]
    assert np.abs(found[..., 0] - widened(0.2)).max() < EXACT


def test_slopes_that_texels_show_do_not_count_twice():
    """A roof of wide slopes: each texel has one normal, and the normal map shows it."""
    found = raw_maps(zoo.plane("low"), roof(0.4, periods=SIZE // 4), maps=[NAME], size=SIZE, samples=16)[1001][NAME]
    assert np.abs(found[..., 0] - 0.4).max() < EXACT


def test_the_normal_map_stays_as_it_is():
    low, high = zoo.plane("low"), roof(0.4)
    alone = bake(low, high, size=(SIZE, SIZE), samples=4, adaptive=False)
    bake_all_maps(low, high, maps=[NAME], size=SIZE, samples=4)
    assert np.array_equal(alone, _pixels("map"))


def _pixels(name):
    image = bpy.data.images[name]
    texels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(texels)
    return texels.reshape(image.size[1], image.size[0], 4)


@pytest.mark.parametrize("samples", [1, 4])
def test_a_bake_with_one_sample_is_warned_of(samples):
    report, _ = bake_all_maps(zoo.plane("low"), roof(0.4), maps=[NAME], size=SIZE, samples=samples)
    assert any("--samples 16" in text for text in report.warnings) == (samples == 1)
