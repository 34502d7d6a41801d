# SPDX-License-Identifier: GPL-3.0-or-later
"""The panels of the settings, with their operators: map, channels, maps, packing, output, rays."""

from collections.abc import Collection, Iterable, Sequence

import bpy

from ..core.declarations.all_settings import DECLARED
from ..core.declarations.choices import Method, Pack, Space, Storage, Wrap
from ..core.declarations.map_settings import ADAPTIVE_FROM
from ..core.map_types import ATTRIBUTE, BY_NAME, OTHERS, VECTOR_DISPLACEMENT, Family
from ..core.report import Report
from ..jobs import weights
from ..output import datablocks
from ..scene.high_materials import materials_of
from . import bake_panel, declared_properties, results
from .cage_overlay import overlay
from .modal import QuickOperator
from .progress_display import SettingsPanel, display
from .properties import ImprintSettings
from .results import distances
from .texts import draw_props, font_size, label, room, split_layout, text_width, tooltip


class IMPRINT_PT_map(SettingsPanel, bpy.types.Panel):
    """Settings of the map."""

    bl_idname = "IMPRINT_PT_map"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Map"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        layout = split_layout(layout)
        settings = context.scene.imprint
        chosen = settings.chosen(context)
        low, rays = chosen.low, chosen.rays
        layout.prop(rays, "method")
        layout.prop(settings, "space")
        if settings.space == Space.TANGENT:
            layout.prop(settings, "basis")
        if low is not None and low.type == "MESH":
            layout.prop_search(settings, "uv_layer", low.data, "uv_layers", icon="GROUP_UVS")
        row = layout.row()
        turns_normals = settings.edge_radius or (settings.detail_maps and _have_normal_maps(chosen.highs))
        shares_samples = chosen.settings.map.drawn_maps or turns_normals
        row.active = rays.method != Method.FLATTEN and int(settings.samples) >= ADAPTIVE_FROM and not shares_samples
        row.prop(settings, "adaptive")
        column = layout.column(align=True)
        column.prop(settings, "wrap")
        row = column.row(align=True)
        row.active = settings.wrap == Wrap.NONE
        row.prop(settings, "margin_type")
        row = column.row(align=True)
        row.active = not settings.unlimited
        row.prop(settings, "margin")
        draw_props(column, settings, "unlimited", "mips")
        draw_props(layout, settings, "stacked", "modifiers", "rest_pose", "keep_faces", "cut_outs", "smooth_high")
        column = layout.column(align=True)
        column.prop(settings, "limited")
        if settings.limited:
            column.prop(settings, "limit")


