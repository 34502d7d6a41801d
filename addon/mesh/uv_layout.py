# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a mesh's triangles lie in UV space, and how large they are there."""

import numpy as np

from ..core import udim
from . import threads
from .triangle_mesh import Mesh

ON_THE_RIM = 1e-5
"""How far outside the tile a UV may lie before it counts: subdivision rounds."""


def areas(mesh: Mesh) -> np.ndarray:
    """Twice the triangles' areas in UV space (T,) float32: below 0 where they turn the other way round than on the
    surface, which is mirrored, and exactly 0 where nothing can be drawn."""
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
    # NaN lies in corners that no triangle uses any more, and must not pass for being inside.
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
        # What lies on the rim between two tiles belongs to one of them; what has no extent, to none.
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
    """The UVs of three corners of the triangles `which`, (T,) each, as u + v i: one gather for both."""
    uv = mesh.uv.view(np.complex64)[:, 0]
    return [np.take(uv, corner, mode="clip") for corner in mesh.triangles[which].T]
