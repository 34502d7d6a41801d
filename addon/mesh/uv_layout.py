# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures triangles in UV space: their areas, the tiles that they cover, and whether they reach a texel's center."""

import numpy as np

from ..core import threads, udim
from .triangle_mesh import Mesh

ON_THE_RIM = 1e-5
"""A UV counts as outside a tile from this distance on: subdivision rounds UVs."""
SNAP = 1.0 / 32.0
"""In texels. Rasterizers round corners to a grid of at least 16 steps a texel."""
_SPREAD = np.array(
    [(i + 1 / 3, j + 1 / 3, 10 - i - j + 1 / 3) for i in range(11) for j in range(11 - i)], np.float32
) / np.float32(11.0)
"""Weights (N, 3) of corners for points that are spread evenly over a triangle."""
_SPREAD_BLOCK = 2**12
"""Triangles whose points are computed at once: those of a mesh of millions do not fit in memory."""
ROUNDING = 2.0**-21
"""Share of the distance from the origin of UV space: how far single precision moves a corner, with room."""


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


def cut_off(mesh: Mesh, which: np.ndarray, tiles: tuple[int, int] = (1, 1)) -> float:
    """The share of the mesh's UV area that lies outside the `tiles` along u and v. which: the triangles (T,) bool that may
    reach outside; the others do not count."""
    sizes = np.abs(areas(mesh))
    total = float(sizes.sum(dtype=np.float64))
    if not which.any() or total == 0.0:
        return 0.0
    if not np.isfinite(total):  # of UVs that lie far outside
        return 1.0
    chosen = np.flatnonzero(which)
    shares = np.empty(len(chosen), np.float32)

    def measure(part: slice) -> None:
        a, b, c = (corners[:, None] for corners in _uv_corners(mesh, chosen[part]))
        points = a * _SPREAD[:, 0] + b * _SPREAD[:, 1] + c * _SPREAD[:, 2]
        is_out = (points.real < 0.0) | (points.real > tiles[0]) | (points.imag < 0.0) | (points.imag > tiles[1])
        shares[part] = is_out.mean(axis=1)

    threads.for_blocks(len(chosen), measure, _SPREAD_BLOCK)
    return float((sizes[chosen] * shares).sum(dtype=np.float64) / total)


def over_centers(
    mesh: Mesh, uv_to_clip: udim.UvToClip, size: tuple[int, int], part: slice = slice(None), *, snap: float = SNAP
) -> np.ndarray:
    """The triangles of `part` whose box in UV space has a texel's center in it: their numbers (N,) int in the mesh, in order.

    The others change no texel when the mesh is drawn with `uv_to_clip` on `size` texels. snap: how far a rasterizer moves
    corners, in texels.
    """
    first, last, _ = part.indices(len(mesh.triangles))
    axes = []
    for axis in range(2):
        half = size[axis] / 2.0
        scale, shift = uv_to_clip[axis] * half, (uv_to_clip[axis + 2] + 1.0) * half - 0.5
        room = snap + ROUNDING * (abs(shift) + 2.0 * half)
        axes.append([np.float32(value) for value in (scale, shift - room, shift + room, size[axis] - 1)])
    is_over = np.empty(max(0, last - first), bool)

    def measure(block: slice) -> None:
        numbers = mesh.triangles[first + block.start : first + block.stop].reshape(-1)
        corners = np.take(mesh.uv.view(np.complex64)[:, 0], numbers, mode="clip").view(np.float32)
        inside = True
        with np.errstate(over="ignore", invalid="ignore"):  # of UVs that lie far outside
            # In rows of one coordinate of one corner: numpy is several times slower along short axes.
            for (scale, low, high, most), (a, b, c) in zip(
                axes, np.ascontiguousarray(corners.reshape(-1, 3, 2).T), strict=True
            ):
                lowest, highest = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
                center = np.maximum(np.ceil(lowest * scale + low), np.float32(0.0))
                inside = inside & (center <= np.minimum(highest * scale + high, most))
        is_over[block] = inside

    threads.for_blocks(len(is_over), measure)
    return np.flatnonzero(is_over) + first


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


def _uv_corners(mesh: Mesh, which: slice | np.ndarray = slice(None)) -> list[np.ndarray]:
    """The UVs of the three corners of the triangles `which`, (T,) each, as complex numbers: one gather reads u and v."""
    uv = mesh.uv.view(np.complex64)[:, 0]
    return [np.take(uv, corner, mode="clip") for corner in mesh.triangles[which].T]
