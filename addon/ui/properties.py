# SPDX-License-Identifier: GPL-3.0-or-later
"""The data that Blender stores for Imprint: the settings of a scene, and the results that panels show."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import bpy
from bpy.props import EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..core import file_formats, naming
from ..core.declarations import targets
from ..core.declarations.choices import Method, Storage
from ..core.errors import BakeError
from ..core.naming import Pair, Suffixes
from ..core.settings import Settings
from ..jobs.job import Job
from ..scene import evaluation, object_checks
from . import engine_choice, object_pairs, results, several
from .callbacks import registering
from .declared_properties import MapList, OfPanels, Options, declared
from .object_pairs import ImprintHigh, ImprintPair, is_mesh
from .texts import labeled

NEVER_HIGH = {"LIGHT", "LIGHT_PROBE", "CAMERA", "SPEAKER"}
"""Types of objects that nobody selects to be high ones: "select all" takes them along."""


def _set_size(settings: "WithEngine", texels: int) -> None:
    settings.width = settings.height = texels


def _make_square(settings: "WithEngine", _context: bpy.types.Context) -> None:
    if settings.square:
        settings.height = settings.whole.width


def _get_names(settings: "WithEngine") -> str:
    """How maps are named, for a preset; empty if that fits one object alone."""
    names = naming.of_one_texture(settings.whole.image)
    return names if naming.has_low(names) and naming.MATERIAL not in names else ""


def _set_names(group: "WithEngine", names: str) -> None:
    """Name the image and the file after a preset. The folder and the ending of the file stay."""
    settings = group.whole
    if names:
        filled = naming.of_texture_sets(names) if settings.texture_sets else names
        settings.image = "" if names == naming.USUAL else filled
        settings.output = naming.renamed(settings.output, filled)


def _fit_depth(group: "WithEngine", _context: bpy.types.Context) -> None:
    """Set a depth that the file can have: .tga has 8 bits alone, whether a preset has set 16 or nobody."""
    settings = group.whole
    if settings.storage == Storage.FILE and not file_formats.takes(settings.output, int(settings.depth)):
        settings.depth = str(file_formats.usual_depth(settings.output))


def _choose(name: str):
    """A callback that gives what a script sets in the scene to the pair of the panel's low object too, as the panel does."""

    def update(settings: "ImprintSettings", context: bpy.types.Context) -> None:
        pair = object_pairs.of(settings.low or context.active_object)
        if pair is not None and pair.is_kept:
            setattr(pair, name, getattr(settings, name))

    return update


class WithEngine:
    """What a scene and a set have beside the settings of a bake: an engine sets several of them at once."""

    @property
    def whole(self) -> "WithEngine":
        """All settings, where a set has some of its own alone. What is set there becomes the set's own."""
        return self


# Blender reads properties from the annotations of a class and of its bases.
WithEngine.__annotations__ = {
    "size": declared("size", get=lambda self: self.whole.width, set=_set_size),
    "square": declared("square", update=_make_square),
    "output": declared("output", update=_fit_depth),
    "names": labeled(
        StringProperty,
        "Names of Maps",
        "Names that an engine or a preset gives to images and files, with {low} or {name}",
        get=_get_names,
        set=_set_names,
    ),
    "export": declared("export"),
    "engine": labeled(
        EnumProperty,
        "Engine",
        "Program that gets the maps. It sets channels, basis, depth, alpha, packing, names, files and the export at once",
        items=engine_choice.engine_items,
        get=lambda self: engine_choice.get_engine(self.whole),
        set=lambda self, number: engine_choice.set_engine(self.whole, number),
    ),
    "engine_name": labeled(
        StringProperty,
        "Engine",
        "Name of the engine that was chosen last",
        default=targets.OF_SCENE,
        options={"HIDDEN"},
    ),
}


