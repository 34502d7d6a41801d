# SPDX-License-Identifier: GPL-3.0-or-later
"""Frees GPU memory if there was no bake for a while. Not in the background, where the next bake of a batch starts soon."""

import bpy

from ..engine import gpu_memory
from .callbacks import Timer
from .live.live_switch import live
from .viewport.progress_display import display

AFTER = 60.0
"""Seconds without a bake."""
EVERY = 15.0
"""Seconds between two checks."""


class IdleMemory:
    """Frees cached GPU memory after `after` seconds without a bake."""

    def __init__(self, after: float = AFTER):
        self.after = after
        self.timer = Timer(self.check)

    def check(self) -> float:
        """Free the memory if it is time. Returns the seconds until the next check."""
        if display.current is None and not live.is_on:
            gpu_memory.free_if_idle(self.after)
        return EVERY


idle_memory = IdleMemory()


def register() -> None:
    if not bpy.app.background:
        idle_memory.timer.start(EVERY, persistent=True)


def unregister() -> None:
    idle_memory.timer.stop()
