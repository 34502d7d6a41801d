# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures triangles in UV space: their areas, and the tiles that they cover."""

import numpy as np

from ..core import udim
from . import threads
from .triangle_mesh import Mesh

ON_THE_RIM = 1e-5
"""A UV counts as outside a tile from this distance on: subdivision rounds UVs."""


def areas(mesh: Mesh) -> np.ndarray:
    """Twice the areas of the triangles in UV space, (T,) float32: negative for mirrored ones, and exactly 0 for triangles
    that cover nothing."""
    result = np.empty(len(mesh.triangles), np.float32)

    def measure(part: slice) -> None:
        a, b, c = _uv_corners(mesh, part)
        with np.errstate(over="ignore", invalid="ignore"):  # of UVs that lie far outside
            b, c = b - a, c - a
            result[part] = b.real * c.imag - b.imag * c.real

    threads.for_blocks(len(result), measure)
    return result


def outside(mesh: Mesh, tiles: tuple[int, int] = (1, 1)) -> np.ndarray:
    """Which triangles (T,) bool reach outside the `tiles` along u and v."""
    low, (u_high, v_high) = -ON_THE_RIM, np.add(tiles, ON_THE_RIM)
    # Corners that no triangle uses may hold NaN: a comparison with it is False, and each triangle is tested.
    if mesh.uv.min() >= low and mesh.uv[:, 0].max() <= u_high and mesh.uv[:, 1].max() <= v_high:
        return np.zeros(len(mesh.triangles), bool)
    corners = np.stack(_uv_corners(mesh), axis=1)
    u, v = corners.real, corners.imag
    return ((u < low) | (u > u_high) | (v < low) | (v > v_high)).any(axis=1)


def tiles(mesh: Mesh) -> list[int]:
    """The numbers of the UDIM tiles that triangles with area may cover, in order."""
    corners = np.stack(_uv_corners(mesh), axis=1)
    corners = corners[np.isfinite(corners).all(axis=1)]
    spans = []
    for values, count in zip((corners.real, corners.imag), (udim.COLUMNS, udim.ROWS), strict=True):
        low, high = values.min(axis=1), values.max(axis=1)
        # A triangle on the border between two tiles belongs to one of them; one without extent belongs to none.
        first, last = np.floor(low + ON_THE_RIM), np.ceil(high - ON_THE_RIM) - 1.0
        last = np.where(low < high, np.maximum(last, first), first - 1.0)
        spans += [np.maximum(first, 0.0), np.minimum(last, count - 1.0)]
    boxes = np.stack(spans, axis=1)
    boxes = np.unique(boxes[(boxes[:, 0] <= boxes[:, 1]) & (boxes[:, 2] <= boxes[:, 3])], axis=0).astype(int)
    found = {
        udim.number(u, v)
        for u_first, u_last, v_first, v_last in boxes.tolist()
        for u in range(u_first, u_last + 1)
        for v in range(v_first, v_last + 1)
    }
    return sorted(found)


def _uv_corners(mesh: Mesh, which: slice = slice(None)) -> list[np.ndarray]:
    """The UVs of the three corners of the triangles `which`, (T,) each, as complex numbers: one gather reads u and v."""
    uv = mesh.uv.view(np.complex64)[:, 0]
    return [np.take(uv, corner, mode="clip") for corner in mesh.triangles[which].T]
