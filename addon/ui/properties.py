# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings as Blender properties: once for the scene, once for the operator's arguments."""

from dataclasses import fields

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..core import file_formats, map_types, udim
from ..core.name_matching import Suffixes
from ..core.settings import AXES, MAX_MIPS, MAX_SIZE, MIN_SIZE, SAMPLES, Settings
from ..scene import bake_objects, visibility
from . import bake_results
from .bake_results import results

_USUAL = Settings()


def _axes(first: str) -> list[tuple[str, str, str]]:
    """The six directions as enum items, those of the axis that usually comes here first."""
    hints = {"+Y": "Up: Blender, Unity, Godot, glTF", "-Y": "Down: Unreal, DirectX, CryEngine"}
    labels = {"+Y": "+Y (OpenGL)", "-Y": "-Y (DirectX)"}
    return [
        (
            axis,
            labels.get(axis, axis),
            hints.get(axis, f"The normal's {axis[1]}, {'as it is' if axis[0] == '+' else 'turned over'}"),
        )
        for axis in sorted(AXES, key=lambda axis: axis[1] != first)
    ]


class Options:
    """The fields of Settings, under the same names."""

    method: EnumProperty(
        name="Method",
        description="How the detail comes from the high mesh to the map",
        items=[
            (
                "AUTO",
                "Auto",
                "Flatten where the meshes share their UV layout, else Cast; the report says which and why",
            ),
            ("FLATTEN", "Flatten", "Draw the high mesh in UV space: both meshes share their UV layout"),
            ("CAST", "Cast", "Rays from the low mesh to the high one: they share nothing but their place in space"),
        ],
    )
    measure: BoolProperty(
        name="Measure Distances",
        description="Find out how far the high surface lies from the low one, instead of taking the two numbers below",
        default=True,
    )
    extrusion: FloatProperty(
        name="Extrusion",
        description="How far outside the low mesh rays start",
        default=0.05,
        min=0.0,
        soft_max=1.0,
        precision=4,
        subtype="DISTANCE",
    )
    max_distance: FloatProperty(
        name="Max Distance",
        description="How far rays go from where they start",
        default=0.1,
        min=0.0,
        soft_max=2.0,
        precision=4,
        subtype="DISTANCE",
    )
    directions: EnumProperty(
        name="Directions",
        description="Which of the low mesh's normals rays follow",
        items=[
            ("SMOOTH", "Smooth", "As if the mesh had no hard edge, so that none leaves a gap"),
            ("SPLIT", "Split", "Its own normals, with hard edges and custom ones"),
        ],
    )
    facing_only: BoolProperty(
        name="Facing Only", description="Pass through high triangles that turn their back on the ray"
    )
    missed: FloatVectorProperty(
        name="Missed",
        description="Colour of texels whose ray hit nothing; their alpha is 0",
        subtype="COLOR_GAMMA",
        size=3,
        min=0.0,
        max=1.0,
        default=(0.5, 0.5, 1.0),
    )
    mask: BoolProperty(name="Mask of Misses", description="Make a second image that is white where rays hit nothing")
    space: EnumProperty(
        name="Space",
        description="What the normals are relative to",
        items=[
            ("TANGENT", "Tangent", "To the low surface: the mesh may deform, and the map may be tiled"),
            ("OBJECT", "Object", "To the low object"),
            ("WORLD", "World", "To the scene"),
        ],
    )
    basis: EnumProperty(
        name="Basis",
        description="What will read the tangent-space map. Readers differ by a few degrees on coarse meshes",
        items=[
            ("AUTO", "Scene's Engine", "What the scene's render engine reads: Cycles its own, all others MikkTSpace"),
            ("BLENDER", "Cycles", "Cycles' Normal Map node, which normalises the interpolated normal alone"),
            ("MIKKTSPACE", "MikkTSpace", "EEVEE and Material Preview, and game engines that follow MikkTSpace"),
        ],
    )
    uv_layer: StringProperty(name="UV Map", description="The low mesh's UV map; empty for the active one")
    width: IntProperty(name="Width", description="Texels", default=_USUAL.width, min=MIN_SIZE, max=MAX_SIZE)
    height: IntProperty(name="Height", description="Texels", default=_USUAL.height, min=MIN_SIZE, max=MAX_SIZE)
    samples: EnumProperty(
        name="Samples",
        description="How often each texel is drawn; several are antialiased. 1 for a look, 4 or more for the map that stays: "
        "4 take some 2 to 3 times as long and leave a fifth of the error",
        items=[(str(n), str(n), "One, at the texel's centre" if n == 1 else f"The mean of {n}") for n in SAMPLES],
    )
    maps: EnumProperty(
        name="Other Maps",
        description="What else is baked, into an image each beside the normal map",
        options={"ENUM_FLAG"},
        items=[(one.name, one.label, one.tooltip) for one in map_types.OTHERS],
        default=set(),
    )
    red: EnumProperty(name="Red", description="What the red channel holds", items=_axes("X"), default="+X")
    green: EnumProperty(name="Green", description="What the green channel holds", items=_axes("Y"), default="+Y")
    blue: EnumProperty(name="Blue", description="What the blue channel holds", items=_axes("Z"), default="+Z")
    margin: IntProperty(
        name="Margin",
        description="Texels around the UV islands that are filled, so that no background shows",
        default=16,
        min=0,
        soft_max=64,
        max=MAX_SIZE,
    )
    unlimited: BoolProperty(name="Unlimited", description="Fill all that the islands leave")
    margin_type: EnumProperty(
        name="Margin Type",
        description="What the margin is filled with",
        items=[
            ("EXTEND", "Extend", "The nearest texel of an island"),
            ("ADJACENT_FACES", "Adjacent Faces", "What lies across the seam on the surface, turned to fit"),
        ],
    )
    mips: IntProperty(
        name="Clean Mip Levels",
        description="How many mip levels the checks want without colours of another UV island: one takes 2 texels between "
        "islands, two take 4, three 8, and half as many to the border",
        default=3,
        min=0,
        max=MAX_MIPS,
    )
    udim: BoolProperty(name="UDIM Tiles", description="A map for each UDIM tile that the low mesh covers")
    tiles: StringProperty(
        name="Tiles",
        description="Of these tiles alone, as 1001, 1003; empty for all that the low mesh covers, 100 at the most",
    )
    limited: BoolProperty(
        name="Set Limit",
        description="Set how far the high surface may lie from the low one before it is told, instead of 5 % of its radius",
    )
    limit: FloatProperty(
        name="Limit",
        description="How far the high surface may lie from the low one before it is told",
        default=0.1,
        min=1e-6,
        soft_max=2.0,
        precision=4,
        subtype="DISTANCE",
    )
    depth: EnumProperty(
        name="Depth",
        description="Bits a channel",
        items=[
            ("8", "8", "Smallest; may show steps on smooth surfaces"),
            ("16", "16", "Smooth: 16-bit PNG, half-float OpenEXR, or a float image inside Blender"),
            ("32", "32", "Exact: float OpenEXR, or a float image inside Blender"),
        ],
        default="16",
    )
    dither: BoolProperty(
        name="Dither", description="Hide the steps of 8 bits in fine noise, instead of rounding to the nearest"
    )
    modifiers: EnumProperty(
        name="Modifiers",
        description="Whose levels and visibility count",
        items=[
            ("RENDER", "Render", "As they are set for rendering"),
            ("VIEWPORT", "Viewport", "As they are set for the viewport"),
        ],
    )
    image: StringProperty(
        name="Image", description="Name of the image to fill; empty for one named after the low object"
    )
    storage: EnumProperty(
        name="Store",
        description="Where the map is kept",
        items=[
            ("PACK", "Packed", "Inside the .blend file"),
            ("FILE", "File", "In an image file beside it"),
            ("MEMORY", "Memory", "Nowhere yet: Blender asks about unsaved images when it closes"),
        ],
    )
    output: StringProperty(
        name="File",
        description="PNG or TIFF (8, 16 bits), OpenEXR (16, 32 bits) or Targa (8 bits). Missing folders are made",
        subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    material: BoolProperty(name="Material", description="Put the map into the low object's material", default=True)
    single_user: BoolProperty(
        name="Single User", description="Copy materials that other objects use as well, so that those keep their looks"
    )

    def to_settings(self, fallback: "Options | None" = None) -> Settings:
        """Plain data. What was not set here is taken from `fallback`."""
        values = {}

        def owner(name: str) -> Options:
            return self if fallback is None or self.properties.is_property_set(name) else fallback

        for name in (field.name for field in fields(Settings)):
            values[name] = getattr(owner(name), name)
        if fallback is not None and owner("output") is self and owner("storage") is fallback:
            values["storage"] = "FILE"  # who names a file wants it written
        values["maps"] = tuple(name for name in map_types.NAMES if name in values["maps"])
        # A script that names a number means it, whatever the switch says.
        if owner("unlimited").unlimited and (
            owner("margin") is fallback or fallback is None or owner("unlimited") is self
        ):
            values["margin"] = None
        if not owner("limited").limited and (owner("limit") is fallback or fallback is None):
            values["limit"] = None
        values["tiles"] = udim.parse(values["tiles"])
        for name in ("depth", "samples"):
            values[name] = int(values[name])
        if values["storage"] == "FILE" and not _is_set(owner("depth"), "depth"):
            values["depth"] = file_formats.usual_depth(values["output"])  # which a format may not have, as Targa
        values["missed"] = tuple(values["missed"])
        for name in ("extrusion", "max_distance"):
            # A script that names a distance means it, whatever the switch says.
            if owner("measure").measure and (owner(name) is fallback or fallback is None):
                values[name] = None
        return Settings(**values).read_by((fallback or self).id_data.render.engine)


def _is_set(owner: Options, name: str) -> bool:
    """Whether somebody has set a property of a scene's settings, or of an operator."""
    return getattr(owner, "properties", owner).is_property_set(name)


def _is_mesh(_settings, obj: bpy.types.Object) -> bool:
    return obj.type == "MESH"


def _may_be_high(_settings, obj: bpy.types.Object) -> bool:
    return bake_objects.may_be_high(obj)


class ImprintHigh(bpy.types.PropertyGroup):
    """One slot for a high object."""

    object: PointerProperty(
        type=bpy.types.Object,
        name="High",
        description="A surface with detail: a mesh, a curve, text, or what shows instances",
        poll=_may_be_high,
    )


def _set_size(settings: "ImprintSettings", texels: int) -> None:
    settings.width = settings.height = texels


def _make_square(settings: "ImprintSettings", _context: bpy.types.Context) -> None:
    if settings.square:
        settings.height = settings.width


class ImprintSettings(bpy.types.PropertyGroup, Options):
    """Scene.imprint."""

    low: PointerProperty(
        type=bpy.types.Object,
        name="Low",
        description="The mesh that gets the map; empty for the active object",
        poll=_is_mesh,
    )
    highs: CollectionProperty(
        type=ImprintHigh, name="High", description="The meshes with detail; empty for the selection"
    )
    cage: PointerProperty(
        type=bpy.types.Object,
        name="Cage",
        description="A mesh with the low one's topology on which rays start; empty for none",
        poll=_is_mesh,
    )
    low_suffix: StringProperty(
        name="Low", description="What the names of low objects end in, in any case", default="_low"
    )
    high_suffix: StringProperty(
        name="High", description="What the names of high objects end in, before an underscore and more", default="_high"
    )
    cage_suffix: StringProperty(name="Cage", description="What the names of cages end in", default="_cage")
    share_image: BoolProperty(name="One Image", description="All pairs by name go into one image, an atlas")
    live_every_time: BoolProperty(
        name="Write Every Map",
        description="While live is on, the image gets each map at once, and not only when the hand rests",
    )
    size: IntProperty(
        name="Size",
        description="Texels along each side",
        min=MIN_SIZE,
        max=MAX_SIZE,
        get=lambda self: self.width,
        set=_set_size,
    )
    square: BoolProperty(
        name="Square",
        description="One size for width and height",
        default=True,
        update=_make_square,
    )
    show_result: BoolProperty(
        name="Show Result",
        description="After a bake, show the map in an open Image Editor and the low mesh with it in the 3D viewport: "
        "Material Preview instead of Solid, the high objects hidden",
        default=True,
    )
    active_high: IntProperty(name="Active High", description="The slot that is selected in the list")

    def subjects(
        self, context: bpy.types.Context, low: bpy.types.Object | None = None
    ) -> tuple[bpy.types.Object | None, list[bpy.types.Object]]:
        """The low object, if none is given, and the high ones: from the slots, else as in "Selected to Active".

        Where none is chosen, a low object whose modifiers add detail is its own high one; else those of its last bake in
        this session count. Where those are hidden, as they are after a bake, they come first.
        """
        low = low or self.low or context.active_object
        highs = [slot.object for slot in self.highs if slot.object]
        if not highs:
            highs = [obj for obj in context.view_layer.objects.selected if obj != low]
        return low, highs or self._remembered(context, low)

    def _remembered(self, context: bpy.types.Context, low: bpy.types.Object | None) -> list[bpy.types.Object]:
        """What counts as high where nothing is chosen."""
        last = results.of(context, low) if low is not None else None
        before = bake_results.high_objects(last) if last is not None else []
        own = bake_objects.own_highs(low)
        is_hidden = before and not any(visibility.is_visible(obj) for obj in before)
        return before if is_hidden or not own else own

    def cage_for(self, method: str) -> bpy.types.Object | None:
        """The cage in the slot, which flattening has no use for."""
        return None if method == "FLATTEN" else self.cage

    def suffixes(self) -> Suffixes:
        """How pairs are named."""
        return Suffixes(self.low_suffix, self.high_suffix, self.cage_suffix)

    def distances(self, context: bpy.types.Context) -> tuple[float, float]:
        """Extrusion and maximum distance as set or, where they are measured, as the last bake found them."""
        owner = context.window_manager.imprint_found if self.measure else self
        return owner.extrusion, owner.max_distance


def _found(name: str):
    """Reads a distance of the low object at hand, as its last bake in this session measured it; 0 where none did."""
    return lambda _: bake_results.distances(results.of(bpy.context)).get(name, 0.0)


class ImprintFound(bpy.types.PropertyGroup):
    """WindowManager.imprint_found: what the last bake of the low object at hand measured."""

    extrusion: FloatProperty(
        name="Extrusion",
        description="As the last bake measured it",
        subtype="DISTANCE",
        precision=4,
        get=_found("extrusion"),
    )
    max_distance: FloatProperty(
        name="Max Distance",
        description="As the last bake measured it",
        subtype="DISTANCE",
        precision=4,
        get=_found("max_distance"),
    )


def register() -> None:
    bpy.utils.register_class(ImprintHigh)
    bpy.utils.register_class(ImprintSettings)
    bpy.utils.register_class(ImprintFound)
    bpy.types.WindowManager.imprint_found = PointerProperty(type=ImprintFound)
    bpy.types.Scene.imprint = PointerProperty(type=ImprintSettings)
    bpy.types.WindowManager.imprint_summary = StringProperty(
        name="Last Bake", description="What the last bake of this session did, a line each", options={"SKIP_SAVE"}
    )
    bpy.types.WindowManager.imprint_warnings = StringProperty(
        name="Warnings", description="What the last bake found to be suspicious, a line each", options={"SKIP_SAVE"}
    )


def unregister() -> None:
    del bpy.types.WindowManager.imprint_warnings
    del bpy.types.WindowManager.imprint_summary
    del bpy.types.Scene.imprint
    del bpy.types.WindowManager.imprint_found
    bpy.utils.unregister_class(ImprintFound)
    bpy.utils.unregister_class(ImprintSettings)
    bpy.utils.unregister_class(ImprintHigh)
