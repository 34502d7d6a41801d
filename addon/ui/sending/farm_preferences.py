# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on's preferences: the address of a render farm."""

import bpy
from bpy.props import StringProperty

from ..translations import LABEL

MODULE = __package__.partition(".addon.")[0]
"""Blender's name for the extension."""


class IMPRINT_AP_preferences(bpy.types.AddonPreferences):
    """What the extension keeps in Blender's preferences."""

    bl_idname = MODULE

    flamenco: StringProperty(
        name="Flamenco Manager",
        description="Address of the Flamenco Manager that gets job files, as http://flamenco.local:8080",
        translation_context=LABEL,
    )

    def draw(self, _context: bpy.types.Context) -> None:
        self.layout.prop(self, "flamenco")


def flamenco_address(context: bpy.types.Context) -> str:
    """The address of the Flamenco Manager, or "" if none is set, or if this is no installed extension."""
    own = context.preferences.addons.get(MODULE)
    return own.preferences.flamenco.strip() if own and own.preferences else ""


CLASSES = (IMPRINT_AP_preferences,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
