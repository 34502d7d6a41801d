# SPDX-License-Identifier: GPL-3.0-or-later
"""The texts over a view: what its panes show, the low object and its map, and the deviations with their legend."""

from collections.abc import Sequence

import bpy

from ..core.map_types import BY_NAME
from . import progress_display, view_shading
from .texts import label, message
from .view_shading import Mode

BAR = (240.0, 12.0)
"""Width and height of the legend, in pixels at a scale of 1."""
EDGE, TEXT = 60.0, progress_display.TEXT_SIZE
"""Height of the labels above the lower edge, and their size, in pixels at a scale of 1."""
SHOWN_SHARE = 0.0005
"""The share of texels that are not measured is shown from this value: the text has one decimal of a percent."""
DEGREES = "\N{DEGREE SIGN}"


def map_label(name: str) -> str:
    """The label of a map in the language of the interface. name: that of a MapType, or of a packed image."""
    return label(BY_NAME[name].label if name in BY_NAME else "Packed")


def title(lows: Sequence[str], name: str) -> str:
    """What is shown, in a line. lows: the names of the low objects. name: of the map."""
    objects = lows[0] if len(lows) == 1 else message("{} low objects").format(len(lows))
    return f"{objects}: {map_label(name)}"


def draw(
    context: bpy.types.Context,
    mode: Mode,
    shown: str,
    deviations: view_shading.Deviations | view_shading.FormatLoss | None,
) -> None:
    """Write the texts of a mode over a view. shown: from `title`."""
    view, region, scale = context.scene.imprint_view, context.region, context.preferences.system.ui_scale
    visible = progress_display.visible_columns(context.area, context.region)
    if mode.is_deviation:
        _draw_deviations(context, [shown, *describe_deviations(deviations)])
        return
    is_split = mode is Mode.SPLIT
    for pane in view_shading.panes(mode, (region.width, region.height), view.split, visible):
        text = label("High") if pane.shows is Mode.HIGH else shown
        width = progress_display.text_width(text, scale)
        share = float(pane.shows is Mode.HIGH) if is_split else 0.5
        x = label_position(pane.columns, width, share, visible, TEXT * scale)
        if x is not None:
            progress_display.write_text(text, x, EDGE * scale, scale)


def _draw_deviations(context: bpy.types.Context, lines: Sequence[str]) -> None:
    """Write the ends of the legend, and lines above it."""
    view, region, scale = context.scene.imprint_view, context.region, context.preferences.system.ui_scale
    x, y = _bar_position(region, scale)
    for end, degrees in ((0.0, 0.0), (1.0, view.limit)):
        progress_display.write_text(
            f"{degrees:.3g}{DEGREES}", x + end * BAR[0] * scale, y - 1.5 * TEXT * scale, scale, 0.5
        )
    for number, line in enumerate(reversed(lines)):
        height = y + (BAR[1] + TEXT * (1.5 * number + 0.7)) * scale
        progress_display.write_text(line, region.width / 2, height, scale, 0.5)


def draw_legend(context: bpy.types.Context) -> None:
    """Draw the colors of deviations as a bar. Call it where the view is drawn."""
    scale = context.preferences.system.ui_scale
    view_shading.draw_legend(_bar_position(context.region, scale), (BAR[0] * scale, BAR[1] * scale))


def describe_deviations(deviations: view_shading.Deviations | view_shading.FormatLoss | None) -> list[str]:
    """The deviations in two lines, and the share that was not measured in a third; what a format loses in one; empty without
    deviations."""
    if deviations is None:
        return []
    if isinstance(deviations, view_shading.FormatLoss):
        mean, most = (f"{angle:.2f}{DEGREES}" for angle in (deviations.mean, deviations.percentile_99))
        return [message("{}: mean {}, 99 % below {}").format(deviations.label, mean, most)]
    elsewhere = []
    if deviations.elsewhere >= SHOWN_SHARE:
        text = message("Purple: {} shows another place of the high mesh and is not measured: cast rays")
        elsewhere = [text.format(f"{deviations.elsewhere:.1%}")]
    if deviations.elsewhere == 1.0:
        return elsewhere
    return elsewhere + [
        text.format(f"{mean:.2f}{DEGREES}", f"{most:.2f}{DEGREES}")
        for text, mean, most in (
            (message("With the map: mean {}, 99 % below {}"), deviations.mean, deviations.percentile_99),
            (message("Without: mean {}, 99 % below {}"), deviations.bare_mean, deviations.bare_percentile_99),
        )
    ]


def label_position(zone: range, width: float, share: float, visible: tuple[int, int], gap: float) -> float | None:
    """The x where a label of this width begins, in the visible part of its zone with a gap at both ends. `share` of the free
    room is on its left. None if it does not fit."""
    start, stop = max(zone.start, visible[0]) + gap, min(zone.stop, visible[1]) - gap
    return start + (stop - start - width) * share if stop - start >= width else None


def _bar_position(region: bpy.types.Region, scale: float) -> tuple[float, float]:
    return (region.width - BAR[0] * scale) / 2, EDGE * scale
