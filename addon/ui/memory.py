# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps in memory survive saving, Undo and Redo; memory of the GPU is freed if there was no bake for a while."""

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..engine import gpu_memory
from ..output import datablocks
from ..output.datablocks import UNPACKED
from .callbacks import Handlers, Timer
from .live import live
from .progress_display import display

MOST_HELD = 1 << 30
"""The most bytes of maps in memory that are held for Undo and Redo."""


class HeldMaps:
    """Holds the pixels of maps in memory: Undo and Redo restore the images without them. Live draws its maps again."""

    def __init__(self):
        self._maps: dict[int, tuple[np.ndarray, bool]] = {}
        """The pixels (height, width, 4) float32, and whether the image is one of floats, by the number of the map."""
        self._shown: dict[int, int] = {}
        """The number of the map in each image, by its session_uid."""

    @property
    def number(self) -> int:
        """The number of maps that are held."""
        return len(self._maps)

    def hold(self) -> None:
        """Hold the maps in memory that are new. The oldest ones go if there are too many."""
        for image in _in_memory():
            number = image[UNPACKED]
            if number not in self._maps and image.is_dirty:
                texels = np.empty((image.size[1], image.size[0], 4), np.float32)
                image.pixels.foreach_get(texels.reshape(-1))
                self._maps[number] = texels, image.is_float
            self._shown[image.session_uid] = number
        while len(self._maps) > 1 and sum(texels.nbytes for texels, _ in self._maps.values()) > MOST_HELD:
            del self._maps[next(iter(self._maps))]

    def put_back(self) -> None:
        """Fill the images that have no pixels, or those of another step."""
        for image in _in_memory():
            number = image[UNPACKED]
            is_there = image.is_dirty and self._shown.get(image.session_uid) == number
            if number in self._maps and not is_there:
                texels, is_float = self._maps[number]
                datablocks.refill(image, texels, is_float=is_float)
                self._shown[image.session_uid] = number

    def forget(self) -> None:
        """Hold nothing."""
        self._maps.clear()
        self._shown.clear()


def _in_memory() -> list[bpy.types.Image]:
    return [] if live.is_on else [image for image in bpy.data.images if image.get(UNPACKED) and not image.library]


held = HeldMaps()


@persistent  # these stay for the next file
def before_saving(*_) -> None:
    """Called by Blender before it saves a file, which would have an empty image in place of a map in memory."""
    datablocks.pack_unpacked()


@persistent
def after_undo(*_) -> None:
    """Called by Blender after Undo and Redo."""
    held.put_back()


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


_handlers = Handlers(("save_pre", before_saving), ("undo_post", after_undo), ("redo_post", after_undo))


def register() -> None:
    _handlers.add()
    if not bpy.app.background:  # there the next bake of a batch starts soon
        idle_memory.timer.start(EVERY, persistent=True)


def unregister() -> None:
    idle_memory.timer.stop()
    _handlers.remove()
    held.forget()
