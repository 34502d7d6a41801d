# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of a bake for the page of results: its map, the low mesh lit with it, and its deviations."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import gpu
import numpy as np

from ..core import udim
from ..core.map_types import NORMAL, Map
from ..core.settings import Settings
from ..engine import normal_space
from ..mesh.local_space import local_space_of
from ..mesh.triangle_mesh import Mesh
from ..mesh.triangles import face_normals
from ..passes import data_texture, lit, mesh_upload, target, viewport

PICTURE_SIDE = 192
"""Pixels along a side of each picture."""
LIT_TEXELS = 512
"""Texels along a side of the map with which the low mesh is drawn, at most."""
MOST_DEGREES = 5.0
"""Degrees at which the colors of deviations end, as in the viewport."""
BACKGROUND, UNKNOWN = 24, 90
"""Gray where nothing is, and where the map has texels but no deviation is known, as bytes."""
_NONE, _NOT_MEASURED = -2.0, -1.0
"""Instead of degrees."""


class BakePictures:
    """Collects the tiles of one bake. settings: of the map."""

    def __init__(self, low: Mesh, tiles: Sequence[int], settings: Settings):
        self._low, self._settings = low, settings
        self._board = _Board(tiles, settings.sampling.size)
        self._maps: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self._degrees: dict[int, np.ndarray] = {}
        self._textures: dict[int, np.ndarray] = {}

    def add(self, tile: int, maps: Mapping[str, Map]) -> None:
        """Add a UDIM tile with its maps as they are stored, before rounding. Without a normal map, only the first of the others
        is shown."""
        other = next((name for name in maps if name != NORMAL.name), NORMAL.name)
        texels, state = maps[NORMAL.name if self._settings.map.normal else other]
        is_known = state != 0
        self._maps[tile] = square_means(texels, is_known, self._board.factor)
        if self._settings.map.normal:
            most = _square_side(self._settings.sampling.size, LIT_TEXELS)
            means, _ = square_means(texels, is_known, most)
            self._textures[tile] = np.dstack([means, np.ones(means.shape[:2], np.float32)])

    def add_degrees(
        self, tile: int, start: int, degrees: np.ndarray, is_known: np.ndarray, is_drawn: np.ndarray
    ) -> None:
        """Add rows of a tile's deviations, from row `start` on: (rows, width) float32.

        is_known, is_drawn: (rows, width) bool, where they are measured, and where the map was drawn.
        """
        values = np.where(is_known, degrees, np.where(is_drawn, _NOT_MEASURED, _NONE)).astype(np.float32)
        into = self._degrees.setdefault(tile, np.full(self._board.shape, _NONE, np.float32))
        add_greatest(into, values, start, self._board.factor)

    def result(self) -> np.ndarray | None:
        """The three pictures side by side, PICTURE_SIDE rows of RGB in uint8, row 0 on top. Those that there are not stay gray.

        Deviations are the greatest of the texels that share a pixel, from dark blue for 0 to red for MOST_DEGREES and more.
        """
        if not self._maps:
            return None
        result = np.full((PICTURE_SIDE, 3 * PICTURE_SIDE, 3), BACKGROUND, np.uint8)
        result[:, :PICTURE_SIDE] = self._board.laid_out({tile: _bytes(*texels) for tile, texels in self._maps.items()})
        if self._textures:
            drawn = _draw_low(self._low, self._textures, self._settings, PICTURE_SIDE)[::-1]
            share = drawn[..., 3:]
            result[:, PICTURE_SIDE : 2 * PICTURE_SIDE] = np.rint(
                _display(drawn[..., :3]) * 255.0 + (1.0 - share) * BACKGROUND
            )
        if self._degrees:
            colors = _ramp()
            result[:, 2 * PICTURE_SIDE :] = self._board.laid_out(
                {tile: _colored(degrees, colors) for tile, degrees in self._degrees.items()}
            )
        return result


