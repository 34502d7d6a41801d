# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators on sets: they make, change and bake them."""

from collections.abc import Sequence

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty

from ..core import naming
from ..core.errors import BakeError
from ..core.progress import Pace, Progress, Task, part, relay
from ..jobs import sets as set_jobs
from ..jobs.job import Wants
from ..jobs.sets import SetJob
from ..scene import object_checks
from ..scene.object_checks import object_by_name
from . import object_pairs, results, sets
from .bake_operators import BakeOperator, Several
from .modal import QuickOperator
from .sets import ImprintSet
from .texts import labeled


def _active(context: bpy.types.Context) -> ImprintSet:
    """The active set, also while the panel bakes the selection. Raises BakeError if there is none."""
    return context.scene.imprint_sets[_index(context)]


def _index(context: bpy.types.Context) -> int:
    """The index of the active set. Raises BakeError if there is none."""
    scene = context.scene
    if not len(scene.imprint_sets):
        raise BakeError("There is no set: add one.")
    return min(scene.imprint.active_set, len(scene.imprint_sets) - 1)


def add(context: bpy.types.Context, name: str) -> ImprintSet:
    """A new set at the end, which becomes the active one."""
    scene = context.scene
    one = scene.imprint_sets.add()
    one.name = name
    scene.imprint.active_set, scene.imprint.bakes = len(scene.imprint_sets) - 1, "SETS"
    return one


def put_part(one: ImprintSet, low: bpy.types.Object) -> None:
    """Add a part to a set, unless it has it."""
    if all(slot.object != low for slot in one.parts):
        one.parts.add().object = low
        one.active_part = len(one.parts) - 1


