# SPDX-License-Identifier: GPL-3.0-or-later
"""Lengths as text, in the units of a scene."""

from collections.abc import Callable

import bpy

DIGITS = 4
"""Significant ones of a length without a unit, and the most after the point of one with a unit."""


def of(context: bpy.types.Context) -> Callable[[float], str]:
    """A function that gives a length in scene units as text, as Blender shows lengths."""
    units = context.scene.unit_settings
    system, scale = units.system, units.scale_length
    if system == "NONE":
        return f"{{:.{DIGITS}g}}".format
    return lambda value: bpy.utils.units.to_string(system, "LENGTH", value * scale, precision=DIGITS).strip()
