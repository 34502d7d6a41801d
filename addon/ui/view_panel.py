# SPDX-License-Identifier: GPL-3.0-or-later
"""The View panel: its settings, its operators and their keys."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, PointerProperty, StringProperty

from ..core.declarations import targets
from ..core.declarations.choices import Space
from ..core.errors import BakeError
from ..core.map_types import NORMAL
from ..core.progress import Pace, Task
from ..core.settings import Settings
from ..jobs import masks
from ..passes import data_texture
from ..scene.textures import SINGLE
from . import object_pairs
from .callbacks import Key, registering
from .check_panel import CHECKS
from .live import live
from .modal import QuickOperator, SlicedOperator, WaitingOperator
from .progress_display import display
from .stored_maps import Mask, maps_of
from .texts import SidebarPanel, draw_paragraphs, labeled, message, split_layout
from .view_labels import describe_deviations, map_label
from .view_shading import ITEMS, TARGETS, Mode
from .views import viewer

HEADLIGHT = (-0.444, 0.518, 0.731)
"""Direction to the view's own light, in view space: slightly from above and from the left."""
NO_MASK = "NONE"
MASKS = {
    NO_MASK: ("None", "No texels are colored"),
    "UNCOVERED": CHECKS["uncovered"],
    "UNSURE": CHECKS["unsure"],
    "OVERLAP": CHECKS["overlap"],
    "SKEWED": (
        "Skewed",
        "Texels whose rays lean by more than 30 degrees: they show detail from beside them. Directions, or a denser low mesh, "
        "change it",
    ),
    "FAR": CHECKS["far"],
    "GAPS": CHECKS["gaps"],
    "BACKWARDS": CHECKS["backwards"],
}
"""Label and tooltip of each mask: None first, then kinds of checks."""
MASK_ITEMS = [(kind, *texts) for kind, texts in MASKS.items()]


def _get_mode(_view: bpy.types.PropertyGroup) -> int:
    return list(Mode).index(viewer.mode)


def _set_mode(_view: bpy.types.PropertyGroup, number: int) -> None:
    viewer.choose(list(Mode)[number])


