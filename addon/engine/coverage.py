# SPDX-License-Identifier: GPL-3.0-or-later
"""Which texels low meshes cover, those on which a bake of them may write, and with how many triangles."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..core import udim
from ..core.recent import Recent
from ..core.settings import SamplingSettings
from ..core.udim import UvToClip
from ..mesh.triangle_mesh import Mesh
from ..passes import audit, low_in_uv, mesh_upload, samples, target
from .bands import bands

TEXEL_BYTES = 2 * 16
"""Of the targets."""


def covered(lows: Sequence[Mesh], tile: int, sampling: SamplingSettings) -> np.ndarray:
    """The texels (height, width) bool of a tile that one of the samples of a bake of these meshes, with UVs, is on."""
    covered_texels = np.zeros(sampling.size[::-1], bool)
    for low in lows:
        points = np.take(low.positions, low.vertices, axis=0)
        batch = mesh_upload.upload(low.triangles, uv=low.uv, position=points, direction=low.normals)
        for band in bands(*sampling.size, 0, tile, texel_bytes=TEXEL_BYTES):
            drawn = target.get("covered", band.width, band.height, "RGBA32F", "RGBA32F")
            for offset in samples.offsets(sampling.samples):
                low_in_uv.draw_points(drawn, batch, replace(band, offset=offset).uv_to_clip)
                covered_texels[band.start : band.stop] |= drawn.texels()[..., 3] > 0.0
    return covered_texels


@dataclass(frozen=True)
class Sparse:
    """A map of `size` (width, height) in texels, on which every `steps`-th texel along u and v is checked."""

    size: tuple[int, int]
    steps: tuple[int, int]

    @property
    def small(self) -> tuple[int, int]:
        """How many texels along u and v are checked."""
        return -(-self.size[0] // self.steps[0]), -(-self.size[1] // self.steps[1])

    def uv_to_clip(self, tile: int, shift: int = 0) -> UvToClip:
        """As udim.uv_to_clip. Texel i of the small map lies on texel i * step + shift of the map."""
        (step_u, step_v), (count_u, count_v) = self.steps, self.small
        start = (1 - step_u) / 2 + shift, (1 - step_v) / 2 + shift
        return udim.uv_to_clip(tile, self.size, start, (step_u * count_u, step_v * count_v))


def at_most(size: tuple[int, int], most: int) -> Sparse:
    """A map of `size` on which at most `most` texels a side are checked."""
    return Sparse(size, (-(-size[0] // most), -(-size[1] // most)))


SAMPLES_A_SIDE = 1024
"""Texels a side, at most, on which overlaps are counted."""


def sampled(size: tuple[int, int]) -> Sparse:
    """The texels of a map of width and height that are checked, evenly spaced: at most SAMPLES_A_SIDE a side."""
    return at_most(size, SAMPLES_A_SIDE)


FEW_TILES = 4
"""Of more tiles, counts are not remembered for other bakes: each takes up to 1 MiB."""
known: Recent[list[np.ndarray]] = Recent(4)
"""Counts of triangles by the checksums of layouts, the size of the map and the tiles."""


def counts(low: Mesh, size: tuple[int, int], tiles: Sequence[int] = (udim.FIRST,)) -> list[np.ndarray]:
    """How many triangles of `low` cover each texel that `sampled` selects, tile by tile, (height, width) uint8; 255 for more.

    size: of the map. The order of triangles is decided by them, and the checks tell them, so that they are remembered: with
    the mesh, and for a few tiles for the next bake of a mesh with the same layout.
    """
    return low.remembered(f"counts {size} {tuple(tiles)}", (), partial(_counts, low, size, tuple(tiles)))


def _counts(low: Mesh, size: tuple[int, int], tiles: tuple[int, ...]) -> list[np.ndarray]:
    key = (*low.checksums("uv", "triangles"), size, tiles)
    counted = known.get(key)
    if counted is None:
        uploaded, sparse = mesh_upload.upload(low.triangles, uv=low.uv), sampled(size)
        counted = [audit.counts(uploaded, sparse.small, sparse.uv_to_clip(tile)) for tile in tiles]
        if len(tiles) <= FEW_TILES:
            known[key] = counted
    return counted
