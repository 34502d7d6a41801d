# SPDX-License-Identifier: GPL-3.0-or-later
"""Brings the colors of pixels to straight or premultiplied alpha, as Blender's Image Texture node shows them."""

import numpy as np
from bpy.types import Image

from ...mesh.threads import for_blocks


def has_alpha_in_colors(image: Image) -> bool:
    """Whether alpha has an influence on colors: not on data, nor where the image's alpha mode is Channel Packed or None."""
    return image.alpha_mode not in {"NONE", "CHANNEL_PACKED"} and not image.colorspace_settings.is_data


def set_alpha(pixels: np.ndarray, image: Image, *, is_premultiplied: bool) -> None:
    """Multiply linear colors (N, 4) of `image` with alpha, or divide them by it, in place.

    Blender keeps bytes with straight alpha and floats with premultiplied alpha.
    """
    if image.alpha_mode == "NONE":
        pixels[:, 3] = 1.0
    if not has_alpha_in_colors(image):
        return
    if is_premultiplied == image.is_float or bool((pixels[:, 3] == 1.0).all()):
        return

    def convert(part: slice) -> None:
        alpha = pixels[part, 3:]
        if is_premultiplied:
            pixels[part, :3] *= alpha
        else:
            np.divide(pixels[part, :3], alpha, out=pixels[part, :3], where=alpha != 0.0)

    for_blocks(len(pixels), convert)
