# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel says of a pair before it is baked: findings, notes of materials and poses, and a look at the high objects.

All of it is kept until an object changes, since a panel is drawn many times a second.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import bpy

from ..core.declarations.choices import Modifiers
from ..core.sentences import NOTE, Sentence, by_harm
from ..core.settings import Settings
from ..jobs import pair_checks
from ..jobs.pair_checks import Finding
from ..scene import poses, reading, render_view
from ..scene.object_checks import ObjectRef
from . import results
from .callbacks import Timer, events, redraw
from .modal import QuickOperator, WaitingOperator
from .progress_display import display

POSE_SECONDS = 0.2
"""Between a change and the measurement of poses for the panel."""
MOST_POSED = 500_000
"""The vertices of a pair up to which the panel measures poses. A bake measures them in any case."""


@dataclass(frozen=True)
class _Kept:
    """What was found the last time."""

    key: tuple
    """What it was found for."""
    found: list
    follows: frozenset[int] = frozenset()
    """The session_uid of the objects and meshes whose changes make it old."""
    if_moved: bool = True
    """Whether a transform is such a change."""


class PanelFindings:
    """The findings for the low object of the panel."""

    def __init__(self):
        self.looks = 0
        """How often a mesh was looked at."""
        self._kept: dict[str, _Kept] = {}
        self._posed: list[ObjectRef] = []
        """The objects whose poses are to be measured."""
        self._is_measuring = False
        self._timer = Timer(self.measure_poses)
        events.hear(depsgraph_update_post=self._after_update, undo_post=self.drop, redo_post=self.drop, end=self.drop)

    def of(
        self,
        context: bpy.types.Context,
        low: bpy.types.Object,
        highs: list[bpy.types.Object],
        settings: Settings,
        *,
        is_exported: bool = False,
    ) -> list[Finding]:
        """The findings for a bake of `low`: whether it is flipped, and more if other programs read the map. settings: of the
        panel, valid.

        is_exported: as in pair_checks.is_for_others.
        """
        find = partial(pair_checks.viewport_flipped, context, low, highs)
        flipped = self._known("flipped", *_key_of(low, highs), find=find)
        if not settings.tracing.keep_faces:  # the bake turns them over
            flipped = [each for each in flipped if not each.values["is_high"]]
        if not pair_checks.is_for_others(settings, is_exported=is_exported):
            return flipped
        return flipped + pair_checks.unsolved_by_export(
            self._of_low(context, low, low in highs, settings), is_exported=is_exported
        )

    def _of_low(
        self, context: bpy.types.Context, low: bpy.types.Object, is_own_base: bool, settings: Settings
    ) -> list[Finding]:
        """The findings in the low object alone."""

        def find() -> list[Finding]:
            self.looks += 1
            return pair_checks.viewport_findings(context, low, settings, is_own_base=is_own_base)

        layer = settings.map.uv_layer or pair_checks.active_layer(low)
        # Names are in the sentences.
        key = low.name, low.mode, is_own_base, layer, pair_checks.active_layer(low), settings.sampling.udim
        uids = low.session_uid, low.data.session_uid
        return self._known("low", (*uids, *key), frozenset(uids), find=find, if_moved=False)

    def material_notes(self, low: bpy.types.Object, highs: list[bpy.types.Object], settings: Settings) -> list[str]:
        """What the maps will not have of the high objects' materials."""
        slots = (slot.material for high in highs for slot in high.material_slots)
        key = (
            *_key_of(low, highs)[0],
            settings.map.drawn_maps,
            settings.map.exact_materials,
            settings.map.normal and settings.map.detail_maps,
            *((material.session_uid, material.name) for material in slots if material is not None),
        )
        find = partial(pair_checks.viewport_material_notes, low, highs, settings.map)
        return self._known("materials", key, frozenset(), find=find)

    def pose_notes(
        self, context: bpy.types.Context, low: bpy.types.Object, highs: list[bpy.types.Object], settings: Settings
    ) -> list[str]:
        """What only one of the objects is moved by, in sentences, as it was measured last. A panel may not measure it while
        it is drawn: that is done soon after."""
        for_render = settings.map.modifiers == Modifiers.RENDER
        if settings.map.rest_pose or not poses.may_differ(low, highs, for_render=for_render):
            return []

        def find() -> list[str]:
            self._posed = [ObjectRef.of(obj) for obj in (low, *highs)]
            self._timer.start(POSE_SECONDS)
            return []

        key, uids = _key_of(low, highs)
        return self._known("poses", (*key, for_render), uids, find=find)

    def measure_poses(self) -> None:
        """Measure what `pose_notes` returns, unless objects have changed since, or other work is under way."""
        kept = self._kept.get("poses")
        if kept is None:
            return
        if render_view.is_busy():  # then it is measured later
            del self._kept["poses"]
            return
        objects, screen = [ref.find() for ref in self._posed], bpy.context.screen
        is_busy = display.current is not None or (screen is not None and screen.is_animation_playing)
        if None in objects or is_busy or any(obj.mode != "OBJECT" for obj in objects):
            return
        if sum(len(obj.data.vertices) for obj in objects if obj.type == "MESH") > MOST_POSED:
            return
        self._is_measuring = True
        try:
            notes = poses.notes(bpy.context, objects[0], objects[1:], for_render=kept.key[-1])
        finally:
            self._is_measuring = False
        self._kept["poses"] = replace(kept, found=notes)
        redraw()

    def worst(self, context: bpy.types.Context, low: bpy.types.Object) -> Sentence | None:
        """The sentence that tells of the most harm to the maps of `low`, for a row; None where nothing but notes is known."""
        found = (text for report in results.all_of(context, low) for text in report.warnings)
        return next((text for text in by_harm(found) if text.harm is not NOTE), None)

    def keep_look(self, low: bpy.types.Object, highs: list[bpy.types.Object], lines: list[str]) -> None:
        """Remember what a look at the high objects found, until one of the objects changes."""
        key, uids = _key_of(low, highs)
        self._kept["look"] = _Kept(key, lines, uids)

    def look_of(self, low: bpy.types.Object, highs: list[bpy.types.Object]) -> list[str]:
        """What the last look at these objects found; empty without one."""
        kept = self._kept.get("look")
        return kept.found if kept is not None and kept.key == _key_of(low, highs)[0] else []

    def _known(
        self, name: str, key: tuple, follows: frozenset[int], *, find: Callable[[], list], if_moved: bool = True
    ) -> list:
        """What was found the last time for the same key, or else what `find` finds. The others: as in _Kept."""
        kept = self._kept.get(name)
        if kept is None or kept.key != key:
            kept = self._kept[name] = _Kept(key, find(), follows, if_moved)
        return kept.found

    def drop(self, *_) -> None:
        """Forget the findings."""
        self._kept = {name: kept for name, kept in self._kept.items() if name == "poses" and self._is_measuring}

    def _after_update(self, _scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        if not self._kept or self._is_measuring:
            return
        moved, changed = set(), set()
        for update in depsgraph.updates:
            if isinstance(update.id, (bpy.types.Material, bpy.types.NodeTree)):
                self._kept.pop("materials", None)
            if update.is_updated_transform:
                moved.add(update.id.original.session_uid)
            if update.is_updated_geometry or isinstance(update.id, bpy.types.Mesh):
                changed.add(update.id.original.session_uid)
        for name, kept in list(self._kept.items()):
            if not kept.follows.isdisjoint(changed | moved if kept.if_moved else changed):
                del self._kept[name]


def _key_of(low: bpy.types.Object, highs: list[bpy.types.Object]) -> tuple[tuple, frozenset[int]]:
    """What tells a pair from another one, and the session_uid of its objects and their data."""
    objects = low, *highs
    uids = [(obj.session_uid, obj.data.session_uid if obj.data else 0) for obj in objects]
    key = tuple((*each, obj.name, obj.mode) for each, obj in zip(uids, objects, strict=True))
    return key, frozenset(uid for each in uids for uid in each)


findings = PanelFindings()


class IMPRINT_OT_look_at_high(WaitingOperator, QuickOperator, bpy.types.Operator):
    """Say what the high objects are before a bake: parts, faces to turn over or leave out, noise, distance to the low object"""

    bl_idname = "imprint.look_at_high"
    bl_label = "Look at High"

    def apply(self, context: bpy.types.Context) -> str:
        chosen = context.scene.imprint.chosen(context)
        job, settings = chosen.job(context)
        lines = pair_checks.look_at_high(context, job, settings).lines(reading.lengths_of(context.scene))
        findings.keep_look(chosen.low, chosen.highs, lines)
        return ". ".join(lines)


CLASSES = (IMPRINT_OT_look_at_high,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
