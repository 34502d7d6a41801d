# SPDX-License-Identifier: GPL-3.0-or-later
"""Tries changes of the high meshes: what places of the low mesh show with and without them, patch by patch."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.progress import Timings
from ..mesh import corner_normals
from ..mesh.triangle_mesh import Mesh
from ..mesh.triangles import barycentric
from . import tree_cache
from .high_patches import HighPatches
from .own_hits import PLACES, LowPlaces, offset_beside, own_hits

SAME = 2e-5
"""In local space. Hits at heights closer than this are the same, as of two sheets in one place."""
NEAR = 3e-3
"""In local space. A hit this far from the low mesh counts half as much as one on it."""
GAIN_OVER_LOSS = 1.5
"""A change is better if it gains more than this factor times what it loses."""
FEWEST_PLACES = 2
"""The fewest places that must gain."""


@dataclass(frozen=True)
class Shown:
    """What the places of the low mesh show.

    Attributes:
        patches (N,) int: The patch of each place's own hit, numbered mesh after mesh; -1 for places that own none.
        heights (N,): Of the hits, in local space.
        spread: How many of the places, the first ones, are spread evenly over the low mesh.
    """

    patches: np.ndarray
    heights: np.ndarray
    spread: int

    @property
    def share(self) -> float:
        """The share of the low mesh that owns a hit."""
        return float(np.mean(self.patches[: self.spread] >= 0)) if self.spread else 0.0

    @property
    def worth(self) -> np.ndarray:
        """What the hit of each place (N,) is worth: 1 on the low mesh, less far from it, and 0 without a hit of its own."""
        return np.where(self.patches >= 0, 1.0 / (1.0 + np.abs(self.heights) / NEAR), 0.0)

    @property
    def value(self) -> float:
        """What the hits of the places that are spread over the low mesh are worth together."""
        return float(self.worth[: self.spread].sum())

    def counts(self, chosen: np.ndarray, count: int) -> np.ndarray:
        """How many of the chosen places (N,) bool show each of `count` patches."""
        return np.bincount(self.patches[chosen & (self.patches >= 0)], minlength=count)


class Trials:
    """Shows high meshes to places of the low mesh with some triangles turned over, and some left out.

    highs: the meshes as the bake takes them if nothing is turned over. near: patches (count,) bool of each mesh that get places
    of their own, those nearest to them. is_reversed: whether the bake has all triangles in the reverse order, as
    draw_order.Order has them: then its tree is used. places: how many are spread over the low mesh.
    """

    def __init__(
        self,
        patches: HighPatches,
        highs: Sequence[Mesh],
        timings: Timings,
        *,
        near: Sequence[np.ndarray] = (),
        is_reversed: bool = False,
        places: int = PLACES,
    ):
        self._patches, self._timings, self._is_reversed = patches, timings, is_reversed
        self._offset = offset_beside(patches.low, patches.meshes.highs)
        self.starts = np.cumsum([0, *(one.count for one in patches.of)])
        """Where the numbers of each mesh's patches start."""
        labels = np.concatenate([one.labels + start for one, start in zip(patches.of, self.starts, strict=False)])
        self._labels = labels[::-1] if is_reversed else labels
        self._read: Shown | None = None
        self.scene = tree_cache.trees.ray_scene_of(self._in_order(highs), timings)
        self._places, self.spread = _places(patches, near, places)

    @property
    def count(self) -> int:
        """How many patches all meshes have."""
        return int(self.starts[-1])

    def expected(self, number: int) -> np.ndarray:
        """How many of the places spread over the low mesh would show each patch (count,) of a mesh if all of it were seen,
        about."""
        one, some = self._patches.of[number], self._patches.samples[number]
        counts = np.maximum(np.bincount(some.patches, minlength=one.count), 1)
        areas = np.bincount(some.patches, some.weights, one.count) / counts * one.sizes
        return self.spread * areas / max(float(self._patches.low_areas.sum()), 1e-300)

    def as_read(self) -> Shown:
        """What places show of the meshes as they are."""
        if self._read is None:
            self._read = self._shown(self.scene)
        return self._read

    def shown(self, turned: Sequence[np.ndarray], left_out: Sequence[np.ndarray] | None = None) -> Shown:
        """What places show with some triangles (T,) bool of each mesh turned over, and some left out."""
        highs = [
            corner_normals.turned_over(high, mask, one.places) if mask.any() else high
            for high, one, mask in zip(self._patches.meshes.highs, self._patches.of, turned, strict=True)
        ]
        if left_out is not None:
            highs = [_without(high, mask) for high, mask in zip(highs, left_out, strict=True)]
        return self._shown(tree_cache.variant(self._in_order(highs), self.scene, self._timings))

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """Values (count,) of all patches, mesh by mesh."""
        return np.split(values, self.starts[1:-1])

    def _in_order(self, highs: Sequence[Mesh]) -> list[Mesh]:
        if not self._is_reversed:
            return list(highs)
        return [high.with_triangles(np.arange(len(high.triangles))[::-1]) for high in reversed(highs)]

    def _shown(self, scene: tree_cache.RayScene) -> Shown:
        owned = own_hits(self._places, scene, self._offset, self._timings)
        return Shown(np.where(owned.is_own, self._labels[owned.triangles], -1), owned.heights, self.spread)


