# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures triangles in UV space: their areas, and the tiles, rows, texels and squares of a map that they touch."""

import threading
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from ..core import threads, udim
from . import topology
from .triangle_mesh import Mesh

ON_THE_RIM = 1e-5
"""A UV counts as outside a tile from this distance on: subdivision rounds UVs."""
SNAP = 1.0 / 32.0
"""In texels. Rasterizers round corners to a grid of at least 16 steps a texel."""
_SPREAD = np.array(
    [(i + 1 / 3, j + 1 / 3, 10 - i - j + 1 / 3) for i in range(11) for j in range(11 - i)], np.float32
) / np.float32(11.0)
"""Weights (N, 3) of corners for points that are spread evenly over a triangle."""
_SPREAD_BLOCK = 2**12
"""Triangles whose points are computed at once: those of a mesh of millions do not fit in memory."""
ROUNDING_SHARE = 2.0**-21
"""Share of the distance from the origin of UV space: how far single precision moves a corner, with room."""


def areas(mesh: Mesh) -> np.ndarray:
    """Twice the areas of the triangles in UV space, (T,) float32: negative for mirrored ones, and exactly 0 for triangles
    that cover nothing."""
    result = np.empty(len(mesh.triangles), np.float32)

    def measure(part: slice) -> None:
        a, b, c = _uv_corners(mesh, part)
        with np.errstate(over="ignore", invalid="ignore"):  # of UVs that lie far outside
            b, c = b - a, c - a
            result[part] = b.real * c.imag - b.imag * c.real

    threads.for_blocks(len(result), measure)
    return result


def outside(mesh: Mesh, tiles: tuple[int, int] = (1, 1)) -> np.ndarray:
    """Which triangles (T,) bool reach outside the `tiles` along u and v."""
    low, (u_high, v_high) = -ON_THE_RIM, np.add(tiles, ON_THE_RIM)
    # Corners that no triangle uses may hold NaN: a comparison with it is False, and each triangle is tested.
    if mesh.uv.min() >= low and mesh.uv[:, 0].max() <= u_high and mesh.uv[:, 1].max() <= v_high:
        return np.zeros(len(mesh.triangles), bool)
    corners: Any = np.stack(_uv_corners(mesh), axis=1)
    u, v = corners.real, corners.imag
    return ((u < low) | (u > u_high) | (v < low) | (v > v_high)).any(axis=1)


def cut_off(mesh: Mesh, which: np.ndarray, tiles: tuple[int, int] = (1, 1)) -> float:
    """The share of the mesh's UV area that lies outside the `tiles` along u and v. which: the triangles (T,) bool that may
    reach outside; the others do not count."""
    sizes = np.abs(areas(mesh))
    total = float(sizes.sum(dtype=np.float64))
    if not which.any() or total == 0.0:
        return 0.0
    if not np.isfinite(total):  # of UVs that lie far outside
        return 1.0
    chosen = np.flatnonzero(which)
    shares = np.empty(len(chosen), np.float32)

    def measure(part: slice) -> None:
        a, b, c = (corners[:, None] for corners in _uv_corners(mesh, chosen[part]))
        points = a * _SPREAD[:, 0] + b * _SPREAD[:, 1] + c * _SPREAD[:, 2]
        is_out = (points.real < 0.0) | (points.real > tiles[0]) | (points.imag < 0.0) | (points.imag > tiles[1])
        shares[part] = is_out.mean(axis=1)

    threads.for_blocks(len(chosen), measure, _SPREAD_BLOCK)
    return float((sizes[chosen] * shares).sum(dtype=np.float64) / total)


def over_centers(
    mesh: Mesh, uv_to_clip: udim.UvToClip, size: tuple[int, int], part: slice = slice(None), *, snap: float = SNAP
) -> np.ndarray:
    """The triangles of `part` whose box in UV space has a texel's center in it: their numbers (N,) int in the mesh, in order.

    The others change no texel when the mesh is drawn with `uv_to_clip` on `size` texels. snap: how far a rasterizer moves
    corners, in texels.
    """
    first, last, _ = part.indices(len(mesh.triangles))
    axes = []
    for axis in range(2):
        half = size[axis] / 2.0
        scale, shift = uv_to_clip[axis] * half, (uv_to_clip[axis + 2] + 1.0) * half - 0.5
        room = snap + ROUNDING_SHARE * (abs(shift) + 2.0 * half)
        axes.append([np.float32(value) for value in (scale, shift - room, shift + room, size[axis] - 1)])
    is_over = np.empty(max(0, last - first), bool)

    def measure(block: slice) -> None:
        numbers = mesh.triangles[first + block.start : first + block.stop].reshape(-1)
        corners = np.take(mesh.uv.view(np.complex64)[:, 0], numbers, mode="clip").view(np.float32)
        inside = True
        with np.errstate(over="ignore", invalid="ignore"):  # of UVs that lie far outside
            # In rows of one coordinate of one corner: numpy is several times slower along short axes.
            for (scale, low, high, most), (a, b, c) in zip(
                axes, np.ascontiguousarray(corners.reshape(-1, 3, 2).T), strict=True
            ):
                lowest, highest = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
                center = np.maximum(np.ceil(lowest * scale + low), np.float32(0.0))
                inside = inside & (center <= np.minimum(highest * scale + high, most))
        is_over[block] = inside

    threads.for_blocks(len(is_over), measure)
    return np.flatnonzero(is_over) + first


