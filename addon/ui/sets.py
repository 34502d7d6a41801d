# SPDX-License-Identifier: GPL-3.0-or-later
"""The sets of a scene, which the file keeps: `Scene.imprint_sets`. The panel bakes them while `Scene.imprint.bakes` is SETS.

A set has a name, its parts, which are low objects, how they share textures, and the settings that are its own. High objects,
cage, size, distance and the switch of a part are not here: its low object has them, see object_pairs, whatever bakes it.

    one = sets.active(context)              # None while the panel bakes the selection
    sets.lows(context, one)                 # the low objects, which can be switched off each
    sets.resolve(context, one)              # what is baked, as plain data
    one.own.is_own("width")                 # whether a setting is the set's own, and not the scene's
    one.own.whole.width                     # the setting that counts
"""

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, IntProperty, PointerProperty, StringProperty

from ..core import naming
from ..core.declarations import kinds, targets
from ..core.declarations.all_settings import DECLARED
from ..core.declarations.choices import Method
from ..core.errors import BakeError
from ..core.naming import Pair
from ..core.settings import Settings
from ..jobs import sets as set_jobs
from ..jobs.job import Job
from ..jobs.sets import SetJob
from ..scene import object_checks
from . import object_pairs
from .callbacks import events, registering
from .declared_properties import REACHES, MapList, Options, declared, length_name, map_switch
from .object_pairs import Slot, is_mesh, with_own
from .properties import ImprintSettings, Named, WithEngine
from .texts import labeled

NEW = "Set"
"""The name of a set that nothing names."""
STANDS_FOR = {
    "size": ("width", "square", "height"),
    "names": ("image", "output"),
    "engine": (
        *("engine_name", *targets.CHOICES[targets.OF_SCENE].values),
        *("image", "output", "storage", "export"),
    ),
    **{length_name(name): (name,) for name in REACHES},
    **{map_switch(name): ("maps",) for name in DECLARED["maps"].values},
}
"""The settings behind properties whose values are made."""
_STORED = tuple(name for name in Options.__annotations__ | WithEngine.__annotations__ if name not in STANDS_FOR)


class ImprintPart(bpy.types.PropertyGroup, Slot):
    """A part of a set."""

    object: labeled(
        PointerProperty, "Low", "Low object of the part", type=bpy.types.Object, poll=is_mesh, update=Slot.note
    )


class Whole:
    """All settings, where a set has some of its own. What is set becomes the set's own."""

    def __init__(self, scene: ImprintSettings, own: "ImprintOwn"):
        vars(self).update(_scene=scene, _own=own)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._own if name in _MADE or self._own.is_own(name) else self._scene, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self._own if name in _OF_SETS else self._scene, name, value)

    def is_property_set(self, name: str) -> bool:
        """Whether the set has a setting of its own."""
        return self._own.is_own(name)

    def property_unset(self, name: str) -> None:
        """Give a setting back to the scene."""
        if name in _OF_SETS:
            self._own.property_unset(name)


_MADE = {"size", "names", "engine"}
"""Properties of a set whose values are made from those that count."""
_OF_SETS = {*_STORED, *STANDS_FOR}
"""The settings that a set can have of its own."""


def head_name(name: str) -> str:
    """The name of the property that shows what counts of a setting of OF_HEAD. To set it makes it the set's own."""
    return f"{name}_of_head"


OF_HEAD = {"width": "size", "height": "size", "square": "size", "samples": "samples"}
"""The settings at the head of the panel that a set stores, each with the pin that it goes by. Engine and size have made
values in any case."""


def _of_head(name: str, pinned: str) -> Any:
    """The property head_name(name)."""
    setting = DECLARED[name]
    values = [str(value) for value in setting.values] if isinstance(setting, kinds.Choice) else None

    def get(own: "ImprintOwn") -> Any:
        value = getattr(own.whole, name)
        return value if values is None else values.index(value)

    def put(own: "ImprintOwn", value: Any) -> None:
        own.make_own(pinned)
        setattr(own, name, value if values is None else values[value])

    return declared(name, get=get, set=put)


class OfHead:
    """The settings at the head of the panel, as they count."""


