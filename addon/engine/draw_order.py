# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of a low mesh that share texels: the order in which triangles are drawn decides for which of them the map is made."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ..core.declarations.choices import Stacked
from ..core.recent import Recent
from ..core.settings import SamplingSettings
from ..core.values import ComparedByValue
from ..mesh import uv_islands, uv_layout
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import MaybeArray, Mesh
from . import coverage

COPIED = 1.25
"""How many times the area in UV space of its base mesh a surface has at least that has copies of parts of it."""


@dataclass(frozen=True)
class Overlaps:
    """How triangles of a low mesh share texels.

    Attributes:
        depth: The most on one texel.
        shared: The share of the covered texels that have several.
        size: Of the map on which they were looked for, in texels that were counted.
    """

    depth: int = 1
    shared: float = 0.0
    size: tuple[int, int] = (0, 0)


@dataclass(frozen=True, eq=False)
class Order(ComparedByValue):
    """The order in which triangles are drawn. What is drawn last stays on the map.

    Attributes:
        overlaps: How triangles of the low mesh share texels.
        low (T,) int: The triangles of the low mesh in that order; None for their own.
        basis: Those of the basis.
        is_reversed: Whether the high meshes, and the triangles of each, are in the reverse order.
    """

    overlaps: Overlaps = field(default_factory=Overlaps)
    low: MaybeArray = None
    basis: MaybeArray = None
    is_reversed: bool = False

    @property
    def is_any(self) -> bool:
        """Whether it is another one than that of the meshes."""
        return self.low is not None or self.is_reversed

    def of(self, meshes: Meshes) -> Meshes:
        """The meshes in this order. They are made once for each mesh."""
        low, basis, kept, highs = meshes.low, meshes.basis, meshes.kept, meshes.highs
        if self.low is not None:
            low = low.remembered("in order", (self.low,), partial(low.with_triangles, self.low))
            kept = None if kept is None else kept[self.low]
        if basis is not None and self.basis is not None:
            basis = basis.remembered("in order", (self.basis,), partial(basis.with_triangles, self.basis))
        if self.is_reversed:
            highs = [high.remembered("reversed", (), partial(_reversed, high)) for high in reversed(highs)]
        if not self.is_any:
            return meshes
        return replace(meshes, low=low, basis=basis, kept=kept, highs=highs, is_reversed=self.is_reversed)


def _reversed(mesh: Mesh) -> Mesh:
    return mesh.with_triangles(np.arange(len(mesh.triangles))[::-1])


def order_of(meshes: Meshes, tiles: Sequence[int], sampling: SamplingSettings) -> Order:
    """The order in which meshes are drawn where parts of the low mesh share texels.

    Everywhere on the map, the part that the settings choose is drawn last, and for Flatten the high triangles of that part. A
    surface that is baked onto its own base mesh shows what comes before the copies that its modifiers make, which the base mesh
    does not have.
    """
    low, is_first = meshes.low, meshes.is_own_base or sampling.stacked == Stacked.FIRST
    order = of_basis = None
    overlaps = overlaps_of(low, sampling.size, tiles)
    if overlaps.depth > 1:
        order = _order(low, is_first=is_first)
        basis = meshes.basis
        if basis is not None:
            # The same triangles in the same order, except those without finite tangents.
            is_whole = len(basis.triangles) == len(low.triangles)
            of_basis = order if is_whole else _order(basis, is_first=is_first)
    # Copies of modifiers are in the same order in both meshes. Finding the parts of many triangles takes long.
    return Order(overlaps, order, of_basis, is_first and (order is not None or _has_copies(meshes)))


def overlaps_of(low: Mesh, size: tuple[int, int], tiles: Sequence[int]) -> Overlaps:
    """How triangles of `low` share texels of maps of this size."""
    depth = shared = covered = 0
    for counts in coverage.counts(low, size, tiles):
        depth = max(depth, int(counts.max()))
        shared, covered = shared + np.count_nonzero(counts > 1), covered + np.count_nonzero(counts)
    return Overlaps(depth, shared / max(1, covered), coverage.sampled(size).small)


def _has_copies(meshes: Meshes) -> bool:
    """Whether modifiers make copies of a surface, with its UVs, that is baked onto its own base mesh.

    What they add with other UVs is detail, which rays find.
    """
    (high, *_) = meshes.highs
    if not meshes.is_own_base or high.uv is None:
        return False
    of_high, of_low = (np.nansum(np.abs(uv_layout.areas(mesh))) for mesh in (high, meshes.low))
    if of_high <= COPIED * of_low:
        return False
    return uv_islands.points_at_a_place(high) > COPIED * uv_islands.points_at_a_place(meshes.low)


known: Recent[np.ndarray] = Recent(4)
"""Orders of triangles by the checksums of meshes."""


def _order(mesh: Mesh, *, is_first: bool) -> np.ndarray:
    """The triangles (T,) int of a mesh, part by part: that whose first triangle is the first, or the last one, comes last."""
    key = (*mesh.checksums("vertices", "triangles", "faces", "uv"), is_first)
    order = known.get(key)
    if order is None:
        parts = uv_islands.parts(mesh)
        known[key] = order = np.argsort(-parts if is_first else parts, kind="stable")
    return order
