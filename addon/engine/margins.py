# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the margin around UV islands, and encodes values as they are stored: the last passes over a band."""

from collections.abc import Sequence

import gpu
import numpy as np

from ..core.declarations.choices import MarginType, Space
from ..core.map_types import BY_NAME, NORMAL, Kind
from ..core.settings import SamplingSettings, Settings
from ..mesh import uv_seams
from ..mesh.triangle_mesh import Mesh
from ..passes import target
from ..passes.margin import margin_fill, margin_search, seam_fill
from . import large_map_margin
from .bands import REACH, Band, bands
from .normal_channels import channels


class Borders:
    """The borders of islands, on one UDIM tile at a time. Several maps may share it."""

    def __init__(self, found: uv_seams.Seams, settings: SamplingSettings):
        self.found = found
        self.size = settings.size
        self.tile = None

    def on(self, tile: int) -> "Borders":
        """These borders, prepared for a tile: `similarities` as uv_seams.Seams returns them, and `uploaded`."""
        if tile != self.tile:
            self.similarities = self.found.similarities(self.size, tile)
            self.uploaded = seam_fill.upload(*self.found.strips(self.size, tile), self.similarities)
            self.tile = tile
        return self


class PostProcess:
    """Encodes the values of one map and draws its margin.

    kind: of the values, a constant of seam_fill. A normal n is stored as 0.5 n + 0.5, other values as they are. borders: for
    a margin that continues the adjacent faces; None for a margin of the nearest texels.
    """

    def __init__(self, settings: Settings, kind: int, borders: Borders | None = None):
        self.settings, self.kind, self.borders = settings, kind, borders
        self.encode = np.eye(4)
        if kind in (seam_fill.NORMAL, seam_fill.TANGENT):
            self.encode[:3, :3], self.encode[:3, 3] = channels(settings.map) * 0.5, 0.5

    def draw(self, band: Band, values: gpu.types.GPUTexture) -> target.Target:
        """The stored texels (RGBA32F) and their state (R8) of the band without its halo, from `values` with it.

        Call `complete` after the last band of a map that has several.
        """
        return self.fill(band, values, self.search(band, values))

    def search(self, band: Band, values: gpu.types.GPUTexture) -> margin_search.Nearest:
        """The texels that the margin of `values` repeats."""
        return margin_search.search(values, self.settings.sampling.margin if band.is_whole else self._near)

    def fill(self, band: Band, values: gpu.types.GPUTexture, nearest: margin_search.Nearest) -> target.Target:
        """As `draw`. nearest: what `search` returned for values that are written on the same texels."""
        stored = target.get("map", band.width, band.stop - band.start, "RGBA32F", "R8")
        margin_fill.draw(
            stored,
            values,
            nearest,
            halo=band.halo,
            encode=self.encode,
            missed=self.settings.map.missed,
        )
        if self.borders:
            seam_fill.draw(
                stored,
                values,
                nearest,
                self.borders.on(band.tile).uploaded,
                band.uv_to_clip,
                halo=band.halo,
                reach=self._near,
                kind=self.kind,
                encode=self.encode,
                is_deferred=not band.is_whole,
            )
        return stored

    @property
    def _near(self) -> int:
        """The width of the margin that is drawn band by band, in texels."""
        return REACH if self.settings.sampling.margin is None else min(self.settings.sampling.margin, REACH)

    def complete(self, tile: int, texels: np.ndarray, state: np.ndarray) -> None:
        """Fill the margin that needs several bands. texels (height, width, 4) float32, state (height, width) uint8: changed
        in place."""
        height, width = state.shape
        if next(bands(width, height, None)).is_whole:
            return
        if self.borders:
            large_map_margin.across(texels, state, self.borders.on(tile).similarities, self.kind, self.encode)
        if self.settings.sampling.margin is None or self.settings.sampling.margin > REACH:
            large_map_margin.beyond(texels, state, self.settings.sampling.margin)


def for_maps(lows: Sequence[Mesh], settings: Settings) -> dict[str, PostProcess]:
    """A PostProcess for each map of a bake, by name. lows: the meshes whose islands are on the map."""
    borders = None
    if settings.sampling.margin_type == MarginType.ADJACENT_FACES and settings.sampling.margin != 0:
        found = uv_seams.find(lows)
        borders = Borders(found, settings.sampling) if len(found.side) else None
    normal = seam_fill.TANGENT if settings.map.space == Space.TANGENT else seam_fill.NORMAL
    of_kind = {Kind.NORMAL: normal, Kind.VALUE: seam_fill.VALUE, Kind.LABEL: seam_fill.LABEL}
    kinds = {name: of_kind[BY_NAME[name].kind] for name in (NORMAL.name, *settings.map.maps)}
    return {name: PostProcess(settings, kind, borders) for name, kind in kinds.items()}
