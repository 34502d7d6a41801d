# SPDX-License-Identifier: GPL-3.0-or-later
"""What the audit of the last bake found, in the panel, and the buttons that show where it is."""

import bpy
from bpy.props import EnumProperty, StringProperty

from ..core.errors import BakeError
from ..core.report import Report
from ..jobs import locate_issues
from ..scene import face_selection
from . import results
from .viewport import progress_display, show_result

WORDS = {
    "overlap": (
        "Overlapping UVs",
        "Texels that two triangles of the low mesh or more share: they show one of them. Parts that lie on the very same "
        "place, as mirrored halves do, share their detail on purpose and do no harm in tangent space",
    ),
    "uncovered": ("Uncovered", "Texels of the low mesh that no high triangle covers, or whose ray hit nothing"),
    "far": ("Far", "Texels whose points on the low and the high mesh lie farther apart than the limit"),
    "gaps": (
        "Close islands",
        "Texels so close to another UV island, or to the border of the map, that the smaller mip levels mix them. How many "
        "levels count is set beside the margin",
    ),
    "backwards": (
        "Z below 0",
        "Texels whose tangent-space normal points into the surface: lost by readers that store x and y and rebuild z",
    ),
    "mirrored": (
        "Mirrored UVs",
        "Triangles that are mirrored in UV space: right practice, as long as the reader knows",
    ),
    "outside": (
        "Outside the tile",
        "Triangles that reach outside the UV tile, or the UDIM tiles, and are cut off there. Parts that were moved by whole "
        "tiles off others on which they lie when taken back do no harm",
    ),
    "no_area": ("Zero-area UVs", "Triangles without area in UV space, which cannot be drawn"),
    "hard_edges": (
        "Hard edges, no seam",
        "Hard edges inside a UV island: each costs a visible line in tangent space. Mark a seam there and unwrap, or shade "
        "smooth",
    ),
    "behind": (
        "Normals behind",
        "Triangles with a shading normal that points behind them, where no tangent-space map can be right",
    ),
    "polygons": ("Quads, n-gons", "Faces with more than three corners: an exporter may cut them into other triangles"),
    "uneven": ("Non-planar faces", "Quads and n-gons whose shape depends on the triangles that they are cut into"),
}
"""Of each kind of check, its label and its tooltip."""


SIGNS = {"GOOD": ("CHECKMARK", 0), "LOOK": ("INFO", 1), "WRONG": ("ERROR", 2)}
"""The sign of each severity, and how much it weighs."""


def _items(kinds: tuple[str, ...]) -> list[tuple[str, str, str]]:
    return [(kind.upper(), *WORDS[kind]) for kind in kinds]


