# SPDX-License-Identifier: GPL-3.0-or-later
"""Counts on the CPU how many texels of a coarse map triangles or meshes share, for what a panel says before a bake."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..core import udim
from .triangle_mesh import Mesh

SIDE = 128
"""Texels a side."""
PAIRS_AT_ONCE = 2**20
"""Pairs of a triangle and a texel of its box that are looked at together."""
MOST_PAIRS = 2**24
"""Pairs, above which fewer texels a side are counted: large triangles lie over one another, so that few texels tell it."""
INSIDE = 1e-6
"""In texels, twice an area: what lies on an edge belongs to neither triangle."""


def shared(mesh: Mesh, tile: int = udim.FIRST, side: int = SIDE) -> tuple[int, int]:
    """How many of side * side texels of a UDIM tile have a triangle at their center, and how many of these have two or more."""
    found = _counts(mesh, tile, side)
    if found is None:
        return shared(mesh, tile, side // 2)
    return int(np.count_nonzero(found)), int(np.count_nonzero(found > 1))


def covered(mesh: Mesh, tile: int = udim.FIRST) -> np.ndarray | None:
    """Which of SIDE * SIDE texels of a UDIM tile have a triangle at their center, as bits, uint8; None if that takes long."""
    found = _counts(mesh, tile, SIDE)
    return np.packbits(found > 0) if found is not None else None


def counts(uv: np.ndarray, side: int = SIDE) -> np.ndarray:
    """How many of triangles with UVs (T, 3, 2) are at the center of each of side * side texels of the map, or of fewer ones if
    that takes long, (N,) int."""
    found = _counted_in(uv.astype(np.float64) * side, side)
    return counts(uv, side // 2) if found is None else found


def shares_of_others(covers: Sequence[Mapping[Any, np.ndarray]]) -> list[float]:
    """The share of the texels of each mesh that others have, too. covers: of each, its bits by image, as `covered` has them."""
    once: dict[Any, np.ndarray] = {}
    twice: dict[Any, np.ndarray] = {}
    for cover in covers:
        for image, bits in cover.items():
            before = once.get(image, np.zeros_like(bits))
            twice[image] = twice.get(image, np.zeros_like(bits)) | (before & bits)
            once[image] = before | bits
    sums = (
        (sum(_number(bits & twice[image]) for image, bits in cover.items()), sum(map(_number, cover.values())))
        for cover in covers
    )
    return [shared / max(1, own) for shared, own in sums]


def _number(bits: np.ndarray) -> int:
    return int(np.count_nonzero(np.unpackbits(bits)))


def _counts(mesh: Mesh, tile: int, side: int) -> np.ndarray | None:
    """How many triangles are at the center of each texel (side * side,); None if that takes long."""
    return _counted_in((mesh.uv[mesh.triangles].astype(np.float64) - udim.place(tile)) * side, side)


def _counted_in(corners: np.ndarray, side: int) -> np.ndarray | None:
    """As _counts, of triangles with corners (T, 3, 2) in texels."""
    with np.errstate(invalid="ignore"):
        first = np.clip(np.ceil(corners.min(axis=1) - 0.5), 0.0, side)
        stop = np.clip(np.floor(corners.max(axis=1) - 0.5) + 1.0, 0.0, side)
        sides = np.maximum(stop - first, 0.0)
    sides[~np.isfinite(sides).all(axis=1)] = 0.0
    number = sides.prod(axis=1).astype(np.int64)
    if number.sum() > MOST_PAIRS and side > 1:
        return None
    chosen = np.flatnonzero(number)
    ends = np.cumsum(number[chosen])
    found = np.zeros(side * side, np.int64)
    most = int(ends[-1]) if len(ends) else 0
    for block in np.split(chosen, np.searchsorted(ends, range(PAIRS_AT_ONCE, most, PAIRS_AT_ONCE))):
        found += _counted(corners[block], first[block].astype(int), sides[block].astype(int), side)
    return found


def _counted(corners: np.ndarray, first: np.ndarray, sides: np.ndarray, side: int) -> np.ndarray:
    """How many of the triangles (T, 3, 2), in texels, have each texel's center inside. first, sides: their boxes (T, 2)."""
    number = sides.prod(axis=1)
    which = np.repeat(np.arange(len(number)), number)
    place = np.arange(len(which)) - np.repeat(np.cumsum(number) - number, number)
    v, u = np.divmod(place, sides[which, 0])
    u, v = u + first[which, 0], v + first[which, 1]
    centers = np.stack([u, v], axis=1) + 0.5
    a, b, c = (corners[which, corner] for corner in range(3))
    areas = np.stack([_area(a, b, centers), _area(b, c, centers), _area(c, a, centers)])
    is_inside = (areas > INSIDE).all(axis=0) | (areas < -INSIDE).all(axis=0)
    return np.bincount((v * side + u)[is_inside], minlength=side * side)


def _area(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> np.ndarray:
    (ux, uy), (vx, vy) = (b - a).T, (point - a).T
    return ux * vy - uy * vx
