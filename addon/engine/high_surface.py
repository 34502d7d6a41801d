# SPDX-License-Identifier: GPL-3.0-or-later
"""The triangles of the high meshes in the order in which hits number them, and what is read at the hits."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import gpu
import numpy as np

from ..mesh.local_space import LocalSpace
from ..mesh.triangle_mesh import ATTRIBUTE, TANGENTS, UV_LAYER, Mesh
from ..passes import data_texture, target
from ..passes.bake import cast
from ..passes.parts import part_hits
from ..passes.surface import corner_tables
from .rays.part_tables import PartTables
from .rays.tree_cache import RayScene


@dataclass(frozen=True)
class HighSurface:
    """What hits are on. ray_scene: of `highs`, maybe without a tree."""

    highs: Sequence[Mesh]
    ray_scene: RayScene
    _textures: dict[tuple[str, str], gpu.types.GPUTexture] = field(default_factory=dict, repr=False)

    @property
    def local_space(self) -> LocalSpace:
        return self.ray_scene.local_space

    @property
    def tables(self) -> cast.Tables:
        """The tables; not of a surface in parts."""
        return self.ray_scene.tables

    def parts(self, hits: target.Target) -> Iterator[tuple["HighSurface", target.Target]]:
        """Each part of the surface, with those of `hits` that are on it. The hits are valid until the next part."""
        scene = self.ray_scene
        if not isinstance(scene.tables, PartTables):
            yield self, hits
            return
        of_part = target.get("hits of a part", hits.width, hits.height, "RGBA32UI")
        for part in scene.tables.parts():
            part_hits.of_part(of_part, hits, part.first, part.count)
            order = scene.order[part.first : part.first + part.count]
            yield HighSurface(self.highs, replace(scene, tables=part.tables, order=order)), of_part

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

    def uvs(self, layer: str) -> gpu.types.GPUTexture:
        """A UV map of the high meshes, as corner_tables.upload_uvs arranges it. Meshes without it have zeros."""
        return self._cached(UV_LAYER, layer, 2, lambda uv: corner_tables.upload_uvs(uv, self.corners, self._materials))

    def attribute(self, name: str) -> gpu.types.GPUTexture:
        """An attribute of the high meshes, as corner_tables.upload_values arranges it. Meshes without it have zeros."""
        return self._cached(ATTRIBUTE, name, 4, lambda values: corner_tables.upload_values(values, self.corners))

    def tangents(self, layer: str) -> gpu.types.GPUTexture:
        """The tangents of a UV map in world space, as corner_tables.upload_tangents arranges them."""
        return self._cached(TANGENTS, layer, 4, lambda values: corner_tables.upload_tangents(values, self.corners))

    def _cached(
        self, kind: str, name: str, channels: int, upload: Callable[[np.ndarray], gpu.types.GPUTexture]
    ) -> gpu.types.GPUTexture:
        """The texture of a layer of all meshes; it is uploaded once."""
        key = kind, name
        if key not in self._textures:
            self._textures[key] = upload(np.concatenate([_layer(high, key, channels) for high in self.highs]))
        return self._textures[key]

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
    return np.concatenate([values[:, :3] @ linear.T, np.sign(np.linalg.det(linear)) * values[:, 3:]], axis=1)
