# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests normal maps and bump maps of high meshes against closed forms and float64 numpy."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon.core.material_feeds import BumpFeed, Extension, ImageFeed, Limits, NormalMapFeed
from addon.passes import data_texture, surface_tables, surface_values, target
from tests.support import angles, cycles, feeds, oracle
from tests.support.raster import unit
from tests.support.seen_surface import SeenSurface, grid, page, read

pytestmark = pytest.mark.usefixtures("gpu_context")


CLOSED_FORM = 0.01
"""Degrees. Single precision."""
SLOPE = 0.05
"""Degrees. Heights between pixels are interpolated: their slope is that of a chord."""
IMAGE = ImageFeed("a", extension=Extension.EXTEND)


def tangent_table(seen, tangents):
    """Tangents (T, 3, 4) or one (4,) for all."""
    count = seen.corners.size
    values = np.broadcast_to(np.asarray(tangents, np.float32), (count // 3, 3, 4))
    return surface_tables.upload_tangents(values.reshape(-1, 4), seen.corners)


def in_space(seen, matrix):
    """The normals in another space, as cast.look_up writes them."""
    drawn = target.Target(seen.width, seen.height, ("RGBA32F",))
    seen.draw_normals(drawn, matrix)
    return drawn


def mapped(seen, shown, feed, tangents, *, matrix=None, materials=None, **options):
    """The normals (height, width, 4) after a normal map."""
    matrix = np.eye(3) if matrix is None else matrix
    drawn = in_space(seen, matrix)
    materials = materials or surface_tables.upload_materials(np.ones(3))
    at_hits = seen.at_hits(shown, feed.image, materials, **options)
    surface_values.apply_normal_map(drawn, at_hits, feed, tangent_table(seen, tangents), matrix)
    return read(drawn)


def bumped(seen, shown, feed, *, matrix=None, unit=1.0, drawn=None, **options):
    """The normals (height, width, 4) after a bump map."""
    matrix = np.eye(3) if matrix is None else matrix
    drawn = drawn or in_space(seen, matrix)
    at_hits = seen.at_hits(shown, feed.image, surface_tables.upload_materials(np.ones(3)), **options)
    surface_values.apply_bump(drawn, at_hits, feed, matrix, unit)
    return read(drawn)


def degrees(normals, truth):
    """The angles between normals and directions of any length."""
    return angles.degrees(normals, unit(np.asarray(truth, float)))


def turned_uv(triangles, turn, *, is_mirrored, scale=1.0):
    """UVs that are turned, and where they point: the directions (3,) of u and v on the plane z = 0."""
    turn = np.deg2rad(turn)
    matrix = scale * np.array(((np.cos(turn), np.sin(turn)), (-np.sin(turn), np.cos(turn))))
    if is_mirrored:
        matrix[0] *= -1.0
    along = unit(np.linalg.inv(matrix).T)
    return triangles[..., :2] @ matrix.T, np.pad(along, ((0, 0), (0, 1)))


NORMALS = [(0.0, 0.0, 1.0), (0.5, 0.0, 0.8), (-0.2, 0.6, 0.5), (0.3, -0.7, 0.1)]


@pytest.mark.parametrize(("turn", "is_mirrored"), [(0, False), (37, True), (90, True), (200, False)])
@pytest.mark.parametrize("normal", NORMALS[1:])
def test_a_constant_map_tilts_a_plane_with_turned_and_mirrored_uvs(turn, is_mirrored, normal):
    triangles = grid(3, 2)
    uv, (u, v) = turned_uv(triangles, turn, is_mirrored=is_mirrored)
    seen = SeenSurface(triangles, (32, 32), uv=uv)
    stored = page(np.broadcast_to(np.array(unit(np.array(normal))) * 0.5 + 0.5, (4, 4, 3)))
    drawn = mapped(seen, stored, NormalMapFeed(IMAGE), (*u, -1.0 if is_mirrored else 1.0))
    x, y, z = unit(np.array(normal))
    assert degrees(drawn[..., :3], x * u + y * v + z * np.array((0, 0, 1))).max() < CLOSED_FORM
    assert (drawn[..., 3] == 1.0).all()


@pytest.mark.parametrize("channel", [None, 1])
def test_stored_values_are_limited_and_scaled_before_they_are_a_normal(channel):
    """As nodes between the image and the Normal Map node say; a map of two channels has a constant blue."""
    color = np.array((1.4, 0.2, 0.0))
    seen = SeenSurface(grid(1, 1), (8, 8))
    image = replace(
        IMAGE, channel=channel, scale=(0.5, 1.0, 0.0), offset=(0.25, 0.1, 1.0), limits=Limits((0.0,) * 3, (1.0,) * 3)
    )
    drawn = mapped(seen, page(np.broadcast_to(color, (4, 4, 3))), NormalMapFeed(image), (1, 0, 0, 1))
    chosen = color if channel is None else color[[channel] * 3]
    expected = (chosen.clip(0.0, 1.0) * image.scale + image.offset) * 2.0 - 1.0
    assert degrees(drawn[..., :3], expected).max() < CLOSED_FORM


@pytest.mark.parametrize("strength", [0.0, 0.4, 1.0, 2.5])
@pytest.mark.parametrize("is_green_down", [False, True])
def test_strength_and_green_are_as_in_cycles(strength, is_green_down):
    """x and y are multiplied; z goes from 1 to its own value, and not beyond."""
    normal = unit(np.array((0.4, 0.3, 0.7)))
    seen = SeenSurface(grid(1, 1), (8, 8))
    stored = page(np.broadcast_to(normal * 0.5 + 0.5, (4, 4, 3)))
    feed = NormalMapFeed(IMAGE, strength=strength, is_green_down=is_green_down)
    drawn = mapped(seen, stored, feed, (1, 0, 0, 1))
    x, y, z = normal
    y = -y if is_green_down else y
    expected = strength * x, strength * y, 1 + (z - 1) * min(strength, 1.0)
    assert degrees(drawn[..., :3], expected).max() < CLOSED_FORM


@pytest.mark.parametrize("seed", range(1, 5))
def test_random_frames_against_numpy_seeds_1_to_4(seed):
    """Random normals and tangents at all corners, a random map, and normals in a space that turns, mirrors and stretches."""
    rng = np.random.default_rng(seed)
    triangles = grid(3, 3)
    count = len(triangles)
    normals = unit(rng.normal(size=(count, 3, 3)) * 0.4 + (0, 0, 1))
    tangents = np.concatenate(
        [
            unit(rng.normal(size=(count, 3, 3)) * 0.3 + (1, 0, 0)),
            np.repeat(rng.choice((-1.0, 1.0), (count, 1, 1)), 3, axis=1),
        ],
        axis=-1,
    )
    image = rng.random((3, 4, 3)) * 0.5 + (0.25, 0.25, 0.5)
    matrix = oracle.rotation(rng) @ np.diag(rng.uniform(0.5, 2.0, 3)) * rng.choice((-1.0, 1.0))
    seen = SeenSurface(triangles, (48, 48), normals=normals)
    lengths = np.append(np.full(3, rng.uniform(0.1, 3.0)), 1.0) * rng.uniform(0.5, 2.0, (count, 3, 1)) ** (1, 1, 1, 0)
    drawn = mapped(seen, page(image), NormalMapFeed(IMAGE), tangents * lengths, matrix=matrix)

    rays = np.stack([seen.x, seen.y, np.full_like(seen.x, 5.0)], -1).reshape(-1, 3)
    triangle, _, weights, margin = oracle.first_hits(
        rays, np.broadcast_to((0.0, 0.0, -1.0), rays.shape), triangles, 100.0
    )
    normal = unit((normals[triangle] * weights[..., None]).sum(axis=1))
    tangent = (tangents[triangle, :, :3] * weights[..., None]).sum(axis=1)
    bitangent = tangents[triangle, 0, 3:] * np.cross(normal, tangent)
    across, up = (np.clip(w.astype(float) * n - 0.5, 0, n - 1) for w, n in ((seen.x.ravel(), 4), (seen.y.ravel(), 3)))
    i, j = np.minimum(across.astype(int), 2), np.minimum(up.astype(int), 1)
    a, b = (across - i)[:, None], (up - j)[:, None]
    color = (image[j, i] * (1 - a) + image[j, i + 1] * a) * (1 - b) + (
        image[j + 1, i] * (1 - a) + image[j + 1, i + 1] * a
    ) * b
    x, y, z = (color * 2 - 1).T[..., None]
    truth = (x * tangent + y * bitangent + z * normal) @ matrix.T
    clear = margin > 1e-4  # a texel on an edge may show either triangle
    error = degrees(drawn[..., :3].reshape(-1, 3), truth)[clear]
    assert clear.mean() > 0.8
    assert error.max() < CLOSED_FORM * 10  # the matrix stretches small angles


def test_a_fine_map_shows_its_mean_direction():
    """Two directions in a checker much finer than the texels: the mean of both."""
    one, other = unit(np.array(((0.6, 0.0, 0.8), (-0.1, 0.3, 0.9))))
    image = np.where((np.indices((512, 512)).sum(axis=0) % 2)[..., None] == 1, one, other) * 0.5 + 0.5
    seen = SeenSurface(grid(2, 2), (32, 32))
    drawn = mapped(seen, page(image), NormalMapFeed(IMAGE), (1, 0, 0, 1))
    assert degrees(drawn[..., :3], one + other).max() < CLOSED_FORM


def test_other_materials_tiles_and_misses_keep_their_normals():
    triangles = grid(4, 4)
    centers = triangles.mean(axis=1)
    keep = centers[:, 1] < 0.75
    seen = SeenSurface(
        triangles[keep], (64, 64), materials=(1 + (centers[:, 0] > 0.5))[keep], uv=triangles[keep, :, :2] * 2
    )
    stored = page(np.full((4, 4, 3), 0.8))
    feed = NormalMapFeed(ImageFeed("a", tiles=(1001,)))
    drawn = mapped(
        seen, stored, feed, (1, 0, 0, 1), materials=surface_tables.upload_materials(np.array((0, 1, -1))), tile=1001
    )
    is_turned = np.abs(drawn[..., 2] - 1.0) > 0.1
    assert is_turned[:31, :31].all()
    assert not is_turned[:48, 33:].any()
    assert not is_turned[33:48].any()
    assert (drawn[49:] == (0, 0, 0, -1)).all()


def test_a_mesh_without_tangents_keeps_its_normals():
    seen = SeenSurface(grid(1, 1), (8, 8))
    drawn = mapped(seen, page(np.full((4, 4, 3), 0.2)), NormalMapFeed(IMAGE), (0, 0, 0, 1))
    assert np.array_equal(drawn, read(in_space(seen, np.eye(3))))
    assert (drawn[..., 3] == 1.0).all()


def test_a_surface_without_normals_keeps_none():
    triangles = grid(1, 1)
    seen = SeenSurface(triangles, (8, 8), normals=np.zeros((2, 3, 3)))
    drawn = mapped(seen, page(np.full((4, 4, 3), 0.2)), NormalMapFeed(IMAGE), (1, 0, 0, 1))
    assert (drawn == (0, 0, 0, -1)).all()
    assert (bumped(seen, page(sine(16)), BumpFeed(ImageFeed("a"), distance=0.1)) == (0, 0, 0, -1)).all()


def sine(pixels, periods=2, rows=None):
    """A page of heights 0.5 + 0.5 sin(2 pi periods u)."""
    u = (np.arange(pixels) + 0.5) / pixels
    return np.tile(0.5 + 0.5 * np.sin(2 * np.pi * periods * u), (rows or pixels, 1))


def sine_normal(u, height, periods=2):
    """Its closed-form normal for heights of `height`, where u runs along x over a length of 1."""
    slope = height * 0.5 * 2 * np.pi * periods * np.cos(2 * np.pi * periods * u)
    return np.stack([-slope, np.zeros_like(u), np.ones_like(u)], axis=-1)


@pytest.mark.parametrize(("pixels", "size"), [(256, 64), (256, 256), (256, 300)])
@pytest.mark.parametrize("height", [0.05, -0.02])
def test_a_sine_of_heights_has_its_closed_form_normal(pixels, size, height):
    seen = SeenSurface(grid(5, 4), (size, size))
    drawn = bumped(seen, page(sine(pixels)), BumpFeed(ImageFeed("a"), distance=height))
    truth = sine_normal(seen.x.astype(float), height)
    # Where a texel has four pixels, their mean flattens the sine a little.
    flattened = 0.2 if pixels > size else SLOPE
    assert degrees(drawn[..., :3], truth).max() < flattened


def test_limits_of_heights():
    """A ramp of heights from 0 to 1 is flat where it is limited."""
    seen = SeenSurface(grid(1, 1), (64, 64))
    image = replace(IMAGE, limits=Limits((0.25,) * 3, (0.75,) * 3))
    ramp = np.tile((np.arange(64) + 0.5) / 64, (4, 1))
    drawn = bumped(seen, page(ramp), BumpFeed(image, distance=0.5))[..., :3]
    slope = np.where((seen.x > 0.25) & (seen.x < 0.75), -0.5, 0.0)
    clear = (np.abs(seen.x - 0.25) > 0.03) & (np.abs(seen.x - 0.75) > 0.03)
    expected = np.stack([slope, np.zeros_like(slope), np.ones_like(slope)], axis=-1)
    assert degrees(drawn[clear], expected[clear]).max() < SLOPE


@pytest.mark.parametrize("is_mirrored", [False, True])
def test_a_bump_map_on_a_slope_with_turned_uvs_in_another_space_seed_5(is_mirrored):
    """The surface is turned, the UVs are turned, the local space has another unit, and normals go to another space."""
    rng = np.random.default_rng(5)
    lean = np.deg2rad(30)
    tilt = np.array(((np.cos(lean), 0, np.sin(lean)), (0, 1, 0), (-np.sin(lean), 0, np.cos(lean))))
    flat = grid(3, 3)
    uv, (u, _) = turned_uv(flat, 25, is_mirrored=is_mirrored, scale=0.7)
    seen = SeenSurface(flat @ tilt.T, (48, 48), uv=uv, normals=np.broadcast_to(tilt @ (0, 0, 1), flat.shape))
    matrix = oracle.rotation(rng) @ np.diag((1.0, 2.0, -0.7))
    scene_units = 4.0
    drawn = bumped(
        seen, page(sine(512)), BumpFeed(ImageFeed("a"), distance=0.1), matrix=matrix, unit=scene_units, samples=4
    )
    # The place on the flat plane of each texel: x was shortened by the tilt.
    place = np.stack([seen.x / np.cos(lean), seen.y], -1).astype(float)
    is_hit = drawn[..., 3] == 1.0
    assert is_hit.mean() > 0.8
    direction = 0.7 * u[:2]
    phase = place @ direction
    slope = 0.1 / scene_units * 0.5 * 2 * np.pi * 2 * np.cos(2 * np.pi * 2 * phase)
    local = np.array((0, 0, 1)) - slope[..., None] * np.array((*direction, 0.0))
    truth = local @ tilt.T @ matrix.T
    assert degrees(drawn[..., :3], truth)[is_hit].max() < SLOPE * 4


@pytest.mark.parametrize("strength", [0.0, 0.5, 1.5])
def test_strength_mixes_with_the_normal_below_it(strength):
    """A bump map on a normal map, as Cycles computes both."""
    below = unit(np.array((0.0, 0.6, 0.8)))
    seen = SeenSurface(grid(1, 1), (16, 16))
    ramp = page(np.tile((np.arange(64) + 0.5) / 64, (64, 1)))
    drawn, stored = in_space(seen, np.eye(3)), page(np.broadcast_to(below * 0.5 + 0.5, (4, 4, 3)))
    at_hits = seen.at_hits(stored, IMAGE, surface_tables.upload_materials(np.ones(3)))
    surface_values.apply_normal_map(drawn, at_hits, NormalMapFeed(IMAGE), tangent_table(seen, (1, 0, 0, 1)), np.eye(3))
    shown = bumped(seen, ramp, BumpFeed(IMAGE, strength=strength, distance=0.5), drawn=drawn)
    dx, dy = np.array((1.0, 0, 0)), np.array((0, 1.0, 0))
    surface_gradient = 1.0 * np.cross(dy, below)  # the height rises by 1 along x
    determinant = dx @ np.cross(dy, below)
    turned = unit(abs(determinant) * below - 0.5 * np.sign(determinant) * surface_gradient)
    truth = strength * turned + (1 - strength) * below
    assert degrees(shown[:, 1:-1, :3], truth).max() < CLOSED_FORM


def test_the_winding_of_triangles_does_not_matter():
    """The normals decide what is outside: triangles of mirrored objects may face the other way."""
    triangles = grid(3, 3)
    shown, feed = page(sine(64)), BumpFeed(ImageFeed("a"), distance=0.05)
    drawn = [bumped(SeenSurface(each, (32, 32)), shown, feed)[..., :3] for each in (triangles, triangles[:, ::-1])]
    assert degrees(*drawn).max() < CLOSED_FORM
    assert degrees(drawn[0], (0, 0, 1)).max() > 5


def test_heights_finer_than_a_texel_do_not_tilt_seed_6():
    rough = np.random.default_rng(6).random((1024, 1024))
    seen = SeenSurface(grid(1, 1), (32, 32))
    drawn = bumped(seen, page(rough), BumpFeed(IMAGE, distance=1 / 1024))
    assert degrees(drawn[..., :3], (0, 0, 1)).max() < 0.5
    rougher = bumped(seen, page(rough), BumpFeed(IMAGE, distance=1 / 1024), samples=10**8)
    assert np.median(degrees(rougher[..., :3], (0, 0, 1))) > 10


def test_small_triangles_bump_as_large_ones():
    """Triangles of 1e-7 of the local space: their area is nothing in single precision."""
    triangles = grid(2, 2)
    seen = SeenSurface(triangles, (32, 32))
    small = SeenSurface(triangles, (32, 32))
    tiny = np.float32(1e-12)
    small.tables = replace(
        small.tables, points=data_texture.upload((triangles * tiny).reshape(-1, 3).astype(np.float32))
    )
    shown = page(sine(64))
    expected = bumped(seen, shown, BumpFeed(ImageFeed("a"), distance=0.05))
    drawn = bumped(small, shown, BumpFeed(ImageFeed("a"), distance=0.05 * float(tiny)))
    assert degrees(drawn[..., :3], expected[..., :3]).max() < CLOSED_FORM


# Surface against cycles


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