# Blender reads properties from the annotations of a class and of its bases.
OfHead.__annotations__ = {head_name(name): _of_head(name, pinned) for name, pinned in OF_HEAD.items()}


class ImprintOwn(bpy.types.PropertyGroup, WithEngine, Options, MapList, OfHead):
    """The settings that are a set's own: those that were set here. The others are the scene's."""

    @property
    def whole(self) -> Whole:
        return Whole(self.id_data.imprint, self)

    def names_of_own(self) -> list[str]:
        """The settings that are the set's own."""
        return [name for name in _STORED if self.is_property_set(name)]

    def is_own(self, name: str) -> bool:
        """Whether a setting is the set's own."""
        return name in _OF_SETS and self.is_property_set(_behind(name)[0])

    def make_own(self, name: str) -> None:
        """Make a setting the set's own, with the value that counts now. A number comes with its switch."""
        names = dict.fromkeys(filter(None, (each for one in _behind(name) for each in (_switch(one), one))))
        values = [(each, getattr(self.whole, each)) for each in names]  # before one of them changes another one
        for each, value in values:
            setattr(self, each, value)

    def back(self, name: str) -> None:
        """Give a setting back to the scene: a switch with its numbers, and the last number of a switch with it."""
        for one in _behind(name):
            for each in (one, *_numbers(one)):
                self.property_unset(each)
            if _switch(one) and not any(map(self.is_property_set, _numbers(_switch(one)))):
                self.property_unset(_switch(one))


def _behind(name: str) -> tuple[str, ...]:
    """The settings that are stored for a property."""
    return STANDS_FOR.get(name, (name,))


def _switch(name: str) -> str:
    return getattr(DECLARED.get(name), "switch", "")


def _numbers(switch: str) -> list[str]:
    """The settings that a switch makes None."""
    return [name for name in _STORED if _switch(name) == switch]


class ImprintSet(bpy.types.PropertyGroup):
    """An item of Scene.imprint_sets. See the top of this module."""

    def _rename(self, _context: bpy.types.Context) -> None:
        unique = unique_name(self.id_data, self.name, self)
        if unique != self.name:
            self.name = unique

    name: labeled(
        StringProperty, "Name", "Name of the set, which an image has that all its parts share", update=_rename
    )
    is_on: labeled(BoolProperty, "Bake", "Whether Bake All Sets bakes this set", default=True)
    source: labeled(
        EnumProperty,
        "Source",
        "Where the parts come from",
        items=[
            ("PARTS", "Parts", "The objects in the list"),
            ("COLLECTION", "Collection", "All meshes in a collection that no name and no pair calls high or cage"),
            ("NAMES", "Names", "All low objects of the scene with high ones that are called alike"),
        ],
    )
    parts: labeled(CollectionProperty, "Parts", "The low objects of the set", type=ImprintPart)
    active_part: labeled(IntProperty, "Active Part", "Index of the selected part", min=0)
    collection: labeled(
        PointerProperty, "Collection", "Collection with the low objects of the set", type=bpy.types.Collection
    )
    textures: labeled(
        EnumProperty,
        "Textures",
        "Which parts share an image",
        items=[
            ("PART", "Each Part", "An image for each part"),
            ("MATERIAL", "Each Material", "An image for each material, which all parts share that wear it"),
            ("ONE", "One for All", "One image for all parts, an atlas, which is named after the set"),
        ],
    )
    own: labeled(PointerProperty, "Own Settings", "The settings that the scene does not decide", type=ImprintOwn)

    def is_own(self, name: str) -> bool:
        """Whether a setting is the set's own."""
        return self.own.is_own(name)

    def make_own(self, name: str) -> None:
        """As ImprintOwn.make_own."""
        self.own.make_own(name)

    def back(self, name: str) -> None:
        """As ImprintOwn.back."""
        self.own.back(name)

    @property
    def settings(self) -> Settings:
        """The settings of the set as plain data, with names that fit its textures."""
        scene = self.id_data.imprint
        settings = scene.to_settings(own=self.own, of_own=self.own.names_of_own())
        return _with_textures(settings, self.textures)


