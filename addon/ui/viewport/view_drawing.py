# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the views: the meshes as the mode shows them, and the labels and figures over them."""

import bpy
import numpy as np

from ...views import view_shading
from ...views.mode_names import Mode
from ..translations import label, message
from . import viewport_text

HEADLIGHT = np.array((-0.6, 0.7, 1.0, 0.0))
"""Direction to the view's own light, in view space: slightly from above and from the left."""
BAR = (240.0, 12.0)
"""Width and height of the legend, in pixels at a scale of 1."""
EDGE, TEXT = 60.0, viewport_text.SIZE
"""Height of the labels above the lower edge, and their size, in pixels at a scale of 1."""
SHOWN_SHARE = 0.0005
"""The share of texels that are not measured is shown from this value: the text has one decimal of a percent."""
DEGREES = "\N{DEGREE SIGN}"


def draw_mesh(context: bpy.types.Context, shading: view_shading.Shading, mode: Mode, *, is_alone: bool) -> None:
    """Draw the meshes into a view, and the legend of the deviations. is_alone: whether the high objects are hidden there."""
    view = context.scene.imprint_view
    shading.draw(mode, eye(context.region_data, view.light), split=view.split, limit=view.limit, is_alone=is_alone)
    if mode.is_deviation:
        scale = context.preferences.system.ui_scale
        shading.draw_legend(_bar_position(context.region, scale), (BAR[0] * scale, BAR[1] * scale))


def draw_labels(context: bpy.types.Context, mode: Mode, figures: view_shading.Figures | None) -> None:
    """Write the names of a view's parts over it, or the measured deviations."""
    view, region, scale = context.scene.imprint_view, context.region, context.preferences.system.ui_scale
    if mode is Mode.SPLIT:
        parts = ((label("High"), 1.0), (label("Low"), 0.5), (label("Low with Map"), 0.0))
        for zone, (text, share) in zip(view_shading.zones(region.width, view.split), parts, strict=True):
            width = viewport_text.width(text, scale)
            x = label_position(zone, width, share, visible_columns(context), TEXT * scale)
            if x is not None:
                viewport_text.write(text, x, EDGE * scale, scale)
    elif mode.is_deviation:
        x, y = _bar_position(region, scale)
        for end, degrees in ((0.0, 0.0), (1.0, view.limit)):
            viewport_text.write(f"{degrees:.3g}{DEGREES}", x + end * BAR[0] * scale, y - 1.5 * TEXT * scale, scale, 0.5)
        for number, line in enumerate(reversed(description(figures))):
            viewport_text.write(line, region.width / 2, y + (BAR[1] + TEXT * (1.5 * number + 0.7)) * scale, scale, 0.5)


def description(figures: view_shading.Figures | None) -> list[str]:
    """The deviations in two lines, and the share that was not measured in a third; empty without figures."""
    if figures is None:
        return []
    elsewhere = []
    if figures.elsewhere >= SHOWN_SHARE:
        text = message("Purple: {} shows another place of the high mesh and is not measured: cast rays")
        elsewhere = [text.format(f"{figures.elsewhere:.1%}")]
    if figures.elsewhere == 1.0:
        return elsewhere
    return elsewhere + [
        text.format(f"{mean:.2f}{DEGREES}", f"{most:.2f}{DEGREES}")
        for text, mean, most in (
            (message("With the map: mean {}, 99 % below {}"), figures.mean, figures.percentile_99),
            (message("Without: mean {}, 99 % below {}"), figures.bare_mean, figures.bare_percentile_99),
        )
    ]


def visible_columns(context: bpy.types.Context) -> tuple[int, int]:
    """The first and last x, in pixels of the region, between the toolbar and the sidebar that lie over it."""
    region = context.region
    left, right = 0, region.width
    for other in context.area.regions:
        if other.type in {"TOOLS", "UI"} and other.width > 1:  # 1 where it is hidden
            if other.alignment == "LEFT":
                left = max(left, other.x + other.width - region.x)
            elif other.alignment == "RIGHT":
                right = min(right, other.x - region.x)
    return left, right


def label_position(zone: range, width: float, share: float, visible: tuple[int, int], gap: float) -> float | None:
    """The x where a label of this width begins, in the visible part of its zone with a gap at both ends. `share` of the free
    room is on its left. None if it does not fit."""
    start, stop = max(zone.start, visible[0]) + gap, min(zone.stop, visible[1]) - gap
    return start + (stop - start - width) * share if stop - start >= width else None


def eye(region_data: bpy.types.RegionView3D, light: bpy.types.Object | None) -> view_shading.Eye:
    """The camera of a view, and its light: an object, or the view's own for None."""
    view = np.array(region_data.view_matrix, np.float64)
    if light is None:
        towards = view.T @ HEADLIGHT  # a view matrix rotates and does not scale
        towards[3] = 0.0
    elif light.data.type == "SUN":
        towards = np.array(light.matrix_world.col[2])
    else:
        towards = np.array(light.matrix_world.col[3])
    return view_shading.Eye(view, np.array(region_data.window_matrix, np.float64), towards)


def _bar_position(region: bpy.types.Region, scale: float) -> tuple[float, float]:
    return (region.width - BAR[0] * scale) / 2, EDGE * scale
