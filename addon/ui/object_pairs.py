# SPDX-License-Identifier: GPL-3.0-or-later
"""The pair of a low object, which the file keeps: `Object.imprint` has its high objects, its cage, the method, the distances of
its rays, its last result, and the images of its maps, of which it is a user.

This is the one place for it. To read the pair of a low object:

    pair = object_pairs.of(low)             # None for an object that is no low object; reading low.imprint would make one
    pair.found(), pair.missing()            # the high objects that exist, and the names of those that do not
    pair.cage, pair.method, pair.measure, pair.extrusion, pair.max_distance
    pair.reports()                          # the last result: a core.report.Report for each texture set

A bake writes it by `remember`, and its images by datablocks.note_maps. Which high objects the eye hides is in Blender's view
layers, which files keep too.

The pointers follow an object that is renamed, and come along if the low object is copied, appended or overridden. They keep no
deleted data in the file: saving replaces a pointer to a deleted object by its name, and an object that comes back with that
name belongs to the pair again.
"""

import json
from collections.abc import Sequence
from dataclasses import fields, replace
from datetime import UTC, datetime
from functools import lru_cache

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, PointerProperty, StringProperty

from ..core import naming
from ..core.declarations.choices import Method
from ..core.report import VERSION, Report
from ..core.sentences import WRONG, rated
from ..jobs import part_state
from ..jobs.job import Job
from ..output import journal
from ..scene import object_checks
from ..scene.object_checks import GONE, ObjectRef, is_deleted
from .callbacks import events, registering, until_change
from .declared_properties import declared
from .texts import labeled

CHOSEN = ("method", "measure", "extrusion", "max_distance")
"""The settings that a pair has, and the scene for low objects that have no pair."""
_OVERRIDABLE = {"LIBRARY_OVERRIDABLE"}
SIZES = (256, 512, 1024, 2048, 4096, 8192)
"""Those that a low object can have in a bake of pairs by name, and a material in one with texture sets."""
OF_SET = "The size that the set has, or the panel without a set"
OF_BATCHES = {
    "Object.imprint_is_baked": labeled(
        BoolProperty,
        "Bake",
        "Whether bakes of several low objects include this one",
        default=True,
        override=_OVERRIDABLE,
    ),
    "Object.imprint_size": labeled(
        EnumProperty,
        "Size",
        "Width and height of this part's maps. Parts that share an image have the size below",
        items=[("0", "Set's", OF_SET), *((str(size), str(size), "") for size in SIZES)],
        override=_OVERRIDABLE,
    ),
    "Object.imprint_distance": labeled(
        FloatProperty,
        "Distance",
        "How far outward and inward of this low object a bake of several looks for the high ones. 0 for the setting of the "
        "panel Rays, which measures it by default",
        min=0.0,
        subtype="DISTANCE",
        precision=3,
        override=_OVERRIDABLE,
    ),
    "Material.imprint_size": labeled(
        EnumProperty,
        "Size",
        "Width and height of the maps of this material, where each material has its own",
        items=[("0", "Set's", OF_SET), *((str(size), str(size), "") for size in SIZES)],
        override=_OVERRIDABLE,
    ),
}
"""Properties of a low object and of its materials that a bake of several uses, see `with_own`. They are no part of a pair,
which only a bake makes."""
NOT_IN_SCENE = "{} is in no collection: bring it back with Undo, link it to one, or remove it."
NOT_IN_FILE = "{} is not in this file: bring it back or append it, or remove it."
"""Sentences about a high object. The panel translates them."""


def is_mesh(_owner, obj: bpy.types.Object) -> bool:
    return obj.type == "MESH"


def may_be_high(_owner, obj: bpy.types.Object) -> bool:
    return object_checks.may_show(obj)


class Slot:
    """A place for an object, which is found again by its name if it was deleted and comes back. `object` points to it."""

    def note(self, _context: bpy.types.Context) -> None:
        """Called when another object is chosen."""
        self.called = self.object.name if self.object else ""

    def find(self) -> bpy.types.Object | None:
        """The object; if it was deleted, one that has its name now; else None."""
        if self.object is not None and not is_deleted(self.object):
            return self.object
        other = bpy.data.objects.get(self.title)
        return None if other is None or other == self.object or is_deleted(other) else other

    @property
    def title(self) -> str:
        """The name of the object, also of one that was deleted; empty for an empty slot."""
        return self.object.name if self.object is not None else self.called

    def settle(self) -> None:
        """Make the pointer that of `find`, so that it keeps no deleted object, and note the object's name."""
        before, now, title = self.object, self.find(), self.title
        if before != now:
            self.object = now
            free(before)
        if self.called != (now.name if now else title):
            self.called = now.name if now else title


