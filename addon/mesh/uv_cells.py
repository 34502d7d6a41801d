# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds free places for shapes of cells in a strip of the map, of all places at once.

The cells of the strip are the bits of an array of bytes, and so is, for each power of two, whether one of so many cells side by
side is taken. A part of these arrays has what a row of a shape would lie on in all places, and an "or" of these parts tells
where the shape is free. Parts are taken for a few rows of the strip at a time, as one gather.

Tried, for a shape of 80 rows in 512 cells: an "or" for each part 80 us, a gather of all parts and one "or" 13 us.
"""

from dataclasses import dataclass, replace

import numpy as np

from . import topology

FEW = 6
"""The parts of a shape that are looked at in the whole strip, before all of them are in a few rows."""
WINDOW = 16
"""The rows that are looked at together."""


@dataclass(frozen=True)
class Runs:
    """Cells side by side in a row, in the order of their shapes.

    Attributes:
        owner: (R,) int, their shape.
        row: (R,) int.
        column: (R,) int, of the first of them.
        length: (R,) int, how many.
    """

    owner: np.ndarray
    row: np.ndarray
    column: np.ndarray
    length: np.ndarray

    def upside_down(self, high: np.ndarray) -> "Runs":
        """With the rows in reverse. high (I,) int: the rows of each shape."""
        return replace(self, row=high[self.owner] - 1 - self.row)

    def mirrored(self, wide: np.ndarray) -> "Runs":
        """With the columns in reverse. wide (I,) int: the columns of each shape."""
        return replace(self, column=wide[self.owner] - self.column - self.length)


class Shapes:
    """Shapes of cells in one direction.

    sizes (I, 2) int: the cells of each along u and v. cells (I,) int: how many it has. centers (I,): the mean row. parts:
    where the bytes start that tell what a shape would lie on, for those from cuts[i] to cuts[i + 1] of shape i.
    """

    def __init__(self, sizes: np.ndarray, runs: Runs, strip: tuple[int, int]):
        """strip: the cells along u and v."""
        self.sizes, self.runs = sizes, runs
        count = len(sizes)
        self.cells = np.bincount(runs.owner, runs.length, count).astype(np.int64)
        self.centers = np.bincount(runs.owner, runs.length * runs.row, count) / np.maximum(self.cells, 1)
        wide = _bytes(strip[0])
        # A run is covered by two that overlap, of a length that is a power of two.
        power = np.frexp(runs.length)[1] - 1
        more = runs.length - (1 << power)
        again = np.flatnonzero(more)
        bits = runs.row * 8 * wide + runs.column
        bits, power = np.append(bits, (bits + more)[again]), np.append(power, power[again])
        owner = np.append(runs.owner, runs.owner[again])
        parts = (power * 8 + bits % 8) * (strip[1] * wide) + bits // 8
        scattered = np.arange(len(parts)) * 0.618034 % 1.0  # so that the first few are from everywhere
        order = np.lexsort((scattered, owner))
        self.parts = parts[order]
        self.cuts = np.searchsorted(owner[order], np.arange(count + 1))
        self.run_cuts = np.searchsorted(runs.owner, np.arange(count + 1))


class Strip:
    """The cells that are taken of a strip of the map. Rows are whole bytes, whose lowest bit is the first cell."""

    def __init__(self, size: tuple[int, int], longest: int, gap: int):
        """Begin with nothing taken.

        Args:
            size: the cells along u and v.
            longest: the longest run of shapes.
            gap: the cells that are left free between two shapes.
        """
        (self.side, self.rows), self.gap, self.wide = size, gap, _bytes(size[0])
        # [k, b]: from which cells one of the next 2^k cells in the row is taken, moved down by b bits.
        powers, each = max(1, longest).bit_length(), self.rows * self.wide
        self._table, self._each = np.zeros(powers * 8 * each + 2 * self.wide, np.uint8), each
        self._moved = self._table[: powers * 8 * each].reshape(powers, 8, each)
        self._parts = np.lib.stride_tricks.as_strided(self._table, (powers * 8 * each, each), (1, 1), writeable=False)
        self._outside: dict[int, np.ndarray] = {}

    def first_free(self, shapes: Shapes, shape: int, limit: float) -> tuple[int, int] | None:
        """The first cell (along u and v) of the lowest place where the shape is free, in the rows below a limit."""
        width, height = shapes.sizes[shape].tolist()
        rows = int(min(self.rows - height + 1, np.ceil(limit)))
        if width > self.side or rows <= 0:
            return None
        parts = shapes.parts[shapes.cuts[shape] : shapes.cuts[shape + 1]]
        outside = self._too_far(width)
        over = self._over(parts[:FEW], 0, rows)
        over |= outside
        is_free = (over != 255).any(axis=1)
        row = 0
        while row < rows:
            step = int(is_free[row:].argmax())
            row += step
            if not is_free[row]:
                return None
            last = min(row + WINDOW, rows)
            here = over[row:last]
            if len(parts) > FEW:
                here = here | self._over(parts[FEW:], row, last)
            free = here != 255
            where = int(free.argmax())
            if free.reshape(-1)[where]:
                byte = ~int(here.reshape(-1)[where]) & 255
                row_there, column = divmod(8 * where + (byte & -byte).bit_length() - 1, 8 * self.wide)
                return column, row + row_there
            row = last
        return None

    def _over(self, parts: np.ndarray, first: int, last: int) -> np.ndarray:
        """What parts of a shape would lie on in rows of the strip."""
        length = (last - first) * self.wide
        return np.bitwise_or.reduce(self._parts[:, :length][parts + first * self.wide], axis=0).reshape(-1, self.wide)

    def _too_far(self, width: int) -> np.ndarray:
        """The cells of a row where a shape of this width cannot start."""
        if width not in self._outside:
            self._outside[width] = np.packbits(np.arange(8 * self.wide) > self.side - width, bitorder="little")
        return self._outside[width]

    def add(self, shapes: Shapes, shape: int, column: int, row: int) -> None:
        """Take the cells of a shape whose first cell is given, and the gap around them."""
        runs, part = shapes.runs, slice(shapes.run_cuts[shape], shapes.run_cuts[shape + 1])
        high, gap, wide = int(shapes.sizes[shape, 1]), self.gap, self.wide
        columns = column + runs.column[part]
        start, stop = np.maximum(columns - gap, 0), np.minimum(columns + runs.length[part] + gap, 8 * wide)
        rows = runs.row[part] * (8 * wide + 1)
        steps = np.bincount(rows + start, minlength=high * (8 * wide + 1)).astype(np.int16)
        steps -= np.bincount(rows + stop, minlength=len(steps)).astype(np.int16)
        lines = np.packbits(np.cumsum(steps).reshape(high, -1)[:, :-1] > 0, axis=1, bitorder="little")
        taken = np.zeros((high + 2 * gap, wide), np.uint8)
        for step in range(2 * gap + 1):
            taken[step : step + high] |= lines
        first, last = max(row - gap, 0), min(row + high + gap, self.rows)
        self._take(taken[first - row + gap : last - row + gap], first)

    def take(self, cells: np.ndarray) -> None:
        """Take cells (R, C) bool from the first row on, without a gap around them."""
        self._take(np.packbits(cells, axis=1, bitorder="little"), 0)

    def _take(self, taken: np.ndarray, row: int) -> None:
        """Take the cells whose bits are set in rows of bytes (R, B) uint8 from a row on."""
        wide = self.wide
        begin, end = row * wide, (row + len(taken)) * wide  # what is beyond a row's end counts for no shape
        self._moved[0, 0, begin:end] |= taken.reshape(-1)
        for k in range(1, len(self._moved)):
            before, (whole, rest) = k - 1, divmod(1 << (k - 1), 8)
            at = self._table[before * 8 * self._each :]
            moved = at[begin + whole : end + whole] >> rest
            if rest:
                moved |= at[begin + whole + 1 : end + whole + 1] << (8 - rest)
            np.bitwise_or(self._moved[before, 0, begin:end], moved, self._moved[k, 0, begin:end])
        pairs = self._moved[:, 0, begin:end].astype(np.uint16)
        pairs[:, :-1] |= pairs[:, 1:] << 8
        np.right_shift(
            pairs[:, None], np.arange(1, 8, dtype=np.uint16)[:, None], self._moved[:, 1:, begin:end], casting="unsafe"
        )


def _bytes(side: int) -> int:
    """How many bytes a row of cells has."""
    return (side + 7) // 8


def rasterize(corners: np.ndarray, owner: np.ndarray, sizes: np.ndarray) -> Runs:
    """The cells that triangles touch.

    Args:
        corners: (T, 3, 2) float, in cells from the first of their shape.
        owner: (T,) int, their shapes, ascending.
        sizes: (I, 2) int, the cells of each shape along u and v; what is beyond counts as inside.
    """
    columns = sizes[:, 0] + 1  # the last one is empty, so that runs end
    length = columns * sizes[:, 1]
    begins = np.cumsum(length) - length
    triangle, row, first, last = spans(corners, sizes[owner, 1])
    of = owner[triangle]
    row = np.clip(row, 0, sizes[of, 1] - 1)
    start = np.clip(first, 0, sizes[of, 0] - 1).astype(np.int64)
    stop = np.clip(last, 0, sizes[of, 0] - 1).astype(np.int64) + 1
    at, total = begins[of] + row * columns[of], int(length.sum())
    steps = np.bincount(at + start, minlength=total) - np.bincount(at + stop, minlength=total)
    return _runs(np.cumsum(steps) > 0, begins, columns)


def transposed(runs: Runs, sizes: np.ndarray) -> Runs:
    """The same cells with rows and columns swapped. sizes (I, 2) int: of the shapes before."""
    columns = sizes[:, 1] + 1
    length = columns * sizes[:, 0]
    begins = np.cumsum(length) - length
    mask = np.zeros(int(length.sum()), bool)
    column, of = topology.ranges(runs.column, runs.length), np.repeat(runs.owner, runs.length)
    mask[begins[of] + column * columns[of] + np.repeat(runs.row, runs.length)] = True
    return _runs(mask, begins, columns)


def _runs(mask: np.ndarray, begins: np.ndarray, columns: np.ndarray) -> Runs:
    """The runs of masks one after the other. begins, columns (I,) int: where that of each shape begins, and its columns."""
    starts, lengths = topology.runs(mask)
    owner = np.searchsorted(begins, starts, side="right") - 1
    row, column = np.divmod(starts - begins[owner], columns[owner])
    return Runs(owner, row, column, lengths)


def spans(corners: np.ndarray, most: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
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
