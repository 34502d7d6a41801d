# SPDX-License-Identifier: GPL-3.0-or-later
"""The data that Blender stores for Imprint: the settings of a scene, and the results that panels show."""

import bpy
from bpy.props import FloatProperty, IntProperty, PointerProperty, StringProperty

from ..core.declarations.choices import Method
from ..core.names import file_names
from ..core.names.name_matching import Suffixes
from ..scene import instances, object_checks, visibility
from . import bake_results
from .bake_results import results
from .settings.bake_options import Options
from .settings.declared_properties import declared
from .settings.map_list import MapList
from .translations.lookup import LABEL


def _is_mesh(_settings, obj: bpy.types.Object) -> bool:
    return obj.type == "MESH"


def _may_be_high(_settings, obj: bpy.types.Object) -> bool:
    return instances.may_show(obj)


class ImprintHigh(bpy.types.PropertyGroup):
    """One slot for a high object."""

    object: PointerProperty(
        type=bpy.types.Object,
        name="High",
        description="Object with detail: a mesh, a curve, text, or an object that shows instances",
        poll=_may_be_high,
        translation_context=LABEL,
    )


def _set_size(settings: "ImprintSettings", texels: int) -> None:
    settings.width = settings.height = texels


def _make_square(settings: "ImprintSettings", _context: bpy.types.Context) -> None:
    if settings.square:
        settings.height = settings.width


def _get_names(settings: "ImprintSettings") -> str:
    """How maps are named, for a preset; empty if that fits one object alone."""
    names = settings.image.replace(file_names.of_texture_sets(file_names.LOW), file_names.LOW)
    return names if file_names.LOW in names and file_names.MATERIAL not in names else ""


def _set_names(settings: "ImprintSettings", names: str) -> None:
    """Name the image and the file after a preset. The folder and the ending of the file stay."""
    if names:
        filled = file_names.of_texture_sets(names) if settings.texture_sets else names
        settings.image = "" if names == file_names.USUAL else filled
        settings.output = file_names.renamed(settings.output, filled)


class ImprintSettings(bpy.types.PropertyGroup, Options, MapList):
    """Scene.imprint."""

    low: declared("low", poll=_is_mesh)
    highs: declared("highs", type=ImprintHigh)
    cage: declared("cage", poll=_is_mesh)
    low_suffix: declared("low_suffix")
    high_suffix: declared("high_suffix")
    cage_suffix: declared("cage_suffix")
    share_image: declared("share_image")
    level_degrees: declared("level_degrees")
    level_distance: declared("level_distance")
    live_every_time: declared("live_every_time")
    size: declared("size", get=lambda self: self.width, set=_set_size)
    square: declared("square", update=_make_square)
    show_result: declared("show_result")
    names: StringProperty(
        name="Names of Maps",
        description="Names that a preset gives to images and files. {low} in them stands for the low object's name",
        get=_get_names,
        set=_set_names,
        translation_context=LABEL,
    )
    export: declared("export")
    convert_image: PointerProperty(
        type=bpy.types.Image,
        name="Map",
        description="Normal map to convert: an image of Imprint or of another baker",
        translation_context=LABEL,
    )
    from_space: declared("from_space")
    from_basis: declared("from_basis")
    from_red: declared("from_red")
    from_green: declared("from_green")
    from_blue: declared("from_blue")
    active_high: IntProperty(name="Active High", description="Index of the selected slot", translation_context=LABEL)

    def chosen_objects(
        self, context: bpy.types.Context, low: bpy.types.Object | None = None
    ) -> tuple[bpy.types.Object | None, list[bpy.types.Object]]:
        """The low object and the high ones: from the slots, else the active and the other selected objects.

        Without high objects, a low object whose modifiers add detail is its own high one. Otherwise, the high objects of
        its last bake in this session are used. They come first if they are all hidden, as they are after a bake. low:
        overrides the slot.
        """
        low = low or self.low or context.active_object
        highs = [slot.object for slot in self.highs if slot.object]
        if not highs:
            highs = [obj for obj in context.view_layer.objects.selected if obj != low]
        return low, highs or self._remembered(context, low)

    def _remembered(self, context: bpy.types.Context, low: bpy.types.Object | None) -> list[bpy.types.Object]:
        """The high objects to use if none are in the slots or selected."""
        last = results.of(context, low) if low is not None else None
        before = bake_results.high_objects(last) if last is not None else []
        own = object_checks.own_highs(low)
        is_hidden = before and not any(visibility.is_visible(obj) for obj in before)
        return before if is_hidden or not own else own

    def cage_for(self, method: str) -> bpy.types.Object | None:
        """The cage in the slot, or None for Flatten, which needs no cage."""
        return None if method == Method.FLATTEN else self.cage

    def suffixes(self) -> Suffixes:
        """The endings of the names of pairs."""
        return Suffixes(self.low_suffix, self.high_suffix, self.cage_suffix)


def _found(name: str):
    """A getter of a distance that the last bake of the current low object measured in this session; 0 if it measured none."""
    return lambda _: bake_results.distances(results.of(bpy.context)).get(name, 0.0)


class ImprintFound(bpy.types.PropertyGroup):
    """WindowManager.imprint_found: the distances that the last bake of the current low object measured."""

    extrusion: FloatProperty(
        name="Extrusion",
        description="Distance that the last bake measured",
        subtype="DISTANCE",
        precision=4,
        get=_found("extrusion"),
        translation_context=LABEL,
    )
    max_distance: FloatProperty(
        name="Max Distance",
        description="Distance that the last bake measured",
        subtype="DISTANCE",
        precision=4,
        get=_found("max_distance"),
        translation_context=LABEL,
    )


def register() -> None:
    bpy.utils.register_class(ImprintHigh)
    bpy.utils.register_class(ImprintSettings)
    bpy.utils.register_class(ImprintFound)
    bpy.types.WindowManager.imprint_found = PointerProperty(type=ImprintFound)
    bpy.types.Scene.imprint = PointerProperty(type=ImprintSettings)
    bpy.types.WindowManager.imprint_summary = StringProperty(
        name="Last Bake",
        description="Summary of this session's last bake, one item per line",
        options={"SKIP_SAVE"},
        translation_context=LABEL,
    )
    bpy.types.WindowManager.imprint_warnings = StringProperty(
        name="Warnings",
        description="Warnings of this session's last bake, one per line",
        options={"SKIP_SAVE"},
        translation_context=LABEL,
    )


def unregister() -> None:
    del bpy.types.WindowManager.imprint_warnings
    del bpy.types.WindowManager.imprint_summary
    del bpy.types.Scene.imprint
    del bpy.types.WindowManager.imprint_found
    bpy.utils.unregister_class(ImprintFound)
    bpy.utils.unregister_class(ImprintSettings)
    bpy.utils.unregister_class(ImprintHigh)