# Blender reads properties from the annotations of a class and of its bases.
Slot.__annotations__ = {
    "called": labeled(
        StringProperty,
        "Name",
        "Name of the object when the file was saved, by which it is found if it was deleted and comes back",
        override=_OVERRIDABLE,
    )
}


class ImprintHigh(bpy.types.PropertyGroup, Slot):
    """A high object of a pair, or one slot for a high object."""

    # Blender matches the items of library overrides by `name`, which is the index here.
    object: labeled(
        PointerProperty,
        "High",
        "Object with detail: a mesh, a curve, text, or an object that shows instances",
        type=bpy.types.Object,
        poll=may_be_high,
        update=Slot.note,
        override=_OVERRIDABLE,
    )


class ImprintMap(bpy.types.PropertyGroup):
    """An image that was baked for the object."""

    image: labeled(
        PointerProperty, "Image", "Image that was baked for the object", type=bpy.types.Image, override=_OVERRIDABLE
    )


class ImprintPair(bpy.types.PropertyGroup):
    """Object.imprint: what Imprint keeps for a low object. See the top of this module."""

    highs: labeled(
        CollectionProperty,
        "High",
        "The high objects of the last bake",
        type=ImprintHigh,
        override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"},
    )
    is_own: labeled(
        BoolProperty, "Own Modifiers", "Whether the last bake was of the object's own modifiers", override=_OVERRIDABLE
    )
    had_detail: labeled(
        BoolProperty,
        "Had Detail",
        "Whether the object's modifiers added detail in its last bake, which must not be baked over without them",
        default=True,
        override=_OVERRIDABLE,
    )
    cage: declared("cage", poll=is_mesh, override=_OVERRIDABLE)
    method: declared("method", override=_OVERRIDABLE)
    measure: declared("measure", override=_OVERRIDABLE)
    extrusion: declared("extrusion", override=_OVERRIDABLE)
    max_distance: declared("max_distance", override=_OVERRIDABLE)
    result: labeled(StringProperty, "Last Bake", "The reports of the last bake, in JSON", override=_OVERRIDABLE)
    state: labeled(StringProperty, "State", "What the last bake has read, in JSON", override=_OVERRIDABLE)
    baked: labeled(StringProperty, "Baked", "Time of the last bake, in UTC", override=_OVERRIDABLE)
    failure: labeled(
        StringProperty,
        "Failure",
        "Why the last bake left the object out; empty once it is baked",
        override=_OVERRIDABLE,
    )

    maps: labeled(
        CollectionProperty,
        "Maps",
        "The images that were baked for the object, which takes them along into other files",
        type=ImprintMap,
        override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"},
    )

    @property
    def is_kept(self) -> bool:
        """Whether there is a pair: the object was baked, or Live followed it."""
        return self.is_own or any(high.title for high in self.highs)

    def found(self) -> list[bpy.types.Object]:
        """The high objects that exist; for a bake onto itself, the low object, unless detail of its modifiers is gone since."""
        if self.is_own:
            low = self.id_data
            return object_checks.own_highs(low) or ([] if self.had_detail else object_checks.itself(low))
        return [obj for high in self.highs if (obj := high.find()) is not None]

    def missing(self) -> list[str]:
        """The names of the high objects that were deleted, or did not come along."""
        return [high.title for high in self.highs if high.title and high.find() is None]

    def choose(self, highs: Sequence[bpy.types.Object]) -> None:
        """Make these the high objects, of which the low object alone stands for a bake onto itself."""
        low = self.id_data
        self.is_own, self.had_detail = list(highs) == [low], not object_checks.shows_own_surface(low, highs)
        self.put([] if self.is_own else highs)

    def put(self, highs: Sequence[bpy.types.Object]) -> None:
        """Make these the high objects. Items of an override cannot be removed: those that are left over are emptied."""
        self._put([(obj, obj.name) for obj in highs])

    def remove(self, title: str) -> None:
        """Remove the high objects of this name from the pair, whether they exist or not."""
        self._put([(high.object, high.called) for high in self.highs if high.title not in {title, ""}])

    def _put(self, highs: Sequence[tuple[bpy.types.Object | None, str]]) -> None:
        """As `put`, of objects that may be missing, with their names."""
        until_change.drop()  # Blender tells of no change
        for index, (obj, called) in enumerate(highs):
            item = self.highs[index] if index < len(self.highs) else self.highs.add()
            if item.object != obj:
                item.object = obj
            item.name, item.called = str(index), called
        for item in self.highs[len(highs) :]:
            item.object, item.called = None, ""
        while len(self.highs) > len(highs) and self.id_data.override_library is None:
            self.highs.remove(len(self.highs) - 1)

    def reports(self) -> list[Report]:
        """The reports of the last bake, one for each texture set, with references to the objects as they are now."""
        low = self.id_data
        return [replace(report, refs=self._refs(low, report)) for report in _read(self.result)]

    def _refs(self, low: bpy.types.Object, report: Report) -> list[ObjectRef]:
        """References as a bake has them. What is missing is referred to by its name."""
        highs = [low] if self.is_own else [high.find() or high.title for high in self.highs if high.title]
        if len(highs) != len(report.high):  # one was removed since
            highs = [bpy.data.objects.get(name, name) for name in report.high]
        cages = [self.cage or report.cage] if report.cage else []
        objects = [low, *highs, *cages]
        return [ObjectRef(GONE, one) if isinstance(one, str) else ObjectRef.of(one) for one in objects]


