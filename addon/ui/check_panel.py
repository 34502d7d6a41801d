# SPDX-License-Identifier: GPL-3.0-or-later
"""The checks of a finished bake: their panel, and its buttons Select Faces, Show Mask and Add Triangulate."""

import bpy
import numpy as np
from bpy.props import EnumProperty, StringProperty

from ..core.errors import BakeError
from ..core.report import Report
from ..core.sentences import LOOK, NOTE, WRONG
from ..jobs import fixes, masks
from ..scene import evaluation, mesh_elements, reading
from . import bake_results, results
from .fix_buttons import ICONS, RIGHT, SIGNS
from .modal import QuickOperator
from .progress_display import display
from .texts import SidebarPanel, draw_paragraphs, label, labeled, message, tooltip

CHECKS = {
    "overlap": (
        "Overlapping UVs",
        "Texels that two or more triangles of the low mesh share: they show only one of them. Parts at exactly the same "
        "place, such as mirrored halves, share their detail on purpose and do no harm in tangent space",
    ),
    "uncovered": ("Uncovered", "Texels of the low mesh that no high triangle covers, or whose ray hit nothing"),
    "far": ("Far", "Texels whose points on the low and the high mesh are farther apart than the limit"),
    "unsure": (
        "Unsure layers",
        "Texels that may show the wrong layer of the high mesh: their rays hit several layers, and the low mesh does not tell "
        "which of them belongs to the texel",
    ),
    "gaps": (
        "Close islands",
        "Texels so close to another UV island, or to the border of the map, that the smaller mip levels mix them. Clean "
        "Mips, below the margin, sets the number of levels",
    ),
    "backwards": (
        "Z below 0",
        "Texels whose tangent-space normal points into the surface: lost by programs that read x and y and rebuild z",
    ),
    "mirrored": (
        "Mirrored UVs",
        "Triangles that are mirrored in UV space: common practice, which the target program must support",
    ),
    "outside": (
        "Outside the tile",
        "Triangles that reach outside the UV tile, or the UDIM tiles, and are cut off there. Parts that "
        "were moved by whole tiles, such as mirrored halves, do no harm",
    ),
    "no_area": ("Zero-area UVs", "Triangles without area in UV space, which cannot be drawn"),
    "hard_edges": (
        "Hard edges, no seam",
        "Hard edges inside a UV island: each shows as a line in tangent space. Mark a seam there and unwrap, or shade "
        "smooth",
    ),
    "behind": (
        "Normals behind",
        "Triangles with a shading normal that points behind them, where no tangent-space map can be right",
    ),
    "polygons": (
        "Quads, n-gons",
        "Faces with more than three corners: an exporter may divide them into other triangles",
    ),
    "uneven": ("Non-planar faces", "Quads and n-gons whose shape depends on how they are divided into triangles"),
}
"""Label and tooltip of each check."""

REASONS = {
    "undecided": "No own hit: {}",
    "backs": "Only backs: {}",
    "contested": "Two own hits: {}",
    "jumps": "Jumps: {}",
    "other_layer": "Not the own hit: {}",
    "covered": "Another surface below: {}",
    "beyond": "Another surface beyond the rays: {}",
}
"""Messages with the share of texels that are unsure for each reason, by the keys of the report."""


def _items(kinds: tuple[str, ...]) -> list[tuple[str, str, str]]:
    return [(kind.upper(), *CHECKS[kind]) for kind in kinds]


