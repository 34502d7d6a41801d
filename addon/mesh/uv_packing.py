# SPDX-License-Identifier: GPL-3.0-or-later
"""Packs UV islands into a map by their outlines, as large as they fit, with a margin around each.

The map is divided into cells, and an island takes all cells that it touches, with the margin around them. One after the other,
the largest first, islands go to the place where their center is lowest. All cells of the map are the bits of one whole number:
one shift moves a row of an island to all places at once, and one "and" tells which of them are taken.
"""

from dataclasses import dataclass

import numpy as np

CELLS = 256
"""Cells a side, about: up to twice as many, so that the margin is a whole number of them."""
ROTATIONS, FEW_ROTATIONS = 16, 8
"""The directions in which an island is tried, evenly over the circle; fewer in a quick search."""
ORDERS, NOISE, SEED = 6, 0.3, 1
"""How many orders are tried at a size: by area times a random factor, whose logarithm has a standard deviation of NOISE."""
FULL = 0.75
"""The share of the cells that are taken at the size that is tried first."""
COARSE, FINE = 1.04, 1.01
"""The factors on the area by which the size is searched: of one order, and of all."""
LEAST = 0.02
"""Islands that do not fit at this share of the map are not packed."""


@dataclass(frozen=True)
class Packed:
    """Where islands go: a point of island i at `uv` goes to matrices[i] @ uv + offsets[i]. (I, 2, 2) and (I, 2) float64."""

    matrices: np.ndarray
    offsets: np.ndarray

    def move(self, uv: np.ndarray, islands: np.ndarray) -> np.ndarray:
        """Move points (N, 2) of the islands (N,) int."""
        return (self.matrices[islands] @ uv[:, :, None])[:, :, 0] + self.offsets[islands]


def pack(corners: np.ndarray, islands: np.ndarray, margin: float, *, is_quick: bool = False) -> Packed | None:
    """Pack islands into the map from 0 to 1, all by the same factor. Returns None if they do not fit.

    Args:
        corners: (T, 3, 2), the UVs of triangles.
        islands: (T,) int from 0, the island of each triangle.
        margin: around each island, as a share of the side. Along u or along v, two islands are twice as far apart.
        is_quick: whether the size is searched by one order of islands alone.
    """
    if not np.isfinite(corners).all():
        return None
    order = np.argsort(islands, kind="stable")
    corners, islands = corners[order].astype(np.float64), islands[order]
    area = float(0.5 * np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])).sum())
    if area == 0.0:
        return None
    return _Packing(corners, islands, area, margin, is_quick=is_quick).search()


class _Packing:
    """The search for the size. Triangles are in the order of their islands."""

    def __init__(self, corners: np.ndarray, islands: np.ndarray, area: float, margin: float, *, is_quick: bool):
        self.corners, self.islands, self.area = corners, islands, area
        self.rotations = FEW_ROTATIONS if is_quick else ROTATIONS
        self.steps = ((COARSE, 1),) if is_quick else ((COARSE, 1), (FINE, ORDERS))
        self.reach = max(1, int(np.ceil(CELLS * margin - 1e-6)))
        self.side = max(2 * self.reach + 1, int(min(self.reach / max(margin, 1e-6), 2.0 * CELLS) + 1e-6))
        self.inside: dict[tuple[int, int], int] = {}

    def search(self) -> Packed | None:
        share = self._guess()
        best = self._try(share, 1)
        while best is None and share > LEAST:
            share /= COARSE
            best = self._try(share, 1)
        if best is None:
            return None
        for factor, orders in self.steps:
            while (found := self._try(share * factor, orders)) is not None:
                best, share = found, share * factor
        return best

    def _guess(self) -> float:
        share = 0.5
        for _ in range(3):
            taken = int(self._shapes(0.0, share).cells.sum())
            share *= min(2.0, FULL * self.side**2 / taken)
        return max(share, LEAST)

    def _shapes(self, angle: float, share: float) -> "_Shapes":
        cosine, sine = self.side * np.sqrt(share / self.area) * np.array([np.cos(angle), np.sin(angle)])
        matrix = np.array([[cosine, -sine], [sine, cosine]])
        return _Shapes(self.corners, self.islands, matrix, self.reach, self.side)

    def _try(self, share: float, orders: int) -> Packed | None:
        """Pack at a size, the triangles' share of the map."""
        turned = [self._shapes(2.0 * np.pi * k / self.rotations, share) for k in range(self.rotations)]
        random = np.random.default_rng(SEED)
        for k in range(orders):
            noise = NOISE * random.standard_normal(len(turned[0].cells)) if k else 0.0
            places = self._place(turned, np.argsort(-turned[0].cells * np.exp(noise), kind="stable").tolist())
            if places is not None:
                matrices = np.stack([turned[k].matrix for k, _, _ in places]) / self.side
                corner = np.array([turned[k].least[island] for island, (k, _, _) in enumerate(places)])
                cell = np.array([(x, y) for _, x, y in places], float) + self.reach
                return Packed(matrices, (cell - corner) / self.side)
        return None

    def _place(self, turned: list["_Shapes"], order: list[int]) -> list[tuple[int, int, int]] | None:
        """Place islands one after the other. Returns the rotation and the first cell along u and v of each, or None."""
        # taken[k]: the cells from which one of the next 2^k cells in the row is taken.
        taken = [0] * self.side.bit_length()
        places = [(0, 0, 0)] * len(order)
        for island in order:
            found = []
            for k, shapes in enumerate(turned):
                free = self._inside(*shapes.sizes[island]) & ~shapes.overlaps(island, taken)
                if free:
                    row, column = divmod((free & -free).bit_length() - 1, self.side)
                    found.append((row + shapes.centers[island], column, row, k))
            if not found:
                return None
            _, column, row, k = min(found)
            places[island] = k, column, row
            taken[0] |= turned[k].bits(island) << (row * self.side + column)
            for power in range(1, len(taken)):
                taken[power] = taken[power - 1] | taken[power - 1] >> (1 << (power - 1))
        return places

    def _inside(self, width: int, height: int) -> int:
        """The cells where an island of this size can start."""
        if (width, height) not in self.inside:
            bits = 0
            if width <= self.side and height <= self.side:
                row = "0" * (width - 1) + "1" * (self.side - width + 1)
                bits = int(row * (self.side - height + 1), 2)
            self.inside[width, height] = bits
        return self.inside[width, height]


