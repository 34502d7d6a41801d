"""Bakes for tests: a float map in memory, as an array."""

import bpy
import numpy as np

from addon.core import progress
from addon.core.settings import Run, Settings
from addon.jobs import Job, bake_pair
from addon.jobs.bake import draw_raw
from addon.jobs.job import Request, check_job


def bake(low, *highs, image="map", **settings):
    """The texels (H, W, 4) float32 of a bake, row 0 at v = 0; without margin and material unless asked for."""
    size = settings.pop("size", (64, 64))
    values = {"method": "FLATTEN", "margin": 0, "depth": 32, "storage": "MEMORY", "material": False, **settings}
    bake_pair(bpy.context, low, highs, Settings(image=image, width=size[0], height=size[1], **values))
    return pixels(bpy.data.images[image])


def bake_all_maps(low, *highs, maps, size=64, cage=None, **settings):
    """The report of a bake and its maps by name in lower case, texels (H, W, 4) float32 as `bake` has them."""
    values = {"method": "FLATTEN", "margin": 0, "depth": 32, "storage": "MEMORY", "material": False, **settings}
    width, height = size if isinstance(size, tuple) else (size, size)
    chosen = Settings(image="map", width=width, height=height, maps=tuple(maps), **values)
    report = bake_pair(bpy.context, low, highs, chosen, cage)
    return report, {name: pixels(bpy.data.images[found["image"]]) for name, found in report.maps.items()}


def raw_maps(low, *highs, maps, size=64, **settings):
    """The maps by UDIM tile and name, (H, W, 4) float32 as Renderer.raw has them. Nothing is stored."""
    values = {"method": "FLATTEN", "margin": 0, "depth": 32, "storage": "MEMORY", "material": False, **settings}
    chosen = Settings(image="map", width=size, height=size, maps=tuple(maps), **values)
    request = Request(Job(low, highs), chosen)
    check_job(bpy.context, request.job, chosen)
    return progress.finish(draw_raw(bpy.context, request, Run(chosen)))[1]


def pixels(image):
    """The pixels (H, W, 4) float32 of an image datablock, row 0 at v = 0."""
    texels = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(texels)
    return texels.reshape(image.size[1], image.size[0], 4)


def texel_uv(width, height):
    """The coordinates (H, W, 2) that the texels stand for: their centers."""
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    return np.stack([u, v], axis=-1)
