# SPDX-License-Identifier: GPL-3.0-or-later
"""High meshes on the GPU for Flatten: whole, or in parts that are uploaded and drawn one after the other."""

from collections.abc import Iterator, Sequence

import gpu
import numpy as np

from ...core.progress import Timings
from ...mesh import uv_layout
from ...mesh.triangle_mesh import Mesh, normal_matrix
from ...passes import mesh_upload, shader, target
from ...passes.bake import flatten
from ..bands import Band

MOST_WHOLE = 2**24
"""The most triangles that are on the GPU at once, and stay there for all samples and bands."""
PART = 2**21
"""The triangles of a part of larger meshes: small enough that the bake can be canceled in between."""
PIECE = 2**17
"""The triangles that are uploaded at a time for drivers that draw in software: these fill texels meanwhile."""
DENSE = 4
"""Triangles per texel. From here on, most triangles cover no texel's center, and finding the others costs less than drawing
all in software. GPUs leave them out themselves."""


class HighBatches:
    """The high meshes as flatten.draw takes them. space_to_world (4, 4): of the space of normals; None for world space."""

    def __init__(
        self,
        highs: Sequence[Mesh],
        space_to_world: np.ndarray | None,
        timings: Timings,
        uploads: mesh_upload.UploadCache | None = None,
    ):
        self.highs, self.timings = highs, timings
        self.matrices = [normal_matrix(high.to_world, space_to_world) for high in highs]
        self._count = sum(len(high.triangles) for high in highs)
        self._keeps = uploads is not None
        self._uploads = uploads or mesh_upload.UploadCache()
        self._uploaded: list | None = None

    def _is_in_parts(self, texels: int) -> bool:
        """Whether the meshes are drawn in parts on so many texels."""
        is_dense = shader.in_software() and self._count > DENSE * texels and not self._keeps
        return self._count > MOST_WHOLE or is_dense

    def _whole(self) -> Iterator[tuple[tuple[gpu.types.GPUBatch, np.ndarray], int]]:
        """The meshes as _draw takes them, each uploaded when it is first asked for, and kept from then on."""
        if self._uploaded is not None:
            yield from self._uploaded
            return
        uploaded = []
        for high, matrix in zip(self.highs, self.matrices, strict=True):
            count = len(high.triangles)
            size = PIECE if shader.in_software() and not self._keeps else count
            for first in range(0, count, size):
                triangles = high.triangles[first : first + size]
                with self.timings.timed("upload"):
                    if len(triangles) == count:
                        batch = self._uploads.upload(high.name, triangles, uv=high.uv, normal=high.normals)
                    else:
                        batch = _piece(high, triangles)
                uploaded.append(((batch, matrix), len(triangles)))
                yield uploaded[-1]
        self._uploaded = uploaded

    def draw(self, into: target.Target, band: Band) -> Iterator[float]:
        """Draw all meshes into `into`, as flatten.draw does. Yields the finished share after each part, at last 1."""
        target.clear(into)
        if not self._is_in_parts(band.width * band.height):
            for mesh, count in self._whole():
                _draw(into, mesh, count, band)
            yield 1.0
            return
        done = 0
        for high, matrix in zip(self.highs, self.matrices, strict=True):
            for first in range(0, len(high.triangles), PART):
                part = slice(first, min(first + PART, len(high.triangles)))
                self._draw_part(into, band, high, part, matrix)
                done += part.stop - part.start
                if done < self._count:
                    yield done / self._count
        yield 1.0

    def _draw_part(self, into: target.Target, band: Band, high: Mesh, part: slice, matrix: np.ndarray) -> None:
        with self.timings.timed("upload"):
            kept = uv_layout.over_centers(high, band.uv_to_clip, (band.width, band.height), part)
            if not len(kept):
                return
            batch = _unrolled(high, kept)
        _draw(into, (batch, matrix), len(kept), band)
        into.finish()  # so that the driver lets go of the part before the next one comes


def _piece(high: Mesh, triangles: np.ndarray) -> gpu.types.GPUBatch:
    """Some of a mesh's triangles (N, 3), as flatten.draw takes them. Most meshes have the corners of a piece side by side."""
    first, end = int(triangles.min()), int(triangles.max()) + 1
    if end - first > triangles.size:
        return _of_corners(high, triangles.reshape(-1))
    return mesh_upload.upload(triangles - first, uv=high.uv[first:end], normal=high.normals[first:end])


def _unrolled(high: Mesh, kept: np.ndarray) -> gpu.types.GPUBatch:
    """These triangles (N,) int of a mesh, as flatten.draw takes them."""
    return _of_corners(high, np.take(high.triangles, kept, axis=0, mode="clip").reshape(-1))


def _of_corners(high: Mesh, corners: np.ndarray) -> gpu.types.GPUBatch:
    """The triangles of these corners (3 N,) int, as flatten.draw takes them."""
    uv, normal = (np.take(values, corners, axis=0, mode="clip") for values in (high.uv, high.normals))
    return mesh_upload.upload_corners(uv=uv, normal=normal)


def _draw(
    into: target.Target,
    mesh: tuple[gpu.types.GPUBatch, np.ndarray],
    count: int,
    band: Band,
) -> None:
    """Draw a mesh of `count` triangles over what is in `into`."""
    if shader.in_software() and count > flatten.STEP:
        flatten.draw_in_steps(into, mesh, count, band.uv_to_clip)
    else:
        flatten.draw(into, [mesh], band.uv_to_clip, clear=False)