def _read_again(_view: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    viewer.read_again()


def _mask_of(low: bpy.types.Object | None) -> str:
    """The mask that lies over a low object."""
    shading = viewer.stored.get(low.session_uid) if low is not None else None
    return shading.mask.kind if shading is not None and shading.mask is not None else NO_MASK


def _get_mask(_view: bpy.types.PropertyGroup) -> int:
    return list(MASKS).index(_mask_of(viewer.low and viewer.low.find()))


def _set_mask(_view: bpy.types.PropertyGroup, number: int) -> None:
    windows = bpy.context.window_manager.windows
    way = "INVOKE_DEFAULT" if windows and not bpy.app.background else "EXEC_DEFAULT"
    try:
        bpy.ops.imprint.view_mask(way, kind=list(MASKS)[number])
    except RuntimeError as error:  # what the operator reports
        viewer.message = str(error).removeprefix("Error: ").strip()


def _is_light(_view: bpy.types.PropertyGroup, obj: bpy.types.Object) -> bool:
    return obj.type == "LIGHT"


class ImprintView(bpy.types.PropertyGroup):
    """Scene.imprint_view: what the 3D viewports show of the map. The mode belongs to the session and is not saved."""

    mode: labeled(
        EnumProperty, "View", "What the 3D viewport shows", items=ITEMS, get=_get_mode, set=_set_mode, options=set()
    )
    target: labeled(
        EnumProperty,
        "Target Engine",
        "Program as which the view reads a tangent-space map. It shows what the program would show of this map",
        items=TARGETS,
        update=_read_again,
        options=set(),
    )
    light: labeled(
        PointerProperty,
        "Light",
        "The light that shines on the mesh; without one, a light that follows the view",
        type=bpy.types.Object,
        poll=_is_light,
    )
    direction: labeled(
        FloatVectorProperty,
        "Direction",
        "Direction of the light that follows the view: drag the ball",
        subtype="DIRECTION",
        size=3,
        default=HEADLIGHT,
    )
    all_lows: labeled(
        BoolProperty,
        "All Low Objects",
        "Show all low objects of the view layer that were baked, and not only that of the panel",
        update=_read_again,
    )
    mask: labeled(
        EnumProperty,
        "Mask",
        "Color texels that a check has found, on the low mesh",
        items=MASK_ITEMS,
        get=_get_mask,
        set=_set_mask,
        options=set(),
    )
    split: labeled(
        FloatProperty,
        "Line",
        "Position of the line between the high and the low mesh, as a share of the view's width",
        default=0.4,  # left of the middle, because the sidebar covers the right end
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    limit: labeled(
        FloatProperty, "Range", "Degrees at the end of the color scale", default=5.0, min=0.01, max=180.0, soft_max=45.0
    )


class _Show(WaitingOperator, SlicedOperator):
    """Shows a mode. If it needs a map, the map is drawn in slices."""

    def wanted(self) -> Mode:
        raise NotImplementedError

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[None]:
        yield from viewer.switching(context, self.wanted(), pace)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        # Without a map to draw, there is nothing to wait for.
        is_quick = viewer.is_ready(context, self.wanted())
        return self.execute(context) if is_quick else super().invoke(context, event)


class IMPRINT_OT_view_show(_Show, bpy.types.Operator):
    """Show in the 3D viewport what the map does"""

    bl_idname = "imprint.view_show"
    bl_label = "Show View"

    mode: labeled(EnumProperty, "View", "What the 3D viewport shows", items=ITEMS)

    def wanted(self) -> Mode:
        return Mode(self.mode)


class IMPRINT_OT_view_next(_Show, bpy.types.Operator):
    """Show the next view: map, high, split, side by side, deviation, deviation without the map, format, off"""

    bl_idname = "imprint.view_next"
    bl_label = "Next View"

    def wanted(self) -> Mode:
        return viewer.mode.next


class IMPRINT_OT_view_flicker(_Show, bpy.types.Operator):
    """Show the high mesh in place of the low mesh with its map, and the other way round"""

    bl_idname = "imprint.view_flicker"
    bl_label = "Flicker"

    def wanted(self) -> Mode:
        return Mode.MAP if viewer.mode is Mode.HIGH else Mode.HIGH


class IMPRINT_OT_view_map(WaitingOperator, QuickOperator, bpy.types.Operator):
    """Show this map of the last bake on the low mesh"""

    bl_idname = "imprint.view_map"
    bl_label = "Show Map on Mesh"

    map: labeled(StringProperty, "Map", "Name of the map, as NORMAL or AO")

    def apply(self, context: bpy.types.Context) -> str:
        if self.map not in maps_of(viewer.low_of(context)):
            raise BakeError(f"The low object has no map {self.map!r}: bake it first.")
        viewer.choose_map(context, self.map)
        return ""


class IMPRINT_OT_view_mask(WaitingOperator, SlicedOperator, bpy.types.Operator):
    """Color the texels of the low mesh that a check has found"""

    bl_idname = "imprint.view_mask"
    bl_label = "Show Mask on Mesh"

    kind: labeled(EnumProperty, "Mask", "Color texels that a check has found, on the low mesh", items=MASK_ITEMS)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and not live.is_on

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return self.execute(context) if self.kind == NO_MASK else super().invoke(context, event)

    def task(self, context: bpy.types.Context, _pace: Pace) -> Task[None]:
        low = viewer.low_of(context)
        if not maps_of(low):
            raise BakeError("Nothing was baked onto this low object: bake it first.")
        textures = {}
        for report in object_pairs.of(low).reports() if self.kind != NO_MASK else ():
            of_tiles = yield from masks.mask_work(context, report, self.kind.lower())
            for tile, mask in of_tiles.items():
                part = tuple(report.slots), tile if report.settings.get("udim") else SINGLE
                textures[part] = data_texture.image(mask, "R8")
        viewer.show_mask(context, low, Mask(self.kind, textures) if textures else None)


class IMPRINT_OT_view_refresh(WaitingOperator, SlicedOperator, bpy.types.Operator):
    """Draw the map of the view again, from the current objects and settings"""

    bl_idname = "imprint.view_refresh"
    bl_label = "Refresh View"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and viewer.mode is not Mode.OFF and not live.is_on

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[None]:
        yield from viewer.switching(context, viewer.mode, pace, redrawn=True)


GREEN = "{target} reads green as {wanted}, and the map stores {stored}: the setting Engine: {preset} sets it."


class IMPRINT_PT_view(SidebarPanel, bpy.types.Panel):
    """The view of the map in the 3D viewports."""

    bl_idname = "IMPRINT_PT_view"
    bl_label = "View"
    bl_order = 1

    def draw(self, context: bpy.types.Context) -> None:
        layout, view = split_layout(self.layout), context.scene.imprint_view
        row = layout.row(align=True)
        row.enabled = display.current is None
        row.prop(view, "mode")
        row.operator("imprint.view_refresh", text="", icon="FILE_REFRESH")
        _draw_maps(layout, row, context)
        if viewer.is_outdated(context):
            draw_paragraphs(layout, context, [message("The settings have changed: refresh the view.")], "INFO")
        if viewer.mode is not Mode.OFF:
            _draw_settings(layout, context)
        if viewer.message:
            draw_paragraphs(layout.box(), context, [viewer.message], "ERROR")


def _draw_maps(layout: bpy.types.UILayout, row: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """A button for each stored map of the low object, which shows it on the mesh; in the `row`, one that opens its image."""
    low = viewer.low_of(context)
    maps = maps_of(low)
    if not maps:
        return
    if low not in {context.scene.imprint.low, context.active_object}:
        layout.label(text=low.name, icon="OBJECT_DATA", translate=False)
    shown = viewer.map if viewer.map in maps else next(iter(maps))
    row.operator("imprint.show_map", text="", icon="IMAGE_DATA").image = maps[shown][0].image.name
    grid = layout.grid_flow(columns=2, even_columns=True, align=True)
    for name in maps:
        is_on = viewer.mode in {Mode.MAP, Mode.SPLIT, Mode.SIDES} and name == shown
        grid.operator("imprint.view_map", text=map_label(name), translate=False, depress=is_on).map = name


def _draw_settings(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """What the mode that is on can be set to."""
    view = context.scene.imprint_view
    is_normal = viewer.mode.is_deviation or viewer.map == NORMAL.name
    if is_normal and viewer.settings is not None and viewer.settings.map.space == Space.TANGENT:
        layout.prop(view, "target")
        draw_paragraphs(layout, context, _green_problem(view.target, viewer.settings), "INFO")
    if viewer.mode.is_deviation:
        layout.prop(view, "limit")
        lines = describe_deviations(viewer.deviations)
        draw_paragraphs(layout.box(), context, lines, "DRIVER_ROTATIONAL_DIFFERENCE")
        return
    layout.prop(view, "mask")
    layout.prop(view, "all_lows")
    if viewer.mode.has_high or is_normal:
        layout.prop(view, "light")
        if view.light is None:
            layout.prop(view, "direction")
    if viewer.mode is Mode.SPLIT:
        layout.prop(view, "split")


def _green_problem(name: str, settings: Settings) -> list[str]:
    """Why the program of this name shows the map with green upside down, in a sentence; empty if it does not."""
    target = targets.BY_NAME.get(name)
    stored = settings.map.green
    if target is None or stored == target.green:
        return []
    return [message(GREEN).format(target=target.label, wanted=target.green, stored=stored, preset=target.preset)]


CLASSES = (
    ImprintView,
    IMPRINT_OT_view_show,
    IMPRINT_OT_view_next,
    IMPRINT_OT_view_flicker,
    IMPRINT_OT_view_map,
    IMPRINT_OT_view_mask,
    IMPRINT_OT_view_refresh,
    IMPRINT_PT_view,
)
register, unregister = registering(
    CLASSES,
    properties={"Scene.imprint_view": PointerProperty(type=ImprintView)},
    keys=[
        Key(operator, key, "3D View", "VIEW_3D", ctrl=True, alt=True)
        for operator, key in ((IMPRINT_OT_view_next.bl_idname, "N"), (IMPRINT_OT_view_flicker.bl_idname, "H"))
    ],
)
