# SPDX-License-Identifier: GPL-3.0-or-later
"""The passes in their order, band by band, from arrays of meshes to an array of texels."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..mesh.arrays import Mesh, normal_matrix
from ..passes import batch, flatten, margin, resolve, tangent, target
from .report import Report
from .settings import Settings

BAND_TEXELS = 4096 * 4096
"""A larger map is drawn in bands of rows, so that the GPU holds a few textures of this many texels at the most."""


@dataclass(frozen=True)
class Band:
    """Rows `start` to `stop` of a map `total` high, drawn with `halo` rows more on either side for the margin."""

    start: int
    stop: int
    total: int
    halo: int

    @property
    def height(self) -> int:
        return self.stop - self.start + 2 * self.halo

    @property
    def window(self) -> tuple[float, float, float, float]:
        """From uv to the band's clip space: xy scale, zw offset."""
        scale = 2.0 * self.total / self.height
        return 2.0, scale, -1.0, -2.0 * (self.start - self.halo) / self.height - 1.0


def bands(width: int, height: int, margin_texels: int) -> Iterator[Band]:
    """Cut a map into bands that are contiguous in memory: whole rows, at most BAND_TEXELS without the halo."""
    rows = max(1, BAND_TEXELS // width)
    if rows >= height:
        yield Band(0, height, height, 0)
        return
    for start in range(0, height, rows):
        yield Band(start, min(start + rows, height), height, margin_texels)


def flattened(low: Mesh, highs: Sequence[Mesh], settings: Settings, report: Report) -> tuple[np.ndarray, np.ndarray]:
    """Draw `highs` in UV space.

    Returns the texels (height, width, 4) float32 as they are stored, and their state (height, width) uint8, one of
    resolve.WRITTEN, resolve.MARGIN and 0; row 0 is v = 0.
    """
    to_world = None if settings.space == "WORLD" else low.to_world
    with report.timed("upload"):
        drawn = [
            (batch.upload(high.triangles, uv=high.uv, normal=high.normals), normal_matrix(high.to_world, to_world))
            for high in highs
        ]
        basis = None
        if settings.space == "TANGENT":
            basis = batch.upload(low.triangles, uv=low.uv, normal=low.normals, tangent=low.tangents)
    width, height = settings.width, settings.height
    texels = np.empty((height, width, 4), np.float32)
    state = np.empty((height, width), np.uint8)
    for band in bands(width, height, settings.margin):
        with report.timed("draw"):
            normals = target.get("high", width, band.height, "RGBA32F")
            flatten.draw(normals, drawn, band.window)
            if basis is not None:
                turned = target.get("low", width, band.height, "RGBA32F")
                blender = settings.basis == "BLENDER"
                tangent.draw(turned, basis, normals.texture, band.window, normalize_normal=blender)
                normals = turned
            offsets = target.get("margin", width, band.height, "R16I")
            margin.draw(offsets, normals, settings.margin)
            stored = target.get("map", width, band.height, "RGBA32F", "R8")
            resolve.draw(
                stored,
                normals,
                offsets,
                halo=band.halo,
                margin=settings.margin,
                flip_green=settings.green == "-Y",
            )
            stored.finish()
        with report.timed("read"):
            stored.read(texels[band.start : band.stop])
            stored.read(state[band.start : band.stop], slot=1)
    return texels, state