def gains(before: Shown, after: Shown, count: int) -> tuple[np.ndarray, ...]:
    """What each of `count` patches gains between two trials, what it loses, and what others gain that show in its place, three
    values (count,); how many places gain it, how many lose it, and how many of the first showed nothing, or the patch itself,
    before.

    A place that shows another patch then is a loss of both by what it shows the worse, and a gain by what it shows the better.
    Places that show the same height before and after count on neither side, whatever they show there.
    """
    is_both = (before.patches >= 0) & (after.patches >= 0)
    differs = ~is_both | (np.abs(before.heights - after.heights) > SAME)
    better = after.worth - before.worth

    def sums(shown: Shown, sign: float) -> np.ndarray:
        some = differs & (shown.patches >= 0) & (sign * better > 0.0)
        return np.bincount(shown.patches[some], sign * better[some], count)

    values = sums(after, 1.0), sums(before, -1.0) + sums(after, -1.0), sums(before, 1.0)
    fresh = after.counts(differs & ((before.patches < 0) | (before.patches == after.patches)), count)
    return *values, after.counts(differs, count), before.counts(differs, count), fresh


def _without(mesh: Mesh, left_out: np.ndarray) -> Mesh:
    """`mesh` with some triangles (T,) bool in one point, where no ray meets them: the tree stays the same."""
    if not left_out.any():
        return mesh
    triangles = mesh.triangles.copy()
    triangles[left_out] = triangles[left_out, :1]
    return replace(mesh, triangles=triangles, face_corners=None)


def _places(patches: HighPatches, near: Sequence[np.ndarray], count: int) -> tuple[LowPlaces, int]:
    """Places spread over the low mesh, and after them those that are nearest to samples of some patches; how many the first
    are."""
    places = LowPlaces.of(patches.meshes, count)
    spread = len(places.triangles)
    asked = [some.at(chosen[some.patches]) for some, chosen in zip(patches.samples, near, strict=False)]
    triangles = np.concatenate([places.triangles, *(some.closest for some in asked)])
    weights = [places.weights]
    for some in asked:
        corners = patches.low_points[patches.low.vertices[patches.low.triangles[some.closest]]]
        # A little moved to the middle: a point on an edge belongs to several triangles.
        weights.append(0.98 * barycentric(some.on_low.astype(np.float64), corners.astype(np.float64)) + 0.02 / 3.0)
    return replace(places, triangles=triangles, weights=np.concatenate(weights)), spread
