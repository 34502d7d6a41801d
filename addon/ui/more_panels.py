# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel More, with what is needed now and then: levels of detail, game assets, conversions and sequences."""

from dataclasses import fields

import bpy
from bpy.props import IntProperty

from ..core import levels
from ..core.asset_limits import AUTO, Mending, Wanted
from ..core.declarations.choices import Space, Storage
from ..core.errors import BakeError
from ..core.levels import ChainReport
from ..core.progress import Pace, Task
from ..core.report import Report
from ..core.stored_normals import ConversionReport, StoredNormals
from ..export import engine_files
from ..jobs import asset, convert, lod
from ..jobs.convert import Conversion
from ..jobs.job import Job, Wants
from ..jobs.sequence import work_on_frames
from ..scene import object_checks
from . import modal, object_pairs
from .bake_operators import BakeOperator, OnePairOperator
from .progress_display import SettingsPanel, display
from .properties import Chosen
from .texts import SidebarPanel, draw_paragraphs, draw_props, label, labeled, message, split_layout


class IMPRINT_PT_more(SidebarPanel, bpy.types.Panel):
    """What is needed now and then."""

    bl_idname = "IMPRINT_PT_more"
    bl_label = "More"
    bl_order = 2
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, _context: bpy.types.Context) -> None:
        """The panels in it draw the rest."""


class IMPRINT_OT_make_levels(modal.MapOperator, bpy.types.Operator):
    """Make coarser copies of the active mesh with the same UV layout, each with its own map, as coarse as the limits allow"""

    bl_idname = "imprint.make_levels"
    bl_label = "Make Levels of Detail"
    bl_options = {"REGISTER", "UNDO"}

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[ChainReport]:
        settings = context.scene.imprint
        if context.active_object is None:
            raise BakeError("No object is active: select the mesh to make levels of.")
        limits = levels.limits(settings.level_degrees, settings.level_distance, settings.level_triangles)
        if settings.export:
            engine_files.check_levels(settings.export, len(limits))
        return (yield from lod.work(context, context.active_object, limits, settings.to_settings(), pace))

    def finish(self, context: bpy.types.Context, result: ChainReport) -> None:
        lines, warnings = result.summary(), list(result.warnings)
        if context.scene.imprint.export:
            try:
                done = engine_files.export_levels(
                    context, [level.bake for level in result.levels], context.scene.imprint.export
                )
            except BakeError as error:  # the levels are made
                warnings.append(str(error))
            else:
                warnings += dict.fromkeys(text for each in done for text in each.warnings)
                paths = dict.fromkeys(path for each in done for path in each.paths)
                lines.append(f"Wrote {', '.join(paths)}")
        if context.scene.imprint.level_beside:  # after the export, where all levels have one place
            lod.put_beside(context, result)
        self.show(context, lines, warnings)


