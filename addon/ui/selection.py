# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of the selected objects are parts of a set, and which are their high objects.

What a name or a pair calls low is a part, and what it calls high is none. Where nothing is called low, the active object is the
part that the others are baked onto, unless they lie side by side: then each is a part.
"""

import os
from collections.abc import Sequence

import bpy

from ..core import naming
from ..scene import object_checks
from . import object_pairs, sets, several
from .sets import NEW

LEAST_LETTERS = 3
"""The letters that names must have in common to name a set."""


def parts(context: bpy.types.Context) -> tuple[list[bpy.types.Object], list[bpy.types.Object]]:
    """The low objects among the selected ones, the active one first; and the high objects of the first, where the selection
    says which these are."""
    selected = _shown(context)
    free = sets.without_highs(context, [obj for obj in selected if obj.type == "MESH"])
    lows = [obj for obj in free if _is_low(context, obj)]
    active = context.active_object
    if len(lows) > 1:
        has_own = bool(sets.highs_of(context, lows[0])) if lows[0] == active else True
        rest = [obj for obj in selected if obj not in lows and obj in free]
        return lows, [] if has_own else rest
    if lows:
        return lows, highs_for(context, lows[0])
    if len(free) > 1 and len(free) == len(selected) and not several.lie_over(free):
        return free, []
    low = active if active in free else next(iter(free), None)
    return ([low], highs_for(context, low)) if low is not None else ([], [])


def highs_for(context: bpy.types.Context, low: bpy.types.Object) -> list[bpy.types.Object]:
    """The selected objects that can be high ones of `low`: no low object or cage."""
    cages = {pair.cage for pair in map(object_pairs.of, context.scene.objects) if pair is not None}
    suffixes = context.scene.imprint.suffixes()
    return [
        obj
        for obj in _shown(context)
        if obj != low and obj not in cages and not _is_low(context, obj) and naming.role(obj.name, suffixes) != "cage"
    ]


def _shown(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected objects that show a surface, the active one first."""
    shown = filter(object_checks.may_show, context.selected_objects)
    return sorted(shown, key=lambda obj: obj != context.active_object)


def _is_low(context: bpy.types.Context, obj: bpy.types.Object) -> bool:
    """Whether a name or a pair calls an object low."""
    pair = object_pairs.of(obj)
    is_paired = pair is not None and pair.is_kept
    return is_paired or naming.role(obj.name, context.scene.imprint.suffixes()) == "low"


def name_of(lows: Sequence[bpy.types.Object]) -> str:
    """The name of a set of these parts: what their names have in common, else their collection's."""
    names = [naming.without_suffix(low.name) for low in lows]
    common = os.path.commonprefix(names).rstrip("_-. 0123456789") if len(names) > 1 else names[0]
    if len(common) >= LEAST_LETTERS or len(names) == 1:
        return common
    collections = set.intersection(*(set(low.users_collection) for low in lows))
    return min((each.name for each in collections if not each.is_embedded_data), default=NEW)
