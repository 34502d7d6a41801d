# SPDX-License-Identifier: GPL-3.0-or-later
"""Brings the colors of an image to those that Blender's Image Texture node shows: color space and alpha."""

import numpy as np
from bpy.types import Image

from ...core.material_feeds import ImagePixels
from ...core.threads import for_blocks
from .. import image_files

SRGB, LINEAR = "sRGB", "Linear Rec.709"
"""Color spaces of Blender's own configuration. Blender itself converts the others."""


def prepare_page(pixels: np.ndarray, width: int, image: Image, *, is_premultiplied: bool) -> ImagePixels:
    """Pixels (H * width, 4) float32 as Blender gives them for `image`, prepared in place.

    is_premultiplied: whether colors are multiplied with alpha.
    """
    space, is_data = image.colorspace_settings.name, image.colorspace_settings.is_data
    if image.alpha_mode == "NONE":
        pixels[:, 3] = 1.0
    has_alpha = has_alpha_in_colors(image) and not bool((pixels[:, 3] == 1.0).all())
    weighs_alpha = has_alpha and not is_premultiplied
    # Blender keeps bytes with straight alpha and floats with premultiplied alpha.
    multiply = has_alpha and is_premultiplied and not image.is_float
    divide = weighs_alpha and image.is_float
    if not image.is_float and not is_data and space == SRGB:
        if multiply:  # Blender's engines multiply stored values, before they are linear
            _multiply(pixels)
            _round_to_bytes(pixels)
        if not image_files.is_converting():
            return ImagePixels(pixels, is_srgb=True, is_byte=True, weighs_alpha=weighs_alpha)
        image_files.linearize_bytes(pixels)
        image_files.from_rec709(pixels)
        return ImagePixels(pixels, weighs_alpha=weighs_alpha)
    if not image.is_float and not is_data:  # Blender has converted floats
        if space == LINEAR:
            image_files.from_rec709(pixels)
        else:
            image_files.from_space(pixels, width, space)
    if multiply:
        _multiply(pixels)
    elif divide:
        _divide(pixels)
    is_raw = is_data or (space == LINEAR and not multiply and not image_files.is_converting())
    return ImagePixels(pixels, is_byte=is_raw and not image.is_float, weighs_alpha=weighs_alpha)


def has_alpha_in_colors(image: Image) -> bool:
    """Whether alpha has an influence on colors: not on data, nor where the image's alpha mode is Channel Packed or None."""
    return image.alpha_mode not in {"NONE", "CHANNEL_PACKED"} and not image.colorspace_settings.is_data


def _multiply(pixels: np.ndarray) -> None:
    def convert(part: slice) -> None:
        pixels[part, :3] *= pixels[part, 3:]

    for_blocks(len(pixels), convert)


def _divide(pixels: np.ndarray) -> None:
    def convert(part: slice) -> None:
        alpha = pixels[part, 3:]
        np.divide(pixels[part, :3], alpha, out=pixels[part, :3], where=alpha != 0.0)

    for_blocks(len(pixels), convert)


def _round_to_bytes(pixels: np.ndarray) -> None:
    def convert(part: slice) -> None:
        pixels[part, :3] = np.rint(pixels[part, :3] * 255.0) / 255.0

    for_blocks(len(pixels), convert)
