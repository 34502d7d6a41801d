# SPDX-License-Identifier: GPL-3.0-or-later
"""The last passes over a band: from values to what is stored, with the margin around the islands."""

from collections.abc import Sequence

import gpu
import numpy as np

from ..core import texel_state
from ..core.declarations.values import MarginType, Space
from ..core.map_types import BY_NAME, NORMAL, Kind
from ..core.settings import Settings
from ..mesh import uv_seams as islands
from ..mesh.triangle_mesh import Mesh
from ..passes import target
from ..passes.margin import nearest_texel, resolve, seam_fill
from . import large_map_margin
from .bands import REACH, Band, bands


class Borders:
    """Where islands end, on one UDIM tile after another. Several maps may share it."""

    def __init__(self, found: islands.Seams, settings: Settings):
        self.found = found
        self.size = settings.width, settings.height
        self.tile = None

    def on(self, tile: int) -> "Borders":
        """This, with what lies on a tile: `similarities` as mesh.seams has them, and `uploaded`."""
        if tile != self.tile:
            self.similarities = self.found.similarities(self.size, tile)
            self.uploaded = seam_fill.upload(*self.found.strips(self.size, tile), self.similarities)
            self.tile = tile
        return self


class PostProcess:
    """Made once for a map.

    kind: of its values, as passes.seams has them; normals are stored as half of what they are and a half, others as they
    are. borders: where the islands on the map end, for a margin that goes on across them; None for one that does not.
    """

    def __init__(self, settings: Settings, kind: int, borders: Borders | None = None):
        self.settings, self.kind, self.borders = settings, kind, borders
        self.encode = np.eye(4)
        if kind in (seam_fill.NORMAL, seam_fill.TANGENT):
            self.encode[:3, :3], self.encode[:3, 3] = channels(settings) * 0.5, 0.5

    def draw(self, band: Band, values: gpu.types.GPUTexture) -> target.Target:
        """The stored texels (RGBA32F) of the band's own rows and their state (R8) from `values`, which has its halo.

        `complete` has to follow the last band, unless there is one alone.
        """
        reach = self.settings.margin
        near = REACH if reach is None else min(reach, REACH)
        stored = target.get("map", band.width, band.stop - band.start, "RGBA32F", "R8")
        nearest = nearest_texel.search(values, reach if band.is_whole else near)
        resolve.draw(
            stored,
            values,
            nearest,
            halo=band.halo,
            encode=self.encode,
            missed=self.settings.missed,
        )
        if self.borders:
            seam_fill.draw(
                stored,
                values,
                nearest,
                self.borders.on(band.tile).uploaded,
                band.uv_to_clip,
                halo=band.halo,
                reach=near,
                kind=self.kind,
                encode=self.encode,
                is_deferred=not band.is_whole,
            )
        return stored

    def complete(self, tile: int, texels: np.ndarray, state: np.ndarray) -> None:
        """Fill what no band could alone, in place: texels (height, width, 4) float32, state (height, width) uint8."""
        height, width = state.shape
        if next(bands(width, height, None)).is_whole:
            return
        if self.borders:
            large_map_margin.across(texels, state, self.borders.on(tile).similarities, self.kind, self.encode)
        if self.settings.margin is None or self.settings.margin > REACH:
            large_map_margin.beyond(texels, state, self.settings.margin)


def for_maps(lows: Sequence[Mesh], settings: Settings) -> dict[str, PostProcess]:
    """One for each map of a bake, by name; `lows` are the meshes whose islands lie on it."""
    borders = None
    if settings.margin_type == MarginType.ADJACENT_FACES and settings.margin != 0:
        found = islands.find(lows)
        borders = Borders(found, settings) if len(found.side) else None
    normal = seam_fill.TANGENT if settings.space == Space.TANGENT else seam_fill.NORMAL
    of_kind = {Kind.NORMAL: normal, Kind.VALUE: seam_fill.VALUE, Kind.LABEL: seam_fill.LABEL}
    kinds = {name: of_kind[BY_NAME[name].kind] for name in (NORMAL.name, *settings.maps)}
    return {name: PostProcess(settings, kind, borders) for name, kind in kinds.items()}


def channels(settings: Settings) -> np.ndarray:
    """The (3, 3) matrix from a normal to what red, green and blue hold of it."""
    matrix = np.zeros((3, 3))
    for row, axis in enumerate((settings.red, settings.green, settings.blue)):
        matrix[row, "XYZ".index(axis[1])] = 1.0 if axis[0] == "+" else -1.0
    return matrix


def backwards(texels: np.ndarray, state: np.ndarray, settings: Settings) -> int:
    """On how many of the written texels z is 0 or less: texels (height, width, 4) of normals as they are stored, and their
    state."""
    z = channels(settings)[:, 2]
    stored = texels[..., int(np.argmax(np.abs(z)))]
    half = np.float32(0.5)
    return int(np.count_nonzero((stored <= half if z.sum() > 0.0 else stored >= half) & (state == texel_state.WRITTEN)))


def upwards(texels: np.ndarray, settings: Settings) -> np.ndarray:
    """The z of the normals that stored texels (height, width, 4) stand for, (height, width), times one half."""
    z = channels(settings)[:, 2]
    return texels[..., int(np.argmax(np.abs(z)))] * np.float32(z.sum()) - np.float32(0.5 * z.sum())
