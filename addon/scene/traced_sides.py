# SPDX-License-Identifier: GPL-3.0-or-later
"""Casts a few rays from a low object to high ones as the viewport shows them, for what a panel says before a bake."""

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

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


def shares(
    centers: np.ndarray,
    normals: np.ndarray,
    surfaces: Sequence[Surface],
    *,
    aside: np.ndarray,
    size: float,
    is_high: bool,
) -> tuple[float, float]:
    """The shares of places from which rays hit the outside of the surfaces, as they are, and with one of the two flipped.

    Args:
        centers, normals: (N, 3) float64, of the low object's faces, in the world; normals of any length.
        aside: (3,), from the low object to the high ones if they lie beside it.
        size: The diagonal of the low object.
        is_high: Whether the high ones are flipped, rather than the low one.
    """
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    away = normals / np.where(lengths > 0.0, lengths, 1.0)
    places = [_Tree(surface, REACH * size) for surface in surfaces]
    hits = np.zeros((len(centers), 2), bool)
    for number, (center, direction) in enumerate(zip(centers + aside, away, strict=True)):
        hits[number, 0] = any(place.is_hit(center, direction, 1.0) for place in places)
        flipped = (direction, -1.0) if is_high else (-direction, 1.0)
        hits[number, 1] = any(place.is_hit(center, *flipped) for place in places)
    before, after = hits.mean(axis=0) if len(hits) else (0.0, 0.0)
    return float(before), float(after)


class _Tree:
    """The tree of a surface, for rays in the world."""

    def __init__(self, surface: Surface, reach: float):
        self.tree, self.reach = surface.tree, reach
        self.to_own = np.linalg.pinv(surface.matrix)

    def is_hit(self, center: np.ndarray, away: np.ndarray, side: float) -> bool:
        """Whether a ray from outside, against `away`, hits a face within reach that points to it. side: -1 for one that points
        away."""
        start = self.to_own[:3, :3] @ (center + self.reach * away) + self.to_own[:3, 3]
        way = self.to_own[:3, :3] @ (-2.0 * self.reach * away)
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
