# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the parts of a map by Flatten that change with a mesh, and the triangles that are drawn there."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...mesh import triangle_mesh
from ...mesh.triangle_mesh import Mesh

TILE = 8
"""Texels per side of the squares of which parts are made."""
MOST_PARTS = 12
"""Above it, one part covers all: each has its own draws."""
MOST_CHANGED = 0.3
"""Share of the triangles of a mesh. If more have changed, drawing the whole map takes as long."""


@dataclass(frozen=True)
class Part:
    """A part of a map, in texels: columns x and rows y."""

    x: range
    y: range

    def grown(self, texels: int, size: tuple[int, int]) -> "Part":
        """This part with `texels` more on all sides, within a map of `size`."""
        x, y = (
            range(max(0, side.start - texels), min(most, side.stop + texels))
            for side, most in zip((self.x, self.y), size, strict=True)
        )
        return Part(x, y)


class DrawnMesh:
    """A mesh as Flatten has drawn it, with a box in UV space around each triangle.

    before: the mesh that was drawn before it, if any.
    """

    BLOCK = 1024
    """Triangles with a common box, so that most of them need not be looked at."""

    def __init__(self, mesh: Mesh, before: "DrawnMesh | None" = None):
        self.mesh = mesh
        self._boxes: tuple[np.ndarray, np.ndarray] | None = None
        self._blocks: tuple[np.ndarray, np.ndarray] | None = None
        if before is not None and _same(mesh.uv, before.mesh.uv) and _same(mesh.triangles, before.mesh.triangles):
            self._boxes, self._blocks = before._boxes, before._blocks

    def changed(self, mesh: Mesh) -> np.ndarray | None:
        """The triangles (N,) that are drawn otherwise from `mesh`; None if they are too many, or other UVs or corners."""
        before = self.mesh
        if not np.array_equal(mesh.to_world, before.to_world) or len(mesh.triangles) != len(before.triangles):
            return None
        if len(mesh.normals) != len(before.normals) or not _same(mesh.uv, before.uv):
            return None
        most, found = MOST_CHANGED * len(mesh.triangles), []
        if mesh.triangles is not before.triangles:
            found.append(triangle_mesh.changed_rows(mesh.triangles, before.triangles))
        if mesh.normals is not before.normals:
            if triangle_mesh.changed_share(mesh.normals, before.normals) > 2.0 * MOST_CHANGED:
                return None
            corners = triangle_mesh.changed_rows(mesh.normals, before.normals)
            if len(corners) > MOST_CHANGED * len(mesh.normals):
                return None
            found.append(_triangles_at(mesh, corners))
        changed = np.unique(np.concatenate([np.empty(0, np.int64), *found]))
        return changed if len(changed) <= most else None

    def replace(self, mesh: Mesh, changed: np.ndarray) -> np.ndarray:
        """Take `mesh` instead. changed: what `changed` returned for it. Returns the boxes in UV space (N, 4), as u and v from
        and to, in which something has changed."""
        lowest, highest = self._all_boxes()
        where = np.concatenate([lowest[changed], highest[changed]], axis=1)
        if mesh.triangles is not self.mesh.triangles:
            lowest[changed], highest[changed] = _boxes(mesh.uv, mesh.triangles[changed])
            where = np.concatenate([where, np.concatenate([lowest[changed], highest[changed]], axis=1)])
            self._gather(np.unique(changed // self.BLOCK))
        self.mesh = mesh
        return where

    def within(self, box: np.ndarray) -> Mesh:
        """The mesh with only those triangles that meet a box in UV space, (4,), u and v from and to, in their order, and with
        corners of their own."""
        lowest, highest = self._all_boxes()
        blocks = np.flatnonzero(_meet(*self._blocks, box))
        near = self._of_blocks(blocks).reshape(-1)
        near = near[near < len(lowest)]
        kept = near[_meet(lowest[near], highest[near], box)]
        mesh = self.mesh
        corners = mesh.triangles[kept].reshape(-1)
        return Mesh(
            mesh.name,
            mesh.positions,
            mesh.vertices[corners],
            mesh.normals[corners],
            np.arange(len(corners), dtype=np.int32).reshape(-1, 3),
            mesh.to_world,
            uv=mesh.uv[corners],
        )

    def _all_boxes(self) -> tuple[np.ndarray, np.ndarray]:
        if self._boxes is None:
            self._boxes = _boxes(self.mesh.uv, self.mesh.triangles)
            count = -(-len(self._boxes[0]) // self.BLOCK)
            self._blocks = np.empty((count, 2), np.float32), np.empty((count, 2), np.float32)
            self._gather(np.arange(count))
        return self._boxes

    def _gather(self, blocks: np.ndarray) -> None:
        """Compute the common boxes of these blocks."""
        rows = self._of_blocks(blocks).clip(max=len(self._boxes[0]) - 1)
        for pick, common, values in zip((np.min, np.max), self._blocks, self._boxes, strict=True):
            # One axis after another: reducing along a short last axis is ten times slower.
            for axis in (0, 1):
                common[blocks, axis] = pick(values[:, axis].take(rows), axis=1)

    def _of_blocks(self, blocks: np.ndarray) -> np.ndarray:
        """The triangles of these blocks, (B, BLOCK). There may be none with the last numbers."""
        return blocks[:, None] * self.BLOCK + np.arange(self.BLOCK)


def parts_of(boxes: np.ndarray, size: tuple[int, int], tile_start: tuple[int, int] = (0, 0)) -> list[Part]:
    """The parts of a map of `size` that contain these boxes in UV space, (N, 4), u and v from and to.

    tile_start: the lowest u and v of the map.
    """
    grid = -(-np.array(size) // TILE)
    # A texel more: the sample of a texel is anywhere in it, and rasterizers round.
    texels = (boxes.reshape(-1, 2, 2) - tile_start) * size + np.array([[-1.0], [1.0]])
    first, last = np.floor(texels / TILE).transpose(1, 0, 2)
    is_on = ((last >= 0) & (first < grid)).all(axis=1)
    first, last = (side[is_on].clip(0, grid - 1).astype(np.int64) for side in (first, last))
    # Each box adds 1 at its first tile, and takes it back beyond its last one.
    edges = np.zeros((grid[1] + 1) * (grid[0] + 1), np.int64)
    for x, y, step in ((first, first, 1), (last + 1, first, -1), (first, last + 1, -1), (last + 1, last + 1, 1)):
        edges += step * np.bincount(y[:, 1] * (grid[0] + 1) + x[:, 0], minlength=len(edges))
    touched = edges.reshape(grid[1] + 1, grid[0] + 1).cumsum(axis=0).cumsum(axis=1)[:-1, :-1] > 0
    found = list(_rectangles(touched, 0, 0))
    if len(found) > MOST_PARTS:
        found = [_bounds(touched, 0, 0)]
    return [
        Part(*(range(TILE * side.start, min(TILE * side.stop, most)) for side, most in zip(sides, size, strict=True)))
        for sides in found
    ]


def _rectangles(touched: np.ndarray, x: int, y: int) -> Iterator[tuple[range, range]]:
    """Rectangles (columns, rows) that contain all of `touched` (rows, columns) bool, divided where columns or rows are empty.

    x, y: added to their numbers.
    """
    if not touched.any():
        return
    columns, rows = _bounds(touched, x, y)
    inner = touched[rows.start - y : rows.stop - y, columns.start - x : columns.stop - x]
    for axis, start in ((0, columns.start), (1, rows.start)):
        empty = np.flatnonzero(~inner.any(axis=axis))
        if len(empty):
            cut = int(empty[len(empty) // 2])
            first, second = (inner[:, :cut], inner[:, cut:]) if axis == 0 else (inner[:cut], inner[cut:])
            yield from _rectangles(first, columns.start, rows.start)
            yield from _rectangles(second, *((start + cut, rows.start) if axis == 0 else (columns.start, start + cut)))
            return
    yield columns, rows


def _bounds(touched: np.ndarray, x: int, y: int) -> tuple[range, range]:
    """The columns and rows from the first to the last that has any."""
    sides = (np.flatnonzero(touched.any(axis=axis)) for axis in (0, 1))
    columns, rows = (range(int(side[0]), int(side[-1]) + 1) for side in sides)
    return range(x + columns.start, x + columns.stop), range(y + rows.start, y + rows.stop)


def _triangles_at(mesh: Mesh, corners: np.ndarray) -> np.ndarray:
    """The triangles of some corners, and maybe others of the same faces."""
    if mesh.face_corners is not None:
        return mesh.face_corners.triangles_of(mesh.face_corners.faces_of(corners))
    is_one = np.zeros(len(mesh.normals), bool)
    is_one[corners] = True
    return np.flatnonzero(is_one[mesh.triangles].any(axis=1))


def _boxes(uv: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and the highest UV (T, 2) of each triangle."""
    a, b, c = (uv.take(corner, axis=0) for corner in triangles.T)
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def _meet(lowest: np.ndarray, highest: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Which boxes (N,) bool meet `box` (4,)."""
    u, v = ((lowest[:, axis] <= box[2 + axis]) & (highest[:, axis] >= box[axis]) for axis in (0, 1))
    return u & v


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    return a is b or np.array_equal(a, b)
