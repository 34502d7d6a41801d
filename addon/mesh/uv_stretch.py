# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures how well UVs use a map: how much of it, how evenly, and at what price in borders and split vertices.

Source: the mean square of the distance of texels is the stretch of Sander, Snyder, Gortler and Hoppe, "Texture mapping
progressive meshes", 2001.
"""

from dataclasses import dataclass

import numpy as np

from . import topology, uv_overlap
from .topology import EdgeTable
from .triangles import face_areas

WORST = 100.0
"""The most that a triangle counts for, as a factor on the mean distance between its texels: slivers without area in UV space
would decide alone."""
SQUASHED, TINY = 1e-3, 1e-7
"""A triangle with less than the first share of the area that it should have in UV space is squashed, if it has more than the
second share of its island."""
BORDER_PRICE = 0.5
"""What a texel at a border costs, as a share of one: mip levels and filters mix half of it with what lies beside."""
SPLIT_PRICE = 0.1
"""What a vertex costs that an engine stores once more, as a share of a vertex: memory and work of the vertex shader."""
OVERLAP_SIDE = 512
"""Texels a side of the map in which overlaps are counted."""


@dataclass(frozen=True)
class Layout:
    """How UVs use a map.

    Attributes:
        used: share of the map that triangles cover, if none overlap.
        angle: the mean factor between the widest and the narrowest distance of texels on the surface; 1 without stretch.
        area: the mean factor by which the size of texels differs from that of all; 1 if all have the same size.
        sharpness: the share of the map that UVs without stretch would need to be as sharp; at most `used`.
        sound: the share of the used texels that are in no triangle folded over, and not in several triangles.
        border: the share of the used texels that are within half a texel of the border of an island; at most 1.
        split: the vertices that UVs add, as a share of those of the surface.
        islands: their number.
    """

    used: float
    angle: float
    area: float
    sharpness: float
    sound: float = 1.0
    border: float = 0.0
    split: float = 0.0
    islands: int = 0

    @property
    def figure(self) -> float:
        """What the map shows for what it costs, from 0 to 1: the texels that stretch leaves, less the price of borders and of
        split vertices."""
        return self.sound * self.sharpness * (1.0 - BORDER_PRICE * self.border) / (1.0 + SPLIT_PRICE * self.split)


def measure(
    points: np.ndarray, uv: np.ndarray, side: int = 1024, vertices: np.ndarray | None = None, *, is_sound: bool = False
) -> Layout:
    """Measure triangles with points (T, 3, 3) and UVs (T, 3, 2). Those without area on the surface do not count.

    Args:
        side: texels of the map's shorter side, for borders.
        vertices: (T, 3) int, the vertices of the corners; None if all in the same place are one.
        is_sound: whether it is known that nothing is folded or overlaps, which takes most of the time.
    """
    measured = _Triangles(points, uv)
    used = float(measured.used.sum())
    if used == 0.0:
        return Layout(0.0, 1.0, 1.0, 0.0)
    if vertices is None:
        vertices = topology.places(points.reshape(-1, 3)).reshape(-1, 3)
    uv, vertices = np.ascontiguousarray(uv[measured.counts]), vertices[measured.counts]
    rows = np.stack(
        [topology.hashes(uv.reshape(-1, 2) + uv.dtype.type(0.0)), vertices.reshape(-1).astype(np.uint64)], axis=1
    )
    nodes = topology.first_rows(rows)
    islands, count = topology.components(tuple(nodes.reshape(-1, 3).T), len(nodes))
    corners, own = len(np.unique(nodes)), len(np.unique(vertices))
    outline = EdgeTable.of(nodes.reshape(-1, 3)).alone
    ends = uv.reshape(-1, 2).astype(np.float64)
    length = np.linalg.norm(np.roll(ends.reshape(-1, 3, 2), -1, axis=1).reshape(-1, 2) - ends, axis=1)[outline].sum()
    weights = measured.surface / measured.surface.sum()
    even = np.sqrt(used / measured.surface.sum())  # the texels by length, if all had the same size
    most, least = np.maximum(measured.most, even / WORST), np.maximum(measured.least, even / WORST)
    size = most * least / even**2
    return Layout(
        used,
        float((weights * most / least).sum()),
        float((weights * np.maximum(size, 1.0 / size)).sum()),
        float(measured.surface.sum() / (weights * _spacing(most, least)).sum()),
        1.0 if is_sound else _sound(measured, uv, islands),
        min(1.0, float(length) * 0.5 / side / used),
        (corners - own) / own,
        count,
    )


def _sound(measured: "_Triangles", uv: np.ndarray, islands: np.ndarray) -> float:
    """The share of the used texels that Layout.sound is. uv (T, 3, 2), islands (T,): of the triangles that count."""
    is_mirrored = np.bincount(islands, measured.signed) < 0.0
    is_folded = (measured.signed < 0.0) != is_mirrored[islands]
    folded = measured.used[is_folded].sum() / measured.used.sum()
    counts = uv_overlap.counts(uv[~is_folded], OVERLAP_SIDE)
    once = np.count_nonzero(counts == 1) / counts.sum() if counts.any() else 1.0
    return float((1.0 - folded) * once)


@dataclass(frozen=True, eq=False)
class Needs:
    """What islands need of a map, by islands.

    Attributes:
        surface: (I,) float64, their areas on the surface.
        need: (I,) float64, the area of a map that gives them as many texels as `surface` would without stretch.
        scale: (I,) float64, the factor on their UVs by which they share a map best, for which `surface` is an even density.
        is_folded: (I,) bool, whether they have triangles that are folded over, or squashed.
    """

    surface: np.ndarray
    need: np.ndarray
    scale: np.ndarray
    is_folded: np.ndarray


def needs(points: np.ndarray, uv: np.ndarray, islands: np.ndarray) -> Needs:
    """What islands need of a map. points (T, 3, 3), uv (T, 3, 2), islands (T,) int from 0.

    If islands with the surface S and the mean square s of distances of their texels take the areas a, all have the least blur
    together where they are scaled to areas in proportion to the root of S * s * a.
    """
    measured, count = _Triangles(points, uv), int(islands.max(initial=-1)) + 1
    islands = islands[measured.counts]
    used, surface = np.bincount(islands, measured.used, count), np.bincount(islands, measured.surface, count)
    even = used / np.where(surface > 0.0, surface, 1.0)
    worst = np.sqrt(even)[islands] / WORST
    most, least = np.maximum(measured.most, worst), np.maximum(measured.least, worst)
    with np.errstate(divide="ignore", invalid="ignore"):
        need = np.sqrt(np.bincount(islands, measured.surface * _spacing(most, least), count) * used)
        scale = np.sqrt(need / used)
    squashed = measured.signed < SQUASHED * measured.surface * even[islands]
    squashed &= measured.surface > TINY * surface[islands]
    is_there = surface > 0.0
    folded = np.bincount(islands[squashed], minlength=count) > 0
    folded |= is_there & ~((used > 0.0) & np.isfinite(need) & np.isfinite(scale))
    return Needs(surface, np.where(is_there & ~folded, need, surface), np.where(is_there & ~folded, scale, 1.0), folded)


class _Triangles:
    """Those triangles that have area on the surface.

    counts (T,) bool: which they are. surface, used, signed: their areas there and in UV space. most, least: the widest and
    the narrowest distance in UV space of points that are 1 apart on the surface.
    """

    def __init__(self, points: np.ndarray, uv: np.ndarray):
        points, uv = points.astype(np.float64), uv.astype(np.float64)
        u, v, surface = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0], face_areas(points)
        self.counts = surface > 1e-12 * surface.max(initial=0.0)
        u, v, uv, self.surface = u[self.counts], v[self.counts], uv[self.counts], surface[self.counts]
        # The triangle in its own plane, so that a 2 x 2 matrix leads from there to UV space: one edge is along the first axis.
        length = np.linalg.norm(u, axis=1)
        along, across = (u * v).sum(axis=1) / length, 2.0 * self.surface / length
        one, other = (uv[:, 1] - uv[:, 0]).T, (uv[:, 2] - uv[:, 0]).T
        self.signed = 0.5 * (one[0] * other[1] - one[1] * other[0])
        self.used = np.abs(self.signed)
        one = one / length
        other = (other - one * along) / across
        # Its singular values, by their squares' sum and their product.
        half, product = 0.5 * (one**2 + other**2).sum(axis=0), np.abs(one[0] * other[1] - one[1] * other[0])
        self.most = np.sqrt(half + np.sqrt(np.maximum(half**2 - product**2, 0.0)))
        self.least = product / np.where(self.most > 0.0, self.most, 1.0)


def _spacing(most: np.ndarray, least: np.ndarray) -> np.ndarray:
    """The mean square of the distance of texels on the surface."""
    return 0.5 * (1.0 / most**2 + 1.0 / least**2)
