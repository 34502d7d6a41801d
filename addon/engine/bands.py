# SPDX-License-Identifier: GPL-3.0-or-later
"""Large maps are drawn in bands of rows, one after another: where these lie, and what draws them."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace

import gpu
import numpy as np

from ..core import udim
from ..core.progress import Task
from ..core.udim import UvToClip
from ..passes import allocation, data_texture

BAND_TEXELS = 4096 * 4096
"""A larger map is drawn in bands of rows, so that no texture on the GPU has more texels than this."""
LEAST_ROWS = 64
"""Of a band, however little memory there is."""
REACH = 64
"""Texels. A margin up to this width is drawn band by band. A wider one is completed from the whole map."""


@dataclass(frozen=True)
class Band:
    """Rows `start` to `stop` of a map of `size`, drawn with `halo` more rows on either side for the margin.

    Attributes:
        tile: Its UDIM number.
        offset: From the center of each texel to its sample, in texels.
    """

    start: int
    stop: int
    size: tuple[int, int]
    halo: int
    tile: int = udim.FIRST
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
    def without_halo(self) -> "Band":
        """The same rows alone."""
        return replace(self, halo=0)

    @property
    def uv_to_clip(self) -> UvToClip:
        """As udim.uv_to_clip, to the band's clip space."""
        x, y = self.offset
        return udim.uv_to_clip(self.tile, self.size, (x, self.start - self.halo + y), (self.width, self.height))


def bands(
    width: int,
    height: int,
    margin_texels: int | None,
    tile: int = udim.FIRST,
    *,
    texel_bytes: int = 1,
    most_rows: int | None = None,
) -> Iterator[Band]:
    """Cut a map into bands that are contiguous in memory: whole rows, at most BAND_TEXELS without the halo.

    Args:
        texel_bytes: as core.preflight.texel_bytes returns them. With the halo, bands fit the budget of passes.allocation.
        most_rows: without the halo; None for no such limit.
    """
    within = allocation.budget() // (width * texel_bytes)
    rows = max(1, min(BAND_TEXELS // width, most_rows or height))
    if min(rows, within) >= height:
        yield Band(0, height, (width, height), 0, tile)
        return
    # The search covers a square: the nearest texel may be in its corner, sqrt(2) times as far as its side.
    halo = math.ceil(math.sqrt(2.0) * min(REACH if margin_texels is None else margin_texels, REACH))
    rows = min(rows, max(within - 2 * halo, LEAST_ROWS))
    for start in range(0, height, rows):
        yield Band(start, min(start + rows, height), (width, height), halo, tile)


class BandMaps(ABC):
    """Draws all maps of a band."""

    takes_time = False
    """Whether a coarse picture is worth its time."""
    texel_bytes = 6 * 16
    """As core.preflight.texel_bytes returns them; of maps that are read from images."""
    most_rows: int | None = None
    """Of a band, once the GPU has refused memory for more."""
    stopped: np.ndarray | None = None
    """Which texels (rows, width) bool of the last band, without its halo, took fewer samples than the settings say; None if
    none did."""

    @abstractmethod
    def of(self, band: Band) -> Task[Iterator[tuple[str, gpu.types.GPUTexture]]]:
        """The names and textures (RGBA32F) of the maps. Each texture is valid until the next one is asked for."""

    def coarse(self, _tile: int) -> Task[None]:
        """A first, coarse picture of the whole map, if `takes_time`."""
        yield from ()


class DrawnMaps(BandMaps):
    """Maps that were drawn before, by name: (height, width, 4) float32, as Renderer.raw returns them."""

    def __init__(self, maps: dict[str, np.ndarray]):
        self.maps = maps

    def of(self, band: Band) -> Task[Iterator[tuple[str, gpu.types.GPUTexture]]]:
        yield from ()
        return ((name, upload_band(values, band)) for name, values in self.maps.items())


def upload_band(values: np.ndarray, band: Band) -> gpu.types.GPUTexture:
    """The rows of a map (height, width, 4) float32 that a band shows, with its halo. Rows outside the map are 0."""
    texels = np.zeros((band.height, band.width, 4), np.float32)
    first, last = band.start - band.halo, band.stop + band.halo
    rows = slice(max(0, first), min(last, len(values)))
    texels[rows.start - first : rows.stop - first] = values[rows]
    return data_texture.image(texels)
