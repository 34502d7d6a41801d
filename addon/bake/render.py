# SPDX-License-Identifier: GPL-3.0-or-later
"""The passes in their order, band by band, from arrays of meshes to an array of texels."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..mesh.arrays import Mesh, normal_matrix
from ..passes import batch, cast, flatten, gbuffer, margin, resolve, samples, tangent, target
from . import casting
from .report import Report
from .settings import Settings

BAND_TEXELS = 4096 * 4096
"""A larger map is drawn in bands of rows, so that the GPU holds a few textures of this many texels at the most."""


@dataclass(frozen=True)
class Band:
    """Rows `start` to `stop` of a map of `size`, drawn with `halo` rows more on either side for the margin.

    offset: where in its texel a sample lies, from the centre, in texels.
    """

    start: int
    stop: int
    size: tuple[int, int]
    halo: int
    offset: tuple[float, float] = (0.0, 0.0)

    @property
    def height(self) -> int:
        return self.stop - self.start + 2 * self.halo

    @property
    def window(self) -> tuple[float, float, float, float]:
        """From uv to the band's clip space: xy scale, zw offset."""
        (width, total), (x, y) = self.size, self.offset
        first = self.start - self.halo + y
        return 2.0, 2.0 * total / self.height, -2.0 * x / width - 1.0, -2.0 * first / self.height - 1.0


def bands(width: int, height: int, margin_texels: int) -> Iterator[Band]:
    """Cut a map into bands that are contiguous in memory: whole rows, at most BAND_TEXELS without the halo."""
    rows = max(1, BAND_TEXELS // width)
    if rows >= height:
        yield Band(0, height, (width, height), 0)
        return
    margin_texels = min(margin_texels, height)
    for start in range(0, height, rows):
        yield Band(start, min(start + rows, height), (width, height), margin_texels)


Source = Callable[[Band], target.Target]
"""Draws a band's unit normals, in world space or the low object's: RGBA32F, alpha 1 written, 0 nothing, -1 missed."""


def flatten_source(low: Mesh, highs: Sequence[Mesh], settings: Settings, report: Report) -> Source:
    """Normals by drawing `highs` in UV space."""
    to_world = None if settings.space == "WORLD" else low.to_world
    with report.timed("upload"):
        drawn = [
            (batch.upload(high.triangles, uv=high.uv, normal=high.normals), normal_matrix(high.to_world, to_world))
            for high in highs
        ]

    def draw(band: Band) -> target.Target:
        normals = target.get("high", settings.width, band.height, "RGBA32F")
        flatten.draw(normals, drawn, band.window)
        return normals

    return draw


def cast_source(low: Mesh, rays, aim: casting.Target, settings: Settings, *, extrusion: float, reach: float) -> Source:
    """Normals by casting `rays` at `aim`; extrusion and reach in the units of its frame."""
    to_space = np.eye(3) if settings.space == "WORLD" else low.to_world[:3, :3].T / np.abs(low.to_world[:3, :3]).max()

    def draw(band: Band) -> target.Target:
        size = settings.width, band.height
        places = target.get("rays", *size, "RGBA32F", "RGBA32F")
        gbuffer.draw(places, rays, band.window)
        hits = target.get("hits", *size, "RGBA32UI")
        cast.trace(
            hits, places, aim.tables, heading=-1.0, back=extrusion, reach=reach, facing_only=settings.facing_only
        )
        normals = target.get("high", *size, "RGBA32F")
        cast.look_up(normals, hits, places, aim.tables, to_space)
        return normals

    return draw


def texels(source: Source, basis: Mesh | None, settings: Settings, report: Report) -> tuple[np.ndarray, np.ndarray]:
    """The map of what `source` draws, in the tangent space of `basis` if there is one.

    Returns the texels (height, width, 4) float32 as they are stored, and their state (height, width) uint8, one of
    resolve.WRITTEN, MARGIN, MISSED and 0; row 0 is v = 0.
    """
    width, height = settings.width, settings.height
    with report.timed("upload"):
        spanned = basis and batch.upload(basis.triangles, uv=basis.uv, normal=basis.normals, tangent=basis.tangents)
    result = np.empty((height, width, 4), np.float32)
    state = np.empty((height, width), np.uint8)
    for band in bands(width, height, settings.margin):
        size = width, band.height
        with report.timed("draw"):
            normals = _sampled(band, source, spanned, settings)
            offsets = target.get("margin", *size, "R16I")
            margin.draw(offsets, normals, settings.margin)
            stored = target.get("map", width, band.stop - band.start, "RGBA32F", "R8")
            resolve.draw(
                stored,
                normals,
                offsets,
                halo=band.halo,
                margin=settings.margin,
                flip_green=settings.green == "-Y",
                missed=settings.missed,
            )
            stored.finish()
        with report.timed("read"):
            stored.read(result[band.start : band.stop])
            stored.read(state[band.start : band.stop], slot=1)
    return result, state


def _sampled(band: Band, source: Source, spanned, settings: Settings) -> target.Target:
    """The normals of a band as they are to be stored, in all their samples."""
    size = settings.width, band.height
    sums = target.get("sums", *size, "RGBA32F") if settings.samples > 1 else None
    for number, offset in enumerate(samples.offsets(settings.samples)):
        sample = replace(band, offset=offset)
        normals = source(sample)
        if spanned is not None:
            turned = target.get("low", *size, "RGBA32F")
            blender = settings.basis == "BLENDER"
            tangent.draw(turned, spanned, normals.texture, sample.window, normalize_normal=blender)
            normals = turned
        if sums is not None:
            samples.add(sums, normals, is_first=number == 0)
    if sums is not None:
        samples.average(normals, sums)
    return normals