class IMPRINT_PT_levels(SettingsPanel, bpy.types.Panel):
    """Makes coarser meshes with the UV layout of the active one."""

    bl_idname = "IMPRINT_PT_levels"
    bl_parent_id = "IMPRINT_PT_more"
    bl_label = "Levels of Detail"

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        column, settings = split_layout(layout.column()), context.scene.imprint
        column.prop(settings, "level_triangles")
        by_deviation = column.column()
        by_deviation.active = not settings.level_triangles.strip()
        draw_props(by_deviation, settings, "level_degrees", "level_distance")
        draw_props(column, settings, "level_beside", "export")

    def draw_button(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        display.draw_operator(layout, "imprint.make_levels", icon="MOD_DECIM")


class IMPRINT_OT_make_asset(BakeOperator, bpy.types.Operator):
    """Make a low mesh with a UV map of the selected objects, and bake all chosen maps for it"""

    bl_idname = "imprint.make_asset"
    bl_label = "Make Game Asset"
    bl_options = {"REGISTER", "UNDO"}

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[list[Report]]:
        settings, suffixes = context.scene.imprint, context.scene.imprint.suffixes()
        wanted = Wanted.of_texts(
            settings.asset_degrees,
            settings.asset_triangles,
            AUTO if settings.asset_fits_size else "",
            settings.asset_distance,
            settings.asset_levels,
            is_count_given=settings.is_property_set("asset_triangles"),
            mending=Mending.of_texts(settings.asset_crumbs, settings.asset_holes, settings.asset_symmetry),
            owns_textures=settings.asset_own_textures,
            keeps=settings.asset_keeps,
            stacks_mirrored=settings.asset_stack_mirrored,
            quads=settings.asset_quads,
            density_group=settings.asset_density_group,
        )
        active, highs = context.active_object, list(context.selected_objects)
        if active is not None and active.select_get():
            highs = [active, *(obj for obj in highs if obj != active)]
        if not highs:
            raise BakeError("No object is selected: select the high-poly objects to make an asset of.")
        highs = highs if wanted.keeps else asset.highs_of(context, highs, suffixes)
        low = None if wanted.keeps else asset.known_low(context, highs, suffixes)
        job = Job(low or highs[0], highs)
        if settings.export:
            engine_files.check_levels(settings.export, 1 + wanted.levels)
        wants = Wants(exported=bool(settings.export))
        values = settings.to_settings()
        return (yield from asset.work(context, job, wanted, values, pace, suffixes=suffixes, wants=wants))

    def finish(self, context: bpy.types.Context, result: list[Report]) -> None:
        path = context.scene.imprint.export
        if path:
            try:
                done = engine_files.export_levels(context, result, path)
            except BakeError as error:  # the asset is made
                result = [report.with_warnings([str(error)]) for report in result]
            else:
                pairs = zip(result, done, strict=True)
                result = [report.with_export(one.to_dict()).with_warnings(one.warnings) for report, one in pairs]
        super().finish(context, result)
        low = context.view_layer.objects.get(result[0].low)
        if low is not None:
            for obj in list(context.selected_objects):
                obj.select_set(False)
            low.select_set(True)
            context.view_layer.objects.active = low


class IMPRINT_PT_asset(SettingsPanel, bpy.types.Panel):
    """Makes a game asset of high objects that have no low one."""

    bl_idname = "IMPRINT_PT_asset"
    bl_parent_id = "IMPRINT_PT_more"
    bl_label = "Game Asset"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        names = "asset_keeps", "asset_triangles", "asset_degrees", "asset_distance"
        names += "asset_quads", "asset_symmetry", "asset_crumbs", "asset_holes", "asset_fits_size", "asset_levels"
        names += "asset_own_textures", "asset_stack_mirrored"
        column, settings, active = split_layout(layout.column()), context.scene.imprint, context.active_object
        draw_props(column, settings, *names)
        if active is not None and active.type == "MESH":
            column.prop_search(settings, "asset_density_group", active, "vertex_groups", icon="GROUP_VERTEX")
        else:
            column.prop(settings, "asset_density_group")
        column.prop(settings, "export")

    def draw_button(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        is_possible = bool(context.selected_objects)
        display.draw_operator(layout, "imprint.make_asset", enabled=is_possible, icon="MESH_ICOSPHERE")


class IMPRINT_OT_convert(modal.MapOperator, bpy.types.Operator):
    """Make a new normal map for the low-poly object of the chosen one, in the space and the basis of the panel Map"""

    bl_idname = "imprint.convert"
    bl_label = "Convert"
    bl_options = {"REGISTER", "UNDO"}

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[ConversionReport]:
        settings = context.scene.imprint
        chosen = settings.chosen(context)
        if chosen.low is None:
            raise BakeError("No low object: select it, or fill the slot.")
        if settings.convert_image is None:
            raise BakeError("No map to convert: choose an image.")
        before = StoredNormals(**{field.name: getattr(settings, field.name) for field in fields(StoredNormals)})
        conversion = Conversion(chosen.low, settings.convert_image, before, is_own_base=_is_own_base(chosen))
        return (yield from convert.work(context, conversion, settings.to_settings(), pace))

    def finish(self, context: bpy.types.Context, result: ConversionReport) -> None:
        self.show(context, result.summary(), result.warnings)


def _is_own_base(chosen: Chosen) -> bool:
    """Whether a map of the low object is of its mesh without modifiers: these add detail, or it was baked onto itself."""
    pair = object_pairs.of(chosen.low)
    return chosen.low in chosen.highs and (
        bool(object_checks.own_highs(chosen.low)) or (pair is not None and pair.is_own)
    )


class IMPRINT_PT_convert(SettingsPanel, bpy.types.Panel):
    """Converts an existing map into the space and the basis of the panel Map."""

    bl_idname = "IMPRINT_PT_convert"
    bl_parent_id = "IMPRINT_PT_more"
    bl_label = "Convert Map"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        layout = split_layout(layout)
        settings = context.scene.imprint
        layout.template_ID(settings, "convert_image", open="image.open", text=label("Map"), translate=False)
        layout.prop(settings, "from_space")
        if settings.from_space == Space.TANGENT:
            layout.prop(settings, "from_basis")
        draw_props(layout.column(align=True), settings, "from_red", "from_green", "from_blue")

    def draw_button(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        is_possible = context.scene.imprint.convert_image is not None
        display.draw_operator(layout, "imprint.convert", enabled=is_possible, icon="FILE_REFRESH")


# Blender draws panels of one order in that of registration.


class IMPRINT_OT_bake_sequence(OnePairOperator, bpy.types.Operator):
    """Bake each frame of the scene's range into a numbered file, for example for wrinkle maps"""

    bl_idname = "imprint.bake_sequence"
    bl_label = "Bake Sequence"
    bl_options = {"REGISTER", "UNDO"}

    first: labeled(IntProperty, "First", "First frame; below 0 for that of the scene", default=-1)
    last: labeled(IntProperty, "Last", "Last frame; below 0 for that of the scene", default=-1)

    def task(self, context: bpy.types.Context, pace: Pace) -> Task:
        job, settings, wants = self.request(context)
        scene = context.scene
        first = self.first if self.first >= 0 else scene.frame_start
        last = self.last if self.last >= 0 else scene.frame_end
        return (yield from work_on_frames(context, job, settings, range(first, last + 1), pace, wants=wants))


class IMPRINT_PT_sequence(SettingsPanel, bpy.types.Panel):
    """Bakes a map for each frame."""

    bl_idname = "IMPRINT_PT_sequence"
    bl_parent_id = "IMPRINT_PT_more"
    bl_label = "Sequence"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        row = layout.row(align=True)
        row.prop(context.scene, "frame_start", text=label("First"))
        row.prop(context.scene, "frame_end", text=label("Last"))
        if not _writes_files(context):
            draw_paragraphs(layout, context, [message("Set Store to File to bake a sequence.")], "INFO")

    def draw_button(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        is_possible = _writes_files(context)
        display.draw_operator(layout, "imprint.bake_sequence", enabled=is_possible, icon="RENDER_ANIMATION")


def _writes_files(context: bpy.types.Context) -> bool:
    return context.scene.imprint.storage == Storage.FILE


# Blender draws the panels in this order.
CLASSES = (
    IMPRINT_PT_more,
    IMPRINT_OT_make_levels,
    IMPRINT_PT_levels,
    IMPRINT_OT_make_asset,
    IMPRINT_PT_asset,
    IMPRINT_OT_convert,
    IMPRINT_PT_convert,
    IMPRINT_OT_bake_sequence,
    IMPRINT_PT_sequence,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