class _Shapes:
    """The cells of all islands in one direction and size.

    matrix (2, 2): from UVs to cells. least (I, 2): the lowest corner of each island then. sizes: the cells along u and v.
    cells (I,): how many there are. centers: the mean row. All count the margin.
    """

    def __init__(self, corners: np.ndarray, islands: np.ndarray, matrix: np.ndarray, reach: int, side: int):
        self.matrix = matrix
        turned = corners @ self.matrix.T
        starts = np.flatnonzero(np.diff(islands, prepend=-1))
        self.least = np.minimum.reduceat(turned.min(axis=1), starts)
        size = np.maximum.reduceat(turned.max(axis=1), starts) - self.least
        size = np.minimum(size.astype(np.int64) + 1 + 2 * reach, 2 * side)  # those that are larger do not fit anyway
        self.sizes = [tuple(row) for row in size.tolist()]
        turned -= self.least[islands][:, None]
        mask, first_rows = _touched(turned, islands, size, reach)
        starts, stops = _runs(mask)
        owner = np.searchsorted(first_rows, starts // mask.shape[1], side="right") - 1
        rows = starts // mask.shape[1] - first_rows[owner]
        lengths = stops - starts
        self.cells = np.bincount(owner, lengths, len(size))
        self.centers = (np.bincount(owner, lengths * rows, len(size)) / self.cells).tolist()
        # A run is covered by two that overlap, of a length that is a power of two.
        power = np.frexp(lengths)[1] - 1
        first = rows * side + starts % mask.shape[1]
        shifts = np.stack([first, first + lengths - (1 << power)], axis=1).tolist()
        cuts = np.searchsorted(owner, np.arange(len(size) + 1)).tolist()
        runs = [(k, shift) for k, pair in zip(power.tolist(), shifts, strict=True) for shift in pair]
        self._runs = [list(dict.fromkeys(runs[2 * a : 2 * b])) for a, b in zip(cuts[:-1], cuts[1:], strict=True)]

    def overlaps(self, island: int, taken: list[int]) -> int:
        """The cells at which the island would overlap taken ones."""
        bits = 0
        for power, shift in self._runs[island]:
            bits |= taken[power] >> shift
        return bits

    def bits(self, island: int) -> int:
        """The cells of the island that starts at the first cell."""
        bits = 0
        for power, shift in self._runs[island]:
            bits |= ((1 << (1 << power)) - 1) << shift
        return bits


def _touched(corners: np.ndarray, islands: np.ndarray, size: np.ndarray, reach: int) -> tuple[np.ndarray, np.ndarray]:
    """The cells that triangles touch, or are `reach` from those.

    Returns a mask (rows, columns) bool with the islands one below the other, and the first row of each.
    """
    first_rows = np.cumsum(size[:, 1]) - size[:, 1]
    bottom, top = np.floor(corners[:, :, 1].min(axis=1)), np.floor(corners[:, :, 1].max(axis=1))
    count = np.minimum(top - bottom + 1, size[islands, 1] - 2 * reach).astype(np.int64)
    triangle = np.repeat(np.arange(len(corners)), count)
    row = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count - bottom.astype(np.int64), count)
    first, last = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        (x, y), (dx, dy) = corners[:, a].T, (corners[:, b] - corners[:, a]).T
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.where(dy == 0.0, 0.0, dx / dy)
        low, high = np.minimum(y, y + dy)[triangle], np.maximum(y, y + dy)[triangle]
        meets = (low < row + 1.0) & (high >= row)
        x, y, slope = x[triangle], y[triangle], slope[triangle]
        ends = [x + (np.clip(row + step, low, high) - y) * slope for step in (0.0, 1.0)]
        flat = (dy == 0.0)[triangle]
        ends[1] = np.where(flat, x + dx[triangle], ends[1])
        first = np.where(meets, np.minimum(first, np.minimum(*ends)), first)
        last = np.where(meets, np.maximum(last, np.maximum(*ends)), last)
    columns = int(min(size[:, 0].max(), 2**31)) + 1
    limit = size[islands, 0][triangle] - 1
    start = np.clip(first, 0, limit).astype(np.int64)
    stop = np.clip(last + 1 + 2 * reach, 1, limit + 1).astype(np.int64)
    at = (first_rows[islands][triangle] + np.minimum(row, size[islands, 1][triangle] - 1 - 2 * reach) + reach) * columns
    length = int(size[:, 1].sum()) * columns
    steps = np.bincount(at + start, minlength=length) - np.bincount(at + stop, minlength=length)
    mask = np.cumsum(steps).reshape(-1, columns) > 0
    grown = mask.copy()
    for step in range(1, reach + 1):  # the first and the last rows of an island are empty so far
        grown[step:] |= mask[:-step]
        grown[:-step] |= mask[step:]
    return grown, first_rows


def _runs(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first and the last cell but one of each run in the rows of a mask whose last column is empty."""
    steps = np.diff(mask.reshape(-1).view(np.int8), prepend=np.int8(0))
    return np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
