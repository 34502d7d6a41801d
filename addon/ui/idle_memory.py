# SPDX-License-Identifier: GPL-3.0-or-later
"""Gives the GPU's memory back when nobody bakes. Batches in the background keep it: for them the next bake is at hand."""

import bpy

from ..engine import gpu_memory
from . import live_mode
from .viewport import progress_display

AFTER = 60.0
"""Seconds without a bake."""
EVERY = 15.0
"""Seconds between two looks."""


def tick() -> float:
    """Free what is kept if it is time."""
    if progress_display.current() is None and live_mode.session() is None:
        gpu_memory.free_if_idle(AFTER)
    return EVERY


def register() -> None:
    if not bpy.app.background:
        bpy.app.timers.register(tick, first_interval=EVERY, persistent=True)


def unregister() -> None:
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
