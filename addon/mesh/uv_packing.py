# SPDX-License-Identifier: GPL-3.0-or-later
"""Packs UV islands into a map by their outlines, as large as they fit, with a margin around each.

Islands are turned upright: their straight borders run along u and v. At a size, one after the other, the largest first, goes to
the lowest free place of a strip as wide as the map. How high the strip is filled tells at which size it is filled to the top of
the map. Small islands are set side by side in rows first, by their boxes and not in whole cells, and rows are packed together.
Beside what stays in the map, islands keep their size, and cells that are too near to it are taken from the beginning.

Source: the lowest place for one after the other, of Baker, Coffman and Rivest, "Orthogonal packings in two dimensions", 1980;
islands as cells in several directions, of Sander, Wood, Gortler, Snyder and Hoppe, "Multi-chart geometry images", 2003; rows
by height, of Coffman, Garey, Johnson and Tarjan, "Performance bounds for level-oriented two-dimensional packing algorithms",
1980.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..core.progress import Progress, Task, finish, part
from . import topology, uv_cells
from .triangles import checked
from .uv_cells import Outlines, Runs, Shapes, Strip

QUICK_CELLS, CELLS = 256, 512
"""Cells a side, about: up to twice as many, so that the distance of two islands is a whole number of them. Fewer in a quick
search."""
DIRECTIONS, MORE_DIRECTIONS, FEW = 2, 4, 60
"""The directions in which an island without straight borders is tried in each quarter of the circle, evenly: more if islands
are few, and the search is not quick."""
STRAIGHT = 0.3
"""The share of an island's outline that runs along one direction, or across, from which on it is upright then."""
UPRIGHT = 1.0005
"""An island alone is upright unless it could be so much longer otherwise."""
HULL = 32
"""Directions in which points of an island alone are looked for that are farthest."""
RULES = ((1.0, 0.0), (0.0, 1.0), (0.5, 0.5))
"""Which place is the lowest: the weights of the height of the island's center there and of its top."""
NOISE, SEED = 0.3, 1
"""Islands are tried by area, and by area times a random factor, whose logarithm has a standard deviation of NOISE."""
TRIES, WORK = 4, 1500
"""Sizes that are tried; more in a search that is not quick, until so many islands were placed together."""
ORDERS, QUICK_ORDERS, PLACED = 16, 3, 400
"""How many orders are tried at a size, at most, and how many ways to put islands in rows in a quick search; fewer if they have
more islands than the last number together."""
STEP, FINE, COARSE = 1.01, 1.0007, 1.05
"""The factors by which the next size differs, at least, and by which it must to be tried at all, and late in a quick search."""
MOST, FEWEST = 300, 4
"""Islands that are packed by their outlines, at most: the smallest of more are in rows. Fewer small ones are in no rows."""
SMALL = 1.15
"""An island is small if whole cells make its box larger by this factor."""
BOXY = 0.8
"""The share of its box, both with the margin, that a small island takes."""
WAYS = ((0, False), (0, True), (24, False), (8, True), (60, True), (24, True))
"""Ways to put islands in rows, tried in turn: in how many blocks, about, 0 for rows as wide as the map in one; and whether all
that fill their boxes are in rows, or small ones alone."""
STRIP, TOO_HIGH = 1.5, 2.0
"""How high the strip is, in maps, and by how much more islands take at most that do not fit."""
FULL, ROUNDING = 0.85, 0.7
"""The share of the strip that is expected to be filled, and by how many cells whole ones make a side longer."""
LEAST_SHARE = 0.02
"""Islands that do not fit at this share of the map are not packed."""
QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])
"""Turns by a quarter of the circle."""


@dataclass(frozen=True, eq=False)
class PackOptions:
    """How `pack` arranges islands.

    Attributes:
        margin: around each island, as a share of the side. Along u or along v, two islands are twice as far apart.
        islands: (T,) int from 0, the island of each triangle; None for those that are connected.
        is_quick: whether few sizes and one order of islands are tried, with fewer cells.
        staying: (S, 3, 2) float, the UVs of triangles that stay where they are: islands go between them, and keep their
            size; None for none.
    """

    margin: float = 1.0 / 256.0
    islands: np.ndarray | None = None
    is_quick: bool = False
    staying: np.ndarray | None = None


