# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators on sets: they make, change and bake them."""

from collections.abc import Sequence

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty

from ..core.errors import BakeError, shorten_list
from ..core.progress import Pace, Progress, Task, part, relay
from ..jobs import sets as set_jobs
from ..jobs.job import Wants
from ..jobs.sets import SetJob
from ..scene import object_checks
from ..scene.object_checks import object_by_name
from . import object_pairs, results, selection, sets, signs
from .bake_operators import BakeOperator, Several
from .modal import QuickOperator
from .properties import Named
from .results import Batch
from .sets import ImprintSet
from .texts import label, labeled, tooltip


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
    low.imprint  # noqa: B018 - reading it makes the group, which panels may not do while they draw
    if all(slot.object != low for slot in one.parts):
        one.parts.add().object = low
        low.imprint  # noqa: B018 - reading it makes it, which the panel may not while it draws
        one.active_part = len(one.parts) - 1


def _put(context: bpy.types.Context, one: ImprintSet) -> str:
    """Add the parts among the selected objects to a set. Returns a sentence about what is in none, or ""."""
    lows, highs = selection.parts(context)
    if highs:
        put_pair(context, lows[0], highs)
    for low in lows:
        put_part(one, low)
    meshes = {obj for obj in context.selected_objects if obj.type == "MESH"}
    free = sets.without_highs(context, sorted(meshes.difference(lows, highs), key=lambda obj: obj.name))
    return f"Not added: {shorten_list(repr(obj.name) for obj in free)}, which nothing calls low." if free else ""


def put_pair(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    cage: bpy.types.Object | None = None,
) -> None:
    """Make these the high objects of a low one, unless its pair or its name has the same. The rays stay as they are, and the
    cage without another one."""
    panel, pair = context.scene.imprint, object_pairs.of(low)
    before = pair.cage if pair is not None and pair.is_kept else Named(context).cage(low)
    if set(panel.alone(context, low).highs) == set(highs) and cage in {None, before}:
        return
    check_editable(low)
    if pair is None or not pair.is_kept:
        object_pairs.remember_objects(low, highs, cage or before, panel.to_settings().flat(), {})
    else:
        pair.choose(highs)
        pair.cage = cage or before


def check_editable(low: bpy.types.Object) -> None:
    """Raise BakeError if an object can have no pair."""
    if not low.is_editable:
        raise BakeError(f"{low.name!r} is linked from another file: make it local, or a library override.")


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

    by_name: labeled(BoolProperty, "By Name", "Of all pairs by name, whatever is selected", options={"SKIP_SAVE"})

    def apply(self, context: bpy.types.Context) -> str:
        lows, _ = ([], []) if self.by_name else selection.parts(context)
        if not lows:
            return _add_by_name(context)
        one = add(context, selection.name_of(lows))
        left = _put(context, one)
        _take_rays(one, lows)
        one.active_part = 0
        return left


def _add_by_name(context: bpy.types.Context) -> str:
    """Add a set of all pairs by name, which bakes what Bake Pairs by Name does; an empty one if there are none."""
    panel = context.scene.imprint
    one = add(context, bpy.path.display_name_from_filepath(bpy.data.filepath))
    one.source = "NAMES" if panel.pairs_by_name(context)[0] else "PARTS"
    one.textures = "ONE" if panel.share_image else "PART"
    return ""


def _take_rays(one: ImprintSet, lows: Sequence[bpy.types.Object]) -> None:
    """Take over the method and distances that all parts were baked by, where they are not the scene's; else each part's own
    distance."""
    pairs = [pair for low in lows if (pair := object_pairs.of(low)) is not None and pair.is_kept]
    values = {tuple(getattr(pair, name) for name in object_pairs.CHOSEN) for pair in pairs}
    panel = one.id_data.imprint
    if len(values) == 1 and len(pairs) == len(lows):
        for name, value in zip(object_pairs.CHOSEN, *values, strict=True):
            if value != getattr(panel, name) and not (name in _DISTANCES and pairs[0].measure):
                setattr(one.own, name, value)
        return
    for pair in pairs:
        low = pair.id_data
        if not pair.measure and not low.imprint_distance and low.is_editable:
            low.imprint_distance = max(pair.extrusion, pair.max_distance / 2.0)


_DISTANCES = ("extrusion", "max_distance")


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
        one = _active(context)
        if one.source != "PARTS":
            raise BakeError("The parts of this set follow its collection or names: set Source to Parts first.")
        if not selection.parts(context)[0]:
            raise BakeError("No low object: select those to add.")
        return _put(context, one)


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
        new = [object_by_name(self.high)] if self.high else selection.highs_for(context, low)
        if not new or not all(map(object_checks.may_show, new)) or low in new:
            raise BakeError("No high object: select one beside the low object.")
        add_highs(context, low, new)
        return ""


