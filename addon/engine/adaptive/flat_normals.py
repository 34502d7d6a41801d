# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive samples by Flatten: all samples after the first two are taken in one pass, without drawing the meshes again."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ...mesh import uv_blocks, uv_cells
from ...mesh.triangle_mesh import Mesh
from ...passes.adaptive import active, cell_samples, rounds
from ...passes.adaptive.cell_samples import Sorted
from ..bands import Band
from .adaptive_normals import AdaptiveNormals

IN_CELL = 8
"""About how many triangles a cell has. Fewer take more memory, and more take longer to search."""
STRIP = 2**18
"""About how many triangles the cells have that are on the GPU at once."""


class FlatNormals(AdaptiveNormals):
    """AdaptiveNormals of sources.Flat."""

    def rest(self, band: Band) -> Iterator[float]:
        """As AdaptiveNormals has it."""
        with self.timings.timed("draw"):
            drawn, needed = self._compare(band)
        count = sum(len(high.triangles) for high in self.source.batches.highs)
        side = _side(count, band.width * band.height)
        rows = -(-band.height // side)
        strips = max(1, min(-(-count // STRIP), rows))
        bounds = [side * (rows * i // strips) for i in range(strips)] + [band.height]
        find = _Finder(self.source.batches.highs, band, side, is_striped=strips > 1)
        for strip, (start, stop) in enumerate(zip(bounds[:-1], bounds[1:], strict=True)):
            steps = self._strip(band, needed, slice(start, stop), find)
            while True:
                with self.timings.timed("draw"):
                    done = next(steps, None)
                    drawn.finish()
                if done is None:
                    break
                yield (strip + done) / strips

    def _strip(self, band: Band, needed: np.ndarray, rows: slice, find: "_Finder") -> Iterator[float]:
        """Take the samples of the texels in these rows. Yields the share that is done."""
        inside, side = needed[rows], find.side
        cells = np.zeros(find.shape, bool)
        first = rows.start // side
        asked = uv_cells.squares(inside >= 2, side)
        cells[first : first + len(asked)] = asked
        places = active.in_blocks(inside >= 2)[0] + (0, rows.start)
        if not len(places):
            return
        batches = self.source.batches
        triangles = find.in_cells(batches.highs, cells, batches.matrices)
        has_any = np.diff(triangles.starts) > 0
        found = needed[places[:, 1], places[:, 0]]
        # Empty texels away from the meshes stay empty.
        kept = (found != rounds.EMPTY) | has_any.reshape(cells.shape)[places[:, 1] // side, places[:, 0] // side]
        taken = np.cumsum([0, *map(len, self.rounds)])
        stops = taken[np.minimum(found[kept], len(self.rounds))]
        yield from cell_samples.add(
            self.mean,
            cell_samples.upload(triangles, cells.shape),
            places[kept],
            stops,
            [(offset, replace(band, offset=offset).uv_to_clip) for offset in sum(self.rounds, [])],
            side=side,
        )


class _Finder:
    """Finds the triangles of meshes that touch some cells of a band. is_striped: whether that is asked for strip after strip.

    The rows of all triangles are found once, so that strips do not look at all triangles' corners.
    """

    def __init__(self, meshes: Sequence[Mesh], band: Band, side: int, *, is_striped: bool):
        self.side, self.shape = side, (-(-band.height // side), -(-band.width // side))
        self._size, self._uv_to_clip = (band.width, band.height), replace(band, offset=(0.0, 0.0)).uv_to_clip
        self._rows: dict[int, np.ndarray] = {}
        """By the mesh's id."""
        if is_striped:
            for mesh in meshes:
                self._rows[id(mesh)] = uv_blocks.rows(mesh, self._uv_to_clip, self._size, self.shape, side)

    def in_cells(self, meshes: Sequence[Mesh], cells: np.ndarray, matrices: Sequence[np.ndarray]) -> Sorted:
        """Those of `meshes` in the cells (rows, columns) bool, of which there is one at least, with their normals.

        matrices: (3, 3), that transform the normals of each mesh.
        """
        numbers = [self._touching(mesh, cells) for mesh in meshes]
        corners = [mesh.triangles[which] for mesh, which in zip(meshes, numbers, strict=True)]
        uv = np.concatenate([mesh.uv[own] for mesh, own in zip(meshes, corners, strict=True)])
        found = uv_cells.sort(uv.transpose(2, 1, 0), self._uv_to_clip, self._size, cells, self.side)
        normals = [
            mesh.normals[own] @ matrix[:3, :3].T.astype(np.float32)
            for mesh, own, matrix in zip(meshes, corners, matrices, strict=True)
        ]
        return Sorted(found.starts, uv[found.triangles], found.planes(np.concatenate(normals)[found.triangles]))

    def _touching(self, mesh: Mesh, cells: np.ndarray) -> np.ndarray:
        """The numbers of the triangles of a mesh that may touch the cells."""
        where = self._uv_to_clip, self._size, cells, self.side
        if id(mesh) not in self._rows:
            return np.flatnonzero(uv_blocks.touching(mesh, *where))
        rows, (first, stop) = np.flatnonzero(cells.any(axis=1)), self._rows[id(mesh)]
        near = np.flatnonzero((first <= rows[-1]) & (stop > rows[0]))
        return near[uv_blocks.touching(mesh, *where, among=near)]


def _side(triangles: int, texels: int) -> int:
    """The side of a cell in texels, a power of 2, for so many triangles on so many texels."""
    side = active.BLOCK
    while side > 1 and triangles * side**2 > IN_CELL * texels:
        side //= 2
    return side