class ImprintSettings(bpy.types.PropertyGroup, WithEngine, Options, OfPanels, MapList):
    """Scene.imprint."""

    low: declared("low", poll=is_mesh)
    highs: declared("highs", type=ImprintHigh)
    cage: declared("cage", poll=is_mesh, update=_choose("cage"))
    method: declared("method", update=_choose("method"))
    measure: declared("measure", update=_choose("measure"))
    extrusion: declared("extrusion", update=_choose("extrusion"))
    max_distance: declared("max_distance", update=_choose("max_distance"))
    live_every_time: declared("live_every_time")
    show_result: declared("show_result")
    convert_image: labeled(
        PointerProperty, "Map", "Normal map to convert: an image of Imprint or of another baker", type=bpy.types.Image
    )
    active_high: labeled(IntProperty, "Active High", "Index of the selected slot")
    bakes: labeled(
        EnumProperty,
        "Bakes",
        "What the panel bakes",
        items=[
            ("SELECTION", "Selection", "The selected objects, or those in the slots"),
            ("SETS", "Sets", "The parts of a set, which stays in the file"),
        ],
    )
    active_set: labeled(IntProperty, "Active Set", "Index of the selected set", min=0)

    def chosen(self, context: bpy.types.Context, low: bpy.types.Object | None = None) -> "Chosen":
        """The low object and the high ones: from the slots, else the active and the other selected objects.

        Without high objects, those of the low object's pair are used, whether they are hidden or not. For a low object without
        a pair, they are those that are called as it is, as crate_high for crate_low; else it is its own high object. low:
        overrides the slot. If several objects are baked each for itself, it is one of them.
        """
        low = low or self.low or context.active_object
        if low in several.lows(context, self):
            return self.alone(context, low)
        if any(slot.title for slot in self.highs):
            highs = [obj for slot in self.highs if (obj := slot.find()) is not None]
            missing = [slot.title for slot in self.highs if slot.title and slot.find() is None]
            return Chosen(self, low, highs, self._pair_of(low, highs), missing)
        pair = object_pairs.of(low)
        return self._by(context, low, self._selected(context, low, pair if pair is not None and pair.is_kept else None))

    def all_chosen(self, context: bpy.types.Context, *, is_each: bool = False) -> list["Chosen"]:
        """What the panel bakes: `chosen`, or several selected objects each for itself.

        is_each: also those that lie over one another.
        """
        lows = several.candidates(context, self) if is_each else several.lows(context, self)
        return [self.alone(context, low) for low in lows] or [self.chosen(context)]

    def alone(self, context: bpy.types.Context, low: bpy.types.Object, named: "Named | None" = None) -> "Chosen":
        """As `chosen` for an object that is selected alone. named: of the view layer, where many are asked for."""
        return self._by(context, low, [], named)

    def _by(
        self,
        context: bpy.types.Context,
        low: bpy.types.Object | None,
        selected: Sequence[bpy.types.Object],
        named: "Named | None" = None,
    ) -> "Chosen":
        """A low object with its high ones, as `chosen`. selected: those that can be meant as high ones."""
        pair = object_pairs.of(low)
        # An armature that is selected too is no high object; where nothing else is, it is named as what it is.
        highs = list(filter(object_checks.may_show, selected))
        if pair is None or not pair.is_kept:
            highs = highs or (named or Named(context)).highs(low) or object_checks.own_highs(low) or selected
            return Chosen(self, low, highs or object_checks.itself(low))
        highs = highs or pair.found()
        pair = self._pair_of(low, highs)
        return Chosen(self, low, highs, pair, pair.missing() if pair is not None else [])

    def _selected(
        self, context: bpy.types.Context, low: bpy.types.Object | None, pair: ImprintPair | None
    ) -> list[bpy.types.Object]:
        """The selected objects that can be meant as high ones, also those without a surface.

        While the high objects of `pair` are hidden, the low objects of other pairs are not: "select all" selects these alone.
        Nor are other low objects, with their high ones.
        """
        cages = {self.cage, pair and pair.cage}
        selected = (obj for obj in context.view_layer.objects.selected if obj.type not in NEVER_HIGH)
        others = [obj for obj in selected if obj != low and obj not in cages]
        if others and pair is not None and not any(map(evaluation.is_visible, pair.found())):
            return [obj for obj in others if (other := object_pairs.of(obj)) is None or not other.is_kept]
        other_lows = several.others(context, self, low)
        left_out = self._with_highs(context, other_lows) if other_lows else ()
        return [obj for obj in others if obj not in left_out]

    def _with_highs(self, context: bpy.types.Context, lows: Sequence[bpy.types.Object]) -> set[bpy.types.Object]:
        """Low objects with their high objects and cages, by name and by pair."""
        pairs = list(filter(None, map(object_pairs.of, lows)))
        named = Named(context)
        by_name = [obj for low in lows for obj in (*named.highs(low), named.cage(low))]
        return {*lows, *by_name, *(obj for pair in pairs for obj in (*pair.found(), pair.cage))}

    def pairs_by_name(self, context: bpy.types.Context) -> tuple[list[Pair], list[str]]:
        """The pairs of the view layer's objects, and sentences about objects without a match. Raises BakeError for suffixes
        that are the same."""
        return matched(tuple(dict.fromkeys(context.view_layer.objects.keys())), self.suffixes())

    def _pair_of(self, low: bpy.types.Object | None, highs: Sequence[bpy.types.Object]) -> ImprintPair | None:
        """The pair of `low` if these are its high objects, else None: then the low object gets other ones."""
        pair = object_pairs.of(low)
        return pair if pair is not None and pair.is_kept and set(pair.found()) == set(highs) else None

    def settings_of(self, job: Job) -> Settings:
        """The settings of a bake of the objects of a job, as far as they exist."""
        low, *highs = (ref.find() for ref in (job.low_ref, *job.high_refs))
        highs = [high for high in highs if high is not None]
        return Chosen(self, low, highs, self._pair_of(low, highs)).settings

    def suffixes(self) -> Suffixes:
        """The endings of the names of pairs."""
        return Suffixes(self.low_suffix, self.high_suffix, self.cage_suffix)


