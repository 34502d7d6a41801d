# SPDX-License-Identifier: GPL-3.0-or-later
"""Casts a few rays from a low object to high ones as the viewport shows them, for what a panel says before a bake."""

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from ..mesh.triangles import transformed, unit

REACH = 0.12
"""How far outside and inside of the low object rays look, of its diagonal, as a bake that looks for parts that stand off."""
MOST_HITS = 16
"""Of a ray: it goes on behind faces that point away from it."""
STEP = 1e-5
"""Of the reach: where a ray goes on behind a hit."""


@dataclass(frozen=True)
class Surface:
    """The faces of an evaluated object: their tree in its own space, and its matrix (4, 4) to the world."""

    tree: BVHTree
    matrix: np.ndarray

    @classmethod
    def of(cls, obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> "Surface":
        return cls(BVHTree.FromObject(obj.original, depsgraph), np.array(obj.matrix_world, np.float64))


FAR = 2.0
"""From how far outside rays look for a high surface that stands off, of the low object's diagonal."""
BEFORE = 0.5
"""The share of the way to the low object's own next surface that a ray may start outside: it does not leave a closed mesh."""


def clear_ways(tree: BVHTree, places: np.ndarray, directions: np.ndarray, far: float) -> np.ndarray:
    """How far (N,) from places (N, 3) rays in directions (N, 3) may start, at most `far`, without passing the low surface.

    tree: of the low surface, in the space of the places.
    """
    step = STEP * far
    distances = np.full(len(places), far)
    for number, (place, direction) in enumerate(zip(places, directions, strict=True)):
        hit = tree.ray_cast(Vector(place + step * direction), Vector(direction), far)
        if hit[0] is not None:
            distances[number] = BEFORE * hit[3]
    return distances


def shares(
    centers: np.ndarray,
    normals: np.ndarray,
    low: Surface,
    surfaces: Sequence[Surface],
    *,
    offset: np.ndarray,
    size: float,
    is_high: bool,
) -> tuple[float, float]:
    """The shares of places from which rays hit the outside of the surfaces, as they are, and with one of the two flipped.

    Args:
        centers, normals: (N, 3) float64, of the low object's faces, in the world; normals of any length.
        low, surfaces: Of the low object, and of the high ones.
        offset: (3,), from the low object to the high ones if they lie beside it.
        size: The diagonal of the low object.
        is_high: Whether the high ones are flipped, rather than the low one.
    """
    away = unit(normals)
    places, reach = [_Tree(surface) for surface in surfaces], REACH * size
    free = np.maximum(reach, _ways_in_world(low, centers, away, FAR * size))
    hits = np.zeros((len(centers), 2), bool)
    for number, (center, direction) in enumerate(zip(centers + offset, away, strict=True)):
        hits[number, 0] = any(place.is_hit(center, direction, 1.0, free[number], reach) for place in places)
        flipped = (direction, -1.0) if is_high else (-direction, 1.0)
        hits[number, 1] = any(place.is_hit(center, *flipped, reach, reach) for place in places)
    before, after = hits.mean(axis=0) if len(hits) else (0.0, 0.0)
    return float(before), float(after)


def _ways_in_world(low: Surface, centers: np.ndarray, away: np.ndarray, far: float) -> np.ndarray:
    """`clear_ways` of an object with a matrix."""
    to_own = np.linalg.pinv(low.matrix)
    ways = away @ to_own[:3, :3].T
    lengths = np.maximum(np.linalg.norm(ways, axis=1), 1e-30)
    own = clear_ways(low.tree, transformed(centers, to_own), ways / lengths[:, None], far * lengths.max(initial=0.0))
    return np.minimum(own / lengths, far)


class _Tree:
    """The tree of a surface, for rays in the world."""

    def __init__(self, surface: Surface):
        self.tree, self.to_own = surface.tree, np.linalg.pinv(surface.matrix)

    def is_hit(self, center: np.ndarray, away: np.ndarray, side: float, outside: float, inside: float) -> bool:
        """Whether a ray from so far outside, against `away`, to so far inside hits a face that points to it. side: -1 for one
        that points away."""
        start = self.to_own[:3, :3] @ (center + outside * away) + self.to_own[:3, 3]
        way = self.to_own[:3, :3] @ (-(outside + inside) * away)
        length = float(np.linalg.norm(way))
        if not length > 0.0:
            return False
        origin, direction, left = Vector(start), Vector(way / length), length
        for _ in range(MOST_HITS):
            place, normal, _, distance = self.tree.ray_cast(origin, direction, left)
            if place is None:
                return False
            # In the object's own space, where a mirrored object's faces point to the same sides as in the world.
            if side * normal.dot(direction) < 0.0:
                return True
            step = distance + STEP * length
            left -= step
            if left <= 0.0:
                return False
            origin = origin + direction * step
        return False
