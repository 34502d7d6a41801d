# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the margin around UV islands, and encodes values as they are stored: the last passes over a band."""

from collections.abc import Sequence

import gpu
import numpy as np

from ..core.declarations.choices import MarginType, Space, Wrap
from ..core.map_types import BY_NAME, DEFERRED, FILLED, MARGIN, MISSED, NORMAL, VECTOR_DISPLACEMENT, WRITTEN, Kind, Map
from ..core.settings import SamplingSettings, Settings
from ..mesh import uv_seams
from ..mesh.triangle_mesh import Mesh
from ..passes import data_texture, margin_fill, target
from .bands import REACH, Band
from .normal_space import channels

ROWS = 256
"""How many rows of a large map are completed at a time, so that memory does not grow with the map."""
COARSE = 4
"""How many times smaller the copy of a large map is in which distant texels are searched. The texel found is at most
2 sqrt(2) COARSE texels farther away than the nearest."""


class Borders:
    """The borders of UV islands on the GPU, for one UDIM tile at a time. Several maps may share it."""

    def __init__(self, found: uv_seams.Seams, sampling: SamplingSettings):
        self.found = found
        self.size = sampling.size
        self.tile = None

    def on(self, tile: int) -> margin_fill.Seams:
        """The borders on a tile."""
        if tile != self.tile:
            similarities = self.found.similarities(self.size, tile)
            self.uploaded = margin_fill.upload_seams(*self.found.strips(self.size, tile), similarities)
            self.tile = tile
        return self.uploaded


class PostProcess:
    """Encodes the values of one map and draws its margin.

    kind: of the values, as margin_fill has it. A normal n is stored as 0.5 n + 0.5, other values as
    they are. borders: for a margin that continues the adjacent faces; None for a margin of the nearest texels. fills_misses: as
    MapType has it.
    """

    def __init__(self, settings: Settings, kind: int, borders: Borders | None = None, *, fills_misses: bool = False):
        self.settings, self.kind, self.borders, self.fills_misses = settings, kind, borders, fills_misses
        self._bands: list[Band] = []
        """Those of the map that is drawn."""
        self.encode = np.eye(4)
        if kind in (margin_fill.NORMAL, margin_fill.TANGENT):
            self.encode[:3, :3], self.encode[:3, 3] = channels(settings.map) * 0.5, 0.5

    def draw(self, band: Band, values: gpu.types.GPUTexture) -> target.Target:
        """The stored texels (RGBA32F) and their state (R8) of the band without its halo, from `values` with it.

        Call `complete` after the last band of a map that has several.
        """
        return self.fill(band, values, self.search(band, values))

    def search(self, band: Band, values: gpu.types.GPUTexture) -> margin_fill.Nearest:
        """The texels that the margin of `values` repeats."""
        return margin_fill.find_nearest(values, self.settings.sampling.margin if band.is_whole else self._near)

    def fill(self, band: Band, values: gpu.types.GPUTexture, nearest: margin_fill.Nearest) -> target.Target:
        """As `draw`. nearest: what `search` of this object returned for values that are written on the same texels."""
        self._bands = [*(self._bands if band.start else []), band]
        stored = target.get("map", band.width, band.stop - band.start, "RGBA32F", "R8")
        margin_fill.fill_from_nearest(
            stored,
            values,
            nearest,
            halo=band.halo,
            encode=self.encode,
            missed=self.settings.map.missed,
            fills_misses=self.fills_misses,
        )
        if self.borders:
            margin_fill.fill_across_seams(
                stored,
                values,
                nearest,
                self.borders.on(band.tile),
                band.uv_to_clip,
                halo=band.halo,
                reach=self._near,
                kind=self.kind,
                encode=self.encode,
                first_row=band.start - band.halo,
                is_deferred=not band.is_whole,
            )
        return stored

    @property
    def _near(self) -> int:
        """The width of the margin that is drawn band by band, in texels."""
        return REACH if self.settings.sampling.margin is None else min(self.settings.sampling.margin, REACH)

    def complete(self, tile: int, texels: np.ndarray, state: np.ndarray) -> None:
        """Fill the margin of a map of several bands where it needs texels of other bands. Changes both arrays in place.

        Args:
            texels: (height, width, 4) float32, as `draw` stored them.
            state: (height, width) uint8.
        """
        if self._bands[0].is_whole:
            return
        if self.borders:
            for band in self._bands:
                self._complete_across(self.borders.on(tile), band, texels, state)
            _take_nearest(texels, state)
        if self.settings.sampling.margin is None or self.settings.sampling.margin > REACH:
            _complete_far(texels, state, self.settings.sampling.margin, fills_misses=self.fills_misses)

    def _complete_across(self, seams: margin_fill.Seams, band: Band, texels: np.ndarray, state: np.ndarray) -> None:
        """Fill the deferred texels whose walk across the seam starts in the rows of a band."""
        first_row, values = max(0, band.start - margin_fill.FARTHEST_ACROSS - 2), None
        for start in range(0, len(state), ROWS):
            rows = slice(start, start + ROWS)
            begins = texels[rows, :, 3]
            y, x = np.nonzero((state[rows] == DEFERRED) & (begins >= band.start) & (begins < band.stop))
            y += start
            if not len(y):
                continue
            if values is None:
                stop = band.stop + margin_fill.FARTHEST_ACROSS + 2
                values = data_texture.image(self._values(texels[first_row:stop], state[first_row:stop]))
            border, right, up = texels[y, x, :3].T
            places = np.column_stack([x, y, right, up]).astype(np.float32)
            colors = margin_fill.colors_across_seams(
                values, seams, places, border[:, None], first_row=first_row, kind=self.kind, encode=self.encode
            )
            is_known = colors[:, 3] > 0.0
            y, x = y[is_known], x[is_known]
            texels[y, x], state[y, x] = colors[is_known], MARGIN

    def _values(self, texels: np.ndarray, state: np.ndarray) -> np.ndarray:
        """The values of stored texels, with the alpha that `draw` takes."""
        decode = np.linalg.inv(self.encode).astype(np.float32)
        values = np.empty_like(texels)
        for start in range(0, len(state), ROWS):
            rows = slice(start, start + ROWS)
            values[rows, :, :3] = texels[rows, :, :3] @ decode[:3, :3].T + decode[:3, 3]
            values[rows, :, 3] = state[rows] == WRITTEN
            values[rows, :, 3] -= (state[rows] == MISSED) | (state[rows] == FILLED)
        return values


