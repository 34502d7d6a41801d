# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows of settings in panels: those of the scene or, while the panel bakes a set, those of the set where it has its own."""

from functools import cached_property
from typing import Any

import bpy

from ..core.declarations.choices import DistanceUnit, Storage
from ..core.settings import Settings
from . import object_pairs, set_lists, sets
from .declared_properties import length_name
from .properties import Chosen

PIN = {True: "PINNED", False: "UNPINNED"}
OF_PAIRS = (*object_pairs.CHOSEN, "cage")
"""The settings that a pair has for itself, where the panel bakes one low object."""
MADE = ("engine",)
"""Settings of a set that show what counts, whoever has it. To choose one makes all that it sets the set's own."""


def is_beside_unsaved(storage: str, output: str) -> bool:
    """Whether maps go beside a .blend file that was never saved. output: the path of the map."""
    return not bpy.data.filepath and storage == Storage.FILE and output.startswith("//")


class Rows:
    """The settings that panels show. Each has a pin while a set is active: what is pinned is the set's own.

    Attributes:
        set: The active set, or None.
    """

    def __init__(self, context: bpy.types.Context):
        self._context, self._panel = context, context.scene.imprint
        self.set = sets.active(context)

    @cached_property
    def chosen(self) -> Chosen:
        """The objects that the settings are for: those of the active part of the set, or those that are selected."""
        if self.set is None:
            return self._panel.chosen(self._context)
        low = set_lists.chosen_low(self._context)
        return self._panel.alone(self._context, low) if low is not None else Chosen(self._panel, None, [])

    @cached_property
    def settings(self) -> Settings:
        """The settings of a bake."""
        return self.set.settings if self.set else self.chosen.settings

    @property
    def is_unsaved(self) -> bool:
        """Whether the maps go beside a .blend file that was never saved."""
        return is_beside_unsaved(self["storage"], self["output"])

    def owner(self, name: str) -> bpy.types.PropertyGroup:
        """What stores a setting."""
        if self.set is not None:
            is_own = name in MADE or self.set.is_own(name)
            return self.set.own if is_own else self._panel
        return self.chosen.rays if name in OF_PAIRS else self._panel

    def __getitem__(self, name: str) -> Any:
        """The value of a setting."""
        return getattr(self.owner(name), name)

    def shown(self, reach: str) -> str:
        """As MapList.shown."""
        return length_name(reach) if self["distance_unit"] == DistanceUnit.SCENE else reach

    def prop(self, layout: bpy.types.UILayout, *names: str, **how: Any) -> None:
        """Draw settings, one below the other. how: as for UILayout.prop."""
        for name in names:
            row = self.row(layout)
            row.prop(self.owner(name), name, **how)
            self.pin(row, name)

    def search(self, layout: bpy.types.UILayout, name: str, *where: Any, **how: Any) -> None:
        """Draw a setting that is the name of an item of a collection. where: the owner of the collection, and its name."""
        row = self.row(layout)
        row.prop_search(self.owner(name), name, *where, **how)
        self.pin(row, name)

    def at_head(self, name: str) -> tuple[bpy.types.PropertyGroup, str]:
        """What stores a setting at the head of the panel, and under which name. Set while a set is active, it is the set's own
        at once: it stands under the set."""
        if self.set is None:
            return self._panel, name
        return self.set.own, sets.head_name(name) if name in sets.OF_HEAD else name

    def row(self, layout: bpy.types.UILayout) -> bpy.types.UILayout:
        """What a setting and its pin are drawn into: the layout itself if there are no pins."""
        return layout if self.set is None else layout.row(align=True)

    def pin(self, layout: bpy.types.UILayout, name: str) -> None:
        """Draw the pin of a setting, if a set is active and can have it."""
        if self.set is not None:
            icon = PIN[self.set.is_own(name)]
            layout.operator("imprint.set_own", text="", icon=icon, emboss=False).setting = name
