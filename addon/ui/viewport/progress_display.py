# SPDX-License-Identifier: GPL-3.0-or-later
"""A bake that is going on, for the eye: its words and share for panel and status bar, the map as it refines in the views."""

import time

import bpy
from gpu_extras.presets import draw_texture_2d

from ...core.progress import Progress
from . import viewport_text

SIDE = 256
"""Of the picture on screen, in pixels at a scale of 1."""
EDGE = 24
REDRAW = 0.25
"""Seconds between two looks at the map."""
KNOWN = 0.05
"""Share of a bake that must be done before the time of the rest is told."""

_step: Progress | None = None
_drawn = _began = 0.0
_handles: list[tuple[type, object]] = []


def current() -> Progress | None:
    """What the bake last said, or None where none is going on."""
    return _step


def show(context: bpy.types.Context, step: Progress) -> None:
    """Show `step` until `hide` is called."""
    global _step, _drawn, _began  # noqa: PLW0603 - there is one bake at a time, and Blender draws without arguments
    if _step is None:
        _began = time.monotonic()
    _step = step
    if not _handles:
        for space in (bpy.types.SpaceView3D, bpy.types.SpaceImageEditor):
            _handles.append((space, space.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")))
    # The views may take longer to draw than a slice of the bake.
    if time.monotonic() - _drawn > REDRAW:
        _drawn = time.monotonic()
        context.workspace.status_text_set(f"{words(step)}   Esc: stop")
        _redraw(context)


def hide(context: bpy.types.Context) -> None:
    """Take everything off the screen."""
    global _step  # noqa: PLW0603 - see above
    _step = None
    while _handles:
        space, handle = _handles.pop()
        space.draw_handler_remove(handle, "WINDOW")
    for window in context.window_manager.windows:  # what ends it may come from another one than began it
        window.workspace.status_text_set(None)
    _redraw(context)


def words(step: Progress) -> str:
    """`step` in a line."""
    return f"{step.what}, {short(step)}"


def short(step: Progress) -> str:
    """How far `step` is and, once that can be told, how much time is left."""
    return f"{step.done:.0%}{_left(step.done, time.monotonic() - _began)}"


def _left(done: float, seconds: float) -> str:
    """How long the rest takes if it goes on as in the `seconds` that this share took, in steps that do not flicker."""
    if done < KNOWN or seconds < 1.0:
        return ""
    left = seconds * (1.0 - done) / done
    if left >= 60.0:
        return f", {left / 60.0:.0f} min left"
    return f", {left if left < 10.0 else 5.0 * round(left / 5.0):.0f} s left"


def _redraw(context: bpy.types.Context) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in {"VIEW_3D", "IMAGE_EDITOR"}:
                area.tag_redraw()


def _draw() -> None:
    if _step is None or _step.picture is None:
        return
    scale = bpy.context.preferences.system.ui_scale
    longer = max(_step.picture.width, _step.picture.height)
    width, height = (SIDE * scale * side / longer for side in (_step.picture.width, _step.picture.height))
    draw_texture_2d(_step.picture, (EDGE * scale, EDGE * scale), width, height)
    viewport_text.write(words(_step), EDGE * scale, EDGE * scale + height + 8 * scale, scale)
