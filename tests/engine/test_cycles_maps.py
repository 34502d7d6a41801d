# SPDX-License-Identifier: GPL-3.0-or-later
"""Colors, detail normals and ambient occlusion of real meshes, compared with Cycles' selected-to-active bakes."""

import bpy
import numpy as np
import pytest

from tests.support import angles, cycles, lanes, scenes
from tests.support.maps import bake, bake_all_maps, texel_uv
from tests.support.real_meshes import FAST, open_pair

pytestmark = [pytest.mark.shared, pytest.mark.usefixtures("gpu_context")]

SIZE = (512, 512)
PAIRS = ["spot_1696_536", "king_40480_4000", "helmet_23358_6117"]
COLOR = 2 / 255
"""The limit of stored colors."""
SHARE = 0.99
"""Of the texels away from borders."""


def pair_and_distances(folder, name):
    low, high = open_pair(folder, name)
    extrusion = 0.02 * max(low.dimensions)
    return low, high, {"extrusion": extrusion, "max_distance": 2.0 * extrusion}


def picture(size=1024, waves=5):
    """Smooth stored colors (size, size, 3): what lies within a texel hardly varies."""
    u, v = np.moveaxis(texel_uv(size, size), -1, 0) * 2.0 * np.pi * waves
    return 0.5 + 0.4 * np.stack([np.sin(u), np.cos(v), np.sin(u + v)], axis=-1)


def painted(high, **sockets):
    """Replace the materials of a mesh by one whose sockets show the picture. Returns the material and its texture node."""
    material = bpy.data.materials.new("painted")
    node = scenes.texture(material, scenes.image("picture", picture()))
    scenes.set_inputs(material, Base_Color=node.outputs["Color"], **sockets)
    high.data.materials.clear()
    high.data.materials.append(material)
    return material, node


def stored(values):
    """sRGB values of scene-linear ones."""
    values = np.maximum(values, 0.0)
    return np.where(values <= 0.0031308, values * 12.92, 1.055 * values ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("name", lanes.slow_but(FAST, PAIRS))
def test_colors_are_those_of_cycles_emission_bake(shared_assets, name):
    low, high, reach = pair_and_distances(shared_assets, name)
    material, node = painted(high)
    _, maps = bake_all_maps(low, high, maps=["BASE_COLOR"], size=SIZE, method="CAST", hit="OUTERMOST", **reach)
    expected, written = cycles.bake_colors(low, SIZE, {material: node.outputs["Color"]}, highs=[high], **reach)
    known = maps["base_color"][..., 3] == 1.0
    inner = angles.eroded(written & known & ~cycles.shared(low, SIZE), 1)
    error = np.abs(stored(maps["base_color"][..., :3]) - stored(expected[..., :3])).max(axis=-1)[inner]
    print(
        f"{name}: {inner.mean():.2f} compared, {(error < COLOR).mean():.4%} within 2/255, "
        f"99 % {np.percentile(error, 99) * 255:.2f}"
    )
    assert inner.mean() > 0.15
    assert (error < COLOR).mean() > SHARE


@pytest.mark.parametrize("name", lanes.slow_but(FAST, PAIRS))
def test_the_high_meshes_own_normal_map_is_that_of_cycles(shared_assets, name):
    low, high, reach = pair_and_distances(shared_assets, name)
    material, _ = painted(high)
    turn = texel_uv(1024, 1024) * 2.0 * np.pi * 5.0
    normals = np.concatenate([0.4 * np.sin(turn), np.ones((1024, 1024, 1))], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    shown = scenes.texture(material, scenes.image("dents", normals * 0.5 + 0.5, space="Non-Color", is_float=True))
    node = material.node_tree.nodes.new("ShaderNodeNormalMap")
    material.node_tree.links.new(shown.outputs["Color"], node.inputs["Color"])
    plain = bake(low, high, method="CAST", hit="OUTERMOST", space="OBJECT", size=SIZE, **reach)
    scenes.set_inputs(material, Normal=node.outputs["Normal"])
    texels = bake(low, high, method="CAST", hit="OUTERMOST", space="OBJECT", size=SIZE, **reach)
    expected, written = cycles.bake_normals(low, SIZE, space="OBJECT", highs=[high], **reach)
    inner = angles.eroded(written & (texels[..., 3] == 1.0) & ~cycles.shared(low, SIZE), 1)
    error, without = (angles.degrees(angles.decode(one), angles.decode(expected))[inner] for one in (texels, plain))
    print(
        f"{name}: median {np.median(error):.3f}, 99 % {np.percentile(error, 99):.3f}; without detail {np.median(without):.1f}"
    )
    assert np.median(error) < 0.1
    assert np.percentile(error, 99) < 1.0
    assert np.median(without) > 5.0


AO_SIZE = (128, 128)
RAYS = 128
MANY = 512
"""Samples of the truth."""
ZOOM = 32.0
"""Cycles spreads the samples of a texel over the triangle of the high mesh: texels have to be small."""
NEAREST = 0.98
"""The share of texels with the smallest errors. At others, Cycles leaves the point: rays of Blender's BVHTree from there give
what Imprint gives."""


def zoom(low):
    """Enlarge the UVs, so that the map shows a part of them."""
    uv = low.data.uv_layers.active.uv
    values = np.empty((len(uv), 2), np.float32)
    uv.foreach_get("vector", values.reshape(-1))
    center = values[len(values) // 3]
    uv.foreach_set("vector", ((values - center) * ZOOM + 0.5).ravel())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["king_40480_4000", "helmet_23358_6117", "kepler_199712_9079"])
def test_occlusion_is_nearer_to_the_truth_than_cycles_at_as_many_samples(shared_assets, name):
    """Cycles with many samples is the truth. Its rays start at the same points, and end at both sides of faces."""
    low, high, reach = pair_and_distances(shared_assets, name)
    zoom(low)
    world = bpy.context.scene.world = bpy.data.worlds.new("sky")
    high.shadow_terminator_geometry_offset = 0.0  # Cycles moves points on smooth surfaces off their triangles
    diagonal = np.linalg.norm(high.dimensions)
    world.light_settings.distance = 0.2 * diagonal
    options = {"highs": [high], **reach}
    truth, written = cycles.bake(low, AO_SIZE, "AO", samples=MANY, seed=1, **options)
    theirs, _ = cycles.bake(low, AO_SIZE, "AO", samples=RAYS, seed=2, **options)
    _, maps = bake_all_maps(
        low,
        high,
        maps=["AO"],
        size=AO_SIZE,
        method="CAST",
        hit="OUTERMOST",
        rays=RAYS,
        two_sided=True,
        distance_unit="SCENE",
        ao_distance=0.2 * diagonal,
        ao_fade="NONE",
        **reach,
    )
    inner = angles.eroded(written & (maps["ao"][..., 3] == 1.0), 1)
    errors = [(values - truth)[inner, 0] for values in (maps["ao"], theirs)]
    kept = int(NEAREST * inner.sum())
    mine, noise = (np.sqrt((np.sort(np.abs(error))[:kept] ** 2).mean()) * 255 for error in errors)
    print(
        f"{name}: mean {truth[inner, 0].mean():.3f}, RMS {mine:.2f}/255, bias "
        f"{errors[0].mean() * 255:+.2f}, Cycles {noise:.2f}"
    )
    assert inner.mean() > 0.15
    assert mine < noise
