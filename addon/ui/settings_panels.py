# SPDX-License-Identifier: GPL-3.0-or-later
"""The panels of the settings, with their operators: map, channels, maps, packing, output, rays."""

from collections.abc import Collection, Sequence

import bpy

from ..core import file_formats
from ..core.declarations.all_settings import DECLARED
from ..core.declarations.choices import Format, Method, Pack, Space, Storage, Wrap
from ..core.declarations.map_settings import ADAPTIVE_FROM
from ..core.map_types import ATTRIBUTE, BY_NAME, OTHERS, VECTOR_DISPLACEMENT, Family
from ..core.report import Report
from ..jobs import weights
from ..scene import object_checks
from ..scene.high_materials import materials_of
from . import bake_panel, declared_properties, results
from .cage_overlay import overlay
from .modal import QuickOperator
from .planned_images import count_images, draw_images, planned_images
from .progress_display import SettingsPanel, display
from .results import distances
from .setting_rows import Rows
from .texts import draw_paragraphs, draw_props, font_size, label, message, room, split_layout, text_width, tooltip


class IMPRINT_PT_map(SettingsPanel, bpy.types.Panel):
    """Settings of the map."""

    bl_idname = "IMPRINT_PT_map"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Map"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        layout, rows = split_layout(layout), Rows(context)
        low = rows.chosen.low
        rows.prop(layout, "method", "space")
        if low is not None and low.type == "MESH":
            rows.search(layout, "uv_layer", low.data, "uv_layers", icon="GROUP_UVS")
        row = layout.row()
        row.active = _is_adaptive(rows)
        rows.prop(row, "adaptive")
        column = layout.column(align=True)
        rows.prop(column, "wrap")
        row = column.row(align=True)
        row.active = rows["wrap"] == Wrap.NONE
        rows.prop(row, "margin_type")
        row = column.row(align=True)
        row.active = not rows["unlimited"]
        rows.prop(row, "margin")
        rows.prop(column, "unlimited", "mips")
        rows.prop(layout, "stacked", "modifiers", "rest_pose", "keep_faces", "cut_outs", "smooth_high")
        column = layout.column(align=True)
        rows.prop(column, "limited")
        if rows["limited"]:
            rows.prop(column, "limit")


def _is_adaptive(rows: Rows) -> bool:
    """Whether a bake can take samples where they are needed alone."""
    turns_normals = rows["edge_radius"] or (rows["detail_maps"] and _have_normal_maps(rows.chosen.highs))
    is_cast = rows["method"] != Method.FLATTEN and int(rows["samples"]) >= ADAPTIVE_FROM
    return is_cast and not (rows.settings.map.drawn_maps or turns_normals)


