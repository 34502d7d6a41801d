# SPDX-License-Identifier: GPL-3.0-or-later
"""Large maps are drawn in bands of rows, one after another."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

BAND_TEXELS = 4096 * 4096
"""A larger map is drawn in bands of rows, so that the GPU holds a few textures of this many texels at the most."""
REACH = 64
"""Texels: how wide a margin is drawn band by band. A wider one is completed from the whole map."""


@dataclass(frozen=True)
class Band:
    """Rows `start` to `stop` of a map of `size`, drawn with `halo` rows more on either side for the margin.

    tile: its UDIM number. offset: where in its texel a sample lies, from the centre, in texels.
    """

    start: int
    stop: int
    size: tuple[int, int]
    halo: int
    tile: int = 1001
    offset: tuple[float, float] = (0.0, 0.0)

    @property
    def width(self) -> int:
        return self.size[0]

    @property
    def height(self) -> int:
        return self.stop - self.start + 2 * self.halo

    @property
    def is_whole(self) -> bool:
        """Whether it is the whole map."""
        return (self.start, self.stop) == (0, self.size[1])

    @property
    def window(self) -> tuple[float, float, float, float]:
        """From uv to the band's clip space: xy scale, zw offset."""
        (width, total), (x, y) = self.size, self.offset
        column, row = (self.tile - 1001) % 10, (self.tile - 1001) // 10
        first = self.start - self.halo + y + row * total
        return 2.0, 2.0 * total / self.height, -2.0 * (x / width + column) - 1.0, -2.0 * first / self.height - 1.0


def bands(width: int, height: int, margin_texels: int | None, tile: int = 1001) -> Iterator[Band]:
    """Cut a map into bands that are contiguous in memory: whole rows, at most BAND_TEXELS without the halo."""
    rows = max(1, BAND_TEXELS // width)
    if rows >= height:
        yield Band(0, height, (width, height), 0, tile)
        return
    # What is nearest to a texel of the margin may be as far away as its square of reach is wide at the corner.
    halo = math.ceil(math.sqrt(2.0) * min(REACH if margin_texels is None else margin_texels, REACH))
    for start in range(0, height, rows):
        yield Band(start, min(start + rows, height), (width, height), halo, tile)
