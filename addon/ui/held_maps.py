# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps in memory that survive saving, Undo and Redo."""

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ..core import foreach
from ..jobs import map_contents
from ..output import datablocks
from ..output.datablocks import UNPACKED
from .callbacks import events
from .live import live

MOST_HELD = 1 << 30
"""The most bytes of maps in memory that are held for Undo and Redo."""


class HeldMaps:
    """Holds the pixels of maps in memory: Undo and Redo restore the images without them. Live draws its maps again."""

    def __init__(self):
        self._maps: dict[int, tuple[np.ndarray, bool]] = {}
        """The pixels (height, width, 4) float32, and whether the image is one of floats, by the number of the map."""
        self._are_left_alone = False
        self._shown: dict[int, int] = {}
        """The number of the map in each image, by its session_uid."""
        events.hear(save_pre=self._before_saving, undo_post=self.put_back, redo_post=self.put_back, end=self.forget)

    @property
    def number(self) -> int:
        """The number of maps that are held."""
        return len(self._maps)

    def hold(self) -> None:
        """Hold the maps in memory that are new. The oldest ones go if there are too many."""
        for image in _in_memory():
            number = image[UNPACKED]
            if number not in self._maps and image.is_dirty:
                texels = foreach.pixels(image)
                self._maps[number] = texels, image.is_float
            self._shown[image.session_uid] = number
        while len(self._maps) > 1 and sum(texels.nbytes for texels, _ in self._maps.values()) > MOST_HELD:
            del self._maps[next(iter(self._maps))]

    def put_back(self, *_) -> None:
        """Fill the images that have no pixels, or those of another step."""
        for image in _in_memory():
            number = image[UNPACKED]
            is_there = image.is_dirty and self._shown.get(image.session_uid) == number
            if number in self._maps and not is_there:
                texels, is_float = self._maps[number]
                datablocks.refill(image, texels, is_float=is_float)
                self._shown[image.session_uid] = number

    def _before_saving(self, *_) -> None:
        """A file would have an empty image in place of a map in memory."""
        if not self._are_left_alone:
            map_contents.pack_unpacked()

    @contextmanager
    def left_alone(self) -> Iterator[None]:
        """Leave the maps in memory while a copy is saved that has no use for them."""
        self._are_left_alone = True
        try:
            yield
        finally:
            self._are_left_alone = False

    def forget(self) -> None:
        """Hold nothing."""
        self._maps.clear()
        self._shown.clear()


def _in_memory() -> list[bpy.types.Image]:
    return [] if live.is_on else [image for image in bpy.data.images if image.get(UNPACKED) and not image.library]


held = HeldMaps()
