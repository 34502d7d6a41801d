# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of a low mesh that are hidden on its map, since others share their texels: in layers, with what each would show."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import gpu
import numpy as np

from ..core import threads, udim
from ..core.settings import Run, SamplingSettings, Settings
from ..mesh import uv_islands
from ..mesh.inputs import Meshes
from ..mesh.local_space import gap, local_space_of
from ..mesh.triangle_mesh import Mesh
from ..passes import audit, low_in_uv, mesh_upload, target
from .baking import Drawing
from .bands import Band, bands
from .draw_order import overlaps_of
from .sampling import SampledMaps

HIDDEN_PROBE = 512
"""Texels a side, at most, on which hidden parts are looked for."""
DEEPEST = 16
"""How many parts on one place are looked at, from the top down."""
ROOM = 2
"""Rows around a layer that are drawn with it: texels look at those beside them."""


@dataclass(frozen=True)
class Layer:
    """Hidden parts that share no texels with each other.

    Attributes:
        number: From 1.
        triangles (N,) int: In the low mesh.
        drawing: Of the high surface at their own places.
    """

    number: int
    triangles: np.ndarray
    drawing: Drawing

    @property
    def meshes(self) -> Meshes:
        """Of the bake, with only these triangles of the low mesh and its basis, on the tile that they are drawn on."""
        return self.drawing.plan.meshes

    @property
    def maps(self) -> SampledMaps:
        """What draws the high surface."""
        return self.drawing.maps

    def bands(self, size: tuple[int, int], tile: int = udim.FIRST) -> Iterator[Band]:
        """The rows of a map of this size that the layer may cover."""
        low = self.meshes.low
        v = low.uv[low.triangles, 1] - udim.place(tile)[1]
        start = int(np.clip(np.floor(v.min() * size[1]) - ROOM, 0, size[1]))
        stop = int(np.clip(np.ceil(v.max() * size[1]) + ROOM, 0, size[1]))
        for band in bands(*size, 0, tile, texel_bytes=self.maps.texel_bytes):
            if max(band.start, start) < min(band.stop, stop):
                yield replace(band.without_halo, start=max(band.start, start), stop=min(band.stop, stop))


class _Hidden(NamedTuple):
    """What is hidden.

    Attributes:
        layers (T,) int: Those of the triangles of the low mesh; 0 for what the map shows.
        parts (T,) int: Those of the triangles.
        pairs (N, 2) int: Parts that share texels, the upper and the lower one.
        share: Of the covered texels, those that hide a part.
    """

    layers: np.ndarray
    parts: np.ndarray
    pairs: np.ndarray
    share: float


