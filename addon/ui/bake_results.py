# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows what was baked in open editors, and the operators that show, connect and export the maps of the last bake."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty

from ..core import file_formats, naming
from ..core.errors import BakeError
from ..core.progress import Pace, Task
from ..core.report import Report
from ..core.settings import Settings
from ..export import engine_files, webp_pictures
from ..export.engine_files import Exported
from ..jobs import one_material
from ..output import materials
from ..scene import evaluation
from ..scene.object_checks import object_by_name
from . import modal, object_pairs, results, sets
from .callbacks import redraw
from .findings import findings
from .modal import QuickOperator
from .progress_display import display
from .results import high_objects
from .texts import labeled, message, tooltip


def show_image(context: bpy.types.Context, shown: bpy.types.Image) -> bool:
    """Show an image in an Image Editor, if one is open that is not pinned to another. Returns whether there was one."""
    editors = _editors(context)
    free = [editor for editor in editors if editor.image == shown or not editor.use_image_pin]
    # One that shows it already, so that no other picture is replaced.
    editor = next((editor for editor in free if editor.image == shown), next(iter(free), None))
    if editor is not None:
        editor.image = shown
    return editor is not None


def is_image_open(shown: bpy.types.Image) -> bool:
    """Whether an Image Editor shows an image."""
    return any(editor.image == shown for editor in _editors(bpy.context))


def _editors(context: bpy.types.Context) -> list[bpy.types.SpaceImageEditor]:
    """The open Image Editors."""
    areas = [area for window in context.window_manager.windows for area in window.screen.areas]
    return [area.spaces.active for area in areas if area.type == "IMAGE_EDITOR"]


BESIDE = 0.4
"""The share of a viewport's width that an image beside it gets."""


def show_image_beside(context: bpy.types.Context, shown: bpy.types.Image) -> None:
    """Show an image in an open Image Editor, or else in a new one beside the viewport, or in a window where there is none."""
    if show_image(context, shown):
        return
    viewport = find_viewport(context)
    area, size = _split(context, viewport) if viewport is not None else (None, ())
    if area is None:
        area = _new_window(context)
        size = area.width, area.height
    area.type = "IMAGE_EDITOR"
    editor = area.spaces.active
    editor.image = shown
    editor.zoom_percentage = 90.0 * min(room / max(1, side) for room, side in zip(size, shown.size, strict=True))


def _split(context: bpy.types.Context, area: bpy.types.Area) -> tuple[bpy.types.Area | None, tuple[float, float]]:
    """The left part of an area, which keeps the rest with its sidebar, and the size that it will have; None if it cannot be
    divided, as one that fills the screen."""
    screen, size = context.window.screen, (BESIDE * area.width, area.height)
    before = set(screen.areas)
    with context.temp_override(area=area, region=next(one for one in area.regions if one.type == "WINDOW")):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=BESIDE)  # below 0.5, the new one is the left one
    return next((one for one in screen.areas if one not in before), None), size


def _new_window(context: bpy.types.Context) -> bpy.types.Area:
    before = set(context.window_manager.windows)
    bpy.ops.wm.window_new()
    return next(window for window in context.window_manager.windows if window not in before).screen.areas[0]


def show_bake(context: bpy.types.Context, reports: list[Report]) -> None:
    """Show the first map, and the low mesh with it: Material Preview instead of Solid, and the high objects hidden.

    No editor is opened. The next bake of the same low object uses its high objects although they are hidden.
    """
    first = bpy.data.images.get(reports[0].image)
    if first is not None:
        show_image(context, first)
    area = find_viewport(context)
    if area is None:
        return
    shading = area.spaces.active.shading
    if shading.type == "SOLID" and all(map(_is_in_material, reports)):
        shading.type = "MATERIAL"
    if shading.type in {"MATERIAL", "RENDERED"}:
        for report in reports:
            hide_high(context, report, True)


def _is_in_material(report: Report) -> bool:
    """Whether the bake put a map into the materials of its low object."""
    settings = report.settings
    has_normals = settings.get("material") and settings.get("normal")
    return bool(has_normals or settings.get("connect_maps") or settings.get("one_material"))


def hide_high(context: bpy.types.Context, report: Report, hide: bool) -> None:
    """Hide the high objects of a bake in the view layer, or show them again."""
    there = set(context.view_layer.objects.values())  # not by name: a linked and a local object may share one
    for obj in high_objects(report):
        if obj in there:
            obj.hide_set(hide)


