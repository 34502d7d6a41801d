# SPDX-License-Identifier: GPL-3.0-or-later
"""The lists of the sets and of their parts, as Blender draws them: their rows, and which low object a row stands for."""

from collections.abc import Sequence
from fnmatch import fnmatchcase

import bpy

from ..core.errors import BakeError
from ..scene.object_checks import ObjectRef
from . import sets
from .callbacks import until_change
from .sets import ImprintPart, ImprintSet
from .texts import message

Item = ImprintPart | bpy.types.Object
"""An item of the list of parts: of the set's own list, or an object of the scene or of a collection."""


def listed(context: bpy.types.Context, one: ImprintSet) -> tuple[bpy.types.bpy_struct, str]:
    """The collection of Blender whose items the list of parts shows, and its name. Not all of them need be parts."""
    if one.source == "PARTS":
        return one, "parts"
    if one.source == "COLLECTION" and one.collection is not None:
        return one.collection, "all_objects"
    return context.view_layer, "objects"


def low_of(item: Item) -> bpy.types.Object | None:
    """The object of an item; None for one that is gone."""
    return item if isinstance(item, bpy.types.Object) else item.find()


def chosen_low(context: bpy.types.Context) -> bpy.types.Object | None:
    """The low object of the row that is chosen in the list of parts of the active set; None if it is none."""
    one = sets.active(context)
    if one is None:
        return None
    owner, name = listed(context, one)
    items = getattr(owner, name)
    low = low_of(items[one.active_part]) if one.active_part < len(items) else None
    return low if low is not None and (one.source == "PARTS" or low.session_uid in uids(context, one)) else None


def uids(context: bpy.types.Context, one: ImprintSet) -> frozenset[int]:
    """The session_uid of each low object of a set."""
    return _known(context, one)[0]


def lows(context: bpy.types.Context, one: ImprintSet) -> list[bpy.types.Object]:
    """As sets.lows, for each redraw."""
    return [low for ref in _known(context, one)[2] if (low := ref.find()) is not None]


def problem(context: bpy.types.Context, one: ImprintSet) -> str:
    """Why no parts can be found, in a sentence; empty if they can."""
    return _known(context, one)[1]


def _known(context: bpy.types.Context, one: ImprintSet) -> tuple[frozenset[int], str, list[ObjectRef]]:
    def find() -> tuple[frozenset[int], str, list[ObjectRef]]:
        try:
            refs = list(map(ObjectRef.of, sets.lows(context, one)))
        except BakeError as error:
            return frozenset(), str(error), []
        return frozenset(ref.uid for ref in refs), "", refs

    collection = one.collection.session_uid if one.collection is not None else 0
    suffixes, layer = context.scene.imprint.suffixes(), context.view_layer.name
    key = (one.source, collection, len(one.parts), suffixes, context.scene.session_uid, layer)
    return until_change.get(f"parts of {one.name}", key, find)


class IMPRINT_UL_sets(bpy.types.UIList):
    """The sets of a scene."""

    def draw_item(self, _context, layout, _data, one, _icon, _active_data, _active_property) -> None:
        row = layout.row(align=True)
        row.prop(one, "is_on", text="")
        row.prop(one, "name", text="", emboss=False)


class IMPRINT_UL_parts(bpy.types.UIList):
    """The parts of a set."""

    def draw_item(self, context, layout, _data, item, _icon, active_data, _active_property) -> None:
        low = low_of(item)
        if low is None:
            layout.label(text=item.title, icon="ERROR", translate=False)
            return
        row = layout.row(align=True)
        row.prop(low, "imprint_is_baked", text="")
        split = row.split(factor=0.6, align=True)
        split.active = low.imprint_is_baked
        split.label(text=low.name, translate=False)
        highs = split.row(align=True)
        highs.active = False
        highs.label(text=short_highs(low, highs_of(context, active_data, low)), translate=False)
        if low.imprint_size != "0":
            size = split.row(align=True)
            size.alignment = "RIGHT"
            size.label(text=low.imprint_size, translate=False)

    def filter_items(self, context, data, name) -> tuple[list[int], list[int]]:
        items, one = getattr(data, name), sets.active(context)
        is_whole = one is None or one.source == "PARTS"
        if is_whole and not self.filter_name:
            return [], []
        shown, pattern = None if is_whole else uids(context, one), f"*{self.filter_name.lower()}*"
        flags = [self.bitflag_filter_item if _is_shown(item, shown, pattern) else 0 for item in items]
        return flags, []


def _is_shown(item: Item, shown: frozenset[int] | None, pattern: str) -> bool:
    """Whether an item is among those that are shown, all for None, and its name fits the pattern."""
    if shown is not None and item.session_uid not in shown:
        return False
    return fnmatchcase((item.name if isinstance(item, bpy.types.Object) else item.title).lower(), pattern)


def highs_of(context: bpy.types.Context, one: ImprintSet, low: bpy.types.Object) -> list[str]:
    """The names of the high objects of a part, also of those that are missing."""
    panel = context.scene.imprint

    def find() -> list[str]:
        if one.source == "NAMES":
            return next((list(pair.highs) for pair in panel.pairs_by_name(context)[0] if pair.low == low.name), [])
        chosen = panel.alone(context, low)
        return [*(high.name for high in chosen.highs), *chosen.missing]

    return until_change.get(f"highs of {low.session_uid}", (one.source, low.name, panel.suffixes()), find)


def short_highs(low: bpy.types.Object, highs: Sequence[str]) -> str:
    """The high objects of a part in a word or two: a name, or their number."""
    if not highs:
        return message("none")
    if list(highs) == [low.name]:
        return message("itself")
    return highs[0] if len(highs) == 1 else message("{} highs").format(len(highs))


CLASSES = (IMPRINT_UL_sets, IMPRINT_UL_parts)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
