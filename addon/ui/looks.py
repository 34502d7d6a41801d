# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks at parts: whether what their last bake has read is still so.

Blender's updates mark the parts that read what has changed, and a timer looks at these while nothing else runs. What Blender
does not report, as levels for renders and files, is compared in turn. What a bake reads is in jobs.part_state.
"""

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

import bpy

from ..core import contents, progress
from ..core.declarations.choices import Occluders
from ..core.errors import BakeError
from ..core.naming import LOW, MATERIAL
from ..core.settings import Settings
from ..jobs import map_contents, part_state
from ..jobs.job import Job, PastBake
from ..jobs.part_state import State, Status
from ..jobs.state_pieces import PROBLEM, SETTING, TARGET
from ..scene import dependencies, evaluation, object_checks, render_view
from ..scene.object_checks import ObjectRef
from . import object_pairs, sets
from .callbacks import Timer, events, redraw
from .live import live
from .progress_display import display

SLICE = 0.005
"""Seconds of looks at a tick. A part is looked at in one go, as Blender evaluates its objects so."""
TICK = 0.02
"""Seconds between two ticks while parts are to be looked at."""
REST = 0.3
"""Seconds without a change after which parts are looked at: not while something is dragged."""
COSTLY, LONG_REST = 0.05, 2.0
"""Seconds of a look, as of what renders alone see of an object, from which a part waits for a longer pause; and that pause."""
REDRAW = 0.5
"""Seconds between two redraws of the panel while parts are looked at."""
WATCH = 0.25
"""Seconds between two ticks that compare what Blender does not report."""
SHAPES = bpy.types.Object, bpy.types.Mesh
"""Types that Blender reports at each new object, as if their materials had changed. Materials are reported themselves."""
PLACES = bpy.types.Scene, bpy.types.Collection
"""Types that Blender reports when objects come or go, at a setting of Imprint, and at each click that selects."""


class Part(NamedTuple):
    """A low object, as a set of a scene bakes it.

    Attributes:
        scene: The session_uid.
        of_set: The name of the set; empty for the last bake of the low object, with the settings that it had.
        low: The session_uid.
    """

    scene: int
    of_set: str
    low: int


class Asked(NamedTuple):
    """What would be baked of a part now, as part_state.look takes it.

    Attributes:
        jobs: Those that are baked together.
        shared_name: The name of the set if its parts share images.
        shading: The session_uids of all objects that may shade a part, with their materials.
        why: Why the part cannot be baked, in a sentence; empty if it can.
    """

    job: Job
    settings: Settings
    jobs: tuple[Job, ...] = ()
    shared_name: str = ""
    shading: frozenset[int] = frozenset()
    why: str = ""

    @property
    def key(self) -> tuple:
        """What is compared. Of the other jobs, it is what shades this one: the rest is a matter of their own parts."""
        return self.job, self.settings, self.shared_name, self.shading, self.why


@dataclass
class Seen:
    """What the last look at a part has found."""

    ref: ObjectRef
    """Its low object."""
    status: Status = Status.UNKNOWN
    changes: tuple[str, ...] = ()
    """What is not as it was in the bake, in clauses; for a copy that was not baked itself, what it is a copy of."""
    problem: str = ""
    """Why the part cannot be baked, in a sentence."""
    key: tuple = ()
    """That of Asked."""
    reads: frozenset[int] = frozenset()
    """The session_uid of each datablock that the part is made from, and of its maps."""
    images: tuple[str, ...] = ()
    """The names of the images among them."""
    files: tuple[str, ...] = ()
    """The paths of the files that those datablocks name."""
    maps: dict[str, str] = field(default_factory=dict)
    """What tells the maps of its last bake from others, as map_contents.note has returned it."""
    seconds: float = 0.0
    """How long it took."""
    stamp: tuple = ()
    """What Blender does not report of them."""


@dataclass
class _Resolved:
    """The jobs of a set, found one after another, as there may be hundreds."""

    settings: Settings
    shared_name: str
    """As in Asked."""
    steps: Iterator[tuple[bpy.types.Object, Job, str]]
    found: dict[int, tuple[Job, str]] = field(default_factory=dict)
    """Each with why it cannot be baked, by the session_uid of the low object."""
    is_whole: bool = False
    jobs: tuple[Job, ...] = ()
    """All of them, if it is whole."""
    shading: frozenset[int] = frozenset()
    """As in Asked."""

    @classmethod
    def of(cls, context: bpy.types.Context, one: sets.ImprintSet) -> "_Resolved":
        return cls(one.settings, _shared_name(one), sets.jobs(context, one))

    def step(self, context: bpy.types.Context) -> None:
        """Find the next job."""
        try:
            low, job, why = next(self.steps)
            self.found[low.session_uid] = job, why
        except (StopIteration, BakeError):
            self.is_whole = True
            self.jobs = tuple(job for job, _ in self.found.values())
            self.shading = shading(context, self.settings, self.jobs)

    def asked(self, low: int) -> Asked | None:
        """What would be baked of a low object, None if the set has it no more."""
        if low not in self.found:
            return None
        job, why = self.found[low]
        return Asked(job, self.settings, self.jobs, self.shared_name, self.shading, why)


class Looks:
    """The parts that rows have asked for, what is known of them, and which are to be looked at.

    count: how many looks there were. version: changes whenever a sign may.
    """

    def __init__(self):
        self.count = self.version = 0
        self._seen: dict[Part, Seen] = {}
        self._marked: dict[Part, int] = {}
        """The parts to look at, with a number that is larger for what was marked later."""
        self._users: dict[int, set[Part]] = {}
        """The parts that read a datablock, by its session_uid."""
        self._shaded: dict[frozenset[int], set[Part]] = {}
        """The parts that others shade, by Asked.shading."""
        self._resolved: dict[str, _Resolved] = {}
        """Of the sets of the context's scene, by name."""
        self._watching: _Resolved | None = None
        self._unwatched: list[str | Part] = []
        """The sets, and the parts without one, that are still to be compared in this round."""
        self._uses: dependencies.Uses | None = None
        self._counts: tuple[int, ...] = ()
        """The datablocks when it was made: Blender does not report that a script removes an unused one."""
        self._known: dict[int, str] = {}
        """Keys of occluders, as part_state.look has them."""
        self._places: tuple = ()
        self._hurries = False
        """Whether this round of comparisons is not to wait for the next ticks: objects have come or gone."""
        self._number, self._changed_at, self._drawn_at = 0, 0.0, 0.0
        self._is_looking, self._may_block = False, True
        self._timer = Timer(self.tick)
        events.hear(
            depsgraph_update_post=self.note_update,
            frame_change_post=self.note_update,
            undo_post=self.mark_all,
            redo_post=self.mark_all,
            baked=self.note_bake,
            end=self.forget,
        )

    # What rows ask

    def of(self, part: Part, low: bpy.types.Object) -> tuple[Seen, bool]:
        """What is known of a part, and whether it is to be looked at again."""
        seen = self._seen.get(part)
        if seen is None:
            self._places = self._places or _find_places()
            seen = self._seen[part] = Seen(ObjectRef.of(low))
            self._mark(part)
        return seen, part in self._marked

    def progress(self, scene: int, of_set: str) -> tuple[int, int]:
        """How many parts of a set of a scene are looked at, of how many. of_set: as in Part."""
        parts = [part for part in self._seen if (part.scene, part.of_set) == (scene, of_set)]
        return sum(part not in self._marked for part in parts), len(parts)

    # What marks parts

    def note_update(self, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        """Mark the parts that read what Blender reports as changed."""
        if self._is_looking or not self._seen:
            return
        self._let_go()
        changed, is_place = set(), False
        for update in depsgraph.updates:
            block = update.id
            if isinstance(block, PLACES):
                is_place = True
            elif not isinstance(block, SHAPES) or update.is_updated_geometry or update.is_updated_transform:
                changed.add(block.original.session_uid)
            elif not update.is_updated_shading:  # it may have another name
                is_place = True
        if is_place:
            self._note_places()
            self._note_settings(scene)
        for uid in changed:
            self.mark(uid)

    def mark(self, uid: int) -> None:
        """Mark the parts that read a datablock."""
        for part in self._users.get(uid, ()):
            self._mark(part)
            if uid == part.low:  # its pair, its size or its switch may be what has changed
                self._resolved.pop(part.of_set, None)
        for uids, parts in self._shaded.items():
            if uid in uids:
                for part in parts:
                    self._mark(part)

    def note_bake(self, low: int) -> None:
        """Let nothing be known of a low object with another last result, until it is looked at."""
        self.version += 1
        for part in self._users.get(low, ()):
            if part.low == low:
                self._seen[part].status, self._seen[part].changes = Status.UNKNOWN, ()
        self.mark(low)
        if not self._hurries:  # it may have replaced maps of others
            self._unwatched, self._hurries = self._round(bpy.context.scene.session_uid), True

    def mark_all(self, *_) -> None:
        """Let nothing be known any more: after Undo."""
        self._let_go()
        self._resolved.clear()
        for part, seen in self._seen.items():
            seen.status, seen.changes = Status.UNKNOWN, ()
            self._mark(part)

    def forget(self, *_) -> None:
        """Forget all parts: another file has others."""
        for kept in (self._seen, self._marked, self._users, self._shaded, self._resolved, self._unwatched):
            kept.clear()
        self._let_go()
        self._places = ()
        self.version += 1

    def _let_go(self) -> None:
        """Keep no datablock, which may be gone now, also not in a set that is half resolved."""
        self._uses = self._watching = None
        self._known.clear()
        self._resolved = {name: known for name, known in self._resolved.items() if known.is_whole}

    def _mark(self, part: Part) -> None:
        self._number += 1
        self.version += part not in self._marked
        self._marked[part] = self._number
        self._changed_at = time.monotonic()
        if not bpy.app.background:
            self._timer.start(TICK)

    def _note_places(self) -> None:
        """If objects have come or gone, or one has another name, resolve sets again soon: objects are paired by their names."""
        before, self._places = self._places, _find_places()
        if self._places != before:
            self.version += 1
            self._resolved.clear()
            self._unwatched, self._hurries = self._round(bpy.context.scene.session_uid), True

    def _note_settings(self, scene: bpy.types.Scene) -> None:
        """Mark the parts of the active set if its settings have changed."""
        one = sets.active(bpy.context) if scene == bpy.context.scene else None
        known = self._resolved.get(one.name) if one is not None else None
        if known is not None and (known.settings, known.shared_name) != (one.settings, _shared_name(one)):
            del self._resolved[one.name]
            for part in self._seen:
                if (part.scene, part.of_set) == (scene.session_uid, one.name):
                    self._mark(part)

    # Looks

    def tick(self) -> float | None:
        """Look for one slice. Returns the seconds until the next tick, None if there are no parts."""
        if not self._seen:
            return None
        context = bpy.context
        if is_busy(context):
            return WATCH
        context.view_layer.update()  # what has changed until now is no work of the looks
        rest = time.monotonic() - self._changed_at
        if self._marked and rest < REST:
            return TICK
        self._may_block = rest >= LONG_REST
        return TICK if self.advance(context, SLICE) else WATCH

    def advance(self, context: bpy.types.Context, seconds: float) -> bool:
        """Look at what is marked for about this long; if nothing is, compare what Blender does not report. Returns whether
        there is more."""
        end, version, is_more = time.perf_counter() + seconds, self.version, True
        while is_more and time.perf_counter() < end:
            is_more = self._step(context)
        now = time.monotonic()
        if self.version != version and (not self._marked or now - self._drawn_at > REDRAW):
            self._drawn_at = now
            redraw(region="UI")
        return self._hurries or self._next(context) is not None

    def _step(self, context: bpy.types.Context) -> bool:
        """Resolve, look at or compare one part. Returns whether there is more in this round."""
        part = self._next(context)
        if part is None:
            return self._watch(context)
        known = self._resolved_of(context, part)
        if known is None or known.is_whole:
            self.look(context, part, self._asked(context, part))
        else:
            known.step(context)
        return True

    def _resolved_of(self, context: bpy.types.Context, part: Part) -> _Resolved | None:
        """The set of a part, None if it has none or the set is gone."""
        one = context.scene.imprint_sets.get(part.of_set) if part.of_set else None
        if one is None:
            return None
        if part.of_set not in self._resolved:
            self._resolved[part.of_set] = _Resolved.of(context, one)
        return self._resolved[part.of_set]

    def _asked(self, context: bpy.types.Context, part: Part) -> Asked | None:
        """What would be baked of a part now; None if there is no such part. Its set is resolved."""
        if part.of_set:
            known = self._resolved_of(context, part)
            return known.asked(part.low) if known is not None else None
        low = self._seen[part].ref.find()
        return _again(context, low) if low is not None else None

    def begin(self) -> None:
        """Look at everything anew: before looks that decide what is baked."""
        self._let_go()

    def look(self, context: bpy.types.Context, part: Part, asked: Asked | None) -> Status:
        """Look at a part now. asked: what would be baked of it; None if there is no such part any more."""
        self._marked.pop(part, None)
        self.version += 1
        low = asked.job.low_ref.find() if asked is not None else None
        if low is None:
            self._follow(part, frozenset())
            self._seen.pop(part, None)
            return Status.UNKNOWN
        seen = self._seen.setdefault(part, Seen(asked.job.low_ref))
        self.count += 1
        start = time.perf_counter()
        with self._unmarked(context):
            then = part_state.kept(low)
            seen.maps = then.images if then is not None else {}
            self._note_reads(part, seen, asked)
            seen.ref, seen.key, seen.stamp = asked.job.low_ref, asked.key, _stamp(asked, seen)
            with self._uses.shared():
                now = self._state(context, asked, then)
            if then is not None and not part.of_set:
                now = _with_settings(now, then)
            seen.problem = next(iter(now.of_kind(PROBLEM).values()), "")
            seen.changes = tuple(part_state.changes(then, now)) if then is not None else _copied(low)
            seen.status = Status.NEVER if then is None else Status.CHANGED if seen.changes else Status.TRUE
        seen.seconds = time.perf_counter() - start
        return seen.status

    def _state(self, context: bpy.types.Context, asked: Asked, then: State | None) -> State:
        if asked.why:
            return State({f"{PROBLEM}:": asked.why})
        how = {"then": then, "jobs": asked.jobs, "known": self._known}
        if asked.shared_name:
            how |= {"share_image": True, "shared_name": asked.shared_name}
        return progress.finish(part_state.look(context, asked.job, asked.settings, **how))

    @contextmanager
    def _unmarked(self, context: bpy.types.Context) -> Iterator[None]:
        """Let no update of the block mark parts."""
        self._is_looking = True
        try:
            yield
            context.view_layer.update()
        finally:
            self._is_looking = False

    def _next(self, context: bpy.types.Context) -> Part | None:
        """The part to look at: of the active set first, then what was marked last. None if all others have to wait."""
        if not self._marked:
            return None
        scene, edited, one = context.scene.session_uid, _edited(context), sets.active(context)
        active = one.name if one is not None else ""
        parts = (
            part
            for part in self._marked
            if part.scene == scene
            and (self._may_block or self._seen[part].seconds < COSTLY)
            and (not edited or edited.isdisjoint((part.low, *self._seen[part].reads)))
        )
        return max(parts, key=lambda part: (part.of_set == active, self._marked[part]), default=None)

    def _watch(self, context: bpy.types.Context) -> bool:
        """Compare what Blender does not report of the next part with that at its look, and mark it if that differs. Returns
        whether there are more in this round."""
        scene = context.scene.session_uid
        if not self._unwatched:
            self._unwatched, self._hurries = self._round(scene), False
            return False
        item = self._unwatched[-1]
        if not isinstance(item, Part):
            self._watch_set(context, item)
            return True
        self._unwatched.pop()
        known = self._resolved_of(context, item)
        if item in self._seen and item not in self._marked and (known is None or known.is_whole):
            asked, seen = self._asked(context, item), self._seen[item]
            if asked is None or (asked.key, _stamp(asked, seen)) != (seen.key, seen.stamp):
                self._mark(item)
        return True

    def _round(self, scene: int) -> list[str | Part]:
        """The sets of a scene, and the parts without one."""
        parts = [part for part in self._seen if part.scene == scene]
        return [*(part for part in parts if not part.of_set), *{part.of_set: None for part in parts if part.of_set}]

    def _watch_set(self, context: bpy.types.Context, name: str) -> None:
        """Resolve a set anew, in steps, then let its parts be compared."""
        if self._watching is None:
            one = context.scene.imprint_sets.get(name)
            self._watching = _Resolved.of(context, one) if one is not None else None
        if self._watching is not None and not self._watching.is_whole:
            self._watching.step(context)
            return
        if self._watching is not None:
            self._resolved[name], self._watching = self._watching, None
        self._unwatched.pop()
        scene = context.scene.session_uid
        self._unwatched += [part for part in self._seen if (part.scene, part.of_set) == (scene, name)]

    def _note_reads(self, part: Part, seen: Seen, asked: Asked) -> None:
        """Note what a part is made from."""
        counts = _counts()
        if self._uses is None or self._counts != counts:
            self._uses, self._counts = dependencies.Uses(), counts
        low, pair = asked.job.low, object_pairs.of(asked.job.low)
        maps = [item.image for item in pair.maps if item.image is not None] if pair is not None else []
        blocks = {*self._uses.all_of(_objects(asked.job)), *maps}
        seen.images = tuple(sorted(block.name for block in blocks if isinstance(block, bpy.types.Image)))
        seen.files = tuple(sorted({each.path for block in blocks for each in dependencies.files_of(block)}))
        self._follow(part, frozenset((low.session_uid, *(block.session_uid for block in blocks))))
        for parts in self._shaded.values():
            parts.discard(part)
        self._shaded = {uids: parts for uids, parts in self._shaded.items() if parts}
        if asked.shading:
            self._shaded.setdefault(asked.shading, set()).add(part)

    def _follow(self, part: Part, reads: frozenset[int]) -> None:
        """Let updates of these datablocks mark a part, and of no others."""
        seen = self._seen.get(part)
        if seen is None:
            return
        for uid in seen.reads - reads:
            self._users[uid].discard(part)
        for uid in reads - seen.reads:
            self._users.setdefault(uid, set()).add(part)
        seen.reads = reads


def _copied(low: bpy.types.Object) -> tuple[str, ...]:
    """What an object that was never baked is a copy of, in quotes; empty if it is none."""
    original = part_state.original(low)
    return (repr(original.name),) if original is not None else ()


def is_busy(context: bpy.types.Context) -> bool:
    """Whether something runs that looks would disturb, or slow down."""
    is_playing = context.screen is not None and context.screen.is_animation_playing
    return display.current is not None or live.is_on or is_playing or render_view.is_busy()


def _counts() -> tuple[int, ...]:
    """How many datablocks there are of each type that parts read."""
    data = bpy.data
    blocks = data.objects, data.meshes, data.curves, data.materials, data.node_groups, data.images, data.collections
    return tuple(map(len, blocks))


def _find_places() -> tuple:
    """The objects of each scene, and their names."""
    return tuple(
        (tuple(obj.session_uid for obj in scene.objects), tuple(scene.objects.keys())) for scene in bpy.data.scenes
    )


def _shared_name(one: sets.ImprintSet) -> str:
    return one.name if one.textures != "PART" else ""


def shading(context: bpy.types.Context, settings: Settings, jobs: Sequence[Job]) -> frozenset[int]:
    """Asked.shading of the parts that are baked together."""
    occluders = settings.tracing.occluders
    if occluders == Occluders.OWN:
        return frozenset()
    objects = [obj for job in jobs for ref in job.high_refs if (obj := ref.find()) is not None]
    if occluders == Occluders.SCENE:
        objects += evaluation.shown_surfaces(context)
    materials = (slot.material for obj in objects for slot in obj.material_slots)
    return frozenset(block.session_uid for block in (*objects, *materials) if block is not None)


def _edited(context: bpy.types.Context) -> set[int]:
    """The session_uids of the objects in a mode whose edits reach the mesh when it is left, and of their data."""
    objects = [obj for obj in filter(None, context.view_layer.objects) if obj.mode not in {"OBJECT", "POSE"}]
    return {block.session_uid for obj in objects for block in (obj, obj.data)}


def _objects(job: Job) -> list[bpy.types.Object]:
    return [obj for ref in job.refs if (obj := ref.find()) is not None]


def _stamp(asked: Asked, seen: Seen) -> tuple:
    """What Blender does not report of a part, to be compared."""
    levels = tuple(
        (modifier.show_render, getattr(modifier, "render_levels", 0))
        for obj in _objects(asked.job)
        for modifier in obj.modifiers
    )
    images = filter(None, map(bpy.data.images.get, seen.images))
    # The size of others would load their files.
    dirty = tuple((image.is_dirty, *(image.size if image.source == "GENERATED" else ())) for image in images)
    return levels, dirty, tuple(map(contents.stamp_of, seen.files)), map_contents.are_shown(asked.job.low, seen.maps)


def _again(context: bpy.types.Context, low: bpy.types.Object) -> Asked:
    """What would be baked if the last bake of a low object were done again, with those that were baked together with it."""
    pair = object_pairs.of(low)
    reports = pair.reports() if pair is not None else []
    if not reports:
        return Asked(Job(low, object_checks.itself(low)), Settings())
    last = reports[-1]  # of the last set, whose state is the newest
    settings = Settings.of_json(last.settings)
    if settings.map.texture_sets:  # names are filled in, each with its own
        settings = settings.stored(image="", output=LOW + MATERIAL + os.path.splitext(settings.storing.output)[1])
    try:
        job = PastBake.of(last).job.but(texture_set=None)
    except BakeError as error:
        return Asked(Job(low, pair.found()), settings, why=str(error))
    if settings.tracing.occluders == Occluders.OWN:
        return Asked(job, settings)
    others = ((obj, object_pairs.of(obj)) for obj in context.scene.objects if obj != low)
    others = [(obj, other) for obj, other in others if other is not None and other.baked == pair.baked]
    jobs = (job, *(Job(obj, other.found()) for obj, other in others))
    return Asked(job, settings, jobs, shading=shading(context, settings, jobs))


def _with_settings(now: State, then: State) -> State:
    """A state with the settings of another one: a look at the last bake of a low object does not ask for others."""
    starts = f"{SETTING}:", f"{TARGET}:"
    pieces = {name: key for name, key in now.pieces.items() if not name.startswith(starts)}
    return State(pieces | {name: key for name, key in then.pieces.items() if name.startswith(starts)})