@lru_cache(maxsize=256)  # a panel lists the results of all low objects
def _read(text: str) -> tuple[Report, ...]:
    """Reports from JSON. Those of another version of Imprint are left out if their keys mean something else."""
    known = {field.name for field in fields(Report)}
    return tuple(
        Report(**_rated({name: value for name, value in values.items() if name in known}))
        for values in (json.loads(text) if text else ())
        if values["version"] == VERSION
    )


def _rated(values: dict) -> dict:
    """The keys of a report. Earlier ones did not say how much harm a warning tells of: all had the same sign."""
    if "ratings" in values:
        return values
    return values | {"warnings": rated(values.get("warnings", ()), WRONG)}


def with_own(job: Job) -> Job:
    """The job with the size and the distance that its low object has, and the sizes of materials: modifiers may set any.

    A copy that a bake has made has the size of its original, as long as that is in the file.
    """
    sizes: dict[str, int] = {}
    for material in bpy.data.materials:
        name = naming.of_material(material)
        is_own = name == material.name or name not in bpy.data.materials
        if is_own and material.imprint_size != "0":  # one of a library may have the same name
            sizes[name] = max(int(material.imprint_size), sizes.get(name, 0))
    return job.but(size=int(job.low.imprint_size), distance=job.low.imprint_distance, sizes=tuple(sizes.items()))


def of(low: bpy.types.Object | None) -> ImprintPair | None:
    """The pair of a low object, or None. Reading `low.imprint` would make an empty one."""
    return low.imprint if low is not None and low.is_property_set("imprint") else None


def problem(missing: Sequence[str]) -> str:
    """Why a bake without these high objects cannot start, in a sentence; empty if none is missing."""
    return why_missing(missing[0]).format(repr(missing[0])) if missing else ""


def why_missing(name: str) -> str:
    """What is the matter with a high object that is missing, as a sentence with a place for its name.

    One that was deleted and one that came along with an appended low object look alike: both are in no collection.
    """
    return NOT_IN_SCENE if bpy.data.objects.get(name) is not None else NOT_IN_FILE


def remember(reports: Sequence[Report]) -> None:
    """Keep the reports of a bake, and the objects and settings that were baked, with their low objects."""
    by_low: dict[int, list[Report]] = {}
    now = datetime.now(UTC).isoformat(timespec="microseconds")
    for report in reports:
        by_low.setdefault(report.refs[0].uid, []).append(report)
    for own in by_low.values():
        low = own[0].refs[0].find()
        if low is None:
            continue
        objects = [ref.find() for ref in own[0].refs[1:]]
        number = len(own[0].high)
        cage = next(iter(objects[number:]), None)
        remember_objects(
            low,
            [high for high in objects[:number] if high],
            cage,
            own[0].settings,
            own[0].distances,
        )
        keep_reports(low, own, now)
        keep_failure(low, "")


