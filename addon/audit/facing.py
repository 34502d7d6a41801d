# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds low or high meshes whose faces point to the wrong side, from a few hundred of their faces."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..mesh.local_space import gap_of_boxes
from ..mesh.triangle_mesh import Mesh

LOW_FACES, HIGH_FACES = 256, 2048
"""The most faces of the low mesh, and of all high ones, that are compared."""
AGAINST = 0.8
"""The share of the low faces that point against the high ones near them, above which one of the two meshes is flipped. Thin
parts reach half of it, because the nearest face can be on their other side."""
INWARD = -0.3
"""How much of a closed mesh's surface points inward: -1 for a flipped sphere, 0 for a plane."""


@dataclass(frozen=True)
class Faces:
    """Some faces of an object in world space: centers and normals (N, 3) float64; the normals have the lengths of areas."""

    centers: np.ndarray
    normals: np.ndarray

    @property
    def outward(self) -> float:
        """From -1 for a closed surface whose faces point inward to 1 for one whose faces point outward."""
        away = self.centers - self.centers.mean(axis=0)
        parts = (away * self.normals).sum(axis=1)
        most = (np.linalg.norm(away, axis=1) * np.linalg.norm(self.normals, axis=1)).sum()
        return float(parts.sum() / most) if most > 0.0 else 0.0


def of_mesh(mesh: Mesh, most: int) -> Faces:
    """Some triangles of a mesh, evenly spaced in their order, at most `most`."""
    kept = mesh.front_triangles[:: max(1, -(-len(mesh.triangles) // most))]
    corners = mesh.positions[mesh.vertices[kept]].astype(np.float64) @ mesh.to_world[:3, :3].T + mesh.to_world[:3, 3]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    return Faces((a + b + c) / 3.0, np.cross(b - a, c - a))


def joined(faces: Sequence[Faces]) -> Faces:
    """The faces of several objects."""
    return Faces(np.concatenate([each.centers for each in faces]), np.concatenate([each.normals for each in faces]))


def is_against(low: Faces, high: Faces) -> bool:
    """Whether the faces of two surfaces in the same place, or side by side, point to opposite sides."""
    low, high = _with_area(low), _with_area(high)
    if not len(low.centers) or not len(high.centers):
        return False
    # Relative to a place near them: squares of large coordinates lose the distances.
    below, above = low.centers - low.centers.mean(axis=0), high.centers - low.centers.mean(axis=0)
    boxes = _box(below), _box(above)
    if gap_of_boxes(*boxes) > 0.0:
        above = above + (sum(boxes[0]) - sum(boxes[1])) / 2.0
    squares = (above * above).sum(axis=1) - 2.0 * below @ above.T
    nearest = high.normals[squares.argmin(axis=1)]
    return bool(((low.normals * nearest).sum(axis=1) < 0.0).mean() > AGAINST)


def flipped_one(low: Faces, high: Faces) -> str:
    """Which of two surfaces that `is_against` finds is flipped: "high" if only its faces point inward, else "low"."""
    return "high" if high.outward < INWARD < low.outward else "low"


def _with_area(faces: Faces) -> Faces:
    kept = (np.isfinite(faces.centers) & np.isfinite(faces.normals)).all(axis=1) & faces.normals.any(axis=1)
    return Faces(faces.centers[kept], faces.normals[kept])


def _box(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return points.min(axis=0), points.max(axis=0)
