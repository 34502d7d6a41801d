# SPDX-License-Identifier: GPL-3.0-or-later
"""The high meshes on the GPU: drawn by Flatten, whole or in parts, and what is read of them at the hits."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import gpu
import numpy as np

from ..core import threads
from ..core.material_feeds import ExactFeed
from ..core.progress import Timings
from ..mesh import shared_values, uv_layout
from ..mesh.inputs import HitsOfFeed
from ..mesh.local_space import LocalSpace
from ..mesh.triangle_mesh import ATTRIBUTE, TANGENTS, UV_LAYER, Mesh, normal_matrix
from ..passes import cast, data_texture, high_in_uv, mesh_upload, shader, surface_tables, target
from ..passes.surface_tables import CornerValues
from .bands import Band
from .tree_cache import RayScene

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
    """The high meshes as high_in_uv.draw_normals takes them.

    space_to_world (4, 4): of the space of normals; None for world space.
    """

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
        """Draw the normals of all meshes into `into`. Yields the finished share after each part, at last 1."""
        target.clear(into)
        if not self._is_in_parts(band.width * band.height):
            for mesh, count in self._whole():
                _draw_batch(into, mesh, count, band)
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
        _draw_batch(into, (batch, matrix), len(kept), band)
        into.finish()  # so that the driver frees the part before the next one is uploaded


def _piece(high: Mesh, triangles: np.ndarray) -> gpu.types.GPUBatch:
    """Some of a mesh's triangles (N, 3), uploaded. Most meshes have the corners of a piece side by side."""
    first, end = int(triangles.min()), int(triangles.max()) + 1
    if end - first > triangles.size:
        return _of_corners(high, triangles.reshape(-1))
    return mesh_upload.upload(triangles - first, uv=high.uv[first:end], normal=high.normals[first:end])


def _unrolled(high: Mesh, kept: np.ndarray) -> gpu.types.GPUBatch:
    """These triangles (N,) int of a mesh, as high_in_uv.draw_normals takes them."""
    return _of_corners(high, np.take(high.triangles, kept, axis=0, mode="clip").reshape(-1))


def _of_corners(high: Mesh, corners: np.ndarray) -> gpu.types.GPUBatch:
    """The triangles of these corners (3 N,) int, as high_in_uv.draw_normals takes them."""
    uv, normal = (np.take(values, corners, axis=0, mode="clip") for values in (high.uv, high.normals))
    return mesh_upload.upload_corners(uv=uv, normal=normal)


def _draw_batch(
    into: target.Target,
    mesh: tuple[gpu.types.GPUBatch, np.ndarray],
    count: int,
    band: Band,
) -> None:
    """Draw a mesh of `count` triangles over what is in `into`."""
    if len(high_in_uv.steps_of(count)) > 1:
        high_in_uv.draw_normals_in_steps(into, mesh, count, band.uv_to_clip)
    else:
        high_in_uv.draw_normals(into, [mesh], band.uv_to_clip, clear=False)


