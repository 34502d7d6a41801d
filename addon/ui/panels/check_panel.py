# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of the checks: their findings in the last bake, and buttons that show where they are."""

import bpy

from ...jobs import locate_issues
from ...scene import scene_lengths
from ..bake_results import results
from ..check_operators import CHECKS, REASONS
from ..translations import label, message
from .sidebar import SidebarPanel, draw_paragraphs

ICONS = {"GOOD": ("CHECKMARK", 0), "LOOK": ("INFO", 1), "WRONG": ("ERROR", 2)}
"""Icon of each severity, and its rank."""


class IMPRINT_PT_checks(SidebarPanel, bpy.types.Panel):
    """The findings of the checks in the last bake."""

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
            worst = max(report.checks.values(), key=lambda check: ICONS[_severity(check)][1], default={})
            self.layout.label(text="", icon=ICONS[_severity(worst)][0])

    def draw(self, context: bpy.types.Context) -> None:
        layout, report = self.layout, results.of(context)
        column = layout.column(align=True)
        for kind in CHECKS:
            _draw_row(column, kind, report.checks[kind], report.low, context)
        row = layout.row()
        row.enabled = report.checks["polygons"]["count"] > 0
        row.operator("imprint.add_triangulate", icon="MOD_TRIANGULATE").low = report.low


def _draw_row(column: bpy.types.UILayout, kind: str, check: dict, low: str, context: bpy.types.Context) -> None:
    """A check in a row: its icon, name and number, and the buttons that show where its findings are."""
    row = column.row(align=True)
    row.label(text=label(CHECKS[kind][0]), icon=ICONS[_severity(check)][0], translate=False)
    number = row.row()
    number.alignment = "RIGHT"
    number.label(text=_number(check), translate=False)
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
            buttons.label(text="", icon="BLANK1")  # keeps the other buttons in their columns
    if "maximum" in check and check["count"]:
        far = map(scene_lengths.of(context.scene), (check["limit"], check["percentile_99"], check["maximum"]))
        text = message("Over {}; 99 % within {}, at most {}").format(*far)
        draw_paragraphs(column, context, [text], "BLANK1")
    if kind == "unsure" and check["count"]:
        found = [message(text).format(_share(check, key)) for key, text in REASONS.items() if check[key]]
        draw_paragraphs(column, context, ["; ".join(found)], "BLANK1")
    if check.get("islands"):
        text = message("UV islands: {}").format(f"{check['islands']:,}")
        column.label(text=text, icon="BLANK1", translate=False)


def _severity(check: dict) -> str:
    """One of ICONS: the rating of the audit or, without a rating, whether there is a finding."""
    return check.get("severity") or ("LOOK" if check.get("count") else "GOOD")


def _number(check: dict) -> str:
    """A check's number in a few characters."""
    return _share(check, "count") if "share" in check else f"{check['count']:,}"


def _share(check: dict, key: str) -> str:
    """The share of the texels that a check's number `key` counts."""
    share = check[key] / max(1, check["of"])
    return f"{share:.1%}" if share >= 0.001 or not check[key] else "< 0.1%"


CLASSES = (IMPRINT_PT_checks,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