class StackedParts:
    """The hidden parts of the low mesh of a bake, in layers.

    They are looked for once they are asked for. Parts that were moved by whole tiles are hidden as well. Parts that hide
    themselves are not found, and no more than DEEPEST of those on one place.
    """

    def __init__(self, drawing: Drawing, settings: Settings):
        self._drawing, self._plan = drawing, drawing.plan
        self._settings = settings.without_other_maps()
        self._numbered: gpu.types.GPUBatch | None = None

    @cached_property
    def _tiles(self) -> np.ndarray:
        """By how many tiles (T, 2) triangles of the low mesh were moved."""
        low = self._plan.meshes.low
        tiles = np.zeros((len(low.triangles), 2), np.float32)
        if not self._settings.sampling.udim:
            moved = uv_islands.moved_copies(low)
            tiles[moved] = np.floor(low.uv[low.triangles[moved]].mean(axis=1))
        return tiles

    @cached_property
    def _hidden(self) -> "_Hidden":
        low, order, size = self._plan.meshes.low, self._plan.order, _size(self._settings.sampling, HIDDEN_PROBE)
        is_moved = self._tiles.any(axis=1)
        layers, parts_of = np.zeros((2, len(low.triangles)), np.int64)
        if not (order.is_any or is_moved.any()):
            return _Hidden(layers, parts_of, np.empty((0, 2), np.int64), 0.0)
        # The map does not have those that were moved: all others hide them.
        in_order = np.argsort(~is_moved, kind="stable")
        drawn, overlaps = _moved_back(low, self._tiles).with_triangles(in_order), order.overlaps
        if is_moved.any() or size != overlaps.size:
            overlaps = overlaps_of(drawn, size, self._plan.tiles)
        parts = parts_of[in_order] = uv_islands.parts(drawn)
        pairs, share = _hiding(drawn, parts, size, self._plan.tiles, min(overlaps.depth, DEEPEST))
        layers[in_order] = _layers(pairs, int(parts.max()) + 1)[parts]
        return _Hidden(layers, parts_of, pairs, share)

    def are_many(self, least: float) -> bool:
        """Whether more than this share of the covered texels hides a part."""
        # No more texels can hide one than have several triangles, which the plan has counted on as many texels or more.
        are_few = self._plan.order.overlaps.shared <= least and not self._tiles.any()
        return not are_few and self._hidden.share > least

    @property
    def triangles(self) -> int:
        """How many triangles of the low mesh are in hidden parts."""
        return int(np.count_nonzero(self._hidden.layers))

    def under_others(self, labels: np.ndarray) -> int:
        """How many triangles of the low mesh are in parts that are hidden by parts with other labels. labels (T,) int: of the
        triangles; that of a part's first triangle counts."""
        parts = self._hidden.parts
        label = np.zeros(int(parts.max()) + 1, np.int64)
        label[parts[::-1]] = labels[::-1]
        upper, lower = self._hidden.pairs.T
        return int(np.isin(parts, lower[label[upper] != label[lower]]).sum())

    @cached_property
    def layers(self) -> list[Layer]:
        """The layers, from the top down, without those that the high meshes do not have."""
        layers = (self._layer(number) for number in range(1, int(self._hidden.layers.max(initial=0)) + 1))
        return [layer for layer in layers if layer.meshes.highs]

    def is_hidden(self, layer: Layer, band: Band) -> np.ndarray:
        """Which texels of a band (rows, width) bool have been drawn for other triangles than those of a layer, if it covers
        them."""
        low = self._plan.meshes.low
        if self._numbered is None:
            self._numbered = audit.upload_with_ids(low.triangles, low.uv, self._hidden.layers + 1)
        (numbers,) = audit.layers_of_triangles(self._numbered, (band.width, band.height), band.uv_to_clip)
        return numbers != layer.number + 1

    def _layer(self, number: int) -> Layer:
        chosen = np.flatnonzero(self._hidden.layers == number)
        meshes = self._plan.meshes
        low, basis = (
            None if mesh is None else _moved_back(mesh.with_triangles(chosen), self._tiles[chosen])
            for mesh in (meshes.low, meshes.basis)
        )
        meshes = replace(meshes, low=low, basis=basis)
        is_drawn = None
        if self._drawing.ray_cast is None:
            meshes, is_drawn = replace(meshes, highs=self._highs(number), whole=None, kept=None), self._is_of(number)
        else:
            kept = chosen if meshes.kept is None else meshes.kept[chosen]
            meshes = replace(meshes, whole=meshes.whole_low, kept=kept)
        return Layer(number, chosen, self._drawing.of_part(meshes, is_drawn, Run(self._settings)))

    def _highs(self, number: int) -> list[Mesh]:
        """The high meshes with their triangles of one layer, without those that have none."""
        highs = self._plan.meshes.highs
        ends = np.cumsum([len(high.triangles) for high in highs])
        chosen = np.split(self._is_of(number), ends[:-1])
        return [high.with_triangles(part) for high, part in zip(highs, chosen, strict=True) if part.any()]

    def _is_of(self, number: int) -> np.ndarray:
        """Which triangles of the high meshes (T,) bool, mesh after mesh, Flatten draws at the places of one layer."""
        is_drawn = self._plan.meshes.is_drawn
        return (self._of_layer == number) & (True if is_drawn is None else is_drawn)

    @cached_property
    def _of_layer(self) -> np.ndarray:
        """The layer (T,) int to which each triangle of the high meshes belongs, mesh after mesh: that whose point in the middle
        of the triangle's UVs is nearest. 0 is what is visible on the map."""
        meshes = self._plan.meshes
        low = _moved_back(meshes.low, self._tiles)
        space = local_space_of([low])
        offset = local_space_of(meshes.highs).origin - space.origin if gap(low, meshes.highs) > 0.0 else np.zeros(3)
        points, uvs = (
            np.concatenate(middles)
            for middles in zip(*(_middles(high, space.points(high)) for high in meshes.highs), strict=True)
        )
        points -= (offset / space.size).astype(np.float32)
        nearest = _Nearest(points, uvs)
        size = _size(self._settings.sampling, HIDDEN_PROBE)
        attributes = {
            "uv": low.uv,
            "position": space.points(low)[low.vertices],
            "direction": low.normals,
        }
        drawn = target.get("audit rays", *size, "RGBA32F", "RGBA32F")
        for number in range(int(self._hidden.layers.max()) + 1):
            chosen = np.ascontiguousarray(low.triangles[self._hidden.layers == number])
            if not len(chosen):
                continue
            uploaded = mesh_upload.upload(chosen, **attributes)
            for tile in self._plan.tiles:
                low_in_uv.draw_points(drawn, uploaded, udim.uv_to_clip(tile))
                nearest.add(number, drawn.texels(), tile)
        return nearest.layers


