# SPDX-License-Identifier: GPL-3.0-or-later
"""Tangent spaces of unevenly scaled objects.

Programs transform normals and tangents of the vertices to the scene, and make bitangents of the results: with a scale that
differs by axis, these are not the bitangents of the mesh, transformed. Only those of core.declarations.bases that are
`in_object_space` make them first and transform the finished normal.
"""

from dataclasses import replace

import numpy as np

from ..core.declarations import bases
from ..core.declarations.bases import Basis
from .triangle_mesh import Mesh

UNEVEN = 1e-4
"""How much the scales of an object along its axes may differ, as a share, to count as the same."""


def of(to_world: np.ndarray) -> np.ndarray:
    """The scale in a matrix (4, 4), perhaps mirrored or sheared: (3, 3) float64. Without it, the matrix is a rotation."""
    _, scales, axes = np.linalg.svd(to_world[:3, :3])
    return np.sign(np.linalg.det(to_world[:3, :3])) * axes.T @ np.diag(scales) @ axes


def is_uneven(to_world: np.ndarray) -> bool:
    """Whether a matrix (4, 4) scales more in one direction than in another."""
    scales = np.linalg.svd(to_world[:3, :3], compute_uv=False)
    return bool(scales[-1] < scales[0] * (1.0 - UNEVEN))


def as_read(low: Mesh, basis: str) -> Mesh:
    """`low`, as it was read, with the normals and tangents from which programs with a basis make the tangent space.

    With the same scale in all directions, nothing changes.
    """
    rules = bases.of_name(basis)
    if rules.in_object_space or not is_uneven(low.to_world):
        return low
    matrix = of(low.to_world)
    normals, tangents = applied(matrix, low.normals, low.tangents, rules)
    return replace(low, normals=normals, tangents=tangents, stretch=matrix)


def applied(
    matrix: np.ndarray, normals: np.ndarray, tangents: np.ndarray, basis: Basis
) -> tuple[np.ndarray, np.ndarray]:
    """Normals (..., 3) and tangents (..., 4), w the sign of the bitangent, after a scale (3, 3): unit vectors, float32."""
    of_normals = np.linalg.inv(matrix)
    turned = _unit(normals @ of_normals)
    along = _unit(tangents[..., :3] @ (of_normals if basis.tangents_as_normals else matrix.T))
    signs = tangents[..., 3:] * np.sign(np.linalg.det(matrix))
    return turned.astype(np.float32), np.concatenate([along, signs], axis=-1).astype(np.float32)


def _unit(vectors: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(lengths > 0.0, lengths, 1.0)