def _with_textures(settings: Settings, textures: str) -> Settings:
    """The settings for images that parts share as `textures` of a set has it. See bake_jobs.named for those of materials."""
    if textures == "MATERIAL":
        return settings.mapped(texture_sets=True)
    image, output = map(naming.of_one_texture, (settings.storing.image, settings.storing.output))
    return settings.mapped(texture_sets=False).stored(image=image, output=output)


def unique_name(scene: bpy.types.Scene, name: str, own: ImprintSet | None = None) -> str:
    """The name, with a number if another set than `own` has it."""
    taken = {one.name for one in scene.imprint_sets if one != own}
    name = name.strip() or NEW
    return next(each for each in _numbered(name) if each not in taken)


def _numbered(name: str) -> Iterator[str]:
    yield name
    base, dot, number = name.rpartition(".")
    base, start = (base, int(number)) if dot and base and number.isdecimal() else (name, 0)
    yield from (f"{base}.{each:03}" for each in itertools.count(start + 1))


def copy(source: ImprintSet, target: ImprintSet) -> None:
    """Make a new set equal to another one, but for its name."""
    for name in ("is_on", "source", "collection", "textures"):
        setattr(target, name, getattr(source, name))
    for part in source.parts:
        item = target.parts.add()
        item.object, item.called = part.object, part.called
    # Those first that change others where these do not fit.
    for name in sorted(source.own.names_of_own(), key=lambda name: name not in {"square", "storage", "output"}):
        setattr(target.own, name, getattr(source.own, name))


def active(context: bpy.types.Context) -> ImprintSet | None:
    """The set that the panel bakes; None while it bakes the selection."""
    scene = context.scene
    if scene.imprint.bakes != "SETS" or not len(scene.imprint_sets):
        return None
    return scene.imprint_sets[min(scene.imprint.active_set, len(scene.imprint_sets) - 1)]


def whole(context: bpy.types.Context) -> ImprintSettings | Whole:
    """The settings that count for what the panel bakes. What is set there is set for the active set, or else for the scene."""
    one = active(context)
    return context.scene.imprint if one is None else one.own.whole


def owner(context: bpy.types.Context, name: str) -> ImprintSettings | ImprintOwn:
    """What stores a setting of what the panel bakes: the active set, if it has it of its own, or else the scene."""
    one = active(context)
    return one.own if one is not None and one.is_own(name) else context.scene.imprint


def lows(context: bpy.types.Context, one: ImprintSet) -> list[bpy.types.Object]:
    """The low objects of a set that exist, also those that are switched off."""
    if one.source == "NAMES":
        return [low for low, _ in _by_name(context)]
    if one.source == "COLLECTION":
        return _of_collection(context, one)
    found = (part.find() for part in one.parts)
    return list(dict.fromkeys(low for low in found if low is not None))


def _by_name(context: bpy.types.Context) -> list[tuple[bpy.types.Object, Pair]]:
    """The low objects of the view layer with their pairs by name. Raises BakeError for suffixes that are the same."""
    pairs, _ = context.scene.imprint.pairs_by_name(context)
    objects = object_checks.by_name(context.view_layer.objects)
    return [(objects[pair.low], pair) for pair in pairs]


def _of_collection(context: bpy.types.Context, one: ImprintSet) -> list[bpy.types.Object]:
    """The meshes of a collection, and of those in it, that nothing calls high or cage."""
    if one.collection is None:
        return []
    meshes = [obj for obj in one.collection.all_objects if obj.type == "MESH"]
    return without_highs(context, meshes)


