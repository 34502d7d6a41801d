# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel Maps: a list of all maps, and below each chosen one what it needs."""

from collections.abc import Collection, Iterable, Sequence

import bpy

from ..core.declarations.all_settings import DECLARED
from ..core.declarations.choices import Pack
from ..core.map_types import ATTRIBUTE, BY_NAME, OTHERS, Family
from ..output import datablocks
from . import bake_panel, declared_properties
from .properties import ImprintSettings
from .sidebar import SettingsPanel, split_layout
from .translations import label

GROUPS = {
    "rays": [one for one in Family if one.casts_rays],
    "materials": [one for one in Family if one.shows_materials],
    "geometry": (Family.POINTS,),
}
"""The groups of the list, and their families."""
INDENT = 2.0
"""The space before the settings of a map."""


class IMPRINT_PT_maps(SettingsPanel, bpy.types.Panel):
    """Which maps to bake, and what they need."""

    bl_idname = "IMPRINT_PT_maps"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Maps"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.scene.imprint
        layout.prop(settings, "normal")
        if settings.normal:
            row = layout.row()
            row.separator(factor=INDENT)
            row.prop(settings, "detail_maps")
        drawn = settings.to_settings().map.drawn_maps
        titles = {
            "rays": label("Occlusion and Curvature"),
            "materials": label("Materials and Attributes"),
            "geometry": label("Geometry"),
        }
        for group, families in GROUPS.items():
            names = [kind.name for kind in OTHERS if kind.family in families]
            header, body = layout.panel(f"imprint_maps_{group}")
            header.label(text=_title(titles[group], settings.maps & set(names)), translate=False)
            if body is not None:
                _draw_group(body, context, names, drawn)
        chosen = settings.chosen(context)
        if drawn and not bake_panel.bake_problem(context, chosen):
            _draw_names(layout.box(), bake_panel.planned_images(chosen.low, settings))


class IMPRINT_PT_packing(SettingsPanel, bpy.types.Panel):
    """What else happens with the maps: packed images, texture sets, attributes."""

    bl_idname = "IMPRINT_PT_packing"
    bl_parent_id = "IMPRINT_PT_maps"
    bl_label = "Packing and Attributes"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = split_layout(self.layout), context.scene.imprint
        column = layout.column(align=True)
        column.prop(settings, "pack")
        if settings.pack == Pack.CUSTOM:
            for name in ("pack_red", "pack_green", "pack_blue", "pack_alpha"):
                column.prop(settings, name)
        layout.prop(settings, "texture_sets")
        layout.prop(settings, "vertex_domain")
        layout.prop(settings, "connect_maps")


def _draw_names(layout: bpy.types.UILayout, images: Iterable[bake_panel.PlannedImage]) -> None:
    """The names of images in lines. Those that exist already have another icon than new ones."""
    column = layout.column(align=True)
    for image in images:
        icon = "FILE_REFRESH" if datablocks.get(image.name) else "IMAGE_DATA"
        column.label(text=image.title, icon=icon, translate=False)


def _title(text: str, chosen: Collection[str]) -> str:
    """The title of a group, with the number of its chosen maps: it may be closed."""
    return f"{text} ({len(chosen)})" if chosen else text


def _draw_group(
    layout: bpy.types.UILayout, context: bpy.types.Context, names: Sequence[str], drawn: Collection[str]
) -> None:
    """The switches of some maps, with their settings. drawn: all maps that the bake draws, also those that only the packed
    image stores."""
    if BY_NAME[names[0]].family.casts_rays:
        _draw_ray_maps(layout, context.scene.imprint, names, drawn)
        return
    grid = layout.grid_flow(row_major=True, columns=2, even_columns=True, align=True)
    for name in names:
        grid.prop(context.scene.imprint, declared_properties.map_switch(name))
    if ATTRIBUTE.name in names and ATTRIBUTE.name in drawn:
        _draw_attribute(_indented(layout), context)


def _draw_ray_maps(
    layout: bpy.types.UILayout, settings: ImprintSettings, names: Sequence[str], drawn: Collection[str]
) -> None:
    """As _draw_group. The settings of a family are below its last map that is drawn, and those of all families at the end."""
    column = layout.column(align=True)
    last = {BY_NAME[name].family: name for name in names if name in drawn}
    for name in names:
        column.prop(settings, declared_properties.map_switch(name))
        if name in last.values():
            _draw_settings(_indented(column), settings, BY_NAME[name].family)
    if last:
        _indented(column).prop(settings, "rays")


def _draw_settings(layout: bpy.types.UILayout, settings: ImprintSettings, family: Family) -> None:
    """What the maps of a family need."""
    if family is Family.THICKNESS:
        _draw_reach(layout, settings, "thickness_distance", label("Distance"))
    elif family is Family.CURVATURE:
        _draw_reach(layout, settings, "curvature_radius", label("Radius"))
    else:
        _draw_reach(layout, settings, "ao_distance", label("Distance"))
        if settings.ao_limited:
            layout.prop(settings, "ao_fade")
        layout.prop(settings, "bias_angle")
        layout.prop(settings, "occluders")
        layout.prop(settings, "floor")
        layout.prop(settings, "two_sided")
    layout.separator()


def _draw_reach(layout: bpy.types.UILayout, settings: ImprintSettings, reach: str, title: str) -> None:
    """A distance behind its switch, and its unit. title: short, since the map is named above."""
    limited = DECLARED[reach].switch
    column = layout.column(align=True)
    row = column.row(align=True, heading=title, translate=False)
    row.prop(settings, limited, text="")
    value = row.row(align=True)
    value.active = getattr(settings, limited)
    value.prop(settings, settings.shown(reach), text="")
    if value.active:
        column.prop(settings, "distance_unit")


def _draw_attribute(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The name of an attribute, to choose from those of the first high mesh."""
    settings = context.scene.imprint
    mesh = next((high.data for high in settings.chosen(context).highs if high.type == "MESH"), None)
    if mesh is None:
        layout.prop(settings, "attribute")
    else:
        layout.prop_search(settings, "attribute", mesh, "attributes")


def _indented(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """A column for what belongs to the line above."""
    row = layout.row()
    row.separator(factor=INDENT)
    return split_layout(row.column())


CLASSES = (IMPRINT_PT_maps, IMPRINT_PT_packing)
