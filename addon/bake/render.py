# SPDX-License-Identifier: GPL-3.0-or-later
"""The passes in their order, band by band, from arrays of meshes to an array of texels."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import gpu
import numpy as np

from ..mesh.arrays import Mesh, normal_matrix
from ..passes import batch, cast, flatten, gbuffer, picture, samples, tangent, target
from . import casting
from .finish import Finish, channels
from .pace import Pace, Step, Work, part
from .report import Report
from .settings import Settings

BAND_TEXELS = 4096 * 4096
"""A larger map is drawn in bands of rows, so that the GPU holds a few textures of this many texels at the most."""


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
    halo = height if margin_texels is None else min(margin_texels, height)
    for start in range(0, height, rows):
        yield Band(start, min(start + rows, height), (width, height), halo, tile)


Source = Callable[[Band], Iterator[tuple[gpu.types.GPUTexture, range]]]
"""Draws a band's unit normals, in world space or the low object's: RGBA32F, alpha 1 written, 0 nothing, -1 missed.

In slices: each step gives the texture and the rows of it that have become ready.
"""
Map = tuple[np.ndarray, np.ndarray]
"""Texels (height, width, 4) float32 as they are stored, and their state (height, width) uint8, one of resolve.WRITTEN,
MARGIN, MISSED and 0; row 0 is v = 0."""
COARSE = 8
"""How many times smaller the first picture of a map is that takes its time."""


def flatten_source(low: Mesh, highs: Sequence[Mesh], settings: Settings, report: Report) -> Source:
    """Normals by drawing `highs` in UV space."""
    to_world = None if settings.space == "WORLD" else low.to_world
    with report.timed("upload"):
        drawn = [
            (batch.upload(high.triangles, uv=high.uv, normal=high.normals), normal_matrix(high.to_world, to_world))
            for high in highs
        ]

    def draw(band: Band) -> Iterator[tuple[gpu.types.GPUTexture, range]]:
        normals = target.get("high", band.width, band.height, "RGBA32F")
        flatten.draw(normals, drawn, band.window)
        yield normals.texture, range(band.height)

    return draw


def cast_source(
    low: Mesh, rays, aim: casting.Target, settings: Settings, pace: Pace, *, extrusion: float, reach: float
) -> Source:
    """Normals by casting `rays` at `aim`; extrusion and reach in the units of its frame."""
    to_space = np.eye(3) if settings.space == "WORLD" else low.to_world[:3, :3].T / np.abs(low.to_world[:3, :3]).max()

    def draw(band: Band) -> Iterator[tuple[gpu.types.GPUTexture, range]]:
        size = band.width, band.height
        places = target.get("rays", *size, "RGBA32F", "RGBA32F")
        gbuffer.draw(places, rays, band.window)
        hits = target.get("hits", *size, "RGBA32UI")
        normals = target.get("high", *size, "RGBA32F")
        if pace.is_sliced:
            target.clear(normals)  # what is not drawn yet must not be seen
        for rows in pace.slices(band.height):
            cast.trace(
                hits,
                places,
                aim.tables,
                heading=-1.0,
                back=extrusion,
                reach=reach,
                facing_only=settings.facing_only,
                rows=rows,
            )
            cast.look_up(normals, hits, places, aim.tables, to_space, rows=rows)
            yield normals.texture, rows

    return draw


def array_source(normals: np.ndarray) -> Source:
    """Normals that were drawn before, (height, width, 4) float32, as `normals` returns them."""

    def draw(band: Band) -> Iterator[tuple[gpu.types.GPUTexture, range]]:
        values = np.zeros((band.height, band.width, 4), np.float32)
        first, last = band.start - band.halo, band.stop + band.halo
        kept = slice(max(0, first), min(last, len(normals)))
        values[kept.start - first : kept.stop - first] = normals[kept]
        data = gpu.types.Buffer("FLOAT", values.shape, values)
        yield gpu.types.GPUTexture((band.width, band.height), format="RGBA32F", data=data), range(band.height)

    return draw


class Renderer:
    """Draws the maps of one bake, in the tangent space of `basis` if there is one, tile by tile."""

    def __init__(self, source: Source, basis: Mesh | None, settings: Settings, report: Report, pace: Pace):
        self.source, self.settings, self.report, self.pace = source, settings, report, pace
        self.basis = None
        if basis is not None:
            with report.timed("upload"):
                self.basis = batch.upload(basis.triangles, uv=basis.uv, normal=basis.normals, tangent=basis.tangents)

    def texels(self, tile: int, finish: Finish) -> Work[Map]:
        """What is to be stored of a tile."""
        settings = self.settings
        result = np.empty((settings.height, settings.width, 4), np.float32)
        state = np.empty((settings.height, settings.width), np.uint8)

        def keep(band: Band, normals: gpu.types.GPUTexture) -> None:
            with self.report.timed("draw"):
                stored = finish.draw(band, normals)
                stored.finish()
            with self.report.timed("read"):
                stored.read(result[band.start : band.stop])
                stored.read(state[band.start : band.stop], slot=1)

        yield from self._banded(tile, settings.margin, keep)
        return result, state

    def normals(self, tile: int) -> Work[np.ndarray]:
        """The normals of a tile in all their samples, (height, width, 4) float32, without a margin; alpha as in Source."""
        settings = self.settings
        result = np.empty((settings.height, settings.width, 4), np.float32)

        def keep(band: Band, normals: gpu.types.GPUTexture) -> None:
            with self.report.timed("read"):
                target.read(normals, result[band.start : band.stop])

        yield from self._banded(tile, 0, keep)
        return result

    def _banded(self, tile: int, margin: int | None, keep) -> Work[None]:
        settings = self.settings
        parts = list(bands(settings.width, settings.height, margin, tile))
        if self.pace.is_sliced:
            yield from part(self._coarse(tile), 0.0, 0.0)
        for number, band in enumerate(parts):
            normals = yield from part(self._sampled(band), number / len(parts), (number + 1) / len(parts))
            keep(band, normals)

    def _coarse(self, tile: int) -> Work[None]:
        """A first look at the whole."""
        settings = self.settings
        size = max(1, settings.width // COARSE), max(1, settings.height // COARSE)
        for normals, _ in self._drawn(Band(0, size[1], size, 0, tile)):
            yield self._step(normals, 0.0, clear=True)

    def _drawn(self, band: Band) -> Iterator[tuple[gpu.types.GPUTexture, range]]:
        """One sample of a band in the wanted space, slice by slice."""
        settings = self.settings
        drawn = self.source(band)
        while True:
            with self.report.timed("draw"):
                normals, rows = next(drawn, (None, None))
                if normals is None:
                    return
                if self.basis is not None:
                    turned = target.get("low", band.width, band.height, "RGBA32F")
                    blender = settings.basis == "BLENDER"
                    tangent.draw(turned, self.basis, normals, band.window, normalize_normal=blender, rows=rows)
                    normals = turned.texture
            yield normals, rows

    def _sampled(self, band: Band) -> Work[gpu.types.GPUTexture]:
        """The normals of a band in all its samples."""
        settings, normals = self.settings, None
        sums = target.get("sums", band.width, band.height, "RGBA32F") if settings.samples > 1 else None
        if sums is not None and self.pace.is_sliced:
            target.clear(sums)  # what is not drawn yet must not be seen
        places = samples.offsets(settings.samples)
        for number, offset in enumerate(places):
            for drawn, rows in self._drawn(replace(band, offset=offset)):
                normals = drawn
                if sums is not None:
                    samples.add(sums, drawn, rows, is_first=number == 0)
                if self.pace.is_sliced:
                    yield self._step(sums.texture if sums else drawn, (number + rows.stop / band.height) / len(places))
        if sums is None:
            return normals
        averaged = target.get("high", band.width, band.height, "RGBA32F")
        with self.report.timed("draw"):
            samples.average(averaged, sums)
        return averaged.texture

    def _step(self, normals: gpu.types.GPUTexture, done: float, *, clear: bool = False) -> Step:
        size = self.settings.width, self.settings.height
        return Step("Drawing", done, picture.draw(normals, size, channels(self.settings), clear=clear))
