# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes texels to image files, with Blender's own writers."""

from pathlib import Path

import bpy
import numpy as np

from ..core import file_formats
from ..core.file_structure import completeness


def write(texels: np.ndarray, path: Path, depth: int) -> None:
    """Write `texels`, (height, width, 4) float32 with row 0 at v = 0, to `path`, in the format that its ending names.

    Alpha is 0 or 1: by anything in between, Blender's 16-bit PNG writer divides. depth: bits per channel. Numbers are
    stored as they are, with the colors under alpha 0. Raises OSError or RuntimeError if that fails, and leaves a partial
    file.
    """
    height, width = texels.shape[:2]
    file_format = file_formats.of(path)
    # A scene of its own for Blender's image writer: the artist's output settings stay as they are.
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
        raise RuntimeError("the disk took only a part of it")
    if file_format.correct:
        file_format.correct(path)