class _Nearest:
    """The layer of which a point is nearest to each of some points.

    layers (N,) int: 0 where no layer has a point at their UVs.
    """

    def __init__(self, points: np.ndarray, uvs: np.ndarray):
        """points (N, 3), uvs (N, 2)."""
        self._points, self._uvs = points, uvs
        self._distances = np.full(len(points), np.inf, np.float32)
        self.layers = np.zeros(len(points), np.int64)

    def add(self, number: int, texels: np.ndarray, tile: int) -> None:
        """Compare them with the points of a layer on a UDIM tile. texels (height, width, 4): w is above 0 where it has one."""
        threads.for_blocks(len(self._points), partial(self._add, number, texels, udim.place(tile)))

    def _add(self, number: int, texels: np.ndarray, corner: tuple[int, int], part: slice) -> None:
        size = texels.shape[1::-1]
        place = np.floor((self._uvs[part] - corner) * size)
        inside = np.flatnonzero(((place >= 0) & (place < size)).all(axis=1))
        column, row = place[inside].astype(np.int64).T
        below, inside = texels[row, column], inside + part.start
        far = np.where(below[:, 3] > 0.0, np.linalg.norm(self._points[inside] - below[:, :3], axis=1), np.inf)
        is_nearer = far < self._distances[inside]
        self.layers[inside[is_nearer]], self._distances[inside[is_nearer]] = number, far[is_nearer]


def _layers(pairs: np.ndarray, count: int) -> np.ndarray:
    """The layer (count,) int of each part: 0 for those that no other part hides, else from 1. pairs: from `_hiding`."""
    layers = np.zeros(count, np.int64)
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    starts = np.searchsorted(both[:, 0], np.arange(count + 1))
    for part in np.unique(pairs[:, 1]).tolist():  # islands that lie below others
        taken = set(layers[both[starts[part] : starts[part + 1], 1]].tolist())
        layers[part] = next(number for number in range(1, len(taken) + 2) if number not in taken)
    return layers


def _hiding(
    low: Mesh, parts: np.ndarray, size: tuple[int, int], tiles: Sequence[int], depth: int
) -> tuple[np.ndarray, float]:
    """Which parts share texels, (N, 2) int, the upper and the lower one, and on which share of the covered texels any do.

    depth: the most triangles that are looked at on a texel.
    """
    uploaded, count = audit.upload_with_ids(low.triangles, low.uv), int(parts.max()) + 1
    codes, shared, covered = [np.empty(0, np.int64)], 0, 0
    for tile in tiles if depth > 1 else ():
        above, is_left, is_shared = [], np.ones(size[::-1], bool), np.zeros(size[::-1], bool)
        for numbers in audit.layers_of_triangles(uploaded, size, udim.uv_to_clip(tile), depth):
            is_left = is_left & (numbers > 0.0)  # then the top one comes again
            part = np.where(is_left, parts[numbers.astype(np.int64) - 1], -1)
            for upper in above:
                both = is_left & (upper != part)
                is_shared |= both
                codes.append(np.unique(upper[both] * count + part[both]))
            above.append(part)
        shared, covered = shared + int(is_shared.sum()), covered + int((above[0] >= 0).sum())
    pairs = np.stack(np.divmod(np.unique(np.concatenate(codes)), count), axis=1)
    return pairs, shared / max(1, covered)


def _moved_back(mesh: Mesh, tiles: np.ndarray) -> Mesh:
    """`mesh` with the UVs of its triangles moved by whole tiles (T, 2), down by so many."""
    if not tiles.any():
        return mesh
    moved = np.zeros_like(mesh.uv)
    moved[mesh.triangles] = tiles[:, None]
    return replace(mesh, uv=mesh.uv - moved)


def _middles(mesh: Mesh, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The middle of each triangle: of its `points` (V, 3), and of its UVs, as (T, 3) and (T, 2) float32."""

    def middles(values: np.ndarray, corners: np.ndarray) -> np.ndarray:
        return (values[corners[:, 0]] + values[corners[:, 1]] + values[corners[:, 2]]) / np.float32(3.0)

    return middles(points, mesh.vertices[mesh.triangles]), middles(mesh.uv, mesh.triangles)


def _size(sampling: SamplingSettings, most: int) -> tuple[int, int]:
    """The width and height of the map, at most so many texels each."""
    return min(sampling.width, most), min(sampling.height, most)
