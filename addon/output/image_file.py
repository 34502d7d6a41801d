# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes texels to image files, with Blender's own writers."""

from pathlib import Path

import bpy
import numpy as np

from ..core import file_formats
from ..core.file_structure import completeness


def write(texels: np.ndarray, path: Path, depth: int) -> None:
    """Write `texels`, (height, width, 4) float32 with row 0 at v = 0, to `path`, in the format that its ending names.

    depth: bits per channel. Values are stored unchanged, whatever alpha is. Raises OSError or RuntimeError if writing fails,
    which can leave a partial file.
    """
    height, width = texels.shape[:2]
    file_format = file_formats.of(path)
    if depth in file_format.divided:
        texels = _multiplied(texels)
    # Blender's image writer reads its settings from a scene. A new scene leaves the user's settings unchanged.
    scene = bpy.data.scenes.new("Imprint output")
    image = bpy.data.images.new("Imprint output", width, height, alpha=True, float_buffer=depth > 8, is_data=True)
    try:
        image.pixels.foreach_set(texels.reshape(-1))
        output = scene.render.image_settings
        output.file_format = file_format.blender
        output.color_mode, output.color_depth = "RGBA", str(depth)
        for name, value in file_format.options.items():
            setattr(output, name, value)
        image.save_render(str(path), scene=scene)
    finally:
        bpy.data.images.remove(image)
        bpy.data.scenes.remove(scene)
    if not completeness.is_complete(path, file_format.is_complete, (width, height)):
        raise RuntimeError("only a part of the file was written, perhaps because the disk is full")
    if file_format.correct:
        file_format.correct(path)


def _multiplied(texels: np.ndarray) -> np.ndarray:
    """`texels` with colors multiplied by an alpha between 0 and 1, for writers that divide by it."""
    alpha = texels[..., 3:]
    if not ((alpha > 0.0) & (alpha < 1.0)).any():
        return texels
    result = texels.copy()
    result[..., :3] *= np.where(alpha > 0.0, alpha, np.float32(1.0))
    return result
