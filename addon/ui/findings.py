# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel says of a pair before it is baked: findings, notes of materials and poses, and a look at the high objects.

All of it is kept until an object changes, since a panel is drawn many times a second.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter, is_
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ..core import naming, preflight
from ..core.declarations.choices import Method, Modifiers
from ..core.errors import Fix, shorten_list
from ..core.sentences import LOOK, NOTE, WRONG, Sentence, rated
from ..core.settings import Settings
from ..jobs import fixes, pair_checks
from ..jobs.pair_checks import Finding
from ..scene import object_checks, poses, reading, render_view
from ..scene.object_checks import ObjectRef
from . import object_pairs, results, sets, several
from .callbacks import Timer, events, redraw, until_change
from .fix_buttons import Told, grouped
from .modal import QuickOperator, WaitingOperator
from .progress_display import display
from .texts import message

if TYPE_CHECKING:
    from .properties import Chosen

WAIT, SLICE = 0.2, 0.02
"""Seconds between a change and a look that takes longer than a redraw may, and between two looks."""
MOST_POSED = 500_000
"""The vertices of a pair up to which the panel measures poses. A bake measures them in any case."""
MOST_AT_ONCE = 20_000
"""The corners of a low mesh up to which it is looked at while the panel is drawn: some hundredths of a second."""
CHECKED = ("outside", "overlap")
"""What is known of UVs before a bake, as its report calls it."""
BY_RANK = attrgetter("rank")
MOST_KEPT = 4000
"""Of all low objects."""


@dataclass(frozen=True)
class _Kept:
    """What was found the last time."""

    key: tuple
    """What it was found for."""
    found: list | dict
    follows: frozenset[int] = frozenset()
    """The session_uid of the objects and meshes whose changes make it old."""
    if_moved: bool = True
    """Whether a transform is such a change."""
    is_known: bool = True
    """Whether it was looked at: what takes long is so soon after it was asked for."""


