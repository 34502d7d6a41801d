# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds which faces, edges, vertices and corners of a mesh belong together."""

import bpy
import numpy as np

from ..mesh_reader import corner_vertices


def edges(data: bpy.types.Mesh, ends: np.ndarray) -> np.ndarray:
    """The edges (N,) int of `data` between these pairs of vertices (N, 2), unordered. Pairs without an edge are left out."""
    pairs = np.empty((len(data.edges), 2), np.int32)
    data.edges.foreach_get("vertices", pairs.reshape(-1))
    keys, end_keys = (
        values.min(axis=1).astype(np.int64) * len(data.vertices) + values.max(axis=1) for values in (pairs, ends)
    )
    return np.flatnonzero(np.isin(keys, end_keys))


def elements(data: bpy.types.Mesh, chosen: np.ndarray, domain: str = "FACE") -> dict[str, np.ndarray]:
    """The indices of the "polygons", "edges" and "vertices" of the `chosen` faces of `data`, or edges for the domain "EDGE"."""
    if domain == "EDGE":
        pairs = np.empty((len(data.edges), 2), np.int32)
        data.edges.foreach_get("vertices", pairs.reshape(-1))
        return {"polygons": chosen[:0], "edges": chosen, "vertices": pairs[chosen].reshape(-1)}
    corners = face_corners(data, chosen)
    return {"polygons": chosen, "edges": corner_edges(data)[corners], "vertices": corner_vertices(data)[corners]}


def face_corners(data: bpy.types.Mesh, chosen: np.ndarray) -> np.ndarray:
    """The corners (N,) int of the `chosen` faces of `data`, face by face."""
    starts, totals = _face_spans(data)
    totals = totals[chosen]
    within = np.arange(totals.sum()) - np.repeat(np.cumsum(totals) - totals, totals)
    return np.repeat(starts[chosen], totals) + within


def next_corners(data: bpy.types.Mesh) -> np.ndarray:
    """The corner that follows each corner in its face, (C,) int."""
    starts, totals = _face_spans(data)
    following = np.arange(1, len(data.loops) + 1)
    following[starts + totals - 1] = starts
    return following


def corner_edges(data: bpy.types.Mesh) -> np.ndarray:
    """The edge from each corner to the next one in its face, (C,) int32."""
    indices = np.empty(len(data.loops), np.int32)
    data.attributes[".corner_edge"].data.foreach_get("value", indices)
    return indices


def _face_spans(data: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """The first corner of each face and their number, (F,) int32 each."""
    starts, totals = (np.empty(len(data.polygons), np.int32) for _ in range(2))
    data.polygons.foreach_get("loop_start", starts)
    data.polygons.foreach_get("loop_total", totals)
    return starts, totals