def keep_reports(low: bpy.types.Object, reports: Sequence[Report], now: str = "") -> None:
    """Keep reports as the last result of a low object. now: the time, which all have that were baked together."""
    write_reports(low, reports)
    low.imprint.baked = now or datetime.now(UTC).isoformat(timespec="microseconds")
    for own in _by_set(reports):
        part_state.keep(low, [report.state for report in own if report.state is not None])


def write_reports(low: bpy.types.Object, reports: Sequence[Report]) -> None:
    """Write what the reports of the last bake of a low object say. What the bake has read, and when, stays noted."""
    low.imprint.result = json.dumps([report.to_dict() for report in reports])


def _by_set(reports: Sequence[Report]) -> list[list[Report]]:
    """The reports of a low object by the sets that bake it, of which each has a texture set once, or none."""
    sets: list[list[Report]] = []
    for report in reports:
        textures = [each.slots for each in sets[-1]] if sets else []
        if not sets or not report.slots or report.slots in textures or [] in textures:
            sets.append([])
        sets[-1].append(report)
    return sets


@journal.recorded
def keep_failure(low: bpy.types.Object, why: str) -> None:
    """Keep why the last bake of a low object failed, or that it did not."""
    if low.is_editable and (why or of(low) is not None):
        low.imprint.failure = why
    events.tell("baked", low.session_uid)


def remember_objects(
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    cage: bpy.types.Object | None,
    settings: dict,
    measured: dict[str, float],
) -> None:
    """Keep objects and settings with a low object. settings: as in Settings. measured: distances, where one is not set."""
    pair = low.imprint
    _touch_reference(low)
    pair.choose(highs)
    pair.method = str(settings["method"])
    if cage is not None or pair.method != Method.FLATTEN:  # Flatten uses none, and forgets none
        pair.cage = cage
    pair.measure = settings["extrusion"] is None and settings["max_distance"] is None
    for name in ("extrusion", "max_distance") if not pair.measure else ():
        value = settings[name] if settings[name] is not None else measured.get(name)
        if value is not None:
            setattr(pair, name, value)


def _touch_reference(low: bpy.types.Object) -> None:
    """Make the object of a library have a pair too, if `low` overrides it: otherwise Blender drops the pair of the override."""
    if low.override_library is not None and low.override_library.reference is not None:
        low.override_library.reference.imprint  # noqa: B018 - reading it makes it


def settle(*_) -> None:
    """Keep no deleted object in the file: replace pointers to such objects by their names, and those names by objects that
    have come back."""
    for scene in bpy.data.scenes:
        if scene.library is None:
            for slot in scene.imprint.highs:
                slot.settle()
            for name in ("low", "cage"):
                _drop(scene.imprint, name)
    for obj in bpy.data.objects:
        pair = of(obj)
        if pair is not None and obj.library is None:
            _touch_reference(obj)
            for high in pair.highs:
                high.settle()
            _drop(pair, "cage")


def _drop(owner: bpy.types.PropertyGroup, name: str) -> None:
    obj = getattr(owner, name)
    if obj is not None and is_deleted(obj):
        setattr(owner, name, None)
        free(obj)


def free(obj: bpy.types.Object | None) -> None:
    """Delete an object that the user has deleted, if nothing else points to it: files would keep its mesh."""
    if obj is not None and not obj.users and is_deleted(obj):
        bpy.data.objects.remove(obj)


def _mark(obj: bpy.types.Object, is_floater: bool) -> None:
    """Mark an object as a floater, or not."""
    if is_floater:
        obj[object_checks.FLOATER] = True
    else:
        obj.pop(object_checks.FLOATER, None)
    obj.update_tag()  # so that signs and Live look at it


events.hear(save_pre=settle)
CLASSES = (ImprintHigh, ImprintMap, ImprintPair)
register, unregister = registering(
    CLASSES,
    properties={
        "Object.imprint": PointerProperty(type=ImprintPair, override=_OVERRIDABLE),
        "Object.imprint_is_floater": labeled(
            BoolProperty,
            "Floater",
            "This high object gives detail and shades nothing: it blocks no rays of ambient occlusion and bent normals. "
            "Alt-click for all selected objects",
            get=object_checks.is_floater,
            set=_mark,
        ),
    }
    | OF_BATCHES,
)
