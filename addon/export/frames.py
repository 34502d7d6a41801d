# SPDX-License-Identifier: GPL-3.0-or-later
"""Decodes tangent-space normals as the shaders of engines do, in double precision."""

import numpy as np

from ..core.declarations.bases import Basis


def decoded(
    basis: Basis, values: np.ndarray, weights: np.ndarray, normals: np.ndarray, tangents: np.ndarray
) -> np.ndarray:
    """The normals (N, 3) float64, of length one, that a program with this basis makes of tangent-space ones.

    values (N, 3): of the map. weights (N, 3): of the corners of each point's triangle. normals (N, 3, 3), tangents (N, 3, 4):
    of those corners, w the sign of the bitangent.
    """
    normals, tangents = normals.astype(np.float64), tangents.astype(np.float64)
    normal, tangent = _mixed(normals, weights), _mixed(tangents[..., :3], weights)
    signs = tangents[..., 3]
    if basis.bitangent_of_vertices:
        bitangent = _mixed(signs[..., None] * np.cross(normals, tangents[..., :3]), weights)
    if basis.normalizes_normal:
        normal = unit(normal)
    if basis.normalizes_tangent:
        tangent = unit(tangent)
    if not basis.bitangent_of_vertices:
        bitangent = np.sign((signs * weights).sum(axis=1))[:, None] * np.cross(normal, tangent)
    if basis.normalizes_bitangent:
        bitangent = unit(bitangent)
    return unit(values[:, :1] * tangent + values[:, 1:2] * bitangent + values[:, 2:] * normal)


def unit(vectors: np.ndarray) -> np.ndarray:
    """`vectors` (..., 3) at length one; those without length stay."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(lengths > 0.0, lengths, 1.0)


def degrees(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The angles (N,) between vectors (N, 3) of length one. From the chord, which is exact for small angles."""
    chord = np.linalg.norm(a - b, axis=-1)
    return np.degrees(2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0)))


def _mixed(corners: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return np.einsum("nc,nck->nk", weights, corners)
