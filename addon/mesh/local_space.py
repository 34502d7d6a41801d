# SPDX-License-Identifier: GPL-3.0-or-later
"""Local spaces around meshes, and bounding boxes in world space."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core import threads
from .triangle_mesh import Mesh
from .triangles import transformed

FARTHEST = 1e8
"""In units of a local space: single precision rounds anything farther by more than the space's size."""
POINTS_AT_ONCE = 2**14
"""Points that a thread moves at once, so that they fit in a processor's cache."""


@dataclass(frozen=True)
class LocalSpace:
    """A space whose origin and unit fit some meshes, so that single precision is as accurate far from the world's origin.

    Attributes:
        origin: (3,) float64, in world space, whose axes it has.
        size: its unit, in world units.
    """

    origin: np.ndarray
    size: float

    def points(self, mesh: Mesh) -> np.ndarray:
        """The positions (V, 3) float32 of `mesh` in this space."""
        matrix = mesh.to_world[:3, :3] / self.size
        offset = (mesh.to_world[:3, 3] - self.origin) / self.size
        points = np.empty(mesh.positions.shape, np.float32)

        def transform(part: slice) -> None:
            # One axis after another: a product of matrices with so few columns takes several times as long.
            axes = mesh.positions[part].T.astype(np.float64, order="C")
            for axis in range(3):
                values = axes[0] * matrix[axis, 0]
                for other in (1, 2):
                    if matrix[axis, other]:
                        values += axes[other] * matrix[axis, other]
                values += offset[axis]
                points[part, axis] = np.clip(values, -FARTHEST, FARTHEST, out=values)

        threads.for_blocks(len(points), transform, POINTS_AT_ONCE)
        return points


def local_space_of(meshes: Sequence[Mesh]) -> LocalSpace:
    """The space in which `meshes` together lie around the origin with a radius of about 1."""
    low, high = world_box(meshes)
    return LocalSpace((low + high) / 2.0, float(np.linalg.norm(high - low)) / 2.0 or 1.0)  # a single point has no size


def world_box(meshes: Sequence[Mesh]) -> tuple[np.ndarray, np.ndarray]:
    """The minimum and maximum coordinates (3,) float64 in world space of the vertices that triangles use."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for mesh in meshes:
        # The transformed corners of the box enclose the transformed mesh.
        box = np.array(np.meshgrid(*mesh.box.T)).reshape(3, -1).T
        corners = transformed(box, mesh.to_world)
        low, high = np.minimum(low, corners.min(axis=0)), np.maximum(high, corners.max(axis=0))
    return low, high


def gap(low: Mesh, highs: Sequence[Mesh]) -> float:
    """The distance, in world units, between the box around `low` and the box around `highs`; 0 if they touch."""
    return gap_of_boxes(world_box([low]), world_box(highs))


def gap_of_boxes(first: tuple[np.ndarray, np.ndarray], second: tuple[np.ndarray, np.ndarray]) -> float:
    """The distance between two boxes, each given by its lowest and its highest corner (3,); 0 if they touch."""
    return float(np.linalg.norm(np.maximum(np.maximum(first[0] - second[1], second[0] - first[1]), 0.0)))