class PanelFindings:
    """What is known of pairs before they are baked."""

    def __init__(self):
        self.looks = 0
        """How often a mesh was looked at."""
        self._kept: dict[tuple[str, int], _Kept] = {}
        """By the name of the check and the session_uid of the low object; that of the panel alone has 0."""
        self._asked: dict[tuple[str, int], Callable[[], list | dict | None]] = {}
        """What is to be looked at; it gives None where that cannot be done now."""
        self._compared: list[dict] = []
        """The texels of low objects that were compared the last time."""
        self._shares: list[float] = []
        """What was found: of each, as pair_checks.lost_shares returns it."""
        self._is_looking = False
        self._timer = Timer(self.look)
        events.hear(depsgraph_update_post=self._after_update, undo_post=self.drop, redo_post=self.drop, end=self.drop)

    def before(self, context: bpy.types.Context, chosen: "Chosen") -> list[Told]:
        """What is known of a pair that can be baked, the worst first."""
        low, highs, settings = chosen.low, chosen.highs, chosen.settings
        issues = self.of(context, low, highs, settings, is_exported=bool(chosen.panel.export))
        sentences = [
            *self.pose_notes(context, low, highs, settings),
            *self._unfit(low, highs, settings),
            *self.material_notes(low, highs, settings),
        ]
        return sorted([*map(_told, issues), *_swapped(low, highs), *map(Told.of, sentences)], key=BY_RANK)

    def told(self, context: bpy.types.Context, chosen: "Chosen") -> list[Told]:
        """As `before`, with what the last bake has found and is not looked at before the next one."""
        before, kept = self.before(context, chosen), self._kept.get(("low", chosen.low.session_uid))
        known = {told.text for told in before}
        looked_at = CHECKED if kept is not None and kept.is_known else ()
        after = [told for told in self._past(context, chosen.low) if told.kind not in looked_at]
        return sorted([*before, *(told for told in after if told.text not in known)], key=BY_RANK)

    def of(
        self,
        context: bpy.types.Context,
        low: bpy.types.Object,
        highs: list[bpy.types.Object],
        settings: Settings,
        *,
        is_exported: bool = False,
    ) -> list[Finding]:
        """The findings for a bake of `low`: whether it is flipped, what its UVs lack, and more if other programs read the map.
        settings: of the panel, valid.

        is_exported: as in pair_checks.is_for_others.
        """
        find = partial(pair_checks.viewport_flipped, context, low, highs)
        flipped = self._known("flipped", *_key_of(low, highs), find=find)
        if not settings.tracing.keep_faces:  # the bake turns them over
            flipped = [each for each in flipped if not each.values["is_high"]]
        found = self.of_low(context, low, low in highs, settings)
        if not pair_checks.is_for_others(settings, is_exported=is_exported):
            found = [each for each in found if each.kind in pair_checks.OF_LAYOUT]
        return flipped + pair_checks.unsolved_by_export(found, is_exported=is_exported)

    def of_low(
        self, context: bpy.types.Context, low: bpy.types.Object, is_own_base: bool, settings: Settings
    ) -> list[Finding]:
        """The findings in the low object alone. A large mesh is looked at soon after this was asked for first."""
        ref = ObjectRef.of(low)

        def find() -> list[Finding]:
            found = ref.find()
            if found is None:
                return []
            self.looks += 1
            return pair_checks.viewport_findings(bpy.context, found, settings, is_own_base=is_own_base)

        layer = settings.map.uv_layer or pair_checks.active_layer(low)
        # Names are in the sentences.
        key = low.name, low.mode, is_own_base, layer, pair_checks.active_layer(low), *_of_layout(settings)
        uids = low.session_uid, low.data.session_uid
        is_small = len(low.data.loops) <= MOST_AT_ONCE
        return self._known(
            "low", (*uids, *key), frozenset(uids), find=find, if_moved=False, uid=uids[0], is_later=not is_small
        )

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

        def measure() -> list[str]:
            objects = [ref.find() for ref in refs]
            if None in objects or any(obj.mode != "OBJECT" for obj in objects):
                return []
            if sum(len(obj.data.vertices) for obj in objects if obj.type == "MESH") > MOST_POSED:
                return []
            return poses.notes(bpy.context, objects[0], objects[1:], for_render=for_render)

        refs = [ObjectRef.of(obj) for obj in (low, *highs)]
        key, uids = _key_of(low, highs)
        return self._known("poses", (*key, for_render), uids, find=measure, is_later=True)

    def _unfit(self, low: bpy.types.Object, highs: list[bpy.types.Object], settings: Settings) -> list[Sentence]:
        """Why the boxes of a pair do not fit, if rays may be cast: another unit, another axis up."""
        method = settings.tracing.method
        if method == Method.FLATTEN or low in highs or any(obj.type != "MESH" for obj in (low, *highs)):
            return []

        def find() -> list[Sentence]:
            least, most = several.boxes([low, *highs])
            box = np.array([least[1:].min(axis=0), most[1:].max(axis=0)])
            hint = preflight.placement_hint(np.array([least[0], most[0]]), box)
            return rated([hint] if hint else [], WRONG if method == Method.CAST else LOOK, "unfit")

        key, uids = _key_of(low, highs)
        return self._known("unfit", (*key, method), uids, find=find)

    def worst(self, context: bpy.types.Context, low: bpy.types.Object) -> Told | None:
        """What tells of the most harm to the maps of `low`, for a row of a list; None where nothing but notes is known.

        Its UVs are looked at soon after this was asked for first.
        """
        kept = self._kept.get(("low", low.session_uid))
        if low.type == "MESH" and (kept is None or kept.key[-1] != sets.whole(context).udim):
            self._ask(("low", low.session_uid), partial(self._look_at, ObjectRef.of(low)))
        found = [_told(one) for one in kept.found if one.kind in pair_checks.OF_LAYOUT] if kept is not None else []
        cover = self._kept.get(("cover", low.session_uid))
        looked_at = (
            *(CHECKED if kept is not None else ()),
            *((pair_checks.SHARED,) if cover is not None and cover.is_known else ()),
        )
        found += [told for told in self._past(context, low) if told.kind not in looked_at]
        worst = min(found, key=BY_RANK, default=None)
        return worst if worst is not None and worst.harm is not NOTE else None

    def of_several(
        self, context: bpy.types.Context, name: str, find_lows: Callable[[], Iterable[bpy.types.Object]]
    ) -> list[Told]:
        """The worst of each of several low objects: those that say the same are one, the worst first. name: of the objects, for
        each of which `find_lows` is called once until an object changes or was looked at."""

        def find() -> list[Told]:
            found = ((low.name, self.worst(context, low)) for low in find_lows())
            return grouped((low, worst) for low, worst in found if worst is not None)

        key = self.looks, sets.whole(context).udim, bpy.app.translations.locale
        return until_change.get(f"told of {name}", key, find)

    def of_set(self, context: bpy.types.Context, one: sets.ImprintSet) -> list[Told]:
        """As `of_several`, of the active set, after what its parts do to each other in images that they share."""
        told = self.of_several(context, one.name, lambda: sets.lows(context, one))
        if one.textures == "PART":
            return told

        def find() -> list[Told]:
            lows = [low for low in sets.lows(context, one) if low.imprint_is_baked and low.type == "MESH"]
            return self._lying_over(lows, one.settings)

        whole, locale = sets.whole(context), bpy.app.translations.locale
        key = self.looks, one.textures, whole.udim, whole.uv_layer, locale
        return [*until_change.get(f"overlaps of {one.name}", key, find), *told]

    def _lying_over(self, lows: list[bpy.types.Object], settings: Settings) -> list[Told]:
        """Which of low objects that share images have the same texels there, once all were looked at."""
        covers = [self._cover(low, settings) for low in lows]
        if not all(self._kept["cover", low.session_uid].is_known for low in lows):
            return []
        if len(covers) != len(self._compared) or not all(map(is_, covers, self._compared)):
            self._compared, self._shares = covers, pair_checks.lost_shares(covers)
        wrong = {low.name: share for low, share in zip(lows, self._shares, strict=True) if share}
        if not wrong:
            return []
        text = message("The UVs of {} lie over one another in the image that they share: pack them side by side.")
        names = shorten_list(map(repr, wrong))
        return [Told(text.format(names), WRONG, pair_checks.SHARED, max(wrong.values()), (fixes.PACK,))]

    def _cover(self, low: bpy.types.Object, settings: Settings) -> dict:
        """What pair_checks.viewport_cover finds for a low object, soon after it was asked for first."""
        ref = ObjectRef.of(low)

        def find() -> dict:
            self.looks += 1
            found, context = ref.find(), bpy.context
            if found is None:
                return {}
            is_own_base = found in context.scene.imprint.alone(context, found).highs
            return pair_checks.viewport_cover(context, found, settings, is_own_base=is_own_base)

        uids, map_settings, sampling = (low.session_uid, low.data.session_uid), settings.map, settings.sampling
        slots = (slot.material for slot in low.material_slots if map_settings.texture_sets)
        materials = tuple(naming.of_material(material) if material else "" for material in slots)
        layer = map_settings.uv_layer or pair_checks.active_layer(low)
        key = (*uids, low.mode, layer, map_settings.texture_sets, sampling.udim, sampling.tiles, materials)
        return self._known("cover", key, frozenset(uids), find=find, if_moved=False, uid=uids[0], is_later=True)

    def is_wrong(self, context: bpy.types.Context, low: bpy.types.Object) -> bool:
        """Whether the last bake of a low object has found that its maps are wrong."""
        return any(told.harm is WRONG for told in self._past(context, low))

    def _past(self, context: bpy.types.Context, low: bpy.types.Object) -> list[Told]:
        """What the last bake of a low object has found."""
        pair = object_pairs.of(low)
        if pair is None or not pair.baked:
            return []

        def find() -> list[Told]:
            return [Told.of(text) for text in results.warnings_of(results.all_of(context, low))]

        return self._known(
            "past", (pair.baked, bpy.app.translations.locale), frozenset(), find=find, uid=low.session_uid
        )

    def _look_at(self, ref: ObjectRef) -> None:
        """Look at a low object for `worst`."""
        low, context = ref.find(), bpy.context
        if low is not None:
            chosen, one = context.scene.imprint.alone(context, low), sets.active(context)
            settings = chosen.settings if one is None else one.settings
            self.of_low(context, low, low in chosen.highs, settings)

    def look(self) -> float | None:
        """Look at one thing that was asked for, unless other work is under way. Returns the seconds until the next one."""
        screen = bpy.context.screen
        is_animated = screen is not None and screen.is_animation_playing
        if not self._asked:
            return None
        if render_view.is_busy() or display.current is not None or is_animated:
            return WAIT
        find = self._asked.pop(next(iter(self._asked)))
        self._is_looking = True
        try:
            find()
        finally:
            self._is_looking = False
        redraw()
        return SLICE if self._asked else None

    def _ask(self, place: tuple[str, int], look: Callable[[], object]) -> None:
        """Have something looked at soon: a panel may not do it while it is drawn."""
        self._asked[place] = look
        self._timer.start(WAIT)

    def keep_look(self, low: bpy.types.Object, highs: list[bpy.types.Object], lines: list[str]) -> None:
        """Remember what a look at the high objects found, until one of the objects changes."""
        key, uids = _key_of(low, highs)
        self._kept["look", 0] = _Kept(key, lines, uids)

    def look_of(self, low: bpy.types.Object, highs: list[bpy.types.Object]) -> list[str]:
        """What the last look at these objects found; empty without one."""
        kept = self._kept.get(("look", 0))
        return kept.found if kept is not None and kept.key == _key_of(low, highs)[0] else []

    def _known(
        self,
        name: str,
        key: tuple,
        follows: frozenset[int],
        *,
        find: Callable[[], list | dict],
        if_moved: bool = True,
        uid: int = 0,
        is_later: bool = False,
    ) -> list | dict:
        """What was found the last time for the same key, or else what `find` finds: now, or later and nothing now.

        The others: as in _Kept and in `_kept`.
        """
        place = name, uid
        kept = self._kept.get(place)
        if kept is None or kept.key != key:
            if len(self._kept) > MOST_KEPT:
                del self._kept[next(iter(self._kept))]
            later = is_later and not self._is_looking
            kept = self._kept[place] = _Kept(key, [] if later else find(), follows, if_moved, not later)
            if later:
                self._ask(place, partial(self._find_again, place, key, find))
        return kept.found

    def _find_again(self, place: tuple[str, int], key: tuple, find: Callable[[], list | dict]) -> None:
        """Find what `_known` left for later, unless the objects have changed since."""
        kept = self._kept.get(place)
        if kept is not None and kept.key == key:
            self._kept[place] = replace(kept, found=find(), is_known=True)

    def drop(self, *_) -> None:
        """Forget the findings."""
        if not self._is_looking:
            self._kept, self._asked, self._compared, self._shares = {}, {}, [], []

    def _after_update(self, _scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        if not self._kept or self._is_looking:
            return
        moved, changed = set(), set()
        for update in depsgraph.updates:
            if isinstance(update.id, (bpy.types.Material, bpy.types.NodeTree)):
                self._kept.pop(("materials", 0), None)
            if update.is_updated_transform:
                moved.add(update.id.original.session_uid)
            if update.is_updated_geometry or isinstance(update.id, bpy.types.Mesh):
                changed.add(update.id.original.session_uid)
        for place, kept in list(self._kept.items()):
            if not kept.follows.isdisjoint(changed | moved if kept.if_moved else changed):
                del self._kept[place]


def _told(finding: Finding) -> Told:
    """A finding as panels show it."""
    text, sentence = message(finding.template).format(**finding.values), finding.sentence
    return Told(text, sentence.harm, sentence.kind, sentence.share, _fixes(finding))


def _fixes(finding: Finding) -> tuple[str, ...]:
    """The buttons of a finding."""
    if finding.kind == pair_checks.OUTSIDE:
        return (Fix.UDIM.name,) if finding.fits_udim else ()
    return (fixes.UNWRAP if finding.kind == pair_checks.OVERLAP else finding.kind,)


def _swapped(low: bpy.types.Object, highs: list[bpy.types.Object]) -> list[Told]:
    """Why the objects may be the wrong ones; empty if they seem right."""
    if not object_checks.seem_swapped(low, highs):
        return []
    names = shorten_list(repr(high.name) for high in highs)
    return [Told(message(object_checks.SWAPPED).format(low=repr(low.name), highs=names), LOOK)]


def _key_of(low: bpy.types.Object, highs: list[bpy.types.Object]) -> tuple[tuple, frozenset[int]]:
    """What tells a pair from another one, and the session_uid of its objects and their data."""
    objects = low, *highs
    uids = [(obj.session_uid, obj.data.session_uid if obj.data else 0) for obj in objects]
    key = tuple((*each, obj.name, obj.mode) for each, obj in zip(uids, objects, strict=True))
    return key, frozenset(uid for each in uids for uid in each)


def _of_layout(settings: Settings) -> tuple:
    """The settings that decide what UVs lack."""
    sampling = settings.sampling
    return (
        sampling.tiles,
        sampling.wrap,
        settings.map.space,
        settings.map.normal,
        settings.map.drawn_maps,
        sampling.udim,
    )


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
