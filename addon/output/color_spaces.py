# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's color spaces: of images, and the working space in which the colors of materials are."""

import bpy
import numpy as np
from mathutils import Color

OTHER_NAMES = {
    "sRGB": ("sRGB Encoded Rec.709 (sRGB)", "sRGB - Texture", "Utility - sRGB - Texture", "srgb_texture", "srgb_tx"),
    "Linear Rec.709": ("Linear Rec.709 (sRGB)", "Utility - Linear - sRGB", "Linear", "lin_rec709", "lin_srgb"),
}
"""The names that other color configurations have for the color spaces of Blender's own."""


def assign(image: bpy.types.Image, color_space: str) -> None:
    """Give the image the color space with Blender's name `color_space`, or mark it as data for "".

    Only what differs is set, because Blender drops unsaved pixels when it changes. An image stays as it is if the color
    configuration does not have the space.
    """
    settings = image.colorspace_settings
    if not color_space:
        # Color configurations can have another name for "Non-Color", but not for its role.
        if not settings.is_data:
            settings.is_data = True
        return
    known = {item.identifier for item in settings.bl_rna.properties["name"].enum_items}
    name = next((name for name in (color_space, *OTHER_NAMES[color_space]) if name in known), None)
    if name is not None and settings.name != name:
        settings.name = name


def to_rec709(texels: np.ndarray) -> None:
    """Convert the colors of `texels` (height, width, 4) float32 in place from the working space to linear Rec.709."""
    columns = [Color(unit).from_scene_linear_to_rec709_linear() for unit in np.eye(3)]
    matrix = np.array(columns, np.float32)
    if not np.allclose(matrix, np.eye(3), atol=1e-5):
        texels[..., :3] = texels[..., :3] @ matrix
