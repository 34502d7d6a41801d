# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests images, normal maps and bump maps at hits against Cycles, which bakes the same material on the same square."""

import bpy
import numpy as np
import pytest

from addon.core.material_feeds import BumpFeed, Extension, ImageFeed, NormalMapFeed
from addon.passes import surface_tables, surface_values
from tests.support import angles, cycles, feeds
from tests.support.seen_surface import SeenSurface, page, read

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 64
STEP = 0.5 / 255
"""Half a step of eight bits, scene-linear. Cycles has its own sRGB curve and half precision."""
DEGREES = 0.1
"""Of normals from stored bytes."""
DIFFERENCES = 0.6
"""Degrees. Cycles takes the slope from a place to the next texel on one side, which curved heights tell from ours."""


def image_of(values, *, is_data):
    """A Blender image of bytes (h, w, 3 or 4), 0 to 255."""
    height, width, channels = values.shape
    image = bpy.data.images.new("shown", width, height, alpha=channels == 4)
    image.colorspace_settings.name = "Non-Color" if is_data else "sRGB"
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :channels] = values / 255
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    return image


def material_with(image, extension="REPEAT", interpolation="Linear"):
    """A material with an Image Texture node, which is returned too."""
    material = bpy.data.materials.new("shown")
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image, node.extension, node.interpolation = image, extension, interpolation
    return material, node


def seen_square(uv):
    """The square of `feeds.square` with UVs (4, 2)."""
    corners = np.array(((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)), float)
    triangles = np.array(((0, 1, 2), (0, 2, 3)))
    return SeenSurface(corners[triangles], (SIZE, SIZE), uv=np.asarray(uv, float)[triangles])


def turned(degrees, scale, shift, *, is_mirrored=False):
    """UVs (4, 2) of the square: turned, scaled, shifted."""
    angle = np.deg2rad(degrees)
    matrix = scale * np.array(((np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle))))
    matrix[0] *= -1.0 if is_mirrored else 1.0
    return np.array(((0, 0), (1, 0), (1, 1), (0, 1))) @ matrix.T + shift


@pytest.mark.parametrize("extension", Extension)
@pytest.mark.parametrize("is_smooth", [True, False])
@pytest.mark.parametrize("is_data", [True, False])
def test_colors_are_those_of_cycles_seed_1(extension, is_smooth, is_data):
    """Pixels are larger than texels. UVs go a page and more outside."""
    values = np.random.default_rng(1).integers(0, 256, (5, 7, 3))
    uv = turned(20, 2.6, (-0.9, -1.3))
    material, node = material_with(image_of(values, is_data=is_data), extension, "Linear" if is_smooth else "Closest")
    square = feeds.square(material, uv)
    baked = feeds.cycles(square, node.outputs["Color"], SIZE)
    feed = ImageFeed("a", extension=extension, is_smooth=is_smooth)
    shown = seen_square(uv).shown(page(values / 255, is_byte=True, is_srgb=not is_data), feed)[..., :3]
    error = np.abs(shown - baked).max(axis=-1)
    print(f"99 % within {np.percentile(error, 99) * 255:.3f}/255, most {error.max() * 255:.3f}/255")
    assert np.percentile(error, 99) < STEP
    assert is_smooth or (error > STEP).mean() < 0.01


def test_colors_with_alpha_are_those_of_cycles_seed_3():
    """Straight colors, which Cycles shows where a material uses the image's alpha as well."""
    values = np.random.default_rng(3).integers(0, 256, (6, 5, 4))
    values[..., 3] = 255 - values[..., 3] // 2
    values[::2, ::2, 3] = 0
    uv = turned(20, 0.9, (0.1, 0.0))
    material, node = material_with(image_of(values, is_data=False))
    tree = material.node_tree
    tree.links.new(node.outputs["Alpha"], tree.nodes["Principled BSDF"].inputs["Alpha"])
    baked = feeds.cycles(feeds.square(material, uv), node.outputs["Color"], SIZE)
    stored = page(values / 255, is_byte=True, is_srgb=True, weighs_alpha=True)
    error = np.abs(seen_square(uv).shown(stored, ImageFeed("a"))[..., :3] - baked).max(axis=-1)
    print(f"99 % within {np.percentile(error, 99) * 255:.3f}/255, most {error.max() * 255:.3f}/255")
    # Cycles keeps colors that are multiplied with alpha in bytes: next to transparent pixels few steps are left.
    assert np.percentile(error, 90) < 4 * STEP