class _Board:
    """Where the tiles of a map lie in a picture.

    factor: texels along a side of the square that becomes a pixel. shape: rows and columns of pixels of a tile.
    """

    def __init__(self, tiles: Sequence[int], size: tuple[int, int]):
        self._places = {tile: udim.place(tile) for tile in tiles}
        self._first = tuple(map(min, zip(*self._places.values(), strict=True)))
        last = tuple(map(max, zip(*self._places.values(), strict=True)))
        self._counts = tuple(end - start + 1 for start, end in zip(self._first, last, strict=True))
        along = list(zip(self._counts, size, strict=True))
        self.factor = next(
            factor
            for factor in range(1, max(size) + 1)
            if all(count * -(-length // factor) <= PICTURE_SIDE for count, length in along)
        )
        self.shape = -(-size[1] // self.factor), -(-size[0] // self.factor)

    def laid_out(self, tiles: Mapping[int, np.ndarray]) -> np.ndarray:
        """A square picture, row 0 on top. tiles: pixels (*shape, 3) uint8, row 0 at v = 0."""
        rows, columns = self.shape
        whole = np.full((rows * self._counts[1], columns * self._counts[0], 3), BACKGROUND, np.uint8)
        for tile, pixels in tiles.items():
            column, row = (at - first for at, first in zip(self._places[tile], self._first, strict=True))
            whole[row * rows : (row + 1) * rows, column * columns : (column + 1) * columns] = pixels
        larger = max(1, PICTURE_SIDE // max(whole.shape))
        whole = whole.repeat(larger, axis=0).repeat(larger, axis=1)[::-1]
        result = np.full((PICTURE_SIDE, PICTURE_SIDE, 3), BACKGROUND, np.uint8)
        top, left = ((PICTURE_SIDE - length) // 2 for length in whole.shape[:2])
        result[top : top + whole.shape[0], left : left + whole.shape[1]] = whole
        return result


def _bytes(values: np.ndarray, is_known: np.ndarray) -> np.ndarray:
    """Values (rows, columns, 3) as pixels. Those that are not all from 0 to 1 are stretched to that."""
    shown = np.nan_to_num(values)
    known = shown[is_known]
    if len(known) and (known.min() < 0.0 or known.max() > 1.0):
        shown = (shown - known.min()) / max(known.max() - known.min(), np.float32(1e-30))
    return np.where(is_known[..., None], np.rint(np.clip(shown, 0.0, 1.0) * 255.0), BACKGROUND).astype(np.uint8)


def _colored(degrees: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """Degrees (rows, columns) as pixels. colors: as `_ramp` returns them."""
    places = np.clip(
        degrees / MOST_DEGREES * len(colors) - 0.5, 0, len(colors) - 1
    )  # each color is that of the middle of its share
    pixels = np.rint(colors[np.rint(places).astype(np.int32)] * 255.0)
    pixels[degrees == _NOT_MEASURED] = UNKNOWN
    pixels[degrees == _NONE] = BACKGROUND
    return pixels.astype(np.uint8)


def _ramp() -> np.ndarray:
    """The colors of deviations from 0 to MOST_DEGREES degrees, (256, 3) float32, as the viewport's legend has them."""
    into = target.get("colors of deviations", 256, 1, "RGBA32F")
    with target.drawing(into):
        viewport.draw_legend((2.0, 2.0, -1.0, -1.0))
    return _display(into.texels()[0, :, :3])


def _display(linear: np.ndarray) -> np.ndarray:
    """Linear values as screens show them (IEC 61966-2-1)."""
    clipped = np.clip(linear, 0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1.0 / 2.4) - 0.055)


TOWARDS_VIEWER = np.array((0.5, -0.75, 0.45))
"""From the middle of a closed mesh, in the axes of the world."""
FILLED = 0.94
"""Share of the picture's side that the mesh takes."""
FINER = 2
"""Pixels drawn along a side for each pixel of the picture."""


def _draw_low(low: Mesh, tiles: Mapping[int, np.ndarray], settings: Settings, side: int) -> np.ndarray:
    """The picture (side, side, 4) float32, linear, row 0 at the bottom; alpha is the share of a pixel that the mesh covers.

    low: with its tangents, if the map has them. tiles: by UDIM tile, a normal map as it is stored (rows, columns, 4) float32,
    perhaps smaller.
    """
    points = local_space_of([low]).points(low)
    away = _towards_viewer(points[low.vertices[low.triangles.reshape(-1)]])
    matrix, up, right = _view(points, away)
    light = np.append(away + 0.7 * up - 0.5 * right, 0.0)
    shading = lit.shading(low.normal_matrix, light, read=normal_space.reading(settings.map))
    into = target.get("picture of low", FINER * side, FINER * side, "RGBA32F", "DEPTH_COMPONENT32F")
    with target.drawing(into, writes_depth=True):
        for tile, batch in low_by_tile(low, points, tiles, is_udim=settings.sampling.udim):
            if tile is not None:
                lit.draw(batch, data_texture.image(tiles[tile]), matrix, shading)
    return into.texels().reshape(side, FINER, side, FINER, 4).mean(axis=(1, 3))


def low_by_tile(
    low: Mesh, points: np.ndarray, tiles: Iterable[int], *, is_udim: bool
) -> Iterator[tuple[int | None, gpu.types.GPUBatch]]:
    """The triangles of a low mesh on each tile, as lit.draw takes them, with UVs within the tile; at last those on none, with
    None for a tile.

    points: (V, 3) float32, of its vertices. is_udim: False for one tile, which repeats.
    """
    corners = low.front_triangles.reshape(-1)
    uv = np.zeros((len(corners), 2), np.float32) if low.uv is None else low.uv[corners]
    tangents = np.zeros((len(low.normals), 4), np.float32) if low.tangents is None else low.tangents
    values = {"position": points[low.vertices[corners]], "normal": low.normals[corners], "tangent": tangents[corners]}
    places = np.floor(uv.reshape(-1, 3, 2).mean(axis=1))
    left = np.ones(len(places), bool)
    for tile in (*tiles, None):
        chosen = left if tile is None or not is_udim else (places == udim.place(tile)).all(axis=1)
        if chosen.any():
            at = np.repeat(chosen, 3)
            within = uv[at] - np.repeat(places[chosen], 3, axis=0).astype(np.float32)
            batch = mesh_upload.upload_corners(uv=within, **{name: each[at] for name, each in values.items()})
            yield tile, batch
        left = left & ~chosen


def _towards_viewer(points: np.ndarray) -> np.ndarray:
    """The direction from the mesh to the viewer. An open mesh turns its front to him: its normals do not add up to zero.

    points: (3 T, 3), the corners of the triangles.
    """
    normals = face_normals(points.reshape(-1, 3, 3), dtype=np.float64)
    lean = normals.sum(axis=0) / max(np.linalg.norm(normals, axis=1).sum(), 1e-30)
    towards = TOWARDS_VIEWER / np.linalg.norm(TOWARDS_VIEWER) + 2.0 * lean
    return towards / max(np.linalg.norm(towards), 1e-30)


def _view(points: np.ndarray, away: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The matrix (4, 4) from the points' space to clip space, which fills the picture, and the directions up and right."""
    right = np.cross((0.0, 0.0, 1.0), away)
    right = np.array((1.0, 0.0, 0.0)) if np.linalg.norm(right) < 1e-3 else right / np.linalg.norm(right)
    up = np.cross(away, right)
    axes = np.array((right, up, -away))  # clip space is nearer where z is less
    seen = points @ axes.T
    least, most = seen.min(axis=0), seen.max(axis=0)
    scales = np.array((*2 * [2.0 * FILLED / max((most - least)[:2].max(), 1e-30)], 1.0 / max((most - least)[2], 1e-30)))
    matrix = np.eye(4)
    matrix[:3, :3] = axes * scales[:, None]
    matrix[:3, 3] = -scales * (least + most) / 2.0
    return matrix, up, right


def _square_side(size: tuple[int, int], most: int) -> int:
    """The texels along a side of a square, so that a map of `size` (width, height) has at most `most` squares along a side."""
    return max(1, -(-max(size) // most))


def square_means(texels: np.ndarray, is_known: np.ndarray, factor: int) -> tuple[np.ndarray, np.ndarray]:
    """The means of the known texels in each square, (rows, columns, 3) float32, and which squares have any, as bool.

    texels: (height, width, 3 or more) float32. is_known: (height, width) bool. Squares at the end may be incomplete.
    """
    height, width = is_known.shape
    columns = np.arange(0, width, factor)
    result = np.zeros((-(-height // factor), len(columns), 3), np.float32)
    has_any = np.zeros(result.shape[:2], bool)
    for row, first in enumerate(range(0, height, factor)):
        part, known = texels[first : first + factor, :, :3], is_known[first : first + factor]
        counts = np.add.reduceat(known.sum(axis=0), columns)
        sums = np.add.reduceat(np.where(known[..., None], part, np.float32(0.0)).sum(axis=0), columns, axis=0)
        result[row] = sums / np.maximum(counts, 1)[:, None]
        has_any[row] = counts > 0
    return result, has_any


def add_greatest(into: np.ndarray, values: np.ndarray, start: int, factor: int) -> None:
    """Raise `into` (rows, columns) to the greatest of `values` (height, width) in each square. start: their first row of the
    map."""
    of_columns = np.maximum.reduceat(values, np.arange(0, values.shape[1], factor), axis=1)
    np.maximum.at(into, (start + np.arange(len(values))) // factor, of_columns)