class Named:
    """Which objects of a view layer belong together by their names."""

    def __init__(self, context: bpy.types.Context):
        self._context = context
        self._objects: dict[str, dict[str, bpy.types.Object]] = {}
        """By name, for the library of a low object."""

    @cached_property
    def _pairs(self) -> dict[str, Pair]:
        try:
            pairs, _ = self._context.scene.imprint.pairs_by_name(self._context)
        except BakeError:  # suffixes that are the same, which the box says
            return {}
        return {pair.low: pair for pair in pairs}

    def highs(self, low: bpy.types.Object | None) -> list[bpy.types.Object]:
        """The high objects of `low`; empty if none are called as it is."""
        return list(filter(object_checks.may_show, self._found(low, "highs")))

    def cage(self, low: bpy.types.Object) -> bpy.types.Object | None:
        """The cage of `low`."""
        return next(iter(self._found(low, "cage")), None)

    def _found(self, low: bpy.types.Object | None, role: str) -> list[bpy.types.Object]:
        suffixes = self._context.scene.imprint.suffixes()
        if low is None or naming.role(low.name, suffixes) != "low" or low.name not in self._pairs:
            return []
        names = getattr(self._pairs[low.name], role)
        library = low.library.filepath if low.library else ""
        if library not in self._objects:
            self._objects[library] = object_checks.by_name(self._context.view_layer.objects, low)
        return [self._objects[library][name] for name in ([names] if isinstance(names, str) else names) if name]


@dataclass(frozen=True)
class Chosen:
    """The objects that the panel bakes.

    Attributes:
        panel: The settings of the scene.
        pair: The pair of `low` if `highs` are its high objects, else None.
        missing: The names of high objects that should be among them, and were deleted or did not come along.
    """

    panel: ImprintSettings
    low: bpy.types.Object | None
    highs: list[bpy.types.Object]
    pair: ImprintPair | None = None
    missing: list[str] = field(default_factory=list)

    @property
    def rays(self) -> ImprintSettings | ImprintPair:
        """What holds the method, the cage and the distances for these objects: their pair, or else the scene's settings."""
        return self.pair or self.panel

    @property
    def cage(self) -> bpy.types.Object | None:
        """The cage for these objects, or None for Flatten, which needs no cage."""
        return None if self.rays.method == Method.FLATTEN else self.rays.cage

    @cached_property
    def settings(self) -> Settings:
        """The settings of a bake of these objects, as they were when they were asked for first."""
        return self.panel.to_settings(own=self.rays, of_own=object_pairs.CHOSEN)

    def hidden(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        """The high objects that the view layer does not show."""
        return [high for high in self.highs if high != self.low and not evaluation.is_visible(high)]

    def check(self, context: bpy.types.Context) -> None:
        """Raise BakeError without a low object, or if a high object is missing."""
        if self.low is None or self.missing:
            raise BakeError(object_pairs.problem(self.missing) or object_checks.problem(context, self.low, self.highs))

    def job(self, context: bpy.types.Context) -> tuple[Job, Settings]:
        """What the panel bakes. Raises BakeError as `check`."""
        self.check(context)
        return Job(self.low, self.highs, self.cage), self.settings


@lru_cache(maxsize=1)
def matched(names: tuple[str, ...], suffixes: Suffixes) -> tuple[list[Pair], list[str]]:
    """As naming.match. Cached: a redraw matches names only if a name or a suffix has changed."""
    return naming.match(names, suffixes)


def _found(name: str):
    """A getter of a distance that the last bake of the current low object measured; 0 if it measured none."""
    return lambda _: results.distances(results.of(bpy.context)).get(name, 0.0)


class ImprintFound(bpy.types.PropertyGroup):
    """WindowManager.imprint_found: the distances that the last bake of the current low object measured."""

    extrusion: labeled(
        FloatProperty,
        "Extrusion",
        "Distance that the last bake measured",
        subtype="DISTANCE",
        precision=4,
        get=_found("extrusion"),
    )
    max_distance: labeled(
        FloatProperty,
        "Max Distance",
        "Distance that the last bake measured",
        subtype="DISTANCE",
        precision=4,
        get=_found("max_distance"),
    )


CLASSES = (ImprintSettings, ImprintFound)
register, unregister = registering(
    CLASSES,
    properties={
        "WindowManager.imprint_found": PointerProperty(type=ImprintFound),
        "Scene.imprint": PointerProperty(type=ImprintSettings),
        "WindowManager.imprint_summary": labeled(
            StringProperty, "Last Bake", "Summary of this session's last bake, one item per line", options={"SKIP_SAVE"}
        ),
        "WindowManager.imprint_warnings": labeled(
            StringProperty, "Warnings", "Warnings of this session's last bake, one per line", options={"SKIP_SAVE"}
        ),
        "WindowManager.imprint_batch": labeled(
            StringProperty,
            "Last Bake of Pairs",
            "Low objects that this session's last bake of pairs baked, and those that it left out, and why, in JSON",
            options={"SKIP_SAVE"},
        ),
    },
)
