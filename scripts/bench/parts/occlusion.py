# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares ambient occlusion with that of Cycles: seconds, and errors against Cycles with other random numbers."""

import time
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

from addon.core import udim
from addon.core.settings import Settings
from addon.engine import tree_cache
from addon.jobs import bake_pair
from addon.passes import audit, mesh_upload
from scripts.bench import bakers, scenes

RAYS = 128
PAIRS = "kepler", "helmet", "king"
"""How the names of the files begin; the demo's terrain stands for them."""
SEED = 7
"""Of Cycles' random numbers in the second bake, which the others are compared with."""


def compare(folder: Path | None, quick: bool) -> Iterator[dict]:
    """Yield a row for each pair: seconds of both, and root mean square differences in steps of 1/255.

    Both cast RAYS rays from each point, without a limit, at both sides of triangles, at 1024; `quick` at 256. Texels that
    several triangles of the low mesh share do not count.
    """
    size = 256 if quick else 1024
    found = [path for name in PAIRS for path in sorted(folder.glob(f"{name}_*.blend"))] if folder else []
    for path in found or [None]:
        pair = scenes.opened(path) if path else scenes.made(*scenes.TERRAIN)
        # Cycles moves points on smooth surfaces off their triangles; without it, both start at the same points.
        pair.high.shadow_terminator_geometry_offset = 0.0
        ours, seconds = imprint(pair, size)
        theirs, cycles_seconds = cycles(pair, size)
        reference, _ = cycles(pair, size, seed=SEED)
        known = np.logical_and.reduce([texels[..., 3] > 0.5 for texels in (ours, theirs, reference)])
        known &= covering(pair.low, size) < 1.5  # of triangles that share a texel, each baker shows another one
        ours, theirs, reference = (texels[..., 0][known].astype(np.float64) for texels in (ours, theirs, reference))
        yield {
            "pair": pair.name,
            "size": size,
            "rays": RAYS,
            "seconds": seconds,
            "cycles_seconds": cycles_seconds,
            "difference": rms(ours - reference),
            "cycles_difference": rms(theirs - reference),
        }


def covering(low: bpy.types.Object, size: int) -> np.ndarray:
    """How many triangles of `low` cover the center of each texel, (size, size) uint8."""
    mesh = low.data
    corners, uv = np.empty(3 * len(mesh.loop_triangles), np.int32), np.empty(2 * len(mesh.loops), np.float32)
    mesh.loop_triangles.foreach_get("loops", corners)
    mesh.uv_layers.active.uv.foreach_get("vector", uv)
    uploaded = mesh_upload.upload(corners.reshape(-1, 3), uv=uv.reshape(-1, 2))
    return audit.counts(uploaded, (size, size), udim.uv_to_clip(1001))


def rms(error: np.ndarray) -> float:
    """In steps of 1/255."""
    return float(np.sqrt((error**2).mean()) * 255.0)


def imprint(pair: scenes.Pair, size: int) -> tuple[np.ndarray, float]:
    """Texels (size, size, 4) and seconds, from the objects to the image; the tree is built too."""
    settings = Settings(
        method="CAST",
        hit="OUTERMOST",
        directions="SMOOTH",
        extrusion=pair.extrusion,
        max_distance=2.0 * pair.extrusion,
        width=size,
        height=size,
        margin=0,
        depth=32,
        storage="MEMORY",
        normal=False,
        maps=("AO",),
        rays=RAYS,
        two_sided=True,
    )
    tree_cache.trees.free()
    start = time.perf_counter()
    report = bake_pair(bpy.context, pair.low, [pair.high], settings)
    seconds = time.perf_counter() - start
    return texels_of(bpy.data.images[next(how["image"] for how in report.maps.values())], size), seconds


def cycles(pair: scenes.Pair, size: int, seed: int = 0) -> tuple[np.ndarray, float]:
    """As `imprint`."""
    image = bakers.target_image(pair.low, "cycles", size)
    image.pixels.foreach_set(np.zeros(size * size * 4, np.float32))  # alpha 0 stays where Cycles writes nothing
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CYCLES", "CPU", RAYS, seed
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.world = scene.world or bpy.data.worlds.new("world")
    scene.world.light_settings.distance = 1e6
    for obj in bpy.data.objects:
        obj.select_set(obj in (pair.low, pair.high))
    bpy.context.view_layer.objects.active = pair.low
    start = time.perf_counter()
    bpy.ops.object.bake(
        type="AO",
        margin=0,
        use_clear=False,
        use_selected_to_active=True,
        cage_extrusion=pair.extrusion,
        max_ray_distance=2.0 * pair.extrusion,
    )
    seconds = time.perf_counter() - start
    return texels_of(image, size), seconds


def texels_of(image: bpy.types.Image, size: int) -> np.ndarray:
    texels = np.empty(size * size * 4, np.float32)
    image.pixels.foreach_get(texels)
    return texels.reshape(size, size, 4)
