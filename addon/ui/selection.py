# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of the selected objects are parts of a set, and which are their high objects.

What a name or a pair calls low is a part, and what it calls high is none. Where nothing is called low, the active object is the
part that the others are baked onto, unless they lie elsewhere: then each is a part.
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
    selected, panel = _shown(context), context.scene.imprint
    free = sets.without_highs(context, [obj for obj in selected if obj.type == "MESH"])
    lows = [obj for obj in free if several.is_low(obj, panel)]
    active = context.active_object
    if len(lows) > 1:
        has_own = bool(sets.highs_of(context, lows[0])) if lows[0] == active else True
        rest = [obj for obj in selected if obj not in lows and obj in free]
        return lows, [] if has_own else rest
    if not lows and len(free) > 1 and len(free) == len(selected) and not several.lie_over(free):
        return free, []
    low = lows[0] if lows else active if active in free else next(iter(free), None)
    return _with_its_highs(context, low, free) if low is not None else ([], [])


def _with_its_highs(
    context: bpy.types.Context, low: bpy.types.Object, free: Sequence[bpy.types.Object]
) -> tuple[list[bpy.types.Object], list[bpy.types.Object]]:
    """As `parts`, of a low object and what lies over it, or all if nothing does. Meshes elsewhere are parts of their own. free:
    those that nothing calls high."""
    own, others = sets.highs_of(context, low), highs_for(context, low)
    near = [obj for obj in others if obj in own or several.lie_over([low, obj])]
    if not near and not own:
        return [low], others
    return [low, *(obj for obj in others if obj in free and obj not in near)], near


def highs_for(context: bpy.types.Context, low: bpy.types.Object) -> list[bpy.types.Object]:
    """The selected objects that can be high ones of `low`: no low object or cage."""
    cages = {pair.cage for pair in map(object_pairs.of, context.scene.objects) if pair is not None}
    panel = context.scene.imprint
    suffixes = panel.suffixes()
    return [
        obj
        for obj in _shown(context)
        if obj != low
        and obj not in cages
        and not several.is_low(obj, panel)
        and naming.role(obj.name, suffixes) != "cage"
    ]


def _shown(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected objects that show a surface, the active one first."""
    shown = filter(object_checks.may_show, context.selected_objects)
    return sorted(shown, key=lambda obj: obj != context.active_object)


def name_of(lows: Sequence[bpy.types.Object]) -> str:
    """The name of a set of these parts: what their names have in common, else their collection's."""
    names = [naming.without_suffix(low.name) for low in lows]
    common = os.path.commonprefix(names).rstrip("_-. 0123456789") if len(names) > 1 else names[0]
    if len(common) >= LEAST_LETTERS or len(names) == 1:
        return common
    collections = set.intersection(*(set(low.users_collection) for low in lows))
    return min((each.name for each in collections if not each.is_embedded_data), default=NEW)
