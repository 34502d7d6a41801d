# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh as plain arrays, and what can be said of it without Blender."""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Mesh:
    """One object's surface, by face corners, in its own space.

    uv (C, 2) and normals (C, 3) float32, one row a corner; tangents (C, 4) float32, w the bitangent's sign, or None.
    triangles (T, 3) int32, indices into the corners. to_world (4, 4) float64. not_finite: how many triangles were left
    out for NaN or infinite values.
    """

    name: str
    uv: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    to_world: np.ndarray
    tangents: np.ndarray | None = None
    not_finite: int = 0


def keep_corners(mesh: Mesh, finite: np.ndarray | None) -> Mesh:
    """`mesh` without the triangles that touch a corner where `finite` (C,) is False; None stands for all True."""
    if finite is None:
        return mesh
    keep = finite[mesh.triangles].all(axis=1)
    left_out = len(keep) - int(np.count_nonzero(keep))
    return replace(mesh, triangles=mesh.triangles[keep], not_finite=mesh.not_finite + left_out)


def finite_rows(*arrays: np.ndarray) -> np.ndarray | None:
    """Which rows hold finite numbers alone in all `arrays` (N, n): (N,) bool, or None when every row does."""
    # A sum is finite unless a term is not, or the sum overflows: the common case costs one pass and no memory.
    with np.errstate(over="ignore", invalid="ignore"):
        if all(np.isfinite(array.sum()) for array in arrays):
            return None
    finite = np.logical_and.reduce([np.isfinite(array).all(axis=1) for array in arrays])
    return None if finite.all() else finite


def uv_flaws(mesh: Mesh) -> tuple[int, int]:
    """Numbers of triangles without area in UV space, and of those that reach outside the tile 0..1."""
    u, v = (np.ascontiguousarray(mesh.uv[:, axis])[mesh.triangles] for axis in (0, 1))
    area = (u[:, 1] - u[:, 0]) * (v[:, 2] - v[:, 0]) - (u[:, 2] - u[:, 0]) * (v[:, 1] - v[:, 0])
    outside = 0
    if len(mesh.uv) and (mesh.uv.min() < 0.0 or mesh.uv.max() > 1.0):
        outside = np.count_nonzero(((u < 0) | (u > 1) | (v < 0) | (v > 1)).any(axis=1))
    return int(np.count_nonzero(area == 0.0)), int(outside)


def normal_matrix(mesh_to_world: np.ndarray, space_to_world: np.ndarray | None = None) -> np.ndarray:
    """The (3, 3) matrix that takes normals from a mesh's space to world space, or to that of another object.

    A normal n is a plane's row vector: a matrix M that takes points takes it to n M^-1, so that world normals are
    M^-T n, and M'^T n_world is what an object with matrix M' has for them. Mirrored objects need no more than this:
    unlike cofactors, the inverse transpose leaves outside what was outside. Not normalised.
    Raises numpy.linalg.LinAlgError for a matrix without volume.
    """
    matrix = np.linalg.inv(mesh_to_world[:3, :3]).T
    if space_to_world is not None:
        matrix = space_to_world[:3, :3].T @ matrix
    # Only directions matter, and a single-precision shader squares them: keep the numbers near 1.
    return matrix / np.abs(matrix).max()
