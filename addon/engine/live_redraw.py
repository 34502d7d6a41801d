# SPDX-License-Identifier: GPL-3.0-or-later
"""A normal map that stays on the GPU between changes of its meshes, so that only what changes is drawn again."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import gpu
import numpy as np

from ..core import udim
from ..core.declarations.choices import Method
from ..core.map_types import NORMAL, WRITTEN, Map
from ..core.preflight import texel_bytes
from ..core.progress import Task, finish
from ..core.settings import Run, Settings
from ..mesh import cutouts, triangle_mesh
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..passes import margin_fill, target
from ..passes.mesh_upload import UploadCache
from .baking import Drawing
from .bands import Band, bands
from .margins import PostProcess
from .planning import Plan
from .sources import Flat

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
        self._boxes: Any = None
        """The lowest and the highest UV (T, 2) of each triangle, once they are asked for."""
        self._blocks: Any = None
        """The same of each block."""
        if before is not None and _same(mesh.uv, before.mesh.uv) and _same(mesh.triangles, before.mesh.triangles):
            self._boxes, self._blocks = before._boxes, before._blocks

    def changed(self, mesh: Mesh) -> np.ndarray | None:
        """The triangles (N,) that are drawn otherwise from `mesh`; None if they are too many, or other UVs or corners."""
        before = self.mesh
        if not np.array_equal(mesh.to_world, before.to_world) or len(mesh.triangles) != len(before.triangles):
            return None
        if len(mesh.normals) != len(before.normals) or not _same(mesh.uv, before.uv):
            return None
        most, parts = MOST_CHANGED * len(mesh.triangles), []
        if mesh.triangles is not before.triangles:
            parts.append(triangle_mesh.changed_rows(mesh.triangles, before.triangles))
        if mesh.normals is not before.normals:
            if triangle_mesh.changed_share(mesh.normals, before.normals) > 2.0 * MOST_CHANGED:
                return None
            corners = triangle_mesh.changed_rows(mesh.normals, before.normals)
            if len(corners) > MOST_CHANGED * len(mesh.normals):
                return None
            parts.append(_triangles_at(mesh, corners))
        changed = np.unique(np.concatenate([np.empty(0, np.int64), *parts]))
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
        blocks = np.flatnonzero(_meet(self._blocks[0], self._blocks[1], box))
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
    rectangles = list(_rectangles(touched, 0, 0))
    if len(rectangles) > MOST_PARTS:
        rectangles = [_bounds(touched, 0, 0)]
    return [
        Part(*(range(TILE * side.start, min(TILE * side.stop, most)) for side, most in zip(sides, size, strict=True)))
        for sides in rectangles
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


MOST_DRAWN = 0.5
"""Share of the triangles. If the parts have more, drawing the whole map takes as long."""


def kept_map(settings: Settings) -> "KeptMap | MapInBands":
    """What draws the normal map of `settings`, which have no other maps, again and again."""
    return KeptMap(settings) if is_whole(settings) else MapInBands()


def is_whole(settings: Settings) -> bool:
    """Whether the normal map of `settings`, which have no other maps, is whole on the GPU, and not drawn in bands."""
    sampling, has_detail = settings.sampling, settings.map.detail_maps or settings.map.edge_radius > 0.0
    size = texel_bytes(settings, Method.AUTO, has_detail=has_detail)
    return next(bands(*sampling.size, sampling.margin, texel_bytes=size)).is_whole


class MapInBands:
    """As KeptMap, for a map that is never whole on the GPU."""

    texture = None

    def __init__(self):
        self.map: Map | None = None

    @property
    def texels(self) -> np.ndarray | None:
        """As KeptMap has it."""
        return self.map and self.map[0]

    def draw(self, drawing: Drawing, process: PostProcess) -> Task[bool]:
        """As KeptMap has it."""
        maps = yield from drawing.renderer.texels(udim.FIRST, {NORMAL.name: process})
        texels, state = maps[NORMAL.name]
        is_any = bool((state == WRITTEN).any())
        if is_any:
            self.map = texels, state
        return is_any

    def redraw(self, *_) -> bool:
        """Returns False: the whole map must be drawn."""
        return False

    def free(self) -> None:
        """As KeptMap has it."""


class KeptMap:
    """The normal map of one low object, which is not larger than a band. Draw with the same pool of targets each time.

    settings: of the bake, with the normal map alone. state (height, width) uint8: as map_types has it; None before the first
    map.
    """

    def __init__(self, settings: Settings):
        self.settings = settings
        self.band = Band(0, settings.sampling.height, settings.sampling.size, 0)
        self.state: np.ndarray | None = None
        self._stored: target.Target | None = None
        self._texels: np.ndarray | None = None
        self._nearest: margin_fill.Nearest | None = None
        self._meshes: Meshes | None = None
        """Those of the values on the GPU, by Flatten; None while these values are incomplete, or of rays."""
        self._drawn: list[DrawnMesh] = []

    @property
    def texels(self) -> np.ndarray | None:
        """The last map, (height, width, 4) float32 as it is stored. It is read when it is first asked for."""
        if self._texels is None and self._stored is not None:
            self._texels = self._stored.texels()
        return self._texels

    @property
    def map(self) -> Map | None:
        """The last map with its state."""
        return None if self.texels is None or self.state is None else (self.texels, self.state)

    def draw(self, drawing: Drawing, process: PostProcess) -> Task[bool]:
        """Draw the whole map. Returns whether any texel was written; if not, the map is gone."""
        self._meshes, plan = None, drawing.plan
        values = yield from drawing.renderer.values(udim.FIRST)
        is_any = self._store(values, process)
        if is_any and self._draws_parts(plan):
            self._meshes, before = plan.meshes, dict(enumerate(self._drawn))
            self._drawn = [DrawnMesh(high, before.get(i)) for i, high in enumerate(plan.meshes.highs)]
        return is_any

    @property
    def texture(self) -> gpu.types.GPUTexture | None:
        """The last map on the GPU, if it is there."""
        return self._stored and self._stored.texture

    def redraw(self, plan: Plan, process: PostProcess, uploads: UploadCache) -> bool:
        """Draw only what differs from the last map. Returns False, with nothing changed, if the whole map must be drawn."""
        parts = self._changed_parts(plan)
        if parts is None:
            return False
        left = MOST_DRAWN * sum(len(high.triangles) for high in plan.meshes.highs)
        around = []
        for part in parts:
            highs = [high for drawn in self._drawn if len((high := drawn.within(self._box(part))).triangles)]
            left -= sum(len(high.triangles) for high in highs)
            if left < 0:
                self._meshes = None
                return False
            around.append((part, highs))
        values, run = None, Run(self.settings)
        for part, highs in around:
            with target.limited_to(part.x, part.y):
                source = Flat(plan.meshes.low, highs, self.settings.map, run.timings)
                ((_, values),) = finish(Drawing(plan, source, run, uploads=uploads).maps.of(self.band))
        if values is not None:
            margin = self.settings.sampling.margin
            reach = None if margin is None or process.borders else margin_fill.farthest_texel(margin) + 1
            self._store_parts(values, parts, reach, process)
        return True

    def free(self) -> None:
        """Free the GPU memory. The texels stay."""
        self._texels = self.texels
        self._stored = self._nearest = self._meshes = None
        self._drawn = []

    def _draws_parts(self, plan: Plan) -> bool:
        """Whether a texel depends on nothing but the triangles of the high meshes on it."""
        is_cut = any(map(cutouts.has_layer, plan.meshes.highs))
        return not (is_cut or plan.casts_rays or plan.meshes.turns_normals(self.settings))

    def _changed_parts(self, plan: Plan) -> list[Part] | None:
        """The parts of the map that differ for `plan`, whose meshes are noted; None if all may."""
        before, meshes = self._meshes, plan.meshes
        if before is None or not self._draws_parts(plan):
            return None
        if meshes.low is not before.low or meshes.basis is not before.basis or len(meshes.highs) != len(self._drawn):
            return None
        changed = []
        for drawn, high in zip(self._drawn, meshes.highs, strict=True):
            rows = drawn.changed(high)
            if rows is None:
                return None
            changed.append(rows)
        self._meshes = meshes
        boxes = [
            drawn.replace(high, rows)
            for drawn, high, rows in zip(self._drawn, meshes.highs, changed, strict=True)
            if len(rows)
        ]
        return parts_of(np.concatenate(boxes), self.band.size) if boxes else []

    def _box(self, part: Part) -> np.ndarray:
        """The box in UV space, (4,), around a part and a texel more."""
        size = self.band.size
        lowest = (part.x.start - 1) / size[0], (part.y.start - 1) / size[1]
        return np.array([*lowest, (part.x.stop + 1) / size[0], (part.y.stop + 1) / size[1]])

    def _store(self, values: gpu.types.GPUTexture, process: PostProcess) -> bool:
        """Encode all values and fill the margin. Returns whether any texel was written."""
        # Where the same texels are written, the margin comes from the same ones.
        nearest = self._nearest or process.search(self.band, values)
        stored = process.fill(self.band, values, nearest)
        state = stored.texels(1)
        if nearest is self._nearest and not np.array_equal(state, self.state):
            nearest = process.search(self.band, values)
            stored = process.fill(self.band, values, nearest)
            state = stored.texels(1)
        self._nearest = nearest
        if not (state == WRITTEN).any():
            self._stored = self._nearest = None  # it was drawn over the last map; what was read of it stays
            return False
        self._stored, self._texels, self.state = stored, None, state
        return True

    def _store_parts(
        self, values: gpu.types.GPUTexture, parts: list[Part], reach: int | None, process: PostProcess
    ) -> None:
        """As `_store`, for some parts. reach: how far around them the margin changes, in texels; None for all of it."""
        size, nearest, whole_state = self.band.size, self._nearest, self.state
        if nearest is None or whole_state is None:
            self._store(values, process)
            return
        filled = (
            [Part(range(size[0]), range(size[1]))] if reach is None else [part.grown(reach, size) for part in parts]
        )
        for part in filled:
            with target.limited_to(part.x, part.y):
                stored = process.fill(self.band, values, nearest)
        for part in filled:
            state = np.empty((len(part.y), len(part.x)), np.uint8)
            stored.read(state, 1, (part.x.start, part.y.start))
            if not np.array_equal(state, whole_state[part.y.start : part.y.stop, part.x.start : part.x.stop]):
                self._store(values, process)
                return
        self._stored, self._texels = stored, None
