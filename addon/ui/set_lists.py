# SPDX-License-Identifier: GPL-3.0-or-later
"""The lists of the sets and of their parts, as Blender draws them: their rows, and which low object a row stands for."""

from dataclasses import dataclass
from fnmatch import fnmatchcase

import bpy

from ..core.errors import BakeError
from ..scene import object_checks
from . import bake_queue, object_pairs, sets, signs
from .callbacks import until_change
from .properties import Named
from .sets import ImprintPart, ImprintSet
from .texts import font_size, message, room, text_width

BESIDE_NAMES = 96.0
"""What a check box, a sign, buttons and margins take of a row, in pixels at a scale of 1."""
GAP = 12.0
"""The space beside a name, in pixels at a scale of 1."""
LEAST = 36.0
"""The space for a name that Blender shortens, in pixels at a scale of 1."""
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


def problem(context: bpy.types.Context, one: ImprintSet) -> str:
    """Why no parts can be found, in a sentence; empty if they can."""
    return _known(context, one)[1]


def _known(context: bpy.types.Context, one: ImprintSet) -> tuple[frozenset[int], str]:
    def find() -> tuple[frozenset[int], str]:
        try:
            return frozenset(low.session_uid for low in sets.lows(context, one)), ""
        except BakeError as error:
            return frozenset(), str(error)

    collection = one.collection.session_uid if one.collection is not None else 0
    suffixes, layer = context.scene.imprint.suffixes(), context.view_layer.name
    key = (one.source, collection, len(one.parts), suffixes, context.scene.session_uid, layer)
    return until_change.get(f"parts of {one.name}", key, find)


class IMPRINT_UL_sets(bpy.types.UIList):
    """The sets of a scene."""

    def draw_item(self, context, layout, _data, one, _icon, _active_data, _active_property) -> None:
        row = layout.row(align=True)
        row.prop(one, "is_on", text="")
        row.prop(one, "name", text="", emboss=False)
        queued = bake_queue.state_of(context.scene, one.name)
        if queued is not None and queued.is_open:
            part = row.row()
            part.alignment = "RIGHT"
            part.label(text=queued.text, translate=False)
        row.label(text="", icon=signs.of_set(context, one).icon)


class IMPRINT_UL_parts(bpy.types.UIList):
    """The parts of a set."""

    def draw_item(self, context, layout, _data, item, _icon, active_data, _active_property) -> None:
        low = low_of(item)
        if low is None:
            layout.label(text=item.title, icon="ERROR", translate=False)
            return
        part = part_of(context, active_data, low)
        row = layout.row(align=True)
        row.prop(low, "imprint_is_baked", text="")
        names = row.row(align=True)
        names.active = low.imprint_is_baked
        size, space = font_size(1.0), room(context) - BESIDE_NAMES
        taken, short = text_width(low.name, size) + GAP, part.short(low)
        if text_width(short, size) > space - taken and len(part.highs) > 1:
            short = str(len(part.highs))
        if min(text_width(short, size), LEAST) > space - taken:  # the name of the low object comes first
            names.label(text=low.name, translate=False)
        else:
            split = names.split(factor=taken / space, align=True)
            split.label(text=low.name, translate=False)
            highs = split.row(align=True)
            highs.active, highs.alignment = False, "RIGHT"
            highs.label(text=short, translate=False)
        if low.imprint_size != "0":
            size = row.row(align=True)
            size.alignment = "RIGHT"
            size.label(text=low.imprint_size, translate=False)
        is_wrong = part.problem and low.imprint_is_baked
        row.label(text="", icon="ERROR" if is_wrong else signs.of(context, low).icon)

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


@dataclass(frozen=True)
class Part:
    """What a row says of a low object.

    Attributes:
        highs: The names of its high objects, also of those that are missing.
        problem: Why it cannot be baked, in a sentence; empty if no reason is known.
    """

    highs: tuple[str, ...]
    problem: str

    def short(self, low: bpy.types.Object) -> str:
        """The high objects in a word or two: a name, or their number."""
        if not self.highs:
            return message("none")
        if self.highs == (low.name,):
            return message("itself")
        return self.highs[0] if len(self.highs) == 1 else message("{} highs").format(len(self.highs))


def part_of(context: bpy.types.Context, one: ImprintSet, low: bpy.types.Object) -> Part:
    """What the row of a part says."""
    panel = context.scene.imprint

    def find() -> Part:
        chosen, missing = panel.alone(context, low), []
        highs, cage = chosen.highs, chosen.pair.cage if chosen.pair is not None else None
        if one.source == "NAMES":
            highs = Named(context).highs(low)
        else:
            missing = chosen.missing
        problem = object_pairs.problem(missing) or object_checks.problem(context, low, highs, cage, method)
        return Part((*(high.name for high in highs), *missing), problem)

    method = one.own.whole.method
    key = (one.source, low.name, method, panel.suffixes())
    return until_change.get(f"part {low.session_uid}", key, find)


CLASSES = (IMPRINT_UL_sets, IMPRINT_UL_parts)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