def _take_nearest(texels: np.ndarray, state: np.ndarray) -> None:
    """Fill the texels that are still deferred with the nearest written ones."""
    for start in range(0, len(state), ROWS):
        y, x = np.nonzero(state[start : start + ROWS] == DEFERRED)
        y += start
        right, up = texels[y, x, 1:3].astype(np.int64).T
        texels[y, x], state[y, x] = texels[y + up, x + right], MARGIN


def _complete_far(texels: np.ndarray, state: np.ndarray, reach: int | None, *, fills_misses: bool) -> None:
    """Fill the background within `reach` texels of written ones, or all of it, from the nearest or almost the nearest.

    fills_misses: fill misses as well.
    """
    # One written texel of each block, if it has any.
    height, width = (-(-side // COARSE) for side in state.shape)
    values = np.zeros((height, width, 4), np.float32)
    for row, column in np.ndindex(COARSE, COARSE):
        part = state[row::COARSE, column::COARSE]
        block = values[: part.shape[0], : part.shape[1]]
        is_first = (part == WRITTEN) & (block[..., 3] == 0.0)
        np.copyto(block, texels[row::COARSE, column::COARSE], where=is_first[..., None])
    uploaded = data_texture.image(values)
    stored = target.get("coarse", width, height, "RGBA32F", "R8")
    nearest = margin_fill.find_nearest(uploaded, None if reach is None else reach // COARSE)
    margin_fill.fill_from_nearest(stored, uploaded, nearest, halo=0, encode=np.eye(4), missed=(0.0, 0.0, 0.0))
    stored.read(values)
    fill_as = {0: MARGIN} | ({MISSED: FILLED} if fills_misses else {})
    for start in range(0, len(state), ROWS):
        for empty, filled in fill_as.items():
            y, x = np.nonzero(state[start : start + ROWS] == empty)
            y += start
            coarse = values[y // COARSE, x // COARSE]
            is_found = coarse[:, 3] > 0.0
            y, x = y[is_found], x[is_found]
            texels[y, x], state[y, x] = coarse[is_found], filled
            texels[y, x, 3] = filled == MARGIN


OWNER = "OWNER"
"""The name of the map of who owns each texel, see `with_owner`."""


def for_maps(lows: Sequence[Mesh], settings: Settings, *, has_owner: bool = False) -> dict[str, PostProcess]:
    """A PostProcess for each map of a bake, by name. lows: the meshes whose islands are on the map. has_owner: whether OWNER is
    one of the maps."""
    borders = None
    sampling = settings.sampling
    if sampling.margin_type == MarginType.ADJACENT_FACES and sampling.margin != 0 and sampling.wrap == Wrap.NONE:
        seams = uv_seams.find(lows)
        borders = Borders(seams, sampling) if len(seams.side) else None
    normal = margin_fill.TANGENT if settings.map.space == Space.TANGENT else margin_fill.NORMAL
    of_kind = {Kind.NORMAL: normal, Kind.VALUE: margin_fill.VALUE, Kind.LABEL: margin_fill.LABEL}
    kinds = {name: of_kind[BY_NAME[name].kind] for name in (NORMAL.name, *settings.map.drawn_maps)}
    if settings.map.has_tangent_displacement:
        kinds[VECTOR_DISPLACEMENT.name] = margin_fill.TANGENT_VECTOR
    processes = {
        name: PostProcess(settings, kind, borders, fills_misses=BY_NAME[name].fills_misses)
        for name, kind in kinds.items()
    }
    if has_owner:
        processes[OWNER] = PostProcess(settings, margin_fill.LABEL, borders, fills_misses=True)
    return processes


def with_owner(maps: dict[str, np.ndarray], is_others: np.ndarray) -> dict[str, np.ndarray]:
    """The maps of a tile, as Renderer.raw has them, with OWNER, and with values where others are, so that margins end there.

    is_others: the texels (height, width) bool on which other low objects are.
    """
    owner = np.zeros_like(maps[NORMAL.name])
    owner[..., 0] = is_others
    for values in maps.values():
        values[is_others] = (0.0, 0.0, 1.0, 1.0)
    owner[..., 3] = maps[NORMAL.name][..., 3]
    return maps | {OWNER: owner}


def without_others(finished: dict[str, Map], processes: dict[str, PostProcess]) -> np.ndarray:
    """Take OWNER out of finished maps, and clear the texels that belong to others, with their margins.

    Returns these texels (height, width) bool, with the background.
    """
    owner, state = finished.pop(OWNER)
    is_nearest = owner[..., 0] > 0.5
    is_others = is_nearest & (state != MISSED) & (state != FILLED)
    for name, (texels, states) in finished.items():
        texels[is_others] = (*(processes[name].encode @ (0.0, 0.0, 1.0, 1.0))[:3], 0.0)
        states[is_others] = 0
        is_missed = is_nearest & (states == FILLED)  # the color of others is not known
        texels[is_missed] = (*processes[name].settings.map.missed, 0.0)
        states[is_missed] = MISSED
    return is_others | (state == 0)