class _OfLastBake:
    """An operator on the low object of the last bake: `_apply` does it and returns what to tell, or "" where there was
    nothing to do; it may raise BakeError."""

    low: StringProperty(
        name="Low",
        description="Name of a low object that was baked; empty for the one that the panel means, or the last one",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return results.is_there(context) and progress_display.current() is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            report = results.named(context, self.low)
            if report is None:
                raise BakeError(f"Nothing was baked onto {self.low!r} in this session.")
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

    kind: EnumProperty(name="Check", description="Which faces", items=_items(locate_issues.KINDS))

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return f"{WORDS[properties.kind.lower()][1]}. Select the faces in Edit Mode"

    def _apply(self, context: bpy.types.Context, report: Report) -> str:
        low, kind = locate_issues.of_low(report), self.kind.lower()
        problem = face_selection.problem(low)
        if problem:
            raise BakeError(problem)
        found, is_edge = locate_issues.find(context, report, kind), kind in locate_issues.ON_EDGES
        which = "edge" if is_edge else "face"
        if not len(found):
            raise BakeError(f"No {which} of {low.name!r} has this flaw: {WORDS[kind][0].lower()}.")
        face_selection.select(context, low, found, "EDGE" if is_edge else "FACE")
        if self.options.is_invoke and context.window is not None:
            show_result.selection(context)
        many = len(found) > 1
        return f"{len(found):,} {which}{'s' if many else ''} of {low.name!r} {'are' if many else 'is'} selected"


class IMPRINT_OT_show_mask(_OfLastBake, bpy.types.Operator):
    """Make an image that is white on the texels that the check is about"""

    bl_idname = "imprint.show_mask"
    bl_label = "Show Mask"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(name="Check", description="Which texels", items=_items(locate_issues.ON_TEXELS))

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return f"{WORDS[properties.kind.lower()][1]}. Show them white in an image"

    def _apply(self, context: bpy.types.Context, report: Report) -> str:
        image = locate_issues.draw_mask(context, report, self.kind.lower())
        is_pressed = self.options.is_invoke and context.window is not None
        show = show_result.image_in_window if is_pressed else show_result.image
        show(context, image)
        return f"The mask is in the image {image.name!r}"


class IMPRINT_OT_add_triangulate(_OfLastBake, bpy.types.Operator):
    """Add a modifier that cuts the low object's faces into the triangles that were baked, so that exporters keep to them"""

    bl_idname = "imprint.add_triangulate"
    bl_label = "Add Triangulate"
    bl_options = {"REGISTER", "UNDO"}

    def _apply(self, context: bpy.types.Context, report: Report) -> str:
        modifier, folded = locate_issues.add_triangulate(context, report)
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
        return results.of(context) is not None

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        report = results.of(context)
        if report is not None:
            worst = max(report.checks.values(), key=lambda check: SIGNS[_severity(check)][1], default={})
            self.layout.label(text="", icon=SIGNS[_severity(worst)][0])

    def draw(self, context: bpy.types.Context) -> None:
        layout, report = self.layout, results.of(context)
        column = layout.column(align=True)
        for kind in WORDS:
            _draw_row(column, kind, report.checks[kind], report.low, context)
        row = layout.row()
        row.enabled = report.checks["polygons"]["count"] > 0
        row.operator("imprint.add_triangulate", icon="MOD_TRIANGULATE").low = report.low


def _draw_row(column: bpy.types.UILayout, kind: str, check: dict, low: str, context: bpy.types.Context) -> None:
    """A check in a row: its sign, its name, its number, and the buttons that show where."""
    row = column.row(align=True)
    row.label(text=WORDS[kind][0], icon=SIGNS[_severity(check)][0])
    number = row.row()
    number.alignment = "RIGHT"
    number.label(text=_number(check))
    buttons = row.row(align=True)
    buttons.enabled = check["count"] > 0
    for operator, icon, kinds in (
        ("imprint.show_mask", "IMAGE_DATA", locate_issues.ON_TEXELS),
        ("imprint.select_flaws", "RESTRICT_SELECT_OFF", locate_issues.KINDS),
    ):
        if kind in kinds:
            button = buttons.operator(operator, text="", icon=icon)
            button.kind, button.low = kind.upper(), low
        else:
            buttons.label(text="", icon="BLANK1")  # so that the others stay in their column
    if "maximum" in check and check["count"]:
        far = (_length(context, check[name]) for name in ("limit", "percentile_99", "maximum"))
        column.label(text="Over {}; 99 % within {}, at most {}".format(*far), icon="BLANK1")


def _severity(check: dict) -> str:
    """One of SIGNS: as the audit weighed it or, where it did not, by whether there is anything to look at."""
    return check.get("severity") or ("LOOK" if check.get("count") else "GOOD")


def _number(check: dict) -> str:
    """A check's number in a few characters."""
    if "share" in check:
        return f"{check['share']:.1%}" if check["share"] >= 0.001 or not check["count"] else "< 0.1%"
    within = f" in {check['islands']:,}" if check.get("islands") else ""
    return f"{check['count']:,}{within}"


def _length(context: bpy.types.Context, distance: float) -> str:
    """A distance in the scene's unit of length."""
    units = context.scene.unit_settings
    if units.system == "NONE":
        return f"{distance:.4g}"
    return bpy.utils.units.to_string(units.system, "LENGTH", distance * units.scale_length, precision=4)


CLASSES = (IMPRINT_OT_select_flaws, IMPRINT_OT_show_mask, IMPRINT_OT_add_triangulate, IMPRINT_PT_checks)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