def _have_normal_maps(highs: Sequence[bpy.types.Object]) -> bool:
    """Whether a material of the high objects has nodes for a normal or bump map, which a bake may follow."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    materials = (material for high in highs for material in materials_of(high.evaluated_get(depsgraph)) if material)
    trees = [material.node_tree for material in materials if material.node_tree is not None]
    return any(node.bl_idname in {"ShaderNodeNormalMap", "ShaderNodeBump"} for tree in trees for node in tree.nodes)


GROUPS = {
    "rays": [one for one in Family if one.casts_rays],
    "materials": [one for one in Family if one.shows_materials],
    "geometry": [one for one in Family if not (one.casts_rays or one.shows_materials or one is Family.NORMAL)],
}
"""The groups of the list, and their families."""
RARE = ("WIDENED_ROUGHNESS", "COAT", "SHEEN", "DISPLACEMENT")
"""The maps of More Settings, which few bakes need."""
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
        layout, rows = self.layout, Rows(context)
        layout.enabled = display.current is None  # a column could not hold the panels of the groups
        rows.prop(layout, "normal")
        if rows["normal"]:
            row = layout.row()
            row.separator(factor=INDENT)
            rows.prop(row.column(align=True), "detail_maps", "edge_radius")
        titles = {
            "rays": label("Occlusion and Curvature"),
            "materials": label("Materials and Attributes"),
            "geometry": label("Geometry"),
        }
        if rows.set is not None:  # the switches of the maps are one setting
            row = layout.row(align=True)
            row.label(text=label(DECLARED["maps"].label), translate=False)
            rows.pin(row, "maps")
        for group, names in groups().items():
            header, body = layout.panel(f"imprint_maps_{group}", default_closed=group != "rays")
            header.label(text=_title(titles[group], rows["maps"] & set(names)), translate=False)
            if body is not None:
                draw_group(body, context, rows, names)
        chosen = rows.chosen
        if rows.set is None and rows.settings.map.drawn_maps and not bake_panel.bake_problem(context, chosen):
            header, body = layout.panel("imprint_images", default_closed=True)
            header.label(text=count_images(chosen.low, rows.settings), translate=False)
            if body is not None:
                draw_images(body, planned_images(chosen.low, rows.settings))


def groups() -> dict[str, list[str]]:
    """The names of the maps of each group, without those of RARE."""
    return {
        group: [kind.name for kind in OTHERS if kind.family in families and kind.name not in RARE]
        for group, families in GROUPS.items()
    }


def _title(text: str, chosen: Collection[str]) -> str:
    """The title of a group, with the number of its chosen maps: it may be closed."""
    return f"{text} ({len(chosen)})" if chosen else text


def draw_group(layout: bpy.types.UILayout, context: bpy.types.Context, rows: Rows, names: Sequence[str]) -> None:
    """The switches of some maps, with the settings of those that are drawn, also where only the packed image stores them."""
    columns, widths = _two_columns(names, names[::2])
    if sum(widths) > room(context):  # long names beside short ones
        longest = sorted(names, key=_switch_width, reverse=True)[: len(columns[0])]
        columns, widths = _two_columns(names, longest)
    split = layout.split(factor=widths[0] / sum(widths), align=True)  # long names are cut off in columns of even widths
    owner = rows.owner("maps")
    for each in columns:
        column = split.column(align=True)
        for name in each:
            column.prop(owner, declared_properties.map_switch(name))
    drawn = [name for name in names if name in rows.settings.map.drawn_maps]
    if packed := [label(BY_NAME[name].label) for name in drawn if name not in rows["maps"]]:
        draw_paragraphs(layout, context, [message("In the packed image: {}").format(", ".join(packed))], "INFO")
    if any(BY_NAME[name].family.casts_rays for name in drawn):
        _draw_ray_settings(layout, rows, drawn)
    for own in (BY_NAME[name] for name in drawn if BY_NAME[name].settings):
        column = _indented(layout)
        column.active = own is not VECTOR_DISPLACEMENT or rows["space"] == Space.TANGENT
        rows.prop(column, *own.settings)
    if ATTRIBUTE.name in drawn:
        _draw_attribute(_indented(layout), rows)


def _two_columns(names: Sequence[str], left: Collection[str]) -> tuple[list[list[str]], list[float]]:
    """The names that are on the left, and the others; and how wide their switches are, in pixels at a scale of 1."""
    columns = [[name for name in names if (name in left) == is_left] for is_left in (True, False)]
    return columns, [max(map(_switch_width, column)) for column in columns]


def _switch_width(name: str) -> float:
    """The width of the switch of a map, in pixels at a scale of 1."""
    return CHECK_BOX + text_width(label(BY_NAME[name].label), font_size(1.0))


def _draw_ray_settings(layout: bpy.types.UILayout, rows: Rows, drawn: Sequence[str]) -> None:
    """The settings of each family of these maps, and at the end that of all families."""
    column = layout.column(align=True)
    for family in dict.fromkeys(BY_NAME[name].family for name in drawn):
        _draw_settings(_indented(column), rows, family)
    rows.prop(_indented(column), "rays")


def _draw_settings(layout: bpy.types.UILayout, rows: Rows, family: Family) -> None:
    """What the maps of a family need."""
    if family is Family.THICKNESS:
        _draw_reach(layout, rows, "thickness_distance", label("Thickness"))
    elif family is Family.CURVATURE:
        _draw_reach(layout, rows, "curvature_radius", label("Curvature"))
    else:
        _draw_reach(layout, rows, "ao_distance", label(DECLARED["ao_distance"].label))
        if rows["ao_limited"]:
            rows.prop(layout, "ao_fade")
        rows.prop(layout, "occluders", "two_sided")
        for obj in _may_float(rows):  # a mark of the object, beside the settings
            row = layout.row()
            row.enabled = obj.is_editable
            text = f"{label('Floater')}: {obj.name}"
            row.prop(obj, "imprint_is_floater", text=text, translate=False)
    layout.separator()


MOST_FLOATERS = 4
"""The high objects of a part that the panel lists."""


def _may_float(rows: Rows) -> list[bpy.types.Object]:
    """The objects whose mark the panel shows: high ones of the active part of the set, or else the active object."""
    if rows.set is not None:
        return [high for high in rows.chosen.highs if high != rows.chosen.low][:MOST_FLOATERS]
    obj = bpy.context.active_object
    return [obj] if obj is not None and object_checks.may_show(obj) else []


def _draw_reach(layout: bpy.types.UILayout, rows: Rows, reach: str, title: str) -> None:
    """A distance behind its switch, and its unit. title: short, since the line is indented."""
    column = layout.column(align=True)
    if _draw_switched(column, rows, reach, title):
        rows.prop(column, "distance_unit")


def _draw_switched(layout: bpy.types.UILayout, rows: Rows, name: str, title: str) -> bool:
    """A number behind its switch. Returns whether that is on."""
    switch = DECLARED[name].switch
    row = layout.row(align=True, heading=title, translate=False)
    row.prop(rows.owner(switch), switch, text="")
    value = row.row(align=True)
    value.active = rows[switch]
    value.prop(rows.owner(name), rows.shown(name) if name in declared_properties.REACHES else name, text="")
    rows.pin(row, name)
    return value.active


def _draw_attribute(layout: bpy.types.UILayout, rows: Rows) -> None:
    """The name of an attribute, to choose from those of the first high mesh."""
    mesh = next((high.data for high in rows.chosen.highs if high.type == "MESH"), None)
    if mesh is None:
        rows.prop(layout, "attribute")
    else:
        rows.search(layout, "attribute", mesh, "attributes")


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
        layout, rows = split_layout(layout), Rows(context)
        column = layout.column(align=True)
        rows.prop(column, "pack")
        if rows["pack"] == Pack.CUSTOM:
            rows.prop(column, "pack_red", "pack_green", "pack_blue", "pack_alpha")
        if rows.set is None:  # Textures of the set say it
            rows.prop(layout, "texture_sets")
        rows.prop(layout, "vertex_domain", "connect_maps")


class IMPRINT_PT_output(SettingsPanel, bpy.types.Panel):
    """Where the map is stored."""

    bl_idname = "IMPRINT_PT_output"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Output"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        layout, rows = split_layout(layout), Rows(context)
        # A name for a new image is not among those that exist, and a search field would be red.
        rows.search(layout, "image", bpy.data, "images", results_are_suggestions=True)
        rows.prop(layout, "depth", expand=True)
        rows.prop(layout, "udim")
        if rows["udim"]:
            rows.prop(layout, "tiles")
        rows.prop(layout, "storage")
        file_format = file_formats.known(rows["output"]) if rows["storage"] == Storage.FILE else None
        if rows["storage"] == Storage.FILE:
            is_blocks = file_format is not None and file_format.is_blocks
            rows.prop(layout, "output", "alpha", "format")
            if rows["format"] == Format.AUTO:
                rows.prop(layout, "most_degrees", "most_steps")
            elif is_blocks:
                rows.prop(layout, "compression")
            if not is_blocks:
                rows.prop(layout, "mip_files")
        is_glb = rows["export"].lower().endswith(file_formats.MESHES[0])
        has_quality = file_format is not None and file_format.has_quality and rows["format"] != Format.AUTO
        if has_quality or (is_glb and (rows["export_webp"] or rows["export_ktx2"])):
            rows.prop(layout, "quality", "lossy_normals")
        rows.prop(layout, "material")
        row = layout.row()
        row.enabled = rows["material"]
        rows.prop(row, "single_user")
        rows.prop(layout, "one_material")
        layout.prop(context.scene.imprint, "show_result")
        rows.prop(layout, "export")
        if is_glb:
            rows.prop(layout, "export_webp", "export_ktx2")


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
        rows = Rows(context)
        for name, value in {**distances(results.of(context)), "measure": False}.items():
            setattr(rows.owner(name), name, value)
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
        return Rows(context)["method"] != Method.FLATTEN

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        layout, rows = split_layout(layout), Rows(context)
        low, measured = rows.chosen.low, context.window_manager.imprint_found
        rows.prop(layout, "hit")
        if rows.set is None:  # a part of a set has its cage in the list of parts
            rows.prop(layout, "cage")
        rows.prop(layout, "measure")
        column = layout.column(align=True)
        if rows["measure"]:
            column.enabled = False
            draw_props(column, measured, "extrusion", "max_distance")
            layout.operator("imprint.freeze_distances", icon="FREEZE")
        else:
            rows.prop(column, "extrusion", "max_distance")
        layout.operator("imprint.show_cage", icon="MESH_UVSPHERE", depress=overlay.is_on)
        rows.prop(layout, "directions")
        if low is not None and low.type == "MESH":
            rows.search(layout, "offset_group", low, "vertex_groups", icon="GROUP_VERTEX")
            layout.operator("imprint.propose_weights", icon="MOD_VERTEX_WEIGHT")
        rows.prop(layout, "missed", "mask")


class IMPRINT_PT_more_settings(SettingsPanel, bpy.types.Panel):
    """What few bakes need: an engine sets it, or its default fits."""

    bl_idname = "IMPRINT_PT_more_settings"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "More Settings"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        rows = Rows(context)
        draw_group(layout, context, rows, RARE)
        layout = split_layout(layout)
        is_tangent = rows["space"] == Space.TANGENT
        column = layout.column(align=True)
        column.active = is_tangent
        rows.prop(column, "basis")
        rows.prop(layout.column(align=True), "red", "green", "blue")
        rows.prop(layout, "appearance", "exact_materials", "bias_angle", "floor", "facing_only")
        low = rows.chosen.low
        if low is not None and low.type == "MESH":
            rows.search(layout, "straight_group", low, "vertex_groups", icon="GROUP_VERTEX")
        row = layout.row()
        row.active = rows["depth"] == "8"
        rows.prop(row, "dither")
        _draw_switched(layout, rows, "value_range", label("Set Range"))
        column = layout.column(align=True)
        column.active = is_tangent
        rows.prop(column, "targets")


# Blender draws them in the order of registration.
CLASSES = (
    IMPRINT_OT_freeze_distances,
    IMPRINT_OT_propose_weights,
    IMPRINT_PT_maps,
    IMPRINT_PT_packing,
    IMPRINT_PT_map,
    IMPRINT_PT_rays,
    IMPRINT_PT_output,
    IMPRINT_PT_more_settings,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
