# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs the passes in order, band by band, to arrays of texels."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator

import gpu
import numpy as np

from ..core.map_types import NORMAL, WRITTEN, Map
from ..core.progress import Task, part
from ..core.settings import Run
from ..passes import target
from .bands import Band, bands
from .margins import PostProcess


class BandMaps(ABC):
    """Draws all maps of a band."""

    takes_time = False
    """Whether a coarse picture is worth its time."""
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
    data = gpu.types.Buffer("FLOAT", texels.shape, texels)
    return gpu.types.GPUTexture((band.width, band.height), format="RGBA32F", data=data)


class Renderer:
    """Draws the maps of one bake, tile by tile: the normal map and the maps in the settings.

    stopped: how many texels that were written took fewer samples than the settings say, so far.
    """

    def __init__(self, maps: BandMaps, run: Run):
        self.maps, self.stopped = maps, 0
        self.settings, self.timings, self.pace = run.settings, run.timings, run.pace

    def texels(self, tile: int, post_processes: dict[str, PostProcess]) -> Task[dict[str, Map]]:
        """The maps of a tile by name, as they are stored."""
        size = self.settings.sampling.height, self.settings.sampling.width
        maps = {name: (np.empty((*size, 4), np.float32), np.empty(size, np.uint8)) for name in post_processes}

        def keep(name: str, band: Band, drawn: gpu.types.GPUTexture) -> None:
            with self.timings.timed("draw"):
                stored = post_processes[name].draw(band, drawn)
                stored.finish()
            with self.timings.timed("read"):
                texels, state = (array[band.start : band.stop] for array in maps[name])
                stored.read(texels)
                stored.read(state, 1)
            self._count(name, state, WRITTEN)

        yield from self._banded(tile, self.settings.sampling.margin, keep)
        with self.timings.timed("draw"):
            for name, process in post_processes.items():
                process.complete(tile, *maps[name])
        return maps

    def values(self, tile: int) -> Task[gpu.types.GPUTexture]:
        """The values of a bake of one map that is one band, without encoding and margin. The texture is in the current pool."""
        found = []
        yield from self._banded(tile, self.settings.sampling.margin, lambda _name, _band, drawn: found.append(drawn))
        (drawn,) = found
        return drawn

    def raw(self, tile: int) -> Task[dict[str, np.ndarray]]:
        """The maps of a tile by name, without encoding and margin: (height, width, 4) float32, alpha as in sources.Source."""
        settings = self.settings
        maps = {
            name: np.empty((settings.sampling.height, settings.sampling.width, 4), np.float32)
            for name in (NORMAL.name, *settings.map.drawn_maps)
        }

        def keep(name: str, band: Band, drawn: gpu.types.GPUTexture) -> None:
            with self.timings.timed("read"):
                texels = maps[name][band.start : band.stop]
                target.read(drawn, texels)
            self._count(name, texels[..., 3], 1.0)

        yield from self._banded(tile, 0, keep)
        return maps

    def _count(self, name: str, known: np.ndarray, written: float) -> None:
        """Count the texels of a band that are `written` among `known` (rows, width)."""
        if name == NORMAL.name and self.maps.stopped is not None:
            self.stopped += int(np.count_nonzero((known == written) & self.maps.stopped))

    def _banded(
        self, tile: int, margin: int | None, keep: Callable[[str, Band, gpu.types.GPUTexture], None]
    ) -> Task[None]:
        settings = self.settings
        parts = list(bands(settings.sampling.width, settings.sampling.height, margin, tile))
        if self.pace.has_listener and self.pace.has_picture and self.maps.takes_time:
            yield from part(self.maps.coarse(tile), 0.0, 0.0)
        for number, band in enumerate(parts):
            maps = yield from part(self.maps.of(band), number / len(parts), (number + 1) / len(parts))
            for name, drawn in maps:
                keep(name, band, drawn)
