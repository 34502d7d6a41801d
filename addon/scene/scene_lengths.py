# SPDX-License-Identifier: GPL-3.0-or-later
"""Lengths as text, in the units of a scene."""

import bpy

from ..core import lengths
from ..core.lengths import Length


def of(scene: bpy.types.Scene) -> Length:
    """Lengths as Blender shows them in this scene."""
    units = scene.unit_settings
    system, scale = units.system, units.scale_length
    if system == "NONE":
        return lengths.plain
    return lambda value: bpy.utils.units.to_string(system, "LENGTH", value * scale, precision=lengths.DIGITS).strip()
