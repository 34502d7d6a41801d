# SPDX-License-Identifier: GPL-3.0-or-later
"""Brings the colors of pixels to straight or premultiplied alpha, as Blender's Image Texture node shows them."""

import numpy as np
from bpy.types import Image

from ...mesh.threads import for_blocks


def set_alpha(pixels: np.ndarray, image: Image, *, is_premultiplied: bool) -> None:
    """Multiply linear colors (N, 4) of `image` with alpha, or divide them by it, in place.

    Blender keeps bytes with straight alpha and floats with premultiplied alpha. Alpha has no influence on the colors of data,
    and where the image's alpha mode is Channel Packed or None.
    """
    if image.alpha_mode == "NONE":
        pixels[:, 3] = 1.0
    if image.alpha_mode in {"NONE", "CHANNEL_PACKED"} or image.colorspace_settings.is_data:
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
