# SPDX-License-Identifier: GPL-3.0-or-later
"""Packs UV islands into a map by their outlines, as large as they fit, with a margin around each.

The map is divided into cells, and an island takes all cells that it touches, with the margin around them. One after the other,
the largest first, islands go to the lowest place. All cells of the map are the bits of an array of bytes: a part of the array
has what a row of an island would lie on for all places at once, and an "or" of these parts tells where a cell is taken.

Source: the lowest place for one after the other, of Baker, Coffman and Rivest, "Orthogonal packings in two dimensions", 1980;
islands as cells in several directions, of Sander, Wood, Gortler, Snyder and Hoppe, "Multi-chart geometry images", 2003.
Tried: Blender's packing by outlines takes up to 215 s for primitives (79 s for a monkey) where this one takes 12 s at most.
"""

from dataclasses import dataclass

import numpy as np

from . import topology
from .triangles import checked

QUICK_CELLS, CELLS = 256, 512
"""Cells a side, about: up to twice as many, so that the margin is a whole number of them. Fewer in a quick search."""
TURNS = 2
"""The directions in which an island is tried in each quarter of the circle, evenly."""
RULES = ((1.0, 0.0), (0.0, 1.0), (0.5, 0.5))
"""Which place is the lowest: the weights of the height of the island's center there and of its top. Tried in turn."""
ORDERS, NOISE, SEED = 6, 0.3, 1
"""How many orders are tried at a size, at most: by area times a random factor, whose logarithm has a standard deviation of
NOISE."""
PLACED = 150
"""Fewer orders are tried if they have more islands than this together."""
MOVES = 3
"""How often the island that does not fit is moved forward in the order."""
FULL = 0.72
"""The share of the cells that are taken at the size that is tried first."""
COARSE, FINE = 1.03, 1.01
"""The factors on the area by which the size is searched: of one order, and of all."""
LEAST_SHARE = 0.02
"""Islands that do not fit at this share of the map are not packed."""


@dataclass(frozen=True)
class _Packed:
    """Where islands go: a point of island i at `uv` goes to matrices[i] @ uv + offsets[i].

    Attributes:
        matrices: (I, 2, 2) float64.
        offsets: (I, 2) float64.
    """

    matrices: np.ndarray
    offsets: np.ndarray

    def move(self, uv: np.ndarray, islands: np.ndarray) -> np.ndarray:
        """Move points (N, 2) of the islands (N,) int."""
        return (self.matrices[islands] @ uv[:, :, None])[:, :, 0] + self.offsets[islands]


@dataclass(frozen=True, eq=False)
class PackOptions:
    """How `pack` arranges islands.

    Attributes:
        margin: around each island, as a share of the side. Along u or along v, two islands are twice as far apart.
        islands: (T,) int from 0, the island of each triangle; None for those that are connected.
        is_quick: whether the size is searched by one order of islands alone, with fewer cells.
    """

    margin: float = 1.0 / 256.0
    islands: np.ndarray | None = None
    is_quick: bool = False


def pack(uv: np.ndarray, triangles: np.ndarray, options: PackOptions = PackOptions()) -> np.ndarray | None:
    """Pack islands into the map from 0 to 1, all by the same factor.

    >>> uv = np.array([(0, 0), (3, 0), (0, 1), (7, 7), (9, 7), (9, 8)], float)  # two triangles
    >>> packed = pack(uv, np.arange(6).reshape(2, 3), PackOptions(margin=0.01))
    >>> bool(packed.min() >= 0.0 and packed.max() <= 1.0)
    True

    Args:
        uv: (C, 2) float.
        triangles: (T, 3) int, indices of UVs.
        options: how far islands are apart.

    Returns:
        The new UVs (C, 2) float64; None if islands do not fit.
    """
    if getattr(uv, "dtype", None) in (np.float32, np.float64) and not np.isfinite(uv).all():  # of faces without an area
        return None
    uv, triangles = checked(uv, triangles, 2)
    islands = options.islands
    if islands is None:
        islands, _ = topology.components(tuple(triangles.T), len(uv))
    packed = _packed(uv[triangles], islands, options)
    if packed is None:
        return None
    of_uvs = np.zeros(len(uv), np.int64)
    of_uvs[triangles] = islands[:, None]
    return packed.move(uv, of_uvs)


