# SPDX-License-Identifier: GPL-3.0-or-later
"""Drives a real Blender window from scripts in tests/window."""

import functools
from collections.abc import Iterator

import bpy


def view() -> tuple[bpy.types.Window, bpy.types.Area, bpy.types.Region]:
    """The largest 3D viewport."""
    window = bpy.context.window_manager.windows[0]
    area = max((a for a in window.screen.areas if a.type == "VIEW_3D"), key=lambda a: a.width * a.height)
    return window, area, next(region for region in area.regions if region.type == "WINDOW")


def at_view():
    """The context of that viewport, for operators."""
    window, area, region = view()
    return bpy.context.temp_override(window=window, area=area, region=region, screen=window.screen)


def start(steps: Iterator[float]) -> None:
    """Run `steps` in Blender's event loop, which wait as many seconds as they yield. Quits Blender after the last."""
    bpy.context.preferences.view.show_splash = False
    bpy.app.timers.register(functools.partial(_run, steps), first_interval=1.0, persistent=True)


def _run(steps: Iterator[float]) -> float | None:
    seconds = next(steps, None)
    if seconds is None:
        with at_view():
            bpy.ops.wm.quit_blender()
    return seconds