def tiles(mesh: Mesh) -> list[int]:
    """The numbers of the UDIM tiles that triangles with area may cover, in order."""
    corners: Any = np.stack(_uv_corners(mesh), axis=1)
    corners = corners[np.isfinite(corners).all(axis=1)]
    spans = []
    for values, count in zip((corners.real, corners.imag), (udim.COLUMNS, udim.ROWS), strict=True):
        low, high = values.min(axis=1), values.max(axis=1)
        # A triangle on the border between two tiles belongs to one of them; one without extent belongs to none.
        first, last = np.floor(low + ON_THE_RIM), np.ceil(high - ON_THE_RIM) - 1.0
        last = np.where(low < high, np.maximum(last, first), first - 1.0)
        spans += [np.maximum(first, 0.0), np.minimum(last, count - 1.0)]
    boxes = np.stack(spans, axis=1)
    boxes = np.unique(boxes[(boxes[:, 0] <= boxes[:, 1]) & (boxes[:, 2] <= boxes[:, 3])], axis=0).astype(int)
    numbers = {
        udim.number(u, v)
        for u_first, u_last, v_first, v_last in boxes.tolist()
        for u in range(u_first, u_last + 1)
        for v in range(v_first, v_last + 1)
    }
    return sorted(numbers)


def _uv_corners(mesh: Mesh, which: slice | np.ndarray = slice(None)) -> list[Any]:
    """The UVs of the three corners of the triangles `which`, (T,) each, as complex numbers: one gather reads u and v."""
    uv = mesh.uv.view(np.complex64)[:, 0]
    return [np.take(uv, corner, mode="clip") for corner in mesh.triangles[which].T]


MOST_PIECES = 2**18
"""The most pieces into which `covered` splits the triangles of a block."""
PIECE = 2
"""The widest piece, in squares, that is not split."""
SPLIT_EXTENT = 4.0
"""Triangles of this extent in UV space are not split: single precision is too coarse for the middles of larger ones."""


def touching(mesh: Mesh, uv_to_clip: udim.UvToClip, size: tuple[int, int], blocks: np.ndarray, side: int) -> np.ndarray:
    """Which triangles (T,) bool have a box in UV space that touches one of the squares, when drawn on `size` texels.

    uv_to_clip: without the offset of a sample. blocks (rows, columns) bool: squares of `side` texels, from the lowest row.
    """
    counts = np.zeros((blocks.shape[0] + 1, blocks.shape[1] + 1), np.int32)
    np.cumsum(np.cumsum(blocks, axis=0, dtype=np.int32), axis=1, out=counts[1:, 1:])
    result = np.empty(len(mesh.triangles), bool)

    def measure(part: slice) -> None:
        corners = _corners(mesh, part)
        x0, x1, y0, y1 = _boxes(corners, uv_to_clip, size, blocks.shape, side)
        result[part] = counts[y1, x1] - counts[y0, x1] - counts[y1, x0] + counts[y0, x0] > 0

    threads.for_blocks(len(result), measure)
    return result


