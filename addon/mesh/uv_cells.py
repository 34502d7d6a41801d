# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds free places for shapes of cells in a strip of the map, of all places at once.

The cells of the strip are the bits of an array of bytes, and so is, for each power of two, whether one of so many cells side by
side is taken. A part of these arrays has what a row of a shape would lie on in all places, and an "or" of these parts tells
where the shape is free. Parts are taken for a few rows of the strip at a time, as one gather.

Tried, for a shape of 80 rows in 512 cells: an "or" for each part 80 us, a gather of all parts and one "or" 13 us.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import ceil

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

    @classmethod
    def together(cls, runs: Sequence["Runs"], count: int) -> "Runs":
        """Those of several times so many shapes."""
        owner = np.concatenate([each.owner + count * k for k, each in enumerate(runs)])
        return cls(
            owner, *(np.concatenate([getattr(each, name) for each in runs]) for name in ("row", "column", "length"))
        )


class Shapes:
    """Shapes of cells.

    sizes (I, 2) int: the cells of each along u and v. cells (I,) int: how many it has. centers (I,): the mean row. parts:
    where the bytes start that tell what a shape would lie on, for those from cuts[i] to cuts[i + 1] of shape i. powers: of two,
    ascending, those that are the lengths of parts.
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
        self.powers = np.unique(power).tolist()
        owner = np.append(runs.owner, runs.owner[again])
        parts = (power * 8 + bits % 8) * (strip[1] * wide) + bits // 8
        scattered = np.arange(len(parts)) * 0.618034 % 1.0  # so that the first few are from everywhere
        order = np.argsort(owner + scattered)
        self.parts = parts[order]
        self.cuts = np.searchsorted(owner[order], np.arange(count + 1))
        self.run_cuts = np.searchsorted(runs.owner, np.arange(count + 1))


class Strip:
    """The cells that are taken of a strip of the map. Rows are whole bytes, whose lowest bit is the first cell."""

    def __init__(self, size: tuple[int, int], gap: int):
        """Begin with nothing taken.

        Args:
            size: the cells along u and v.
            gap: the cells that are left free between two shapes.
        """
        (self.side, self.rows), self.gap, self.wide = size, gap, _bytes(size[0])
        # [k, b]: from which cells one of the next 2^k cells in the row is taken, moved down by b bits.
        self._each, most = self.rows * self.wide, self.side.bit_length()
        self._table = np.zeros(most * 8 * self._each + 2 * self.wide, np.uint8)
        self._parts = np.lib.stride_tricks.as_strided(
            self._table, (most * 8 * self._each, self._each), (1, 1), writeable=False
        )
        self._moved = self._table[: most * 8 * self._each].reshape(most, 8, self._each)
        self._powers = list(range(most))
        self._top = 0  # the first row from which on all are free

    def clear(self, powers: list[int]) -> None:
        """Begin again, with nothing taken: in new memory, whose pages come one by one, it takes longer.

        powers: of the shapes that are added and looked at from now on.
        """
        end = self._top * self.wide
        for k in range(self._powers[-1] + 1):
            self._moved[k, : 8 if k in self._powers else 1, :end] = 0
        self._powers = [k for k in powers if k < len(self._moved)] or [0]  # longer ones are wider than the strip
        self._top = 0

    def first_free(self, shapes: Shapes, shape: int, limit: float) -> tuple[int, int] | None:
        """The first cell (along u and v) of the lowest place where the shape is free, in the rows below a limit."""
        width, height = shapes.sizes[shape].tolist()
        rows = min(self.rows - height + 1, ceil(limit), self._top + 1)
        if width > self.side or rows <= 0:
            return None
        parts = shapes.parts[shapes.cuts[shape] : shapes.cuts[shape + 1]]
        over = self._over(parts[:FEW], 0, rows)
        over |= _too_far(self.wide, self.side, width)
        is_free = (over != 255).reshape(-1)
        row = 0
        while row < rows:
            start = row * self.wide
            step = int(is_free[start:].argmax())
            if not is_free[start + step]:
                return None
            row += step // self.wide
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

    def add(self, shapes: Shapes, shape: int, column: int, row: int) -> None:
        """Take the cells of a shape whose first cell is given, and the gap around them."""
        runs, part = shapes.runs, slice(shapes.run_cuts[shape], shapes.run_cuts[shape + 1])
        high, gap, wide = int(shapes.sizes[shape, 1]), self.gap, self.wide
        columns = column + runs.column[part]
        start, stop = np.maximum(columns - gap, 0), np.minimum(columns + runs.length[part] + gap, 8 * wide)
        rows = runs.row[part]
        begins = np.flatnonzero(np.diff(rows, prepend=-1))  # runs in one row follow each other
        lines = np.zeros((high, wide), np.uint8)
        if len(rows):
            before = _before(wide)
            lines[rows[begins]] = np.bitwise_or.reduceat(before[stop] ^ before[start], begins)
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
        self._top = max(self._top, row + len(taken))
        begin, end = row * wide, (row + len(taken)) * wide  # what is beyond a row's end counts for no shape
        self._moved[0, 0, begin:end] |= taken.reshape(-1)
        for k in range(1, self._powers[-1] + 1):
            before, (whole, rest) = k - 1, divmod(1 << (k - 1), 8)
            at = self._table[before * 8 * self._each :]
            moved = at[begin + whole : end + whole] >> rest
            if rest:
                moved |= at[begin + whole + 1 : end + whole + 1] << (8 - rest)
            np.bitwise_or(self._moved[before, 0, begin:end], moved, self._moved[k, 0, begin:end])
        bits = np.arange(1, 8, dtype=np.uint16)[:, None]
        for k in self._powers:  # most shapes have rows of few lengths
            pairs = self._moved[k, 0, begin:end].astype(np.uint16)
            pairs[:-1] |= pairs[1:] << 8
            np.right_shift(pairs, bits, self._moved[k, 1:, begin:end], casting="unsafe")


@cache
def _too_far(wide: int, side: int, width: int) -> np.ndarray:
    """The cells of a row of so many bytes where a shape of this width cannot start, if the strip has so many cells a row."""
    return np.packbits(np.arange(8 * wide) > side - width, bitorder="little")


@cache
def _before(wide: int) -> np.ndarray:
    """Rows of so many bytes with the first cells taken: none in the first row, one more in each."""
    cells = np.arange(8 * wide)
    return np.packbits(cells < np.append(cells, 8 * wide)[:, None], axis=1, bitorder="little")


def _bytes(side: int) -> int:
    """How many bytes a row of cells has."""
    return (side + 7) // 8


@dataclass(frozen=True, eq=False)
class Outlines:
    """The borders of shapes, which say all about what shapes cover, with far fewer points than their triangles.

    Attributes:
        points: (P, 2) float64, at least one for each shape.
        of: (P,) int, their shapes, ascending.
        sides: (S, 2) int, from which point to which one: the shape is on their left.
        layers: (S,) int, how many triangles more of the shape lie on each other on the left than on the right.
    """

    points: np.ndarray
    of: np.ndarray
    sides: np.ndarray
    layers: np.ndarray

    @classmethod
    def around(cls, corners: np.ndarray, owner: np.ndarray) -> "Outlines":
        """Of triangles.

        Args:
            corners: (T, 3, 2) float.
            owner: (T,) int from 0, the shape of each, ascending; each has some.
        """
        # All are turned so that their sides run around them to the left: then no two cancel what both cover.
        (ux, uy), (vx, vy) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
        is_turned = ux * vy < uy * vx
        corners = np.where(is_turned[:, None, None], corners[:, ::-1], corners).astype(np.float64) + 0.0  # no -0
        flat = corners.reshape(-1, 2)
        same = topology.first_rows(np.column_stack([flat, np.repeat(owner, 3)]))
        first, last = same, np.roll(same.reshape(-1, 3), -1, axis=1).reshape(-1)
        keys, which = np.unique(topology.edge_keys(first, last, len(flat)), return_inverse=True)
        layers = np.bincount(which.reshape(-1), np.sign(last - first), len(keys)).astype(np.int64)
        low, high = np.divmod(keys[layers != 0], len(flat))
        layers = layers[layers != 0]
        ends = np.where((layers > 0)[:, None], np.stack([low, high], axis=1), np.stack([high, low], axis=1))
        # And one point for each, which lies on it if nothing else does.
        alone = same[3 * np.flatnonzero(np.diff(owner, prepend=-1))]
        ends, layers = np.concatenate([ends, np.stack([alone, alone], axis=1)]), np.append(np.abs(layers), 0 * alone)
        used, sides = topology.numbered(ends)
        return cls(flat[used], owner[used // 3], sides, layers)

    @classmethod
    def together(cls, outlines: Sequence["Outlines"]) -> "Outlines":
        """Those of several, numbered one after the other."""
        points = np.cumsum([0] + [len(each.points) for each in outlines]).tolist()
        shapes = np.cumsum([0] + [int(each.of.max(initial=-1)) + 1 for each in outlines]).tolist()
        return cls(
            np.concatenate([each.points for each in outlines]),
            np.concatenate([each.of + first for each, first in zip(outlines, shapes, strict=False)]),
            np.concatenate([each.sides + first for each, first in zip(outlines, points, strict=False)]),
            np.concatenate([each.layers for each in outlines]),
        )

    def chosen(self, shapes: np.ndarray) -> "Outlines":
        """Those of the chosen shapes (I,) bool, numbered anew."""
        kept, new = shapes[self.of], np.cumsum(shapes) - 1
        some = kept[self.sides[:, 0]]
        sides = (np.cumsum(kept) - 1)[self.sides[some]]
        return Outlines(self.points[kept], new[self.of[kept]], sides, self.layers[some])

    def with_boxes(self, sizes: np.ndarray) -> "Outlines":
        """These, and boxes (N, 2) from 0 on as more shapes."""
        count = len(sizes)
        corners = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
        number = np.arange(4 * count) + len(self.points)
        following = np.roll(number.reshape(-1, 4), -1, axis=1).reshape(-1)
        return Outlines(
            np.concatenate([self.points, (sizes[:, None] * corners).reshape(-1, 2)]),
            np.append(self.of, np.repeat(np.arange(count), 4) + int(self.of.max(initial=-1)) + 1),
            np.concatenate([self.sides, np.stack([number, following], axis=1)]),
            np.append(self.layers, np.ones(4 * count, np.int64)),
        )

    def boxes(self) -> tuple[np.ndarray, np.ndarray]:
        """The lowest and the highest u and v (I, 2) of each shape."""
        begins = np.flatnonzero(np.diff(self.of, prepend=-1))
        return np.minimum.reduceat(self.points, begins), np.maximum.reduceat(self.points, begins)


def rasterize(outlines: Outlines, sizes: np.ndarray) -> Runs:
    """The cells that shapes touch: those that sides touch, and those whose middle is inside.

    Args:
        outlines: with points in cells from the first of their shape.
        sizes: (I, 2) int, the cells of each shape along u and v; what is beyond counts as in the last ones.
    """
    start, stop = outlines.points[outlines.sides[:, 0]], outlines.points[outlines.sides[:, 1]]
    of = outlines.of[outlines.sides[:, 0]]
    rows, lines = sizes[of, 1], (np.cumsum(sizes[:, 1]) - sizes[:, 1])[of]
    (x, y), (dx, dy) = start.T, (stop - start).T
    low, high = np.minimum(y, y + dy), np.maximum(y, y + dy)
    slope = np.divide(dx, dy, out=np.zeros_like(dx), where=dy != 0.0)
    # Where sides begin and end in each row.
    bottom, top = (np.clip(np.floor(end), 0, rows - 1).astype(np.int64) for end in (low, high))
    side, row = np.repeat(np.arange(len(of)), top - bottom + 1), topology.ranges(bottom, top - bottom + 1)
    below = np.where(row == 0, -np.inf, row)
    above = np.where(row == rows[side] - 1, np.inf, row + 1.0)
    ends = [x[side] + (np.clip(end, low[side], high[side]) - y[side]) * slope[side] for end in (below, above)]
    ends[1] = np.where(dy[side] == 0.0, (x + dx)[side], ends[1])
    columns = sizes[of[side], 0]
    first, last = (
        np.clip(np.floor(end), 0, columns - 1).astype(np.int64) for end in (np.minimum(*ends), np.maximum(*ends))
    )
    line = lines[side] + row
    # Where the middles of each row are inside: between the sides that cross it.
    bottom, top = (np.clip(np.ceil(end - 0.5), 0, rows).astype(np.int64) for end in (low, high))
    side, row = np.repeat(np.arange(len(of)), top - bottom), topology.ranges(bottom, top - bottom)
    cross, across = x[side] + (row + 0.5 - y[side]) * slope[side], lines[side] + row
    order = np.lexsort((cross, across))
    inside = np.cumsum((-np.sign(dy) * outlines.layers).astype(np.int64)[side[order]])[:-1] != 0
    begins = np.clip(np.ceil(cross[order] - 0.5), 0, sizes[of[side[order]], 0]).astype(np.int64)
    inside &= begins[1:] > begins[:-1]
    line = np.append(line, across[order][:-1][inside])
    first, last = np.append(first, begins[:-1][inside]), np.append(last + 1, begins[1:][inside])
    return _joined(line, first, last, sizes)


def _joined(line: np.ndarray, first: np.ndarray, last: np.ndarray, sizes: np.ndarray) -> Runs:
    """The runs of cells from `first` on, up to before `last`, (N,) int each, in rows that are numbered through all shapes."""
    wide = int(sizes[:, 0].max(initial=0)) + 1
    order = np.argsort(line * wide + first)
    starts, stops = (line * wide + first)[order], np.maximum.accumulate((line * wide + last)[order])
    is_new = np.append(True, starts[1:] > stops[:-1])
    starts, stops = starts[is_new], stops[np.append(is_new[1:], True)]
    line, column = np.divmod(starts, wide)
    begins = np.cumsum(sizes[:, 1]) - sizes[:, 1]
    owner = np.searchsorted(begins, line, side="right") - 1
    return Runs(owner, line - begins[owner], column, stops - starts)