def add_highs(context: bpy.types.Context, low: bpy.types.Object, new: Sequence[bpy.types.Object]) -> None:
    """Give a part high objects beside those that it has. Raises BakeError."""
    own = [high for high in context.scene.imprint.alone(context, low).highs if high != low]
    put_pair(context, low, list(dict.fromkeys([*own, *new])))


class IMPRINT_OT_set_high_remove(SetOperator, bpy.types.Operator):
    """Remove a high object from this part"""

    bl_idname = "imprint.set_high_remove"
    bl_label = "Remove High"

    low: labeled(StringProperty, "Low", "Name of the low object; empty for the active object", options={"SKIP_SAVE"})
    high: labeled(StringProperty, "High", "Name of the high object", options={"SKIP_SAVE"})

    def apply(self, context: bpy.types.Context) -> str:
        low = _low(context, self.low)
        check_editable(low)
        chosen = context.scene.imprint.alone(context, low)
        if chosen.pair is None and low not in chosen.highs:  # they were found by name
            left = [high for high in chosen.highs if high.name != self.high]
            if not left:
                raise BakeError(
                    f"{self.high!r} is called as {low.name!r} is: rename it, or add another high object first."
                )
            put_pair(context, low, left)
        else:
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

    setting: labeled(
        StringProperty,
        "Setting",
        "Name of the setting; empty to give all own settings back to the scene",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """For all settings, which these are; else Blender's, which is the first line above."""
        one = sets.active(context)
        if properties.setting or one is None:
            return ""
        shown = dict.fromkeys(label(one.own.bl_rna.properties[name].name) for name in one.own.names_of_own())
        return tooltip("Give all settings that are the set's own back to the scene: {}").format(", ".join(shown))

    def apply(self, context: bpy.types.Context) -> str:
        one = _active(context)
        if not self.setting:
            for name in one.own.names_of_own():
                one.back(name)
        elif one.is_own(self.setting):
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
        return (yield from bake_sets(context, chosen(context, self.name), pace, changed=self.changed))


def chosen(context: bpy.types.Context, name: str) -> list[tuple[SetJob, Wants]]:
    """The set of this name, or all that are on, as they are baked. Raises BakeError if there is none."""
    chosen = [one for one in context.scene.imprint_sets if (one.name == name if name else one.is_on)]
    if not chosen:
        raise BakeError(f"There is no set {name!r}." if name else "No set is on: switch one on, or add one.")
    context.view_layer.update()  # a script may link or rename objects and bake without a redraw
    wants = [Wants(exported=bool(one.own.whole.export)) for one in chosen]
    return list(zip(sets.resolve_all(context, chosen), wants, strict=True))


LOOKS = 0.1
"""The share of the bar for looks at what has changed."""


def bake_sets(
    context: bpy.types.Context, chosen: Sequence[tuple[SetJob, Wants]], pace: Pace, *, changed: bool = False
) -> Task[Several]:
    """Bake sets. What cannot be baked is left out. Raises BakeError if nothing can be.

    changed: only parts whose maps are not those of the scene as it is, which may be none.
    """
    parts = sum(len(set_job.wanted()) + sum(map(bool, dict(set_job.left_out))) for set_job, _ in chosen)
    done = Several([], [one for set_job, _ in chosen for one in set_job.left_out], parts)

    def noted(step: Progress) -> Progress:
        done.reports.extend([step.report] if step.report else [])
        done.left_out.extend([step.failure] if step.failure else [])
        return step

    try:
        for number, (set_job, wants) in enumerate(chosen):
            start, end = number / len(chosen), (number + 1) / len(chosen)
            begun = start + LOOKS * (end - start) if changed else start
            only = (yield from part(signs.untrue(context, set_job), start, begun)) if changed else None
            if only is not None and not only:
                continue
            steps = set_jobs.work(context, set_job, pace, only=only, wants=wants)
            try:
                yield from relay(part(steps, begun, end), noted)
            except BakeError as error:
                for low in filter(None, (job.low_ref.find() for job in set_job.wanted(only))):
                    object_pairs.keep_failure(low, str(error))
                if all(reason != str(error) for _, reason in done.left_out):
                    done.left_out.append(("", str(error)))
    except (GeneratorExit, MemoryError):  # the maps that are done stay
        results.remember(done.reports)
        raise
    if not done.reports and done.left_out:
        results.keep_batch(Batch(done.left_out))
        raise BakeError(done.left_out[0][1])
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
