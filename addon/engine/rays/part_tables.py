# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of high meshes that have more triangles than a texture holds: in parts, which are built when rays reach them."""

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...core import threads
from ...core.timings import Timings
from ...mesh.local_space import LocalSpace
from ...mesh.spatial import shared_normals, tree_parts
from ...mesh.triangle_mesh import Mesh
from ...passes.bake import cast

PART = 12 * 2**20
"""The most triangles of a part."""
KEPT_BYTES = 3 * 2**30
"""The most GPU memory that parts hold at once. Beyond it, they are built again whenever rays are cast at them."""
MOST_TRIANGLES = 2**28 - 1
"""The most triangles of all parts together, which shaders/lib/hit_lib.glsl can number."""


@dataclass(frozen=True)
class Part:
    """`count` triangles from number `first` on, of those of all parts. Their tables number them from 0."""

    first: int
    count: int
    tables: cast.Tables


class PartTables:
    """What cast.Tables holds, of any number of triangles of `highs`, in parts.

    timings: of the bake that asks for parts. most: the most triangles of a part that the GPU takes. order (T,) int32: as in
    tree_cache.RayScene.
    """

    def __init__(self, highs: Sequence[Mesh], local_space: LocalSpace, timings: Timings, *, most: int):
        self.timings, self._size = timings, min(PART, most)
        self._points = _joined([local_space.points(high) for high in highs])
        self._normals = _joined([high.to_world_normals(high.normals) for high in highs])
        # The winding decides whether a ray hits the front or the back.
        self._corners = _numbered([high.front_triangles for high in highs], [len(high.vertices) for high in highs])
        self._vertices = _numbered([high.vertices for high in highs], [len(high.positions) for high in highs])
        self.order, self._grid = tree_parts.order(self._points, self._vertices_of, len(self._corners))
        self._kept: OrderedDict[int, Part] = OrderedDict()

    @property
    def bytes(self) -> int:
        """The GPU memory of the parts that are there, and the memory of what others are built from."""
        held = sum(part.tables.bytes for part in self._kept.values())
        return held + sum(
            array.nbytes for array in (self._points, self._normals, self._corners, self._vertices, self.order)
        )

    @property
    def count(self) -> int:
        """The number of parts."""
        return -(-len(self.order) // self._size)

    def parts(self) -> Iterator[Part]:
        """Each part once. Those that are there come first: so fewer are built if not all of them can stay."""
        starts = list(range(0, len(self.order), self._size))
        for start in sorted(starts, key=lambda start: start not in self._kept):
            part = self._kept.pop(start, None)
            if part is None:
                part = self._build(start)
            self._kept[start] = part
            yield part

    def _build(self, start: int) -> Part:
        """Build a part, in the place of parts that were used longest ago."""
        triangles = self.order[start : start + self._size]
        corners = threads.take(self._corners, triangles)
        with self.timings.timed("tree"):
            vertices = threads.take(self._vertices, corners)
            nodes, first_leaf = tree_parts.nodes(self._points, vertices, self._grid)
        largest = max((part.tables.bytes for part in self._kept.values()), default=0)
        while self._kept and largest * (len(self._kept) + 1) > KEPT_BYTES:
            self._kept.popitem(last=False)
        with self.timings.timed("upload"):
            tables = cast.upload(
                nodes,
                self._points,
                vertices,
                *shared_normals.share_of_part(len(self._points), vertices, self._normals, corners),
                first_leaf=first_leaf,
                origin=self._grid.origin,
                scale=self._grid.scale,
            )
        return Part(start, len(triangles), tables)

    def _vertices_of(self, block: slice) -> np.ndarray:
        """The vertices (N, 3) of triangles, in the order of the meshes."""
        return threads.take(self._vertices, self._corners[block])


def _joined(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """One array of all; of one alone, without a copy: they are large."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)


def _numbered(indices: Sequence[np.ndarray], counts: Sequence[int]) -> np.ndarray:
    """Indices into several arrays as such into all of them together. counts: their lengths."""
    starts = np.cumsum([0, *counts[:-1]])
    return _joined([one + start if start else one for one, start in zip(indices, starts, strict=True)])
