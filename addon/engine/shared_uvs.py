# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of a low mesh that share texels: which of them the map is made for."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core import udim
from ..core.declarations.choices import Stacked
from ..core.settings import SamplingSettings
from ..mesh import uv_islands, uv_layout
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..passes import audit, mesh_upload, target

PROBE = 1024
"""Texels a side, at most, on which triangles that share some are looked for."""

COPIED = 1.25
"""How many times the area in UV space of its base mesh a surface has at least that has copies of parts of it."""


def ordered(
    meshes: Meshes, tiles: Sequence[int], settings: SamplingSettings, before: tuple[Meshes, Meshes] | None = None
) -> Meshes:
    """`meshes` with their triangles in another order where parts of the low mesh share texels; otherwise as they are.

    What is drawn last stays: everywhere on the map, that is the part that the settings choose, and for Flatten the high
    triangles of that part. The high meshes are in another order, too. A surface that is baked onto its own base mesh shows what
    comes before the copies that its modifiers make, which the base mesh does not have. before: earlier meshes, as they were
    read and the result; what was not read again stays the same.
    """
    low, is_first = meshes.low, meshes.is_own_base or settings.stacked == Stacked.FIRST
    if before is not None and before[0].low is low:
        is_same, (low, basis, kept) = before[1] is before[0], (before[1].low, before[1].basis, before[1].kept)
    else:
        basis, kept, is_same = meshes.basis, meshes.kept, not _has_copies(meshes)
        if depth(low, (min(settings.width, PROBE), min(settings.height, PROBE)), tiles) > 1:
            is_same = False
            order = _order(low, is_first=is_first)
            if basis is not None:
                # The same triangles in the same order, except those without finite tangents.
                is_whole = len(basis.triangles) == len(low.triangles)
                basis = basis.with_triangles(order if is_whole else _order(basis, is_first=is_first))
            kept = None if kept is None else kept[order]
            low = low.with_triangles(order)
    if is_same:
        return meshes
    changed = replace(meshes, low=low, basis=basis, kept=kept)
    if not is_first:
        return changed
    # Copies of modifiers are in the same order in both meshes. Finding the parts of many triangles takes long.
    highs = [high.with_triangles(np.arange(len(high.triangles))[::-1]) for high in reversed(meshes.highs)]
    return replace(changed, highs=highs, is_reversed=True)


def depth(low: Mesh, size: tuple[int, int], tiles: Sequence[int]) -> int:
    """The most triangles of `low` on one texel of a map of this size."""
    drawn, counts = target.get("overlap", *size, "R16F"), np.empty(size[::-1], np.float32)
    uploaded, most = mesh_upload.upload(low.triangles, uv=low.uv), 0
    for tile in tiles:
        audit.draw_overlap(drawn, uploaded, udim.uv_to_clip(tile))
        drawn.read(counts)
        most = max(most, int(counts.max()))
    return most


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


def _order(mesh: Mesh, *, is_first: bool) -> np.ndarray:
    """The triangles (T,) int of a mesh, part by part: that whose first triangle is the first, or the last one, comes last."""
    parts = uv_islands.parts(mesh)
    return np.argsort(-parts if is_first else parts, kind="stable")