def _packed(corners: np.ndarray, islands: np.ndarray, options: PackOptions) -> _Packed | None:
    """Where islands go. corners: (T, 3, 2), the UVs of triangles. islands: (T,) int."""
    order = np.argsort(islands, kind="stable")
    corners, islands = corners[order].astype(np.float64), islands[order]
    area = float(0.5 * np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])).sum())
    if area == 0.0:
        return None
    best = _Packing(corners, islands, area, options.margin, QUICK_CELLS).first()
    if best is not None and not options.is_quick:
        best = _Packing(corners, islands, area, options.margin, CELLS).better(best)
    return None if best is None else best.packed


@dataclass(frozen=True)
class _Fitting:
    """What fits.

    Attributes:
        share: of the map, that the triangles have.
        order: of the islands.
        rule: its weights, one of RULES.
        packed: where they go.
    """

    share: float
    order: list[int]
    rule: tuple[float, float]
    packed: _Packed


class _Packing:
    """The search for the size, which is the triangles' share of the map. Triangles are in the order of their islands."""

    def __init__(self, corners: np.ndarray, islands: np.ndarray, area: float, margin: float, cells: int):
        self.corners, self.islands, self.area = corners, islands, area
        self.reach = max(1, int(np.ceil(cells * margin - 1e-6)))
        self.side = max(2 * self.reach + 1, int(min(self.reach / max(margin, 1e-6), 2.0 * cells) + 1e-6))
        self.random = np.random.default_rng(SEED)

    def first(self) -> _Fitting | None:
        """Pack by area, at a size that is guessed and then searched."""
        share = 0.5
        for _ in range(3):
            taken = int(self._shapes(0.0, share)[0].cells.sum())
            share *= min(2.0, FULL * self.side**2 / taken)
        share = max(share, LEAST_SHARE)
        best = self._try(share, None, 1)
        while best is None and share > LEAST_SHARE:
            share /= COARSE
            best = self._try(share, None, 1)
        return None if best is None else self._grow(best, COARSE, 1)

    def better(self, best: _Fitting) -> _Fitting:
        """Pack larger, beginning with the order that fits."""
        orders = max(1, min(ORDERS, PLACED // len(best.order)))
        return self._grow(self._grow(best, COARSE, 1), FINE, orders)

    def _grow(self, best: _Fitting, factor: float, orders: int) -> _Fitting:
        while (larger := self._try(best.share * factor, best, orders)) is not None:
            best = larger
        return best

    def _try(self, share: float, last: _Fitting | None, orders: int) -> _Fitting | None:
        """Pack at a size. The first order that is tried is the one that fit last."""
        angles = 0.5 * np.pi * np.arange(TURNS) / TURNS
        turned = [shapes for angle in angles.tolist() for shapes in self._shapes(angle, share)]
        cells = turned[0].cells
        for k in range(orders):
            noise = NOISE * self.random.standard_normal(len(cells)) if k else 0.0
            order = np.argsort(-cells * np.exp(noise), kind="stable").tolist()
            rule = RULES[k % len(RULES)]
            if last is not None and k == 0:
                order, rule = last.order.copy(), last.rule
            for _ in range(MOVES + 1):
                places = self._place(turned, order, rule)
                if len(places) == len(order):
                    return _Fitting(share, order, rule, self._packed(turned, places))
                order.insert(len(places) // 2, order.pop(len(places)))
        return None

    def _shapes(self, angle: float, share: float) -> list["_Shapes"]:
        """The islands in a direction, and turned by one to three quarters of the circle from there."""
        cosine, sine = self.side * np.sqrt(share / self.area) * np.array([np.cos(angle), np.sin(angle)])
        matrix = np.array([[cosine, -sine], [sine, cosine]])
        turned = self.corners @ matrix.T
        starts = np.flatnonzero(np.diff(self.islands, prepend=-1))
        least = np.minimum.reduceat(turned.min(axis=1), starts)
        extent = np.maximum.reduceat(turned.max(axis=1), starts) - least
        inner = np.minimum(np.floor(extent) + 1.0, 2.0 * self.side)  # those that are larger do not fit anyway
        corner = (
            least - 0.5 * np.maximum(inner - extent, 0.0) - self.reach
        )  # with as much place on one side as on the other
        size = inner.astype(np.int64) + 2 * self.reach
        turned -= (corner + self.reach)[self.islands][:, None]
        mask, first_rows = _rasterize_conservative(turned, self.islands, size, self.reach)
        (left, bottom), (right, top), (wide, high) = corner.T, (corner + size).T, size.T
        quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
        row, column, length = _runs(mask)
        owner = np.searchsorted(first_rows, row, side="right") - 1
        row -= first_rows[owner]
        end = wide[owner] - column - length
        along_u = [
            _Shapes(matrix, (left, bottom), (wide, high), _Runs(owner, row, column, length), self.side),
            _Shapes(-matrix, (-right, -top), (wide, high), _Runs(owner, high[owner] - 1 - row, end, length), self.side),
        ]
        column, row, length = _runs(np.ascontiguousarray(mask.T))
        order = np.argsort(row, kind="stable")  # by islands
        column, row, length = column[order], row[order], length[order]
        owner = np.searchsorted(first_rows, row, side="right") - 1
        row -= first_rows[owner]
        end, column_2 = high[owner] - row - length, wide[owner] - 1 - column
        matrix = quarter @ matrix
        along_v = [
            _Shapes(matrix, (-top, left), (high, wide), _Runs(owner, column, end, length), self.side),
            _Shapes(-matrix, (bottom, -right), (high, wide), _Runs(owner, column_2, row, length), self.side),
        ]
        return along_u + along_v

    def _place(
        self, turned: list["_Shapes"], order: list[int], rule: tuple[float, float]
    ) -> dict[int, tuple[int, int, int]]:
        """Place islands one after the other, up to the first that does not fit. Returns the direction of each, and the first
        cell along u and v."""
        by_center, by_top = rule
        taken, places = _OccupancyGrid(self.side), {}
        for island in order:
            best, lowest = None, np.inf
            above = [by_center * shapes.centers[island] + by_top * shapes.sizes[island][1] for shapes in turned]
            for k in sorted(range(len(turned)), key=above.__getitem__):
                place = taken.first_free(turned[k], island, min(lowest - above[k], self.side))
                if place is not None and place[1] + above[k] < lowest:
                    best, lowest = (k, *place), place[1] + above[k]
            if best is None:
                break
            places[island] = best
            taken.add(turned[best[0]], island, *best[1:])
        return places

    def _packed(self, turned: list["_Shapes"], places: dict[int, tuple[int, int, int]]) -> _Packed:
        where = [places[island] for island in range(len(places))]
        matrices = np.stack([turned[k].matrix for k, _, _ in where]) / self.side
        corners = np.array([turned[k].corners[island] for island, (k, _, _) in enumerate(where)])
        return _Packed(matrices, (np.array([place for _, *place in where], float) - corners) / self.side)


@dataclass(frozen=True)
class _Runs:
    """Cells side by side in a row, by islands.

    Attributes:
        owner: (R,) int, their island.
        row: (R,) int.
        column: (R,) int, of the first of them.
        length: (R,) int, how many.
    """

    owner: np.ndarray
    row: np.ndarray
    column: np.ndarray
    length: np.ndarray


class _Shapes:
    """The cells of all islands in one direction and size.

    matrix (2, 2): from UVs to cells. corners (I, 2): where the first cell of each island is then. sizes: the cells along u and
    v. cells (I,): how many there are. centers: the mean row. parts: where the bytes start that tell what each run of an island
    would lie on, if it starts at the first cell. runs: the rows, the columns and the lengths. All count the margin.
    """

    def __init__(
        self,
        matrix: np.ndarray,
        corner: tuple[np.ndarray, np.ndarray],
        size: tuple[np.ndarray, np.ndarray],
        runs: "_Runs",
        side: int,
    ):
        self.matrix, self.corners = matrix, np.stack(corner, axis=1)
        self.sizes = list(zip(*[x.tolist() for x in size], strict=True))
        count = len(self.sizes)
        self.cells = np.bincount(runs.owner, runs.length, count)
        self.centers = (np.bincount(runs.owner, runs.length * runs.row, count) / self.cells).tolist()
        # A run is covered by two that overlap, of a length that is a power of two.
        power = np.frexp(runs.length)[1] - 1
        first = runs.row * 8 * _bytes(side) + runs.column
        bits = np.stack([first, first + runs.length - (1 << power)], axis=1)
        parts = (power[:, None] * 8 + bits % 8) * (side * _bytes(side)) + bits // 8
        cuts = np.searchsorted(runs.owner, np.arange(count + 1)).tolist()
        bounds = list(zip(cuts[:-1], cuts[1:], strict=True))
        self.parts = [list(dict.fromkeys(parts[a:b].reshape(-1).tolist())) for a, b in bounds]
        self.runs = [(runs.row[a:b], runs.column[a:b], runs.length[a:b]) for a, b in bounds]


class _OccupancyGrid:
    """The cells of the map that are taken. Rows are whole bytes, whose lowest bit is the first cell."""

    def __init__(self, side: int):
        self.side, self.wide = side, _bytes(side)
        self._cells = np.zeros((side, 8 * self.wide), bool)
        # [k, b]: from which cells one of the next 2^k cells in the row is taken, moved down by b bits.
        self._moved = np.zeros((side.bit_length(), 8, side * self.wide), np.uint8)
        self._parts = self._moved.reshape(-1)
        self._over = np.empty(side * self.wide, np.uint8)
        self._outside: dict[int, np.ndarray] = {}

    def first_free(self, shapes: _Shapes, island: int, limit: float) -> tuple[int, int] | None:
        """The first cell (along u and v) where the island does not overlap taken ones, in the rows below a limit."""
        width, height = shapes.sizes[island]
        rows = int(min(self.side - height + 1, np.ceil(limit)))
        if width > self.side or rows <= 0:
            return None
        length = rows * self.wide
        over = self._over[:length]
        over[:] = self._too_far(width)[:length]
        for start in shapes.parts[island]:
            np.bitwise_or(over, self._parts[start : start + length], over)
        is_free = over != 255
        byte = int(is_free.argmax())
        if not is_free[byte]:
            return None
        free = ~int(over[byte]) & 255
        row, column = divmod(8 * byte + (free & -free).bit_length() - 1, 8 * self.wide)
        return column, row

    def _too_far(self, width: int) -> np.ndarray:
        """The cells where an island of this width cannot start."""
        if width not in self._outside:
            row = np.arange(8 * self.wide) > self.side - width
            self._outside[width] = np.tile(np.packbits(row, bitorder="little"), self.side)
        return self._outside[width]

    def add(self, shapes: _Shapes, island: int, column: int, row: int) -> None:
        """Take the cells of an island whose first cell is given."""
        height = shapes.sizes[island][1]
        steps = np.zeros((height, 8 * self.wide + 1), np.int8)
        rows, columns, lengths = shapes.runs[island]
        steps[rows, column + columns] += 1
        steps[rows, column + columns + lengths] -= 1
        cells = self._cells[row : row + height]
        cells |= np.cumsum(steps[:, :-1], axis=1, dtype=np.int8) > 0
        # The row before also sees the first cells of this one.
        first = max(row - 1, 0)
        part = slice(first * self.wide, (row + height) * self.wide)
        moved = self._moved[:, :, part]
        moved[0, 0] = np.packbits(self._cells[first : row + height], bitorder="little")
        for k in range(1, len(moved)):
            moved[k, 0] = moved[k - 1, 0] | _shift_left(moved[k - 1, 0], 1 << (k - 1))
        for bits in range(1, 8):
            moved[:, bits] = _shift_left(moved[:, 0], bits)


def _bytes(side: int) -> int:
    """How many bytes a row of cells has."""
    return (side + 7) // 8


def _shift_left(cells: np.ndarray, bits: int) -> np.ndarray:
    """Cells (..., N) uint8 moved down by a number of bits: the first ones get lost."""
    moved = np.zeros_like(cells)
    whole, rest = divmod(bits, 8)
    length = max(0, cells.shape[-1] - whole)
    moved[..., :length] = cells[..., whole:] >> rest
    if rest:
        moved[..., : max(0, length - 1)] |= cells[..., whole + 1 :] << (8 - rest)
    return moved


def _rasterize_conservative(
    corners: np.ndarray, islands: np.ndarray, size: np.ndarray, reach: int
) -> tuple[np.ndarray, np.ndarray]:
    """The cells that triangles touch, or are `reach` from those.

    Returns a mask (rows, columns) bool with the islands one below the other, and the first row of each. The last column is
    empty, and a row after each island.
    """
    first_rows = np.cumsum(size[:, 1] + 1) - size[:, 1] - 1
    triangle, row, first, last = _spans(corners, size[islands, 1] - 2 * reach)
    columns = int(min(size[:, 0].max(), 2**31)) + 1
    limit = size[islands, 0][triangle] - 1
    start = np.clip(first, 0, limit).astype(np.int64)
    stop = np.clip(last + 1 + 2 * reach, 1, limit + 1).astype(np.int64)
    at = (first_rows[islands][triangle] + np.minimum(row, size[islands, 1][triangle] - 1 - 2 * reach) + reach) * columns
    length = int((size[:, 1] + 1).sum()) * columns
    steps = np.bincount(at + start, minlength=length) - np.bincount(at + stop, minlength=length)
    mask = np.cumsum(steps).reshape(-1, columns) > 0
    grown = mask.copy()
    for step in range(1, reach + 1):  # the first and the last rows of an island are empty so far
        grown[step:] |= mask[:-step]
        grown[:-step] |= mask[step:]
    return grown, first_rows


def _spans(corners: np.ndarray, most: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The rows of cells that triangles (T, 3, 2) touch, at most so many (T,) of each: the triangle, the row, and where the
    triangle begins and ends in it."""
    bottom, top = np.floor(corners[:, :, 1].min(axis=1)), np.floor(corners[:, :, 1].max(axis=1))
    count = np.minimum(top - bottom + 1, most).astype(np.int64)
    triangle = np.repeat(np.arange(len(corners)), count)
    row = topology.ranges(bottom.astype(np.int64), count)
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
    return triangle, row, first, last


def are_apart(corners: np.ndarray, islands: np.ndarray, gap: float) -> bool:
    """Whether islands in the map from 0 to 1 share no cell of the size `gap`, as those that are so far apart along u or v.

    Args:
        corners: (T, 3, 2) float, the UVs of triangles.
        islands: (T,) int.
    """
    side = int(1.0 / gap)
    cells = np.clip(corners.astype(np.float64), 0.0, 1.0) * side
    triangle, row, first, last = _spans(cells, np.full(len(cells), side + 1))
    first, last = (np.clip(np.floor(end), 0, side).astype(np.int64) for end in (first, last))
    length = last - first + 1
    cell = topology.ranges(first, length) + np.repeat(row, length) * (side + 1)
    owner = np.full((side + 1) * (side + 1), -1)
    numbers = np.repeat(islands[triangle], length)
    owner[cell] = numbers
    return bool((owner[cell] == numbers).all())


def _runs(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The row, the first column and the length of each run in the rows of a mask whose last column is empty."""
    starts, lengths = topology.runs(mask.reshape(-1))
    return *np.divmod(starts, mask.shape[1]), lengths
