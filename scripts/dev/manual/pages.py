# SPDX-License-Identifier: GPL-3.0-or-later
"""The README's terrain, and the extension's icon and feature picture."""

from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

from scripts import demo
from scripts.dev.manual import models

Picture = tuple[str, np.ndarray]
TERRAIN_SIZE = (1500, 435)
FEATURE_SIZE = (1920, 1080)
ICON = 256


def terrain() -> Iterator[Picture]:
    """The picture that `imprint.py demo` makes, smaller."""
    models.clear()
    folder = Path(bpy.app.tempdir)
    high, _, mapped, flat = terrains = demo.build_terrains()
    demo.bake(high, mapped, 2048, folder / "low_normal.png")
    demo.bake(high, flat, 2048, folder / "plane_normal.png")
    demo.arrange(terrains)
    yield "terrain", models.render(TERRAIN_SIZE, 32)
    models.clear()


def extension() -> Iterator[Picture]:
    """The icon, and the carved monkey, its low mesh without the map, and with it."""
    yield "../extension/icon.png", icon()
    models.clear()
    high, low = models.monkeys()
    bare = low.copy()
    bare.data = low.data.copy()
    bare.data.materials.clear()
    bare.data.materials.append(models.material("bare", models.STONE))
    bpy.context.scene.collection.objects.link(bare)
    high.data.materials.clear()
    high.data.materials.append(models.material("carved", models.STONE))
    models.bake(low, high, width=4096, height=4096)
    for obj, words, x in ((high, "High", -2.9), (bare, "Low", 0.0), (low, "Low with the map", 2.9)):
        obj.location.x, obj.rotation_euler.z = x, -0.35
        models.letter(words, (x, -0.9, -1.5), 0.3)
        models.letter(f"{demo.count_triangles(obj):,} triangles", (x, -0.9, -1.85), 0.2)
    models.letter("Imprint", (0.0, -0.9, 1.62), 0.62)
    models.light_and_camera((0, -14, 0.0))
    camera = bpy.context.scene.camera.data
    camera.type, camera.ortho_scale = "ORTHO", 9.0
    models.set_sky("night")
    yield "../extension/feature.jpg", models.render(FEATURE_SIZE, 48)
    models.clear()


def icon() -> np.ndarray:
    """The normal map of a ball in a plate with a raised rim, on a plate with round corners."""
    scale = 4
    places = (np.arange(ICON * scale) + 0.5) / (ICON * scale) * 2 - 1
    x, y = np.meshgrid(places, -places)
    heights = (
        _relief(np.sqrt(x * x + y * y)) - 0.5 * np.clip((np.maximum(abs(x), abs(y)) - 0.80) / 0.12, 0, 1) ** 2 * 0.12
    )
    step = places[1] - places[0]
    slope_y, slope_x = np.gradient(heights, step)
    normals = np.stack([-slope_x, slope_y, np.ones_like(x)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    outside = np.maximum(abs(x) - 0.70, 0) ** 2 + np.maximum(abs(y) - 0.70, 0) ** 2 > 0.22**2
    color = np.where(outside[..., None], 0.11, normals * 0.5 + 0.5)
    small = color.reshape(ICON, scale, ICON, scale, 3).mean(axis=(1, 3))
    return np.round(small * 255).astype(np.uint8)


def _relief(radius: np.ndarray) -> np.ndarray:
    """Heights by the distance from the middle: a dent, and the rim around it."""
    dent = -np.sqrt(np.clip(0.52**2 - radius**2, 0, None)) * 0.9
    rim = 0.09 * np.exp(-(((radius - 0.56) / 0.05) ** 2))
    return dent + rim