def without_highs(context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> list[bpy.types.Object]:
    """The objects that neither a name nor a pair calls high or cage."""
    suffixes, others = context.scene.imprint.suffixes(), set()
    for pair in filter(None, map(object_pairs.of, context.scene.objects)):
        others.update([pair.cage], () if pair.is_own else pair.found())
    return [obj for obj in objects if obj not in others and naming.role(obj.name, suffixes) not in {"high", "cage"}]


def highs_of(context: bpy.types.Context, low: bpy.types.Object) -> list[bpy.types.Object]:
    """The high objects that the pair or the name of a low object gives it; none if it is baked onto itself."""
    highs = context.scene.imprint.alone(context, low).highs
    return [] if low in highs else highs


def resolve(context: bpy.types.Context, one: ImprintSet) -> SetJob:
    """What is baked of a set. Raises BakeError if nothing can be."""
    set_job = _look(context, one)
    if not set_job.jobs:
        raise BakeError(set_job.left_out[0][1])
    return set_job


def resolve_all(context: bpy.types.Context, chosen: Sequence[ImprintSet]) -> list[SetJob]:
    """What is baked of several sets, without what sets before them in the list bake already. A set of which nothing can be
    baked has no jobs, and why in `left_out`."""
    every = context.scene.imprint_sets
    resolved = set_jobs.apart([_look(context, one) for one in every if one.is_on])
    of_names = {set_job.name: set_job for set_job in resolved}
    return [of_names.get(one.name) or _look(context, one) for one in every if one in chosen]


def _look(context: bpy.types.Context, one: ImprintSet) -> SetJob:
    """As `resolve`, without jobs if nothing can be baked, and why in `left_out`."""
    ready, left_out, off, settings = [], [], set(), one.settings
    try:
        for low, job, why in jobs(context, one):
            reason = why or object_checks.problem(context, low, job.highs, job.cage, settings.tracing.method)
            if not low.imprint_is_baked:
                off.add(low.session_uid)
            if not reason:
                ready.append(job)
            elif low.imprint_is_baked:
                left_out.append((low.name, reason))
        left_out += _gone(context, one)
    except BakeError as error:  # suffixes that are the same
        left_out.append(("", str(error)))
    if not ready and not left_out:
        left_out.append(("", set_jobs.all_off(one.name) if off else _empty(one)))
    set_job = SetJob(one.name, tuple(ready), settings, one.textures != "PART", tuple(left_out), frozenset(off))
    return set_jobs.check_highs(set_job)


def _gone(context: bpy.types.Context, one: ImprintSet) -> list[tuple[str, str]]:
    """The parts whose objects do not exist, and objects whose names lack another one; and why, in sentences."""
    if one.source == "NAMES":
        return [("", problem) for problem in context.scene.imprint.pairs_by_name(context)[1]]
    titles = [part.title for part in one.parts if part.title and part.find() is None] if one.source == "PARTS" else []
    return [(title, object_pairs.problem([title])) for title in titles]


def _empty(one: ImprintSet) -> str:
    if one.source == "COLLECTION":
        if one.collection is None:
            return f"The collection of the set {one.name!r} is gone: choose another one."
        return f"The collection {one.collection.name!r} of the set {one.name!r} has no low object: add one."
    if one.source == "NAMES":
        return f"The set {one.name!r} has no part: no two objects are called alike, as crate_low and crate_high."
    return f"The set {one.name!r} has no part: add low objects."


def jobs(context: bpy.types.Context, one: ImprintSet) -> Iterator[tuple[bpy.types.Object, Job, str]]:
    """Each part's low object, its job, and why it cannot be baked."""
    if one.source == "NAMES":
        objects = object_checks.by_name(context.view_layer.objects)
        for low, pair in _by_name(context):
            yield low, with_own(Job(low, [objects[name] for name in pair.highs], objects.get(pair.cage))), ""
        return
    named, has_cages = Named(context), one.own.whole.method != Method.FLATTEN
    for low in lows(context, one):
        chosen = context.scene.imprint.alone(context, low, named)
        cage = chosen.pair.cage if chosen.pair is not None else named.cage(low)
        yield low, with_own(Job(low, chosen.highs, cage if has_cages else None)), object_pairs.problem(chosen.missing)


def settle(*_) -> None:
    """As object_pairs.settle, of the parts of sets."""
    for scene in bpy.data.scenes:
        for part in (part for one in scene.imprint_sets for part in one.parts if scene.library is None):
            part.settle()


events.hear(save_pre=settle)
CLASSES = (ImprintPart, ImprintOwn, ImprintSet)
register, unregister = registering(CLASSES, properties={"Scene.imprint_sets": CollectionProperty(type=ImprintSet)})