def normals_of(seen, shown, feed, tangent, bump=None):
    """World normals after a normal map, and a bump map (page, feed) over it."""
    drawn = seen.drawn_normals
    materials = surface_tables.upload_materials(np.ones(2))
    if feed is not None:
        tangents = surface_tables.upload_tangents(np.repeat(np.float32([tangent]), 6, axis=0), seen.corners)
        at_hits = seen.at_hits(shown, feed.image, materials)
        surface_values.apply_normal_map(drawn, at_hits, feed, tangents, np.eye(3))
    if bump is not None:
        image, of_image = bump
        surface_values.apply_bump(drawn, seen.at_hits(image, of_image.image, materials), of_image, np.eye(3), 1.0)
    return read(drawn)[..., :3]


@pytest.mark.parametrize("is_mirrored", [False, True])
@pytest.mark.parametrize("strength", [0.6, 1.0, 1.7])
def test_normal_maps_are_those_of_cycles_seed_2(is_mirrored, strength):
    """Tilts stay below 45 degrees: from there on Cycles' shaders bend normals that would reflect into the surface."""
    values = np.random.default_rng(2).integers(95, 160, (6, 6, 3))
    values[..., 2] = 200
    uv = turned(50, 0.8, (0.1, 0.2), is_mirrored=is_mirrored)
    material, node = material_with(image_of(values, is_data=True))
    tree = material.node_tree
    normal_map = tree.nodes.new("ShaderNodeNormalMap")
    normal_map.inputs["Strength"].default_value = strength
    normal_map.uv_map = "UVMap"
    tree.links.new(node.outputs["Color"], normal_map.inputs["Color"])
    tree.links.new(normal_map.outputs["Normal"], tree.nodes["Principled BSDF"].inputs["Normal"])
    square = feeds.square(material, uv)
    square.data.uv_layers.active = square.data.uv_layers[feeds.BAKED]
    square.data.uv_layers["UVMap"].active_render = True
    square.data.calc_tangents(uvmap="UVMap")
    first = square.data.loops[0]
    tangent = (*first.tangent, first.bitangent_sign)
    square.data.free_tangents()
    baked, mask = cycles.world_normals(square, (SIZE, SIZE))
    assert mask.all()
    shown = normals_of(
        seen_square(uv), page(values / 255, is_byte=True), NormalMapFeed(ImageFeed("a"), strength=strength), tangent
    )
    error = angles.degrees(shown, baked)
    print(f"99 % within {np.percentile(error, 99):.4f} degrees, most {error.max():.4f}")
    assert error.max() < DEGREES
    assert np.median(angles.degrees(baked, np.array((0, 0, 1.0)))) > 7 * strength


@pytest.mark.parametrize("is_mirrored", [False, True])
@pytest.mark.parametrize("strength", [0.5, 1.0])
def test_bump_maps_are_those_of_cycles(is_mirrored, strength):
    """Smooth heights: Cycles takes differences over a texel, and Imprint over a pixel."""
    x, y = np.meshgrid(np.arange(64) / 64 * 2 * np.pi, np.arange(64) / 64 * 2 * np.pi)
    heights = 0.5 + 0.2 * np.sin(x) + 0.25 * np.cos(y)
    uv = turned(35, 0.7, (0.3, 0.2), is_mirrored=is_mirrored)
    image = bpy.data.images.new("shown", 64, 64, float_buffer=True, is_data=True)
    image.pixels.foreach_set(np.dstack([heights] * 3 + [np.ones_like(heights)]).astype(np.float32).ravel())
    material, node = material_with(image)
    tree = material.node_tree
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Strength"].default_value, bump.inputs["Distance"].default_value = strength, 0.12
    tree.links.new(node.outputs["Color"], bump.inputs["Height"])
    tree.links.new(bump.outputs["Normal"], tree.nodes["Principled BSDF"].inputs["Normal"])
    square = feeds.square(material, uv)
    square.data.uv_layers.active = square.data.uv_layers[feeds.BAKED]
    square.data.uv_layers["UVMap"].active_render = True
    baked, _ = cycles.world_normals(square, (SIZE, SIZE))
    feed = BumpFeed(ImageFeed("a"), strength=strength, distance=0.12)
    shown = normals_of(seen_square(uv), None, None, None, (page(heights), feed))
    error = angles.degrees(shown, baked)[2:-2, 2:-2]
    print(f"99 % within {np.percentile(error, 99):.4f} degrees, most {error.max():.4f}")
    assert np.percentile(error, 99) < DIFFERENCES
    assert np.median(angles.degrees(baked, np.array((0, 0, 1.0)))) > 5 * strength
