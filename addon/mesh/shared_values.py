# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds values that triangles share: on smooth surfaces, all triangles at a vertex have the same normal there."""

import numpy as np

from ..core import threads


def share(
    count: int, vertices: np.ndarray, values: np.ndarray, triangles: np.ndarray, domain: str = ""
) -> tuple[np.ndarray | None, np.ndarray, np.ndarray]:
    """Fewer values of the corners of a mesh: the same to the bit.

    Args:
        count: Of the vertices, V.
        vertices: (C,) int32, the vertex of each corner.
        values: (C, k) float32, normals or any others of the corners.
        triangles: (T, 3) int, indices into the corners.
        domain: Of the values, as Mesh.normals_domain has it; "" if it is not known.

    Returns:
        The values of the vertices (V, k), which most triangles have, with any for vertices without corners; None if no
        triangle has them. The values (N, k) of those that have their own. And where these are, (T,) int32: 0 for a triangle
        with the values of its vertices, else 1 + 2 * place for one value for all three corners, or 2 + 2 * place for three in a
        row.
    """
    own = np.zeros(len(triangles), np.int32)
    if domain == "FACE":
        own[:] = 1 + 2 * np.arange(len(triangles), dtype=np.int32)
        return None, threads.take(values, triangles[:, 0]), own
    last = np.zeros(count, np.int32)
    last[vertices] = np.arange(len(vertices), dtype=np.int32)
    shared = threads.take(values, last)
    differs = None if domain == "POINT" else _differs(shared, vertices, values)
    if differs is None or not differs.any():
        return shared, values[:0], own
    beside = np.flatnonzero(threads.take(differs, triangles).any(axis=1))
    corners = triangles[beside]
    bits = values[corners].view(np.int32)
    is_flat = (bits == bits[:, :1]).all(axis=(1, 2))
    flat, bent = np.count_nonzero(is_flat), np.count_nonzero(~is_flat)
    own[beside[is_flat]] = 1 + 2 * np.arange(flat, dtype=np.int32)
    own[beside[~is_flat]] = 2 + 2 * (flat + 3 * np.arange(bent, dtype=np.int32))
    return shared, np.concatenate([values[corners[is_flat, 0]], values[corners[~is_flat].reshape(-1)]]), own


def joined(
    parts: list[tuple[np.ndarray | None, np.ndarray, np.ndarray]], counts: list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """What `share` found for several meshes, of so many vertices each, as one.

    Returns:
        The values (N, k), those of the vertices first unless no triangle has them. And where the triangles' own values are in
        them, (T,) int32, as `share` has it.
    """
    channels = parts[0][1].shape[1]
    shared = []
    if any(of_vertices is not None for of_vertices, _, _ in parts):
        shared = [
            np.zeros((count, channels), np.float32) if of_vertices is None else of_vertices
            for (of_vertices, _, _), count in zip(parts, counts, strict=True)
        ]
    place, own_places = sum(map(len, shared)), []
    for _, values, own in parts:
        own_places.append(np.where(own > 0, own + 2 * place, 0).astype(np.int32) if place and len(values) else own)
        place += len(values)
    tables = [table for table in [*shared, *(values for _, values, _ in parts)] if len(table)]
    return (
        tables[0] if len(tables) == 1 else np.concatenate(tables),
        own_places[0] if len(own_places) == 1 else np.concatenate(own_places),
    )


def places(own: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Where the values of the corners of triangles are, (T, 3) int32.

    Args:
        own: (T,) int32, as `joined` has it.
        vertices: (T, 3) int32, of the triangles.
    """
    at = np.array(vertices, np.int32)
    has_own = np.flatnonzero(own)
    own = own[has_own] - 1
    at[has_own] = (own >> 1)[:, None] + (own & 1)[:, None] * np.arange(3, dtype=np.int32)
    return at


def _differs(shared: np.ndarray, vertices: np.ndarray, values: np.ndarray) -> np.ndarray:
    """At which corners (C,) bool a bit of `values` (C, k) differs from the one that is `shared` (V, k) at their vertex."""
    differs = np.empty(len(vertices), bool)

    def compare(part: slice) -> None:
        bits = np.take(shared, vertices[part], axis=0, mode="clip").view(np.int32) != values[part].view(np.int32)
        differs[part] = bits[:, 0]
        for channel in range(1, values.shape[1]):
            differs[part] |= bits[:, channel]

    threads.for_blocks(len(vertices), compare)
    return differs