def _have_normal_maps(highs: Sequence[bpy.types.Object]) -> bool:
    """Whether a material of the high objects has nodes for a normal or bump map, which a bake may follow."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    materials = (material for high in highs for material in materials_of(high.evaluated_get(depsgraph)) if material)
    trees = [material.node_tree for material in materials if material.node_tree is not None]
    return any(node.bl_idname in {"ShaderNodeNormalMap", "ShaderNodeBump"} for tree in trees for node in tree.nodes)


class IMPRINT_PT_channels(SettingsPanel, bpy.types.Panel):
    """The content of each channel. The setting Engine sets it."""

    bl_idname = "IMPRINT_PT_channels"
    bl_parent_id = "IMPRINT_PT_map"
    bl_label = "Channels"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        layout = split_layout(layout)
        draw_props(layout.column(align=True), context.scene.imprint, "red", "green", "blue")


class IMPRINT_PT_targets(SettingsPanel, bpy.types.Panel):
    """The programs for which the report says how far off they are."""

    bl_idname = "IMPRINT_PT_targets"
    bl_parent_id = "IMPRINT_PT_map"
    bl_label = "Target Engines"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        settings = context.scene.imprint
        column = layout.column(align=True)
        column.active = settings.space == Space.TANGENT
        column.prop(settings, "targets")


GROUPS = {
    "rays": [one for one in Family if one.casts_rays],
    "materials": [one for one in Family if one.shows_materials],
    "geometry": [one for one in Family if not (one.casts_rays or one.shows_materials or one is Family.NORMAL)],
}
"""The groups of the list, and their families."""
CHECK_BOX = 28.0
"""The width of a check box and of the margins beside its name, in pixels at a scale of 1."""
INDENT = 2.0
"""The space before the settings of a map."""


class IMPRINT_PT_maps(SettingsPanel, bpy.types.Panel):
    """Which maps to bake, and what they need."""

    bl_idname = "IMPRINT_PT_maps"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Maps"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.scene.imprint
        layout.enabled = display.current is None  # a column could not hold the panels of the groups
        layout.prop(settings, "normal")
        if settings.normal:
            row = layout.row()
            row.separator(factor=INDENT)
            column = row.column(align=True)
            draw_props(column, settings, "detail_maps", "edge_radius", "appearance")
        chosen = settings.chosen(context)
        drawn = chosen.settings.map.drawn_maps
        titles = {
            "rays": label("Occlusion and Curvature"),
            "materials": label("Materials and Attributes"),
            "geometry": label("Geometry"),
        }
        for group, families in GROUPS.items():
            names = [kind.name for kind in OTHERS if kind.family in families]
            header, body = layout.panel(f"imprint_maps_{group}", default_closed=group != "rays")
            header.label(text=_title(titles[group], settings.maps & set(names)), translate=False)
            if body is not None:
                draw_group(body, context, names, drawn)
        if drawn and not bake_panel.bake_problem(context, chosen):
            header, body = layout.panel("imprint_images", default_closed=True)
            header.label(text=bake_panel.count_images(chosen.low, chosen.settings), translate=False)
            if body is not None:
                _draw_names(body, bake_panel.planned_images(chosen.low, chosen.settings))


def _draw_names(layout: bpy.types.UILayout, images: Iterable[bake_panel.PlannedImage]) -> None:
    """The names of images in lines. Those that exist already have another icon than new ones."""
    column = layout.column(align=True)
    for image in images:
        icon = "FILE_REFRESH" if datablocks.get(image.name) else "IMAGE_DATA"
        column.label(text=image.title, icon=icon, translate=False)


def _title(text: str, chosen: Collection[str]) -> str:
    """The title of a group, with the number of its chosen maps: it may be closed."""
    return f"{text} ({len(chosen)})" if chosen else text


def draw_group(
    layout: bpy.types.UILayout, context: bpy.types.Context, names: Sequence[str], drawn: Collection[str]
) -> None:
    """The switches of some maps, with their settings. drawn: all maps that the bake draws, also those that only the packed
    image stores."""
    columns, widths = _two_columns(names, names[::2])
    if sum(widths) > room(context):  # long names beside short ones
        longest = sorted(names, key=_switch_width, reverse=True)[: len(columns[0])]
        columns, widths = _two_columns(names, longest)
    split = layout.split(factor=widths[0] / sum(widths), align=True)  # long names are cut off in columns of even widths
    for each in columns:
        column = split.column(align=True)
        for name in each:
            column.prop(context.scene.imprint, declared_properties.map_switch(name))
    if BY_NAME[names[0]].family.casts_rays:
        _draw_ray_settings(layout, context.scene.imprint, [name for name in names if name in drawn])
    if any(BY_NAME[name].socket for name in names if name in drawn):
        split_layout(layout.column()).prop(context.scene.imprint, "exact_materials")
    for own in (BY_NAME[name] for name in names if name in drawn and BY_NAME[name].settings):
        column = _indented(layout)
        column.active = own is not VECTOR_DISPLACEMENT or context.scene.imprint.space == Space.TANGENT
        draw_props(column, context.scene.imprint, *own.settings)
    if ATTRIBUTE.name in names and ATTRIBUTE.name in drawn:
        _draw_attribute(_indented(layout), context)


def _two_columns(names: Sequence[str], left: Collection[str]) -> tuple[list[list[str]], list[float]]:
    """The names that are on the left, and the others; and how wide their switches are, in pixels at a scale of 1."""
    columns = [[name for name in names if (name in left) == is_left] for is_left in (True, False)]
    return columns, [max(map(_switch_width, column)) for column in columns]


def _switch_width(name: str) -> float:
    """The width of the switch of a map, in pixels at a scale of 1."""
    return CHECK_BOX + text_width(label(BY_NAME[name].label), font_size(1.0))


def _draw_ray_settings(layout: bpy.types.UILayout, settings: ImprintSettings, drawn: Sequence[str]) -> None:
    """The settings of each family of these maps, and at the end that of all families."""
    column = layout.column(align=True)
    for family in dict.fromkeys(BY_NAME[name].family for name in drawn):
        _draw_settings(_indented(column), settings, family)
    if drawn:
        _indented(column).prop(settings, "rays")


def _draw_settings(layout: bpy.types.UILayout, settings: ImprintSettings, family: Family) -> None:
    """What the maps of a family need."""
    if family is Family.THICKNESS:
        _draw_reach(layout, settings, "thickness_distance", label("Thickness"))
    elif family is Family.CURVATURE:
        _draw_reach(layout, settings, "curvature_radius", label("Curvature"))
    else:
        _draw_reach(layout, settings, "ao_distance", label(DECLARED["ao_distance"].label))
        if settings.ao_limited:
            layout.prop(settings, "ao_fade")
        draw_props(layout, settings, "bias_angle", "occluders", "floor", "two_sided")
    layout.separator()


def _draw_reach(layout: bpy.types.UILayout, settings: ImprintSettings, reach: str, title: str) -> None:
    """A distance behind its switch, and its unit. title: short, since the line is indented."""
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


class IMPRINT_PT_packing(SettingsPanel, bpy.types.Panel):
    """What else happens with the maps: packed images, texture sets, attributes."""

    bl_idname = "IMPRINT_PT_packing"
    bl_parent_id = "IMPRINT_PT_maps"
    bl_label = "Packing and Attributes"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        layout, settings = split_layout(layout), context.scene.imprint
        column = layout.column(align=True)
        column.prop(settings, "pack")
        if settings.pack == Pack.CUSTOM:
            draw_props(column, settings, "pack_red", "pack_green", "pack_blue", "pack_alpha")
        draw_props(layout, settings, "texture_sets", "vertex_domain", "connect_maps")


class IMPRINT_PT_output(SettingsPanel, bpy.types.Panel):
    """Where the map is stored."""

    bl_idname = "IMPRINT_PT_output"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Output"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        layout = split_layout(layout)
        settings = context.scene.imprint
        # A name for a new image is not among those that exist, and a search field would be red.
        layout.prop_search(settings, "image", bpy.data, "images", results_are_suggestions=True)
        layout.prop(settings, "depth", expand=True)
        if settings.depth == "8":
            layout.prop(settings, "dither")
        row = layout.row(align=True, heading=label("Set Range"), translate=False)
        row.prop(settings, "range_limited", text="")
        value = row.row(align=True)
        value.active = settings.range_limited
        value.prop(settings, "value_range", text="")
        layout.prop(settings, "udim")
        if settings.udim:
            layout.prop(settings, "tiles")
        layout.prop(settings, "storage")
        if settings.storage == Storage.FILE:
            draw_props(layout, settings, "output", "alpha", "mip_files")
        layout.prop(settings, "material")
        row = layout.row()
        row.enabled = settings.material
        row.prop(settings, "single_user")
        draw_props(layout, settings, "one_material", "show_result", "export")


class IMPRINT_OT_freeze_distances(bpy.types.Operator):
    """Set Extrusion and Max Distance to what the last bake of this low object measured"""

    bl_idname = "imprint.freeze_distances"
    bl_label = "Freeze Distances"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not distances(results.of(context)):
            cls.poll_message_set(tooltip("Bake this low object first, with Measure Distances on"))
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        rays, measured = context.scene.imprint.chosen(context).rays, distances(results.of(context))
        rays.extrusion, rays.max_distance = measured["extrusion"], measured["max_distance"]
        rays.measure = False
        return {"FINISHED"}


class IMPRINT_OT_propose_weights(QuickOperator, bpy.types.Operator):
    """Fill both groups with weights that leave fewer doubtful texels than the last bake had, and with 0.5 elsewhere"""

    bl_idname = "imprint.propose_weights"
    bl_label = "Propose Weights"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = _weights_problem(results.of(context))
        if problem:
            cls.poll_message_set(tooltip(problem))
        return not problem and display.current is None

    def apply(self, context: bpy.types.Context) -> str:
        report, settings = results.of(context), context.scene.imprint
        groups = {name: getattr(settings, name) for name in weights.GROUP_NAMES}
        proposal = weights.propose(context, report, groups)
        for name, group in weights.apply(report.refs[0].resolve(), proposal, groups).items():
            setattr(settings, name, group)
        share = f"{proposal.before:.2%} of the texels are doubtful"
        if proposal.after < proposal.before:
            return f"{share}, with the proposed weights {proposal.after:.2%}"
        return f"{share}, and other weights are no better: the groups are ready to be painted"


def _weights_problem(report: Report | None) -> str:
    """Why no weights can be proposed, without a full stop; empty if they can. report: of the last bake."""
    if report is None:
        return "Bake this low object first"
    low = report.refs[0].find()
    if report.method != Method.CAST:
        return "The last bake cast no rays"
    if low.mode == "EDIT":
        return "Leave Edit Mode first"
    return "" if low.is_editable and low.data.is_editable else "The low object is linked from another file"


class IMPRINT_PT_rays(SettingsPanel, bpy.types.Panel):
    """Where rays start and end."""

    bl_idname = "IMPRINT_PT_rays"
    bl_parent_id = "IMPRINT_PT_map"
    bl_label = "Rays"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.scene.imprint.chosen(context).rays.method != Method.FLATTEN

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        layout = split_layout(layout)
        settings = context.scene.imprint
        chosen = settings.chosen(context)
        low, rays = chosen.low, chosen.rays
        measured = context.window_manager.imprint_found
        layout.prop(settings, "hit")
        draw_props(layout, rays, "cage", "measure")
        column = layout.column(align=True)
        if rays.measure:
            column.enabled = False
            draw_props(column, measured, "extrusion", "max_distance")
            layout.operator("imprint.freeze_distances", icon="FREEZE")
        else:
            draw_props(column, rays, "extrusion", "max_distance")
        layout.operator("imprint.show_cage", icon="MESH_UVSPHERE", depress=overlay.is_on)
        layout.prop(settings, "directions")
        if low is not None and low.type == "MESH":
            for name in ("offset_group", "straight_group"):
                layout.prop_search(settings, name, low, "vertex_groups", icon="GROUP_VERTEX")
            layout.operator("imprint.propose_weights", icon="MOD_VERTEX_WEIGHT")
        draw_props(layout, settings, "facing_only", "missed", "mask")


# Blender draws them in the order of registration.
CLASSES = (
    IMPRINT_OT_freeze_distances,
    IMPRINT_OT_propose_weights,
    IMPRINT_PT_maps,
    IMPRINT_PT_packing,
    IMPRINT_PT_map,
    IMPRINT_PT_rays,
    IMPRINT_PT_channels,
    IMPRINT_PT_targets,
    IMPRINT_PT_output,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
