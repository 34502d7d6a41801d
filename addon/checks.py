# SPDX-License-Identifier: GPL-3.0-or-later
"""What the audit of the last bake found, in the panel, and the buttons that show where it is."""

import json
from dataclasses import asdict

import bpy
from bpy.props import EnumProperty, StringProperty

from . import progress
from .bake import flaws, selection
from .bake.errors import BakeError
from .bake.report import Report

WORDS = {
    "overlap": ("Shared texels", "Texels that two triangles of the low mesh or more share: they show one of them"),
    "uncovered": ("Without high", "Texels of the low mesh that no high triangle covers, or whose ray hit nothing"),
    "far": ("Far apart", "Texels whose points on the low and the high mesh lie farther apart than the limit"),
    "mirrored": ("Mirrored", "Triangles that are mirrored in UV space"),
    "outside": (
        "Outside the tile",
        "Triangles that reach outside the UV tile, or the UDIM tiles, and are cut off there",
    ),
    "no_area": ("No UV area", "Triangles without area in UV space, which cannot be drawn"),
    "polygons": ("Quads, n-gons", "Faces with more than three corners: an exporter may cut them into other triangles"),
    "uneven": ("Not flat", "Quads and n-gons whose shape depends on the triangles that they are cut into"),
}


def remember(context: bpy.types.Context, reports: list[Report]) -> None:
    """Keep what was baked last, for the panel and its buttons."""
    context.window_manager.imprint_checks = json.dumps([asdict(report) for report in reports])


def last(context: bpy.types.Context, low: str = "") -> Report | None:
    """The report of the last bake onto the object `low`; without a name, onto the active one if there is such a report,
    else the first. None where there is none."""
    reports = [Report(**values) for values in json.loads(context.window_manager.imprint_checks or "[]")]
    if low:
        return next((report for report in reports if report.low == low), None)
    active = context.active_object
    uid = active.session_uid if active else 0
    return next((report for report in reports if report.uids[:1] == [uid]), next(iter(reports), None))


def show(context: bpy.types.Context, image: bpy.types.Image) -> None:
    """Show `image` in an Image Editor, if one is open."""
    areas = [area for window in context.window_manager.windows for area in window.screen.areas]
    editor = next((area for area in areas if area.type == "IMAGE_EDITOR"), None)
    if editor is not None:
        editor.spaces.active.image = image


def _items(kinds: tuple[str, ...]) -> list[tuple[str, str, str]]:
    return [(kind.upper(), *WORDS[kind]) for kind in kinds]


class _OfLastBake:
    """An operator on the low object of the last bake: `_apply` does it and returns what to tell, or "" where there was
    nothing to do; it may raise BakeError."""

    low: StringProperty(
        name="Low",
        description="Name of a low object of the last bake; empty for the active one, or else the first",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(context.window_manager.imprint_checks) and progress.current() is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            report = last(context, self.low)
            if report is None:
                raise BakeError(f"The last bake had no low object called {self.low!r}.")
            self.report({"INFO"}, self._apply(context, report))
        except BakeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class IMPRINT_OT_select_flaws(_OfLastBake, bpy.types.Operator):
    """Select the low object's faces that the check is about, in Edit Mode"""

    bl_idname = "imprint.select_flaws"
    bl_label = "Select Faces"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(name="Check", description="Which faces", items=_items(flaws.KINDS))

    def _apply(self, context: bpy.types.Context, report: Report) -> str:
        low, kind = flaws.of_low(report), self.kind.lower()
        problem = selection.problem(low)
        if problem:
            raise BakeError(problem)
        faces = flaws.find_faces(context, report, kind)
        if not len(faces):
            raise BakeError(f"No face of {low.name!r} has this flaw: {WORDS[kind][0].lower()}.")
        selection.select(context, low, faces)
        return f"{len(faces):,} faces of {low.name!r} are selected"


class IMPRINT_OT_show_mask(_OfLastBake, bpy.types.Operator):
    """Make an image that is white on the texels that the check is about"""

    bl_idname = "imprint.show_mask"
    bl_label = "Show Mask"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(name="Check", description="Which texels", items=_items(flaws.ON_TEXELS))

    def _apply(self, context: bpy.types.Context, report: Report) -> str:
        image = flaws.draw_mask(context, report, self.kind.lower())
        show(context, image)
        return f"The mask is in the image {image.name!r}"


class IMPRINT_OT_add_triangulate(_OfLastBake, bpy.types.Operator):
    """Add a modifier that cuts the low object's faces into the triangles that were baked, so that exporters keep to them"""

    bl_idname = "imprint.add_triangulate"
    bl_label = "Add Triangulate"
    bl_options = {"REGISTER", "UNDO"}

    def _apply(self, context: bpy.types.Context, report: Report) -> str:
        modifier, folded = flaws.add_triangulate(context, report)
        otherwise = f"; it cuts {folded:,} folded quads otherwise than Blender draws them" if folded else ""
        return f"{report.low!r} has the modifier {modifier.name!r}{otherwise}"


class IMPRINT_PT_checks(bpy.types.Panel):
    """What the last bake found."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Imprint"
    bl_idname = "IMPRINT_PT_checks"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Checks"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(context.window_manager.imprint_checks)

    def draw(self, context: bpy.types.Context) -> None:
        layout, report = self.layout, last(context)
        layout.label(text=report.low, icon="OBJECT_DATA")
        column = layout.column(align=True)
        for kind, (name, _) in WORDS.items():
            check = report.checks[kind]
            row = column.row(align=True)
            row.label(text=f"{name}: {_number(check)}")
            buttons = row.row(align=True)
            buttons.enabled = check["count"] > 0
            for operator, icon, has_button in (
                ("imprint.show_mask", "IMAGE_DATA", kind in flaws.ON_TEXELS),
                ("imprint.select_flaws", "RESTRICT_SELECT_OFF", True),
            ):
                if has_button:
                    button = buttons.operator(operator, text="", icon=icon)
                    button.kind, button.low = kind.upper(), report.low
            if kind == "far":
                column.label(text=f"99 %: {check['percentile_99']:.4g}, at most {check['maximum']:.4g}", icon="BLANK1")
        row = layout.row()
        row.enabled = report.checks["polygons"]["count"] > 0
        row.operator("imprint.add_triangulate", icon="MOD_TRIANGULATE").low = report.low


def _number(check: dict[str, float]) -> str:
    """A check's number in a few characters."""
    if "share" in check:
        beyond = f" over {check['limit']:.4g}" if "limit" in check else ""
        return f"{check['share']:.2%}{beyond}"
    within = f" in {check['islands']:,} islands" if "islands" in check else ""
    return f"{check['count']:,}{within}"


CLASSES = (IMPRINT_OT_select_flaws, IMPRINT_OT_show_mask, IMPRINT_OT_add_triangulate, IMPRINT_PT_checks)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    _register()
    bpy.types.WindowManager.imprint_checks = StringProperty(
        name="Checks", description="The reports of the last bake of this session, as JSON", options={"SKIP_SAVE"}
    )


def unregister() -> None:
    del bpy.types.WindowManager.imprint_checks
    _unregister()