def _selected_lows(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The low objects among the selected ones: what a name or a pair calls low, else what nothing calls high. Where the active
    object has the others as its high ones, it alone."""
    panel, selected = context.scene.imprint, [obj for obj in context.selected_objects if obj.type == "MESH"]
    low = context.active_object if context.active_object in selected else None
    free = sets.without_highs(context, selected)
    named = [obj for obj in free if naming.role(obj.name, panel.suffixes()) == "low" or _is_paired(obj)]
    if named:
        return named
    if low is not None and len(panel.all_chosen(context)) == 1:
        return [low]
    return free


def _is_paired(obj: bpy.types.Object) -> bool:
    pair = object_pairs.of(obj)
    return pair is not None and pair.is_kept


class SetOperator(QuickOperator):
    """An operator on the sets of a scene."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.scene is not None and context.scene.is_editable


class IMPRINT_OT_set_add(SetOperator, bpy.types.Operator):
    """Add a set of the selected objects: what a name or a pair calls low is a part. Nothing selected: of all pairs by name"""

    bl_idname = "imprint.set_add"
    bl_label = "Add Set"

    def apply(self, context: bpy.types.Context) -> str:
        lows = _selected_lows(context)
        if not context.selected_objects:
            _by_name(context)
            return ""
        one = add(context, naming.without_suffix(lows[0].name) if lows else "")
        for low in lows:
            put_part(one, low)
        _keep_pair(context, lows)
        return ""


def _by_name(context: bpy.types.Context) -> None:
    """Add a set of all pairs by name, with what Bake Pairs by Name takes."""
    panel = context.scene.imprint
    one = add(context, bpy.path.display_name_from_filepath(bpy.data.filepath) or "")
    one.source = "NAMES"
    one.textures = "ONE" if panel.share_image else "PART"


def _keep_pair(context: bpy.types.Context, lows: Sequence[bpy.types.Object]) -> None:
    """Make the pair of the active object, if it is the only part and others are selected as its high objects."""
    chosen = context.scene.imprint.chosen(context)
    if list(lows) == [chosen.low] and chosen.pair is None and chosen.highs and chosen.low not in chosen.highs:
        chosen.low.imprint.put(chosen.highs)


class IMPRINT_OT_set_remove(SetOperator, bpy.types.Operator):
    """Remove the active set. Its objects and maps stay"""

    bl_idname = "imprint.set_remove"
    bl_label = "Remove Set"

    def apply(self, context: bpy.types.Context) -> str:
        scene, at = context.scene, _index(context)
        scene.imprint_sets.remove(at)
        scene.imprint.active_set = max(0, min(at, len(scene.imprint_sets) - 1))
        return ""


class IMPRINT_OT_set_duplicate(SetOperator, bpy.types.Operator):
    """Add a copy of the active set, of the same objects"""

    bl_idname = "imprint.set_duplicate"
    bl_label = "Duplicate Set"

    def apply(self, context: bpy.types.Context) -> str:
        scene, at, name = context.scene, _index(context), _active(context).name
        one = add(context, name)
        sets.copy(scene.imprint_sets[at], one)
        scene.imprint_sets.move(len(scene.imprint_sets) - 1, at + 1)
        scene.imprint.active_set = at + 1
        return ""


class IMPRINT_OT_set_move(SetOperator, bpy.types.Operator):
    """Move the active set in the list"""

    bl_idname = "imprint.set_move"
    bl_label = "Move Set"

    direction: labeled(
        EnumProperty, "Direction", "Where to", items=[("UP", "Up", "One place up"), ("DOWN", "Down", "One place down")]
    )

    def apply(self, context: bpy.types.Context) -> str:
        scene, at = context.scene, _index(context)
        to = at + (1 if self.direction == "DOWN" else -1)
        if 0 <= to < len(scene.imprint_sets):
            scene.imprint_sets.move(at, to)
            scene.imprint.active_set = to
        return ""


class IMPRINT_OT_set_part_add(SetOperator, bpy.types.Operator):
    """Add the selected low objects to the active set"""

    bl_idname = "imprint.set_part_add"
    bl_label = "Add Part"

    def apply(self, context: bpy.types.Context) -> str:
        one, lows = _active(context), _selected_lows(context)
        for low in lows:
            put_part(one, low)
        _keep_pair(context, lows)
        return ""


class IMPRINT_OT_set_part_remove(SetOperator, bpy.types.Operator):
    """Remove the selected part from the active set"""

    bl_idname = "imprint.set_part_remove"
    bl_label = "Remove Part"

    index: labeled(IntProperty, "Index", "Of the part; -1 for the selected one", default=-1, options={"SKIP_SAVE"})

    def apply(self, context: bpy.types.Context) -> str:
        one = _active(context)
        at = self.index if self.index >= 0 else one.active_part
        if at < len(one.parts):
            one.parts.remove(at)
            one.active_part = max(0, min(at, len(one.parts) - 1))
        return ""


class IMPRINT_OT_set_high_add(SetOperator, bpy.types.Operator):
    """Make the selected objects high objects of this part, beside those that it has"""

    bl_idname = "imprint.set_high_add"
    bl_label = "Add High"

    low: labeled(StringProperty, "Low", "Name of the low object; empty for the active object", options={"SKIP_SAVE"})
    high: labeled(StringProperty, "High", "Name of the high object; empty for the selected ones", options={"SKIP_SAVE"})

    def apply(self, context: bpy.types.Context) -> str:
        low = _low(context, self.low)
        wanted = [object_by_name(self.high)] if self.high else context.selected_objects
        new = [obj for obj in wanted if obj != low and object_checks.may_show(obj)]
        if not new:
            raise BakeError("No high object: select one beside the low object.")
        own = [high for high in context.scene.imprint.alone(context, low).highs if high != low]
        low.imprint.is_own = False
        low.imprint.put(list(dict.fromkeys([*own, *new])))
        return ""


class IMPRINT_OT_set_high_remove(SetOperator, bpy.types.Operator):
    """Remove a high object from this part"""

    bl_idname = "imprint.set_high_remove"
    bl_label = "Remove High"

    low: labeled(StringProperty, "Low", "Name of the low object; empty for the active object", options={"SKIP_SAVE"})
    high: labeled(StringProperty, "High", "Name of the high object", options={"SKIP_SAVE"})

    def apply(self, context: bpy.types.Context) -> str:
        low = _low(context, self.low)
        chosen = context.scene.imprint.alone(context, low)
        if chosen.pair is None:  # from now on it is made by hand
            low.imprint.put([high for high in chosen.highs if high != low])
        low.imprint.remove(self.high)
        return ""


def _low(context: bpy.types.Context, name: str) -> bpy.types.Object:
    """The low object of a part. Raises BakeError."""
    low = object_by_name(name) if name else context.active_object
    if low is None or low.type != "MESH":
        raise BakeError("No low object: select it, or fill the slot.")
    return low


class IMPRINT_OT_set_own(SetOperator, bpy.types.Operator):
    """Make this setting the active set's own. Press again to take the scene's"""

    bl_idname = "imprint.set_own"
    bl_label = "Own Setting"

    setting: labeled(StringProperty, "Setting", "Name of the setting", options={"SKIP_SAVE"})

    def apply(self, context: bpy.types.Context) -> str:
        one = _active(context)
        if one.is_own(self.setting):
            one.back(self.setting)
        else:
            one.make_own(self.setting)
        return ""


class IMPRINT_OT_bake_sets(BakeOperator, bpy.types.Operator):
    """Bake the set of this name, or all sets that are on. Goes on after a part that fails"""

    bl_idname = "imprint.bake_sets"
    bl_label = "Bake Sets"
    bl_options = {"REGISTER", "UNDO"}

    name: labeled(StringProperty, "Name", "Name of the set; empty for all that are on", options={"SKIP_SAVE"})
    changed: labeled(
        BoolProperty, "Changed", "Bake only parts whose maps are not those of the scene as it is", options={"SKIP_SAVE"}
    )

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[Several]:
        return (yield from bake_sets(context, _resolved(context, self.name), pace))


def _resolved(context: bpy.types.Context, name: str) -> list[tuple[SetJob, Wants]]:
    """The set of this name, or all that are on, as they are baked. Raises BakeError if nothing can be."""
    chosen = [one for one in context.scene.imprint_sets if (one.name == name if name else one.is_on)]
    if not chosen:
        raise BakeError(f"There is no set {name!r}." if name else "No set is on: switch one on, or add one.")
    return [(sets.resolve(context, one), Wants(exported=bool(one.own.whole.export))) for one in chosen]


def bake_sets(context: bpy.types.Context, chosen: Sequence[tuple[SetJob, Wants]], pace: Pace) -> Task[Several]:
    """Bake sets. What cannot be baked is left out."""
    done = Several([], [one for set_job, _ in chosen for one in set_job.left_out])

    def noted(step: Progress) -> Progress:
        done.reports.extend([step.report] if step.report else [])
        done.left_out.extend([step.failure] if step.failure else [])
        return step

    try:
        for number, (set_job, wants) in enumerate(chosen):
            steps = set_jobs.work(context, set_job, pace, wants=wants)
            before = len(done.reports)
            reports = yield from relay(part(steps, number / len(chosen), (number + 1) / len(chosen)), noted)
            done.reports[before:] = reports
    except GeneratorExit:  # the maps that are done stay
        results.remember(done.reports)
        raise
    return done


CLASSES = (
    IMPRINT_OT_set_add,
    IMPRINT_OT_set_remove,
    IMPRINT_OT_set_duplicate,
    IMPRINT_OT_set_move,
    IMPRINT_OT_set_part_add,
    IMPRINT_OT_set_part_remove,
    IMPRINT_OT_set_high_add,
    IMPRINT_OT_set_high_remove,
    IMPRINT_OT_set_own,
    IMPRINT_OT_bake_sets,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
