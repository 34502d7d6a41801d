# SPDX-License-Identifier: GPL-3.0-or-later
"""The triangles of the high meshes in the order in which hits number them, and what is read at the hits."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import gpu
import numpy as np

from ..core import threads
from ..mesh.local_space import LocalSpace
from ..mesh.spatial import shared_values
from ..mesh.triangle_mesh import ATTRIBUTE, TANGENTS, UV_LAYER, Mesh
from ..passes import data_texture
from ..passes.bake import cast
from ..passes.surface import corner_tables
from ..passes.surface.corner_tables import CornerValues
from .rays.tree_cache import RayScene


@dataclass(frozen=True)
class HighSurface:
    """What hits are on. ray_scene: of `highs`, maybe without a tree."""

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
        """A data texture with the numbers of each triangle's object and material in x and y."""
        labels = np.concatenate([high.labels for high in self.highs])[self.ray_scene.order]
        return data_texture.upload(np.pad(labels, ((0, 0), (0, 1))))

    def uvs(self, layer: str) -> CornerValues:
        """A UV map of the high meshes, as corner_tables.upload_uvs arranges it. Meshes without it have zeros."""
        return self._cached(
            UV_LAYER, layer, 2, lambda uv, corners: corner_tables.upload_uvs(uv, corners, self._materials)
        )

    def attribute(self, name: str) -> CornerValues:
        """An attribute of the high meshes, as corner_tables.upload_values arranges it. Meshes without it have zeros."""
        return self._cached(ATTRIBUTE, name, 4, corner_tables.upload_values)

    def tangents(self, layer: str) -> CornerValues:
        """The tangents of a UV map in world space, as corner_tables.upload_tangents arranges them."""
        return self._cached(TANGENTS, layer, 4, corner_tables.upload_tangents)

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