def hides_high(report: Report) -> bool:
    """Whether no high object of a bake is visible."""
    return not any(evaluation.is_visible(obj) for obj in high_objects(report))


def show_selection(context: bpy.types.Context) -> None:
    """Frame the selected faces in the viewport, with X-Ray so that nothing covers them."""
    area = find_viewport(context)
    if area is None:
        return
    shading = area.spaces.active.shading
    if shading.type == "SOLID":
        shading.show_xray = True
    region = next(region for region in area.regions if region.type == "WINDOW")
    with context.temp_override(area=area, region=region):
        bpy.ops.view3d.view_selected()


def find_viewport(context: bpy.types.Context) -> bpy.types.Area | None:
    """The 3D viewport of the context, or the largest one of its window; None if no 3D viewport is open."""
    if context.area is not None and context.area.type == "VIEW_3D":
        return context.area
    areas = context.window.screen.areas if context.window is not None else ()
    areas = [area for area in areas if area.type == "VIEW_3D"]
    return max(areas, key=lambda area: area.width * area.height, default=None)


class IMPRINT_OT_connect_maps(QuickOperator, bpy.types.Operator):
    """Put the maps of the last bake into the low object's material: colors, roughness, metallic, occlusion and height"""

    bl_idname = "imprint.connect_maps"
    bl_label = "Connect Maps"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not any(materials.takes_any(report.maps) for report in results.all_of(context)):
            cls.poll_message_set(tooltip("Bake a map first that a material takes, such as base color"))
            return False
        return True

    def apply(self, context: bpy.types.Context) -> str:
        reports, warnings = results.all_of(context), []
        low = reports[0].refs[0].resolve()
        materials.check(low, can_be_off=False)
        for report in reports:
            warnings += materials.connect_maps_of_report(
                low,
                report.maps,
                report.uv_layer,
                space=report.space,
                single_user=sets.whole(context).single_user,
                slots=report.slots or None,
                is_own_base=low in [ref.find() for ref in report.refs[1:]],
            )
        for warning in dict.fromkeys(warnings):
            self.report({"WARNING"}, warning)
        return ""


class IMPRINT_OT_one_material(QuickOperator, bpy.types.Operator):
    """Replace the materials of this low object, and of those in the same images, by one with the maps of the last bake"""

    bl_idname = "imprint.one_material"
    bl_label = "Make One Material"
    bl_options = {"REGISTER", "UNDO"}

    low: labeled(
        StringProperty, "Low", "Name of the low object; empty for the slot or the active object", options={"SKIP_SAVE"}
    )
    on_copies: labeled(
        BoolProperty, "On Copies", "Copy the objects and hide them: the copies get the material", default=False
    )
    join: labeled(BoolProperty, "Join", "Join the objects that get the material", default=False)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not results.has_any(context):
            cls.poll_message_set(tooltip("Bake this low object first"))
            return False
        return display.current is None

    def apply(self, context: bpy.types.Context) -> str:
        low = object_by_name(self.low) if self.low else context.scene.imprint.low or context.active_object
        own = results.of(context, low)
        if own is None:
            raise BakeError(f"{low.name if low else 'No object'!r} was not baked: bake it first.")
        reports = results.with_image(context, own)
        single_user = sets.whole(context).single_user
        settings = Settings.of_json(reports[0].settings).stored(single_user=single_user)
        shown = list(map(one_material.Shown.of, reports))
        warnings = one_material.put_checked(context, shown, settings, on_copies=self.on_copies, is_joined=self.join)
        for warning in warnings:
            self.report({"WARNING"}, warning)
        redraw()
        return ""