def covered_squares(meshes: Sequence[Mesh], uv_to_clip: udim.UvToClip, size: tuple[int, int], side: int) -> np.ndarray:
    """Which squares (rows, columns) bool of `side` texels the triangles may touch, when drawn on `size` texels.

    Large triangles are split, so that the boxes of their pieces lie close to them; all squares count where that would take too
    many pieces. uv_to_clip: as in `touching`.
    """
    result = np.zeros((-(-size[1] // side), -(-size[0] // side)), bool)

    def mark(mesh: Mesh, part: slice) -> None:
        pieces = _corners(mesh, part)
        while pieces.shape[1]:
            boxes = _boxes(pieces, uv_to_clip, size, result.shape, side)
            x0, x1, y0, y1 = boxes
            is_in = (x1 > x0) & (y1 > y0)
            is_large = is_in & (np.maximum(x1 - x0, y1 - y0) > PIECE)
            x0, x1, y0, y1 = boxes[:, is_in & ~is_large]
            for x in (x0, x1 - 1):
                for y in (y0, y1 - 1):
                    result[y, x] = True
            pieces = pieces[:, is_large]
            if pieces.shape[1] > MOST_PIECES or np.ptp(pieces, axis=2).max(initial=0.0) >= SPLIT_EXTENT:
                result[:] = True
                return
            pieces = _halves(pieces)

    for mesh in meshes:
        threads.for_blocks(len(mesh.triangles), partial(mark, mesh))
    return result


def covered_rows(meshes: Sequence[Mesh], uv_to_clip: udim.UvToClip, size: tuple[int, int], step: int) -> np.ndarray:
    """About how many texels (N,) float64 the triangles cover of each `step` rows, when drawn on `size` texels.

    Each triangle counts alike in all rows that it reaches. Where triangles overlap, all of them count, up to all texels.
    """
    width, height = size
    count = -(-height // step)
    changes = np.zeros(count + 1)
    lock = threading.Lock()

    def add(mesh: Mesh, part: slice) -> None:
        with np.errstate(over="ignore", invalid="ignore"):  # of UVs that lie far outside
            (x, y) = (
                corners * np.float32(uv_to_clip[axis] * side / 2.0)
                + np.float32((uv_to_clip[axis + 2] + 1.0) * side / 2.0)
                for axis, (corners, side) in enumerate(zip(_corners(mesh, part), size, strict=True))
            )
            area = 0.5 * np.abs((x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0]))
            lowest, highest = y.min(axis=1), y.max(axis=1)
            is_in = (x.max(axis=1) > 0.0) & (x.min(axis=1) < width) & (highest > 0.0) & (lowest < height)
            is_in &= np.isfinite(area)
        first, last = np.floor(lowest[is_in] / step), np.floor(highest[is_in] / step)
        share = area[is_in].astype(np.float64) / (last - first + 1.0)
        first, last = first.clip(0, count - 1).astype(np.int64), last.clip(0, count - 1).astype(np.int64)
        step_changes = np.bincount(first, share, count + 1) - np.bincount(last + 1, share, count + 1)
        with lock:
            np.add(changes, step_changes, out=changes)

    for mesh in meshes:
        threads.for_blocks(len(mesh.triangles), partial(add, mesh))
    return np.cumsum(changes[:-1]).clip(0.0, step * width)


def _halves(corners: np.ndarray) -> np.ndarray:
    """Triangles (2, T, 3) as (2, 2 T, 3), each split at the middle of its longest edge."""
    lengths = np.square(np.roll(corners, -1, axis=2) - corners).sum(axis=0)
    order = (lengths.argmax(axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(corners, order[None], axis=2).transpose(2, 0, 1)
    middle = (a + b) * np.float32(0.5)
    return np.concatenate([np.stack([a, middle, c], axis=2), np.stack([middle, b, c], axis=2)], axis=1)


def _corners(mesh: Mesh, part: slice) -> np.ndarray:
    """The corners (2, T, 3) float32 of these triangles in UV space."""
    return np.take(mesh.uv, mesh.triangles[part].reshape(-1), axis=0, mode="clip").T.reshape(2, -1, 3)


def _boxes(
    corners: np.ndarray, uv_to_clip: udim.UvToClip, size: tuple[int, int], shape: tuple[int, int], side: int
) -> np.ndarray:
    """The first column, the last one plus 1, and the same for rows (4, T) int32 of the squares that each triangle may touch."""
    edges = []
    with np.errstate(over="ignore", invalid="ignore"):  # of UVs that lie far outside
        for axis, (a, b, c) in enumerate(corners.transpose(0, 2, 1)):
            half, most = size[axis] / 2.0, np.float32(shape[1 - axis])
            scale, shift = uv_to_clip[axis] * half, (uv_to_clip[axis + 2] + 1.0) * half
            room = SNAP + ROUNDING_SHARE * (abs(shift) + 2.0 * half)
            lowest, highest = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
            first = np.floor((lowest * np.float32(scale) + np.float32(shift - room)) / side)
            last = np.floor((highest * np.float32(scale) + np.float32(shift + room)) / side) + 1.0
            # Comparisons with NaN are False: such triangles cover nothing.
            edges += [np.where(end > 0.0, np.minimum(end, most), 0.0).astype(np.int32) for end in (first, last)]
    return np.stack(edges)


def runs(chosen: np.ndarray, most: int) -> list[tuple[int, int]]:
    """At most so many ranges, each its start and its length, that hold all True of `chosen` (N,) bool, and few others."""
    starts, lengths = topology.runs(chosen)
    stops = starts + lengths
    if len(starts) > most:
        gaps = starts[1:] - stops[:-1]
        kept = np.sort(np.argsort(gaps)[len(gaps) - (most - 1) :])
        starts, stops = np.r_[starts[0], starts[1:][kept]], np.r_[stops[:-1][kept], stops[-1]]
    return list(zip(starts.tolist(), (stops - starts).tolist(), strict=True))
