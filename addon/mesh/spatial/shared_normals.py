# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds normals that triangles share: on smooth surfaces, all triangles at a vertex have the same one there."""

import numpy as np

from ...core import threads


def share(
    count: int, vertices: np.ndarray, normals: np.ndarray, triangles: np.ndarray, domain: str
) -> tuple[np.ndarray, np.ndarray]:
    """Fewer normals (N, 3) float32, and which of them each corner of `triangles` has, (T, 3) int32: the same to the bit.

    triangles (T, 3) int: indices into corners. By corner: vertices (C,) int32, of `count`, and normals (C, 3) float32. domain:
    of the normals, as Mesh has it.
    """
    if domain == "FACE":
        numbers = np.arange(len(triangles), dtype=np.int32)[:, None]
        return threads.take(normals, triangles[:, 0]), np.broadcast_to(numbers, triangles.shape)
    shared = np.zeros((count, 3), np.float32)
    shared[vertices] = normals
    numbers = threads.take(vertices, triangles)
    is_other = None if domain == "POINT" else _differs(shared, vertices, normals)
    if is_other is None or not is_other.any():
        return shared, numbers
    beside = np.flatnonzero(threads.take(is_other, triangles).any(axis=1))
    corners = triangles[beside]
    own = normals[corners].view(np.int32)
    is_flat = (own == own[:, :1]).all(axis=(1, 2))
    flat, bent = beside[is_flat], corners[~is_flat]
    # Each corner with a normal of its own gets a number of its own, and so does each triangle without bends.
    is_alone = np.zeros(len(vertices), bool)
    is_alone[bent] = is_other[bent]
    alone = np.flatnonzero(is_alone)
    of_corners = np.array(vertices, np.int32)
    of_corners[alone] = np.arange(count, count + len(alone))
    numbers[beside[~is_flat]] = of_corners[bent]
    numbers[flat] = np.arange(len(flat))[:, None] + count + len(alone)
    return np.concatenate([shared, normals[alone], normals[corners[is_flat, 0]]]), numbers


def share_of_part(
    count: int, vertices: np.ndarray, normals: np.ndarray, corners: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """As `share`, for some triangles of large meshes, in memory that goes with their number.

    vertices (T, 3) int, of `count`, and corners (T, 3) int, indices into normals (C, 3) float32, are those of these triangles.
    """
    is_used = np.zeros(count, bool)
    is_used[vertices.reshape(-1)] = True
    numbers = np.cumsum(is_used, dtype=np.int32) - np.int32(1)
    of_part = np.arange(corners.size, dtype=np.int32).reshape(corners.shape)
    own = threads.take(normals, corners.reshape(-1))
    return share(int(numbers[-1]) + 1, threads.take(numbers, vertices.reshape(-1)), own, of_part, "")


def _differs(shared: np.ndarray, vertices: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """At which corners (C,) bool a bit of `normals` (C, 3) differs from the one that is `shared` (V, 3) at their vertex."""
    differs = np.empty(len(vertices), bool)

    def compare(part: slice) -> None:
        bits = np.take(shared, vertices[part], axis=0, mode="clip").view(np.int32) != normals[part].view(np.int32)
        differs[part] = bits[:, 0] | bits[:, 1] | bits[:, 2]

    threads.for_blocks(len(vertices), compare)
    return differs
