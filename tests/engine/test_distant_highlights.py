# SPDX-License-Identifier: GPL-3.0-or-later
"""The highlight on a bumpy ball in Cycles, from so far away that no bump shows, against the one on the low mesh with maps."""

import bpy
import numpy as np
import pytest
from mathutils import Euler

from addon.core.settings import Settings
from addon.jobs import bake_pair
from tests.support import scenes, zoo
from tests.support.maps import pixels

pytestmark = pytest.mark.usefixtures("gpu_context")

ROUGHNESS = 0.4
WITHIN = 0.05
"""The share by which the width of a highlight may be off."""
WAVES = 40
PIXELS = 64
WIDE = np.radians(70.0)
"""The longitudes and latitudes of the patch."""


def patch(name, n, heights=None):
    """A part of the unit ball around +Z. heights: a function from longitude and latitude to heights above it."""

    def surface(u, v):
        longitude, latitude = WIDE * (u - 0.5), WIDE * (v - 0.5)
        radius = 1.0 + (heights(longitude, latitude) if heights else 0.0)
        x, y, z = np.sin(longitude) * np.cos(latitude), np.sin(latitude), np.cos(longitude) * np.cos(latitude)
        return np.stack([x, y, z], axis=1) * radius[:, None] if heights else np.stack([x, y, z], axis=1)

    return zoo.sheet(name, surface, n, n)


def bumps(slope, cycles, seed):
    """Waves in all directions, whose slopes are almost Gaussian with this root of the mean square. cycles: on the patch."""
    rng = np.random.default_rng(seed)
    turns, phases = rng.uniform(0.0, 2.0 * np.pi, (2, WAVES))
    numbers = 2.0 * np.pi * cycles / WIDE * rng.uniform(0.8, 1.2, WAVES)
    height = slope * np.sqrt(2.0 / WAVES)

    def heights(longitude, latitude):
        total = np.zeros_like(longitude)
        for turn, phase, number in zip(turns, phases, numbers, strict=True):
            total += np.sin(number * (np.cos(turn) * longitude + np.sin(turn) * latitude) + phase) / number
        return height * total

    return heights


def glossy(name, *, roughness=ROUGHNESS, normal=None):
    """A Beckmann lobe. roughness: a number or an image. normal: an image of tangent space."""
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    tree.nodes.clear()
    shader, output = tree.nodes.new("ShaderNodeBsdfAnisotropic"), tree.nodes.new("ShaderNodeOutputMaterial")
    shader.distribution = "BECKMANN"
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    if isinstance(roughness, float):
        shader.inputs["Roughness"].default_value = roughness
    else:
        tree.links.new(texture(tree, roughness), shader.inputs["Roughness"])
    if normal:
        node = tree.nodes.new("ShaderNodeNormalMap")
        node.uv_map = zoo.LAYER
        tree.links.new(texture(tree, normal), node.inputs["Color"])
        tree.links.new(node.outputs[0], shader.inputs["Normal"])
    return material


def texture(tree, path):
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.load(str(path))
    node.image.colorspace_settings.name = "Non-Color"
    return node.outputs["Color"]


def set_up():
    """A camera without perspective and a sun, both straight above."""
    scene = bpy.context.scene
    camera, sun = bpy.data.cameras.new("camera"), bpy.data.lights.new("sun", "SUN")
    camera.type, camera.ortho_scale, sun.angle = "ORTHO", 1.1, 0.0
    for data in (camera, sun):
        obj = bpy.data.objects.new(data.name, data)
        obj.location, obj.rotation_euler = (0.0, 0.0, 5.0), Euler((0.0, 0.0, 0.0))
        scene.collection.objects.link(obj)
    scene.camera = bpy.data.objects["camera"]
    scene.world = bpy.data.worlds.new("black")
    scene.world.color = 0.0, 0.0, 0.0
    scene.render.engine, scene.cycles.samples, scene.cycles.max_bounces = "CYCLES", 64, 0
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.render.resolution_x = scene.render.resolution_y = PIXELS
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.view_settings.view_transform = "Raw"


def width_of(shown, material, folder):
    """The radius in the picture at which the highlight has half of its brightness."""
    for obj in bpy.context.scene.objects:
        obj.hide_render = obj.type == "MESH" and obj is not shown
    shown.data.materials.clear()
    shown.data.materials.append(material)
    path = folder / f"{material.name}.exr"
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    picture = pixels(bpy.data.images.load(str(path)))[..., 0].astype(float)
    x, y = np.meshgrid(*[(np.arange(PIXELS) + 0.5) / PIXELS - 0.5] * 2)
    radius = np.hypot(x, y) * 1.1
    rings = np.minimum((radius * PIXELS).astype(int), PIXELS)
    counts = np.bincount(rings.ravel())
    profile, at = (np.bincount(rings.ravel(), values.ravel()) / counts for values in (picture, radius))
    # A Gaussian of the radius has a straight line as its logarithm over the square of the radius.
    inner = (at < 0.45) & (profile > 0.05 * profile[:3].max())
    slope, _ = np.polyfit(at[inner] ** 2, np.log(profile[inner]), 1, w=np.sqrt(counts[inner]) * profile[inner])
    return np.sqrt(np.log(2.0) / -slope)


@pytest.mark.slow
@pytest.mark.parametrize(("level", "size", "samples"), [(0, 32, 64), (3, 256, 4)])
def test_the_low_mesh_has_the_highlight_of_the_high_one_seed_1(level, size, samples, tmp_path):
    """Where texels are wider than bumps, and on a mip level of a map that shows the bumps."""
    low, high = patch("low", 48), patch("high", 512, bumps(0.2, 64, 1))
    high.data.materials.append(scenes.material("rough", Roughness=ROUGHNESS))
    chosen = Settings(
        method="FLATTEN",
        storage="FILE",
        output=str(tmp_path / "ball.exr"),
        depth=32,
        width=size,
        height=size,
        samples=samples,
        maps=("WIDENED_ROUGHNESS",),
        mip_files=True,
        material=False,
    )
    bake_pair(bpy.context, low, [high], chosen)
    ending = f"_mip{level}.exr" if level else ".exr"
    normal, roughness = tmp_path / f"ball{ending}", tmp_path / f"ball_widened_roughness{ending}"
    set_up()
    truth = width_of(high, glossy("high"), tmp_path)
    without = width_of(low, glossy("without", normal=normal), tmp_path)
    found = width_of(low, glossy("with", normal=normal, roughness=roughness), tmp_path)
    assert without < 0.8 * truth
    assert found == pytest.approx(truth, rel=WITHIN)