@dataclass(frozen=True)
class HighSurface:
    """What hits are on.

    Attributes:
        ray_scene: Of `highs`, maybe without a tree.
    """

    highs: Sequence[Mesh]
    ray_scene: RayScene
    _layers: dict[tuple[str, str], CornerValues] = field(default_factory=dict, repr=False)

    @property
    def local_space(self) -> LocalSpace:
        return self.ray_scene.local_space

    @property
    def tables(self) -> cast.Tables:
        return self.ray_scene.tables

    @cached_property
    def corners(self) -> np.ndarray:
        """The corners of each triangle (T, 3) int32, in the order of the hits, counted mesh after mesh."""
        return np.take(
            np.concatenate(
                [first + high.front_triangles for first, high in zip(self._firsts, self.highs, strict=True)]
            ),
            self.ray_scene.order,
            axis=0,
        )

    @cached_property
    def numbers(self) -> np.ndarray:
        """The number, from 0, of each triangle (T,) int32 in the hits, mesh after mesh."""
        numbers = np.empty(len(self.ray_scene.order), np.int32)
        numbers[self.ray_scene.order] = np.arange(len(numbers), dtype=np.int32)
        return numbers

    @cached_property
    def material_numbers(self) -> np.ndarray:
        """The number of each triangle's material (T,) int, in the order of the hits."""
        return self._materials.astype(np.int64)

    def hits_of(
        self, feed: ExactFeed, triangles: np.ndarray, weights: np.ndarray
    ) -> Iterator[tuple[np.ndarray, HitsOfFeed]]:
        """Hits (N,), as cast.read_hits has them, mesh by mesh, each with the places of its hits in (N,)."""
        whole = self.ray_scene.order[triangles]
        starts = np.cumsum([0, *(len(high.triangles) for high in self.highs)])
        of_corners = np.concatenate([1.0 - weights.sum(axis=1, keepdims=True), weights], axis=1, dtype=np.float32)
        of_mesh = np.searchsorted(starts, whole, side="right") - 1
        for mesh in np.unique(of_mesh).tolist():
            high, places = self.highs[mesh], np.flatnonzero(of_mesh == mesh)
            own, mixed = whole[places] - starts[mesh], of_corners[places]
            is_mirrored = high.front_triangles is not high.triangles
            number = int(high.labels[own[0], 0])
            yield places, HitsOfFeed(feed, high, number, own, mixed[:, ::-1] if is_mirrored else mixed)

    @property
    def uv(self) -> np.ndarray:
        """The UVs that Flatten draws (3 T, 2) float32, of the corners of each triangle in the order of the hits."""
        return np.concatenate([high.uv for high in self.highs])[self.corners.reshape(-1)]

    @property
    def _firsts(self) -> list[int]:
        """The number of the first corner of each mesh."""
        return np.cumsum([0, *(len(high.vertices) for high in self.highs[:-1])]).tolist()

    @cached_property
    def labels(self) -> gpu.types.GPUTexture:
        """A data texture with the numbers of each triangle's object, material and part in x, y and z."""
        labels = np.concatenate([high.labels for high in self.highs])[self.ray_scene.order]
        return data_texture.upload(np.pad(labels, ((0, 0), (0, 3 - labels.shape[1]))))

    def uvs(self, layer: str) -> CornerValues:
        """A UV map of the high meshes, as surface_tables.upload_uvs arranges it. Meshes without it have zeros."""
        return self._cached(
            UV_LAYER, layer, 2, lambda uv, corners: surface_tables.upload_uvs(uv, corners, self._materials)
        )

    def attribute(self, name: str) -> CornerValues:
        """An attribute of the high meshes, as surface_tables.upload_values arranges it. Meshes without it have zeros."""
        return self._cached(ATTRIBUTE, name, 4, surface_tables.upload_values)

    def tangents(self, layer: str) -> CornerValues:
        """The tangents of a UV map in world space, as surface_tables.upload_tangents arranges them."""
        return self._cached(TANGENTS, layer, 4, surface_tables.upload_tangents)

    def _cached(
        self, kind: str, name: str, channels: int, upload: Callable[[np.ndarray, np.ndarray], CornerValues]
    ) -> CornerValues:
        """A layer of all meshes; it is uploaded once. upload: takes the values and their places by triangle, (T, 3) int."""
        key = kind, name
        if key not in self._layers:
            counts = [len(high.positions) for high in self.highs]
            shared = [
                shared_values.share(count, high.vertices, _layer(high, key, channels), high.front_triangles)
                for count, high in zip(counts, self.highs, strict=True)
            ]
            values, own = shared_values.joined(shared, counts)
            order = self.ray_scene.order
            self._layers[key] = upload(values, shared_values.places(own[order], self._vertices[order]))
        return self._layers[key]

    @property
    def _vertices(self) -> np.ndarray:
        """The vertices of each triangle (T, 3) int32, counted and in order mesh after mesh."""
        firsts = np.cumsum([0, *(len(high.positions) for high in self.highs[:-1])]).tolist()
        return np.concatenate(
            [
                first + threads.take(high.vertices, high.front_triangles)
                for first, high in zip(firsts, self.highs, strict=True)
            ]
        )

    @property
    def _materials(self) -> np.ndarray:
        """The number of each triangle's material (T,), in the order of the hits."""
        return np.concatenate([high.labels[:, 1] for high in self.highs])[self.ray_scene.order]


def _layer(high: Mesh, key: tuple[str, str], channels: int) -> np.ndarray:
    """A layer of one mesh, tangents in world space; zeros if the mesh lacks it."""
    values = high.layers.get(key)
    if values is None:
        return np.zeros((len(high.vertices), channels), np.float32)
    if key[0] != TANGENTS:
        return values
    linear = high.to_world[:3, :3]
    # A mirror turns the bitangent around.
    turned = np.concatenate([values[:, :3] @ linear.T, np.sign(np.linalg.det(linear)) * values[:, 3:]], axis=1)
    return turned.astype(np.float32)