class _LastBakeOperator(QuickOperator):
    """An operator on the low object of the last bake."""

    low: labeled(
        StringProperty,
        "Low",
        "Name of a low object that was baked; empty for that of the panel, or else the last one",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return results.has_any(context) and display.current is None

    def last_bake(self, context: bpy.types.Context) -> Report:
        """The report of the bake. Raises BakeError if there is none."""
        report = results.named(context, self.low)
        if report is None:
            raise BakeError(f"Nothing was baked onto {self.low!r}.")
        return report


class IMPRINT_OT_select_flaws(_LastBakeOperator, bpy.types.Operator):
    """Select the faces of the low object that the check has found, in Edit Mode"""

    bl_idname = "imprint.select_flaws"
    bl_label = "Select Faces"
    bl_options = {"REGISTER", "UNDO"}

    kind: labeled(EnumProperty, "Check", "The check whose faces to select", items=_items(masks.KINDS))

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return f"{tooltip(CHECKS[properties.kind.lower()][1])}. {tooltip('Select the faces in Edit Mode')}"

    def apply(self, context: bpy.types.Context) -> str:
        report = self.last_bake(context)
        low, kind = masks.of_low(report), self.kind.lower()
        problem = _selection_problem(low)
        if problem:
            raise BakeError(problem)
        indices, is_edge = masks.find(context, report, kind), kind in masks.ON_EDGES
        which = "edge" if is_edge else "face"
        if not len(indices):
            raise BakeError(f"No {which} of {low.name!r} has this issue: {CHECKS[kind][0].lower()}.")
        _select(context, low, indices, "EDGE" if is_edge else "FACE")
        if self.options.is_invoke and context.window is not None:
            bake_results.show_selection(context)
        many = len(indices) > 1
        return f"{len(indices):,} {which}{'s' if many else ''} of {low.name!r} {'are' if many else 'is'} selected"


def _selection_problem(obj: bpy.types.Object) -> str:
    """Why faces of `obj` cannot be selected, as a sentence; empty if they can."""
    if not (obj.is_editable and obj.data.is_editable):
        return f"{obj.name!r} is linked from another file: make it local, so that its faces can be selected."
    if not evaluation.is_visible(obj):
        return f"{obj.name!r} is hidden: show it, so that its faces can be selected."
    return ""


def _select(context: bpy.types.Context, obj: bpy.types.Object, chosen: np.ndarray, domain: str = "FACE") -> None:
    """Enter Edit Mode with only `obj`, and select only the faces with the `chosen` indices; edges for the domain "EDGE"."""
    layer = context.view_layer
    _leave_mode(layer.objects.active)
    for other in layer.objects.selected:
        other.select_set(False)
    layer.objects.active = obj
    obj.select_set(True)
    _leave_mode(obj)
    for name, indices in mesh_elements.elements(obj.data, chosen, domain).items():
        part = getattr(obj.data, name)
        flags = np.zeros(len(part), bool)
        flags[indices] = True
        part.foreach_set("select", flags)
        hidden = np.empty_like(flags)
        part.foreach_get("hide", hidden)
        if (hidden & flags).any():  # hidden elements are not visible and do not stay selected
            part.foreach_set("hide", hidden & ~flags)
    obj.data.update_tag()
    context.tool_settings.mesh_select_mode = (False, domain == "EDGE", domain == "FACE")
    # In Edit Mode, the first Undo only leaves the mode. The changes above need their own undo step.
    bpy.ops.ed.undo_push(message="Select Faces")
    bpy.ops.object.mode_set(mode="EDIT")


def _leave_mode(active: bpy.types.Object | None) -> None:
    if active is not None and active.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


class IMPRINT_OT_show_mask(_LastBakeOperator, bpy.types.Operator):
    """Make an image that is white on the texels that the check has found"""

    bl_idname = "imprint.show_mask"
    bl_label = "Show Mask"
    bl_options = {"REGISTER", "UNDO"}

    kind: labeled(EnumProperty, "Check", "The check whose texels to show", items=_items(masks.ON_TEXELS))

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return f"{tooltip(CHECKS[properties.kind.lower()][1])}. {tooltip('Show them white in an image')}"

    def apply(self, context: bpy.types.Context) -> str:
        image = masks.draw_mask(context, self.last_bake(context), self.kind.lower())
        is_pressed = self.options.is_invoke and context.window is not None
        show = bake_results.show_image_beside if is_pressed else bake_results.show_image
        show(context, image)
        return f"The mask is in the image {image.name!r}"


class IMPRINT_OT_add_triangulate(_LastBakeOperator, bpy.types.Operator):
    """Add a modifier that divides the low object's faces into the triangles that were baked, so that exporters use the same"""

    bl_idname = "imprint.add_triangulate"
    bl_label = "Add Triangulate"
    bl_options = {"REGISTER", "UNDO"}

    def apply(self, context: bpy.types.Context) -> str:
        report = self.last_bake(context)
        return fixes.triangulate_sentence(report.low, *fixes.add_triangulate(context, report))


class IMPRINT_PT_checks(SidebarPanel, bpy.types.Panel):
    """The findings of the checks in the last bake."""

    bl_idname = "IMPRINT_PT_checks"
    bl_parent_id = "IMPRINT_PT_results"
    bl_label = "Checks"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return results.of(context) is not None

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        report = results.of(context)
        if report is not None:
            icons = [_sign(report, kind) for kind in CHECKS]
            self.layout.label(text="", icon=next((icon for icon in SIGNS if icon in icons), RIGHT))

    def draw(self, context: bpy.types.Context) -> None:
        layout, report = self.layout, results.of(context)
        column = layout.column(align=True)
        for kind in CHECKS:
            _draw_row(column, kind, report, context)
        row = layout.row()
        row.enabled = report.checks["polygons"]["count"] > 0
        row.operator("imprint.add_triangulate", icon="MOD_TRIANGULATE").low = report.low


def _draw_row(column: bpy.types.UILayout, kind: str, report: Report, context: bpy.types.Context) -> None:
    """A check in a row: its icon, name and number, and the buttons that show where its findings are."""
    row, check, low = column.row(align=True), report.checks[kind], report.low
    row.label(text=label(CHECKS[kind][0]), icon=_sign(report, kind), translate=False)
    number = row.row()
    number.alignment = "RIGHT"
    number.label(text=_number(check), translate=False)
    buttons = row.row(align=True)
    buttons.enabled = check["count"] > 0
    for operator, icon, kinds in (
        ("imprint.show_mask", "IMAGE_DATA", masks.ON_TEXELS),
        ("imprint.select_flaws", "RESTRICT_SELECT_OFF", masks.KINDS),
    ):
        if kind in kinds:
            button = buttons.operator(operator, text="", icon=icon)
            button.kind, button.low = kind.upper(), low
        else:
            buttons.label(text="", icon="BLANK1")  # keeps the other buttons in their columns
    if "maximum" in check and check["count"]:
        far = map(reading.lengths_of(context.scene), (check["limit"], check["percentile_99"], check["maximum"]))
        text = message("Over {}; 99 % within {}, at most {}").format(*far)
        draw_paragraphs(column, context, [text], "BLANK1")
    if kind == "unsure" and check["count"]:
        reasons = [message(text).format(_share(check, key)) for key, text in REASONS.items() if check[key]]
        draw_paragraphs(column, context, ["; ".join(reasons)], "BLANK1")
    if check.get("islands"):
        text = message("UV islands: {}").format(f"{check['islands']:,}")
        column.label(text=text, icon="BLANK1", translate=False)


def _sign(report: Report, kind: str) -> str:
    """The icon of a check: that of its warning; without one, what it has found does no harm."""
    check = report.checks.get(kind, {})
    told = next((text for text in report.warnings if text.kind == kind), None)
    if told is not None:
        return ICONS[told.harm]
    if check.get("severity") == WRONG:  # another warning says why
        return ICONS[LOOK]
    return ICONS[NOTE] if check.get("count") else RIGHT


def _number(check: dict) -> str:
    """A check's number in a few characters."""
    return _share(check, "count") if "share" in check else f"{check['count']:,}"


def _share(check: dict, key: str) -> str:
    """The share of the texels that a check's number `key` counts."""
    share = check[key] / max(1, check["of"])
    return f"{share:.1%}" if share >= 0.001 or not check[key] else "< 0.1%"


CLASSES = (IMPRINT_OT_select_flaws, IMPRINT_OT_show_mask, IMPRINT_OT_add_triangulate, IMPRINT_PT_checks)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