def pack(uv: np.ndarray, triangles: np.ndarray, options: PackOptions = PackOptions()) -> np.ndarray | None:
    """Pack islands into the map from 0 to 1, all by the same factor: `work`, done at once.

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
    return finish(work(uv, triangles, options))


def work(uv: np.ndarray, triangles: np.ndarray, options: PackOptions = PackOptions()) -> Task[np.ndarray | None]:
    """`pack` in steps, one for each order of islands that is tried."""
    if getattr(uv, "dtype", None) in (np.float32, np.float64) and not np.isfinite(uv).all():  # of faces without an area
        return None
    uv, triangles = checked(uv, triangles, 2)
    islands = options.islands
    if islands is None:
        islands, _ = topology.components(tuple(triangles.T), len(uv))
    if not len(triangles) or not 2.0 * options.margin < 1.0:
        return None
    search = _Search(uv[triangles].astype(np.float64), islands, options)
    places = yield from search.best() if options.staying is None else search.beside(options.staying)
    if places is None:
        return None
    of_uvs = np.zeros(len(uv), np.int64)
    of_uvs[triangles] = np.unique(islands, return_inverse=True)[1][:, None]
    return places.move(uv, of_uvs)


def are_apart(corners: np.ndarray, islands: np.ndarray, gap: float) -> bool:
    """Whether islands in the map from 0 to 1 share no cell of the size `gap`, as those that are so far apart along u or v.

    Args:
        corners: (T, 3, 2) float, the UVs of triangles.
        islands: (T,) int.
    """
    if not len(islands):
        return True
    side = int(1.0 / gap)
    order = np.argsort(islands, kind="stable")
    owner = np.unique(islands[order], return_inverse=True)[1]
    outlines = Outlines.around(np.clip(corners[order].astype(np.float64), 0.0, 1.0) * side, owner)
    runs = uv_cells.rasterize(outlines, np.full((int(owner.max(initial=-1)) + 1, 2), side + 1))
    cell = topology.ranges(runs.row * (side + 1) + runs.column, runs.length)
    return len(np.unique(cell)) == len(cell)


def upright(outlines: Outlines) -> tuple[np.ndarray, np.ndarray]:
    """By which angle (I,) to turn islands so that they lie along u and v, and which (I,) bool have straight borders.

    Most of straight borders run along the axes then; without such, the island's box is as small as it can be.

    Args:
        outlines: of the islands, in UVs.
    """
    owner, count = outlines.of[outlines.sides[:, 0]], int(outlines.of[-1]) + 1
    along = np.diff(outlines.points[outlines.sides], axis=1)[:, 0]
    length, angle = np.hypot(*along.T), np.arctan2(along[:, 1], along[:, 0]) % (0.5 * np.pi)
    # Directions in a quarter of the circle, by degrees, each with its two neighbors.
    step = 0.5 * np.pi / 90
    bins = np.bincount(owner * 90 + (angle / step).astype(np.int64) % 90, length, count * 90).reshape(count, 90)
    near = bins + np.roll(bins, 1, axis=1) + np.roll(bins, -1, axis=1)
    most = near.argmax(axis=1)
    is_straight = near[np.arange(count), most] >= STRAIGHT * np.maximum(bins.sum(axis=1), 1e-300)
    middle = (most + 0.5) * step
    away = (angle - middle[owner] + 0.25 * np.pi) % (0.5 * np.pi) - 0.25 * np.pi
    # The median of what is near, by length: borders that are not quite parallel turn no rectangle.
    is_near = np.flatnonzero(np.abs(away) <= 2.0 * step)
    is_near = is_near[np.lexsort((away[is_near], owner[is_near]))]
    total = np.bincount(owner[is_near], length[is_near], count)
    so_far = np.cumsum(length[is_near]) - (np.cumsum(total) - total)[owner[is_near]]
    is_past = so_far >= 0.5 * total[owner[is_near]]
    halves, first = np.unique(owner[is_near[is_past]], return_index=True)
    middle[halves] += away[is_near[is_past][first]]
    if not is_straight.all():
        middle[~is_straight] = _smallest_box(outlines.chosen(~is_straight), np.arange(0.0, 0.5 * np.pi, 2.0 * step))
    return -middle, is_straight


def _smallest_box(outlines: Outlines, turns: np.ndarray) -> np.ndarray:
    """The first of some angles (N,) at which the box (I,) of each shape is the smallest, if it is turned back by it."""
    begins = np.flatnonzero(np.diff(outlines.of, prepend=-1))
    turned = _rotations(-turns) @ outlines.points.T  # of one coordinate after the other: numpy is slow along short axes
    box = (np.maximum.reduceat(turned, begins, axis=2) - np.minimum.reduceat(turned, begins, axis=2)).prod(axis=1)
    return turns[(box <= box.min(axis=0) * (1.0 + 1e-9)).argmax(axis=0)]


def _turned(points: np.ndarray, angle: float) -> np.ndarray:
    """Points (N, 2) turned by an angle."""
    return points @ _rotations(np.array([angle]))[0].T


def _rotations(angles: np.ndarray) -> np.ndarray:
    """The matrices (I, 2, 2) that turn by angles (I,)."""
    cosine, sine = np.cos(angles), np.sin(angles)
    return np.stack([np.stack([cosine, -sine], axis=1), np.stack([sine, cosine], axis=1)], axis=1)


def _outermost(points: np.ndarray) -> np.ndarray:
    """Those of points (N, 2) that can be corners of their convex hull: not inside that of the farthest in some directions."""
    angles = 2.0 * np.pi * np.arange(HULL) / HULL
    far = points[
        [int((points @ direction).argmax()) for direction in np.stack([np.cos(angles), np.sin(angles)], axis=1)]
    ]
    outside = np.zeros(len(points), bool)
    for start, along in zip(far, np.roll(far, -1, axis=0) - far, strict=True):
        away = points - start
        outside |= along.any() & (along[0] * away[:, 1] - along[1] * away[:, 0] <= 0.0)
    return points[outside] if outside.any() else points[:1]


@dataclass(frozen=True, eq=False)
class _Places:
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

    def then(self, other: "_Places") -> "_Places":
        """These, and those of another after them."""
        moved = (other.matrices @ self.offsets[:, :, None])[:, :, 0] + other.offsets
        return _Places(other.matrices @ self.matrices, moved)

    def of(self, islands: np.ndarray) -> "_Places":
        """Those of some islands."""
        return _Places(self.matrices[islands], self.offsets[islands])


@dataclass(frozen=True, eq=False)
class _Items:
    """What is packed at a size: islands, and blocks of small ones. All in cells.

    Attributes:
        of: (I,) int, the item of each island.
        inner: where each island is in its item.
        outlines: of items.
        is_free: (N,) bool, which items are tried in more directions than along the axes.
        has_blocks: whether there are any.
    """

    of: np.ndarray
    inner: _Places
    outlines: Outlines
    is_free: np.ndarray
    has_blocks: bool


@dataclass(frozen=True, eq=False)
class _Turned:
    """Items in all directions, in cells: a point goes to matrices[k] @ point + offsets[k] in the cells of the k-th shape.

    Attributes:
        matrices: (K, 2, 2).
        offsets: (K, 2).
        shapes: of the cells that they touch. The first ones are the items as they are.
        of: the shapes of each item.
    """

    matrices: np.ndarray
    offsets: np.ndarray
    shapes: Shapes
    of: list[list[int]]


class _Search:
    """The search for the largest size. Islands are upright; a size is how many cells are as long as 1 in UVs."""

    def __init__(self, corners: np.ndarray, islands: np.ndarray, options: PackOptions):
        used, of = np.unique(islands, return_inverse=True)
        order = np.argsort(of, kind="stable")
        corners, owner, self.count = corners[order], of[order], len(used)
        self.given = Outlines.around(corners, owner)
        angles, self.is_straight = upright(self.given)
        turns = _rotations(angles)
        turned = replace(self.given, points=(turns[self.given.of] @ self.given.points[:, :, None])[:, :, 0])
        least, most = turned.boxes()
        self.extents = most - least
        self.outlines = replace(turned, points=turned.points - least[turned.of])
        (ux, uy), (vx, vy) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
        self.areas = np.bincount(owner, 0.5 * np.abs(ux * vy - uy * vx), self.count)
        self.upright = _Places(turns, -least)
        self.random = np.random.default_rng(SEED)
        self.is_quick, self.margin = options.is_quick, options.margin
        cells, between = QUICK_CELLS if options.is_quick else CELLS, 2.0 * options.margin
        if between > 0.0:
            cells = min(np.ceil(cells * between - 1e-6) / between, 2.0 * cells)
        self.side = int(cells * (1.0 - between) + 1e-6)
        self.cell = (1.0 - between) / max(self.side, 1)
        self.gap = int(np.ceil(between / self.cell * (1.0 - 1e-9)))

    def best(self) -> Task[_Places | None]:
        """Where islands go at the largest size that is found."""
        if not self.areas.sum() > 0.0 or self.side < 1:
            return None
        if self.count == 1:
            return self._alone()
        least = self.side * np.sqrt(LEAST_SHARE / self.areas.sum())
        most = np.inf if self.is_quick else self._largest  # a quick search has too few tries to begin there
        size = max(min(self._size(FULL * self.side**2), most), least)
        best, smallest_too_large, work, tries, done = None, most * STEP, 0, 0, 0.0
        while True:
            height, found, placed = yield from part(self._try(size), done, done)
            work, tries = work + placed, tries + 1
            done = max(done, min(0.9, max(work / WORK, tries / (2.0 * TRIES))))
            following = self._size(self._need(size) * self.side / height)
            if found is None:
                if best is None and size <= least:
                    return None
                smallest_too_large = min(smallest_too_large, size)
                following = max(min(following, size / STEP), least)
            else:
                # In a slow search, the sizes between are worth their tries: each shuffles the orders anew.
                best, largest = found, size * (max(1.0, self._room(found)) if self.is_quick else 1.0)
                following = max(following, largest * STEP)
            if best is not None:
                if following <= largest or following >= smallest_too_large:
                    following = np.sqrt(largest * smallest_too_large)
                enough = (following / largest < COARSE or tries >= 2 * TRIES) if self.is_quick else work > WORK
                if min(following, most) / largest < FINE or (tries >= TRIES and enough):
                    return self._filling(self.upright.then(best))
            size = following

    def beside(self, staying: np.ndarray) -> Task[_Places | None]:
        """Where islands go at their own size, beside triangles (S, 3, 2) that stay."""
        if not self.areas.sum() > 0.0 or self.side < 1:
            return None
        taken, work = self._taken(staying), 0
        for k in range(ORDERS):
            yield Progress("Packing UV islands", k / ORDERS)
            items = self._items(1.0 / self.cell, *WAYS[k % len(WAYS)])
            turned = self._turned(items)
            order = self._order(turned.shapes.cells[: len(turned.of)], k)
            _, places = self._place(turned, order, RULES[k % len(RULES)], self.side, taken)
            if places:
                return self.upright.then(self._found(items, turned, places))
            work += len(order)
            if work > WORK:
                break
        return None

    def _taken(self, staying: np.ndarray) -> np.ndarray:
        """The cells (side, side) bool, rows first, that are too near to triangles (S, 3, 2) that stay."""
        reach, size = 2 * self.gap + 1, self.side + 2 * self.gap  # with those around the cells
        corners = (staying.astype(np.float64) - self.margin) / self.cell + self.gap
        least, most = corners.min(axis=1), corners.max(axis=1)
        is_near = ((most >= 0.0) & (least < size)).all(axis=1)
        is_out = is_near & (least[:, 1] < 0.0)  # as boxes: of others, rows from the lowest on are looked at
        least, most = (np.clip(end[is_out], 0.0, size - 0.5) for end in (least, most))
        box = [np.stack([x, y], axis=1) for y in (least[:, 1], most[:, 1]) for x in (least[:, 0], most[:, 0])]
        corners = np.concatenate(
            [
                corners[is_near & ~is_out],
                *(np.stack([box[a], box[b], box[c]], axis=1) for a, b, c in ((0, 1, 2), (1, 3, 2))),
            ]
        )
        taken = np.zeros((size, size), bool)
        if not len(corners):
            return taken[: self.side, : self.side]
        outlines = Outlines.around(corners, np.zeros(len(corners), np.int64))
        runs = uv_cells.rasterize(outlines, np.array([[size, size]]))
        taken.reshape(-1)[topology.ranges(runs.row * size + runs.column, runs.length)] = True
        for _ in range(2):
            before = np.pad(np.cumsum(taken, axis=0, dtype=np.int64), ((1, 0), (0, 0)))
            taken = (before[reach:] > before[:-reach]).T
        return taken

    def _order(self, cells: np.ndarray, number: int) -> list[int]:
        """The order in which items of so many cells are placed: the largest first, in all orders but the first about."""
        noise = NOISE * self.random.standard_normal(len(cells)) if number else 0.0
        return np.argsort(-cells * np.exp(noise), kind="stable").tolist()

    def _filling(self, places: _Places) -> _Places:
        """Places so that islands just reach two opposite sides of the map, with the margin."""
        least = places.move(self.given.points, self.given.of).min(axis=0)
        factor = self._room(places, self.given)
        return _Places(places.matrices * factor, self.margin + (places.offsets - least) * factor)

    def _room(self, places: _Places, outlines: Outlines | None = None) -> float:
        """By which factor islands may be larger until they reach two opposite sides of the map, with the margin. outlines:
        what is moved; None for upright islands."""
        outlines = self.outlines if outlines is None else outlines
        extent = np.ptp(places.move(outlines.points, outlines.of), axis=0).max()
        return float((1.0 - 2.0 * self.margin) / max(extent, 1e-300))

    def _alone(self) -> _Places:
        """One island, in the smallest square: upright, if others are hardly smaller."""
        points = _outermost(self.outlines.points)
        sides, turns = [], [0.0]
        for step in (np.pi / 360, np.pi / 36000):
            middle = turns[int(np.argmin(sides))] if sides else 0.25 * np.pi
            turns += (middle + step * np.arange(-90, 91)).tolist()
            for turn in turns[len(sides) :]:
                sides.append(float(np.ptp(_turned(points, turn), axis=0).max()))
        best = 0 if sides[0] <= min(sides) * UPRIGHT else int(np.argmin(sides))
        return self._filling(self.upright.then(_Places(_rotations(np.array([turns[best]])), np.zeros((1, 2)))))

    @property
    def _angles(self) -> list[float]:
        """The angles in a quarter of the circle by which islands without straight borders are turned."""
        number = MORE_DIRECTIONS if self.count <= FEW and not self.is_quick else DIRECTIONS
        return (0.5 * np.pi * np.arange(number) / number).tolist()

    @cached_property
    def _largest(self) -> float:
        """The size at which the island that needs most is as long as the map, or as wide: none can be packed larger."""
        sides = []
        for angle in self._angles:
            least, most = replace(self.outlines, points=_turned(self.outlines.points, angle)).boxes()
            sides.append((most - least).max(axis=1))
        needed = np.where(self.is_straight, sides[0], np.min(sides, axis=0))
        return self.side / max(float(needed.max()), 1e-300) * (1.0 - 1e-9)

    @cached_property
    def _strip(self) -> Strip:
        return Strip((self.side, int(STRIP * self.side)), self.gap)

    def _need(self, size: float) -> float:
        """About the cells that islands take, with the margin around them."""
        return float(np.polyval(self._polynomial, size))

    def _size(self, need: float) -> float:
        """The size at which islands take about so many cells; 0 if none."""
        square, linear, constant = self._polynomial
        return (np.sqrt(max(0.0, linear**2 + 4.0 * square * max(0.0, need - constant))) - linear) / (2.0 * square)

    @cached_property
    def _polynomial(self) -> list[float]:
        around = self.gap + ROUNDING
        return [float(self.areas.sum()), float(self.extents.sum()) * around, self.count * around**2]

    def _try(self, size: float) -> Task[tuple[float, _Places | None, int]]:
        """Pack at a size. Returns how high the strip is filled, where islands go if they fit, and how many items were placed
        in all orders that were tried."""
        lowest, work = np.inf, 0
        items = self._items(size, *WAYS[0])
        most = min(ORDERS, len(RULES) * max(1, self.count * (self.count - 1)))
        if self.is_quick:
            most = QUICK_ORDERS if items.has_blocks else 1
        turned, known = self._turned(items), set()
        for k in range(most):
            yield Progress("Packing UV islands", 0.0)
            if k == 1 or (k and items.has_blocks):
                before, items = items, self._items(size, *WAYS[k % len(WAYS)])
                if before.has_blocks or items.has_blocks:  # else they are the same
                    turned = self._turned(items)
            order = self._order(turned.shapes.cells[: len(turned.of)], k)
            way = (*order, k % len(RULES), k if items.has_blocks else 0)
            if way in known:  # few islands have few orders
                continue
            known.add(way)
            height, places = self._place(turned, order, RULES[k % len(RULES)], self.side if k else STRIP * self.side)
            lowest, work = min(lowest, height), work + len(order)
            if height <= self.side:
                return height, self._found(items, turned, places), work
            if work > PLACED:
                break
        return lowest, None, work

    def _items(self, size: float, blocks: int, with_large: bool) -> _Items:
        """The islands at a size, some in rows: see WAYS."""
        wide, high = extents = self.extents.T * size
        gap = self.gap
        box = (wide + gap) * (high + gap)
        is_boxy = self.areas * size**2 + gap * (wide + high + gap) > BOXY * box
        is_small = is_boxy & (with_large | ((wide + gap + ROUNDING) * (high + gap + ROUNDING) > SMALL * box))
        large = np.flatnonzero(~is_small)
        is_small[large[np.argsort(-box[large], kind="stable")[MOST:]]] = True
        if np.count_nonzero(is_small) < FEWEST:
            is_small[:] = False
        small, large = np.flatnonzero(is_small), np.flatnonzero(~is_small)
        of, place = np.empty(self.count, np.int64), np.zeros((self.count, 2))
        of[large] = np.arange(len(large))
        matrices = np.tile(size * np.eye(2), (self.count, 1, 1))
        outlines = self.outlines.chosen(~is_small)
        outlines = replace(outlines, points=outlines.points * size)
        is_free = ~self.is_straight[large]
        if len(small):
            is_wide = (wide > high)[small]
            matrices[small[is_wide]] = size * QUARTER
            place[small[is_wide], 0] = high[small[is_wide]]
            sizes = np.sort(extents[:, small], axis=0).T  # the longer side is upright
            target = np.sqrt(box[small].sum() / blocks) if blocks else self.side + gap
            block, where, shapes = _rows(sizes + gap, min(target, self.side + gap), target if blocks else np.inf)
            place[small] += where
            of[small] = block + len(large)
            outlines = outlines.with_boxes(shapes - gap)
            is_free = np.append(is_free, np.zeros(len(shapes), bool))
        return _Items(of, _Places(matrices, place), outlines, is_free, len(small) > 0)

    def _turned(self, items: _Items) -> _Turned:
        """Items in all directions: each in four, turned by quarters, and the free ones in more."""
        angles = self._angles
        some = items.outlines.chosen(items.is_free) if items.is_free.any() else None
        given = [items.outlines, *([some] * (len(angles) - 1) if some is not None else [])]
        turned = [replace(each, points=_turned(each.points, angle)) for each, angle in zip(given, angles, strict=False)]
        outlines, free = Outlines.together(turned), np.flatnonzero(items.is_free)
        item = np.concatenate([np.arange(len(items.is_free)), np.tile(free, len(given) - 1)])
        turns = _rotations(np.repeat(angles[: len(given)], [int(each.of[-1]) + 1 for each in given]))
        least, most = outlines.boxes()
        extent = most - least
        sizes = np.clip(np.ceil(extent - 1e-6), 1, 2 * self.side).astype(np.int64)  # larger ones do not fit anyway
        corner = least - 0.5 * np.maximum(sizes - extent, 0.0)  # as much place on one side as on the other
        outlines = replace(outlines, points=outlines.points - corner[outlines.of])
        across, count = replace(outlines, points=outlines.points[:, ::-1]), len(sizes)
        both = np.concatenate([sizes, sizes[:, ::-1]])
        runs = uv_cells.rasterize(Outlines.together([outlines, across]), both)
        # Mirrored along the diagonal and then along u is turned by a quarter.
        runs = replace(runs, column=np.where(runs.owner < count, runs.column, runs.mirrored(both[:, 0]).column))
        half = runs.upside_down(both[:, 1]).mirrored(both[:, 0])
        shapes = Shapes(
            np.tile(both, (2, 1)), Runs.together([runs, half], 2 * count), (self.side, int(STRIP * self.side))
        )
        (wide, high), none, aside = sizes.T, np.zeros(count, np.int64), corner @ QUARTER.T
        quarter, three = np.stack([high, none], axis=1) - aside, np.stack([none, wide], axis=1) + aside
        # A box is the same when it is turned by half the circle.
        number = np.arange(4 * count).reshape(4, -1)
        number[2:, shapes.cells[:count] == sizes.prod(axis=1)] = -1
        of = np.split(number.T[np.argsort(item, kind="stable")].reshape(-1), np.cumsum(4 * np.bincount(item))[:-1])
        return _Turned(
            np.concatenate([turns, QUARTER @ turns, -turns, -QUARTER @ turns]),
            np.concatenate([-corner, quarter, corner + sizes, three]),
            shapes,
            [each[each >= 0].tolist() for each in of],
        )

    def _place(
        self,
        turned: _Turned,
        order: list[int],
        rule: tuple[float, float],
        limit: float,
        taken: np.ndarray | None = None,
    ) -> tuple[float, dict[int, tuple[int, int, int]]]:
        """Place items one after the other, as low as they go in the strip. taken: its cells that are not free.

        Returns how high it is filled, about, if it is higher than the limit; and the shape of each item, and its first cell
        along u and v.
        """
        shapes, rows = turned.shapes, int(min(limit, STRIP * self.side))
        high = shapes.sizes[:, 1].tolist()
        above = (rule[0] * shapes.centers + rule[1] * shapes.sizes[:, 1]).tolist()
        strip, places, top = self._strip, {}, 0
        strip.clear(shapes.powers)
        if taken is not None:
            strip.take(taken)
        for number, item in enumerate(order, 1):
            best, lowest = None, np.inf
            for height, shape in sorted((above[shape], shape) for shape in turned.of[item]):
                place = strip.first_free(shapes, shape, min(lowest - height, rows - high[shape] + 1))
                if place is not None and place[1] + height < lowest:
                    best, lowest = (shape, *place), place[1] + height
            if best is None:
                cells = shapes.cells[: len(turned.of)]
                return rows * min(max(1.05, cells.sum() / max(1, cells[list(places)].sum())), TOO_HIGH), {}
            places[item] = best
            if number < len(order):
                strip.add(shapes, *best)
            top = max(top, best[2] + high[best[0]])
        return top, places

    def _found(self, items: _Items, turned: _Turned, places: dict[int, tuple[int, int, int]]) -> _Places:
        """Where upright islands go in the map."""
        shape, *first = np.array([places[item] for item in range(len(places))]).T
        cells = _Places(turned.matrices[shape], turned.offsets[shape] + np.stack(first, axis=1)).of(items.of)
        map_ = _Places(self.cell * np.eye(2)[None], np.full((1, 2), self.margin))
        return items.inner.then(cells).then(map_)


def _rows(sizes: np.ndarray, target: float, most: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Set boxes side by side in rows, the highest first, and rows on each other in blocks.

    Returns the block (N,) of each box, where it is there (N, 2), and the sizes of blocks (B, 2).

    Args:
        sizes: (N, 2), of boxes, along u and v.
        target: how wide blocks are, if one box is not wider.
        most: how high, if one row is not higher.
    """
    order = np.lexsort((-sizes[:, 0], -sizes[:, 1]))
    wide, high = sizes[order].T
    ends = np.cumsum(wide)
    block, where, blocks = np.empty(len(sizes), np.int64), np.empty((len(sizes), 2)), []
    first, top = 0, np.inf  # above all
    while first < len(order):
        before = ends[first] - wide[first]
        last = max(first + 1, int(np.searchsorted(ends, before + target * (1.0 + 1e-9), side="right")))
        if top == np.inf or top + high[first] > most:
            top = 0.0
            blocks.append([0.0, 0.0])
        here = order[first:last]
        block[here], where[here, 1] = len(blocks) - 1, top
        where[here, 0] = ends[first:last] - wide[first:last] - before
        top += high[first]
        blocks[-1] = [max(blocks[-1][0], ends[last - 1] - before), top]
        first = last
    return block, where, np.array(blocks)