class IMPRINT_OT_show_map(QuickOperator, bpy.types.Operator):
    """Show an image of the last bake in an open Image Editor, or else in a new one beside the viewport"""

    bl_idname = "imprint.show_map"
    bl_label = "Show Map"

    image: labeled(StringProperty, "Image", "Name of the image; empty for the first one", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return results.of(context) is not None

    def apply(self, context: bpy.types.Context) -> str:
        name = self.image or results.of(context).image
        shown = bpy.data.images.get(name)
        if shown is None:
            raise BakeError(f"The image {name!r} was undone, renamed or deleted: bake again.")
        is_pressed = self.options.is_invoke and context.window is not None
        show = show_image_beside if is_pressed else show_image
        show(context, shown)
        redraw()
        return ""


class IMPRINT_OT_select_result(QuickOperator, bpy.types.Operator):
    """Select this low object alone. The panels are then about it"""

    bl_idname = "imprint.select_result"
    bl_label = "Select Low Object"
    bl_options = {"REGISTER", "UNDO"}

    low: labeled(StringProperty, "Low", "Name of the low object", options={"SKIP_SAVE"})

    def apply(self, context: bpy.types.Context) -> str:
        low, layer, settings = object_by_name(self.low), context.view_layer, context.scene.imprint
        evaluation.show_object(context, low)
        if layer.objects.active is not None and layer.objects.active.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        for obj in layer.objects.selected:
            obj.select_set(False)
        low.select_set(True)
        layer.objects.active = low
        if settings.low not in {None, low}:  # the slots are those of another pair, which that object keeps
            settings.low = None
            settings.highs.clear()
        return ""


class IMPRINT_OT_show_high(bpy.types.Operator):
    """Hide the high objects of the last bake to see the low object with its map, or show them again"""

    bl_idname = "imprint.show_high"
    bl_label = "Show High"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        report = results.of(context)
        return report is not None and bool(high_objects(report))

    def execute(self, context: bpy.types.Context) -> set[str]:
        report = results.of(context)
        hide_high(context, report, hide=not hides_high(report))
        return {"FINISHED"}


ENDINGS = ", ".join(file_formats.MESHES)


class IMPRINT_OT_export(modal.SlicedOperator, bpy.types.Operator):
    """Write the low object and the maps of its last bake to a file for an engine, read it back, and compare it with the bake"""

    bl_idname = "imprint.export"
    bl_label = "Export for Engine"

    filepath: labeled(
        StringProperty,
        "File",
        "File to write; empty for the one in the panel",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    filter_glob: modal.file_filter(";".join(f"*{ending}" for ending in file_formats.MESHES))
    check_existing: modal.warning_of_files()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if results.of(context) is None:
            cls.poll_message_set(tooltip("Bake this low object first"))
            return False
        return display.current is None

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.filepath or sets.whole(context).export:
            return super().invoke(context, event)
        self.filepath = f"{naming.file_name(results.of(context).low)}{file_formats.MESHES[0]}"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, _context: bpy.types.Context) -> None:
        """What the file browser shows beside the files."""
        column = self.layout.column(align=True)
        column.label(text=message("The ending decides the format:"), translate=False)
        column.label(text=ENDINGS, translate=False)

    def execute(self, context: bpy.types.Context) -> set[str]:
        if self.options.is_invoke and context.window is not None:  # the file browser has closed
            bpy.ops.imprint.export("INVOKE_DEFAULT", filepath=self.filepath)
            return {"FINISHED"}
        return super().execute(context)

    def task(self, context: bpy.types.Context, _pace: Pace) -> Task[Exported]:
        reports = results.all_of(context)
        panel = sets.whole(context)
        path = naming.fill(self.filepath or panel.export, reports[0].low, low_suffix=panel.low_suffix)
        if not path:
            raise BakeError("No file is set for the export: set one.")
        if path.startswith("//") and not bpy.data.filepath:
            raise BakeError(f"{path!r} is relative to a .blend file that was never saved: save it first.")
        own = {name: getattr(panel, name) for name in webp_pictures.NAMES}
        place = Path(bpy.path.abspath(path)).absolute()
        (done,) = yield from engine_files.work(context, [reports], place, settings=own)
        return done

    def finish(self, context: bpy.types.Context, result: Exported) -> None:
        for warning in result.warnings:
            self.report({"WARNING"}, warning)
        exported = {**result.to_dict(), "warnings": result.warnings}
        reports = [report.with_export(exported) for report in results.all_of(context)]
        object_pairs.write_reports(reports[0].refs[0].resolve(), reports)
        findings.drop()  # which the report now tells otherwise
        self.report({"INFO"}, reports[0].exported)
        redraw()


CLASSES = (
    IMPRINT_OT_connect_maps,
    IMPRINT_OT_one_material,
    IMPRINT_OT_show_map,
    IMPRINT_OT_select_result,
    IMPRINT_OT_show_high,
    IMPRINT_OT_export,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
