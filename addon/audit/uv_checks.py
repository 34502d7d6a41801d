# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks of a low mesh's UV layout: what the tiles cut off, and what overlaps."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core import udim
from ..core.settings import SamplingSettings
from ..engine import coverage
from ..mesh import uv_islands, uv_layout, uv_overlap
from ..mesh.triangle_mesh import Mesh
from . import severity
from .severity import Check


def space(sampling: SamplingSettings) -> tuple[int, int]:
    """The number of tiles along u and v on which UVs are inside."""
    return (udim.COLUMNS, udim.ROWS) if sampling.udim else (1, 1)


def outside(low: Mesh, sampling: SamplingSettings) -> Check:
    """The check of the triangles that reach outside the tiles, as in Report.checks without the severity."""
    is_outside = uv_layout.outside(low, space(sampling))
    # With UDIM, triangles that were moved by whole tiles are on a tile of their own and do not repeat another one.
    moved = uv_islands.moved_copies(low) if is_outside.any() and not sampling.udim else np.zeros(1, bool)
    lost = is_outside & ~moved
    cut_off = uv_layout.cut_off(low, lost, space(sampling))
    return count_of(is_outside, len(low.triangles)) | {
        "moved": int(np.count_nonzero(moved)),
        "cut_off": cut_off,
        "fits_udim": not sampling.udim and cut_off > severity.MUCH_CUT_OFF and _fits_udim(low, lost),
    }


def _fits_udim(low: Mesh, lost: np.ndarray) -> bool:
    """Whether the triangles (T,) bool that are cut off lie on UDIM tiles, and cross no border between two."""
    tiles = udim.COLUMNS, udim.ROWS
    crossing = lost & uv_islands.crossing(low)
    is_whole = (
        np.abs(uv_layout.areas(low)[crossing]).sum() <= severity.MUCH_CUT_OFF * np.abs(uv_layout.areas(low)).sum()
    )
    return bool(is_whole) and uv_layout.cut_off(low, lost, tiles) <= severity.MUCH_CUT_OFF


def overlap(low: Mesh, size: tuple[int, int], tiles: Sequence[int]) -> Check:
    """The texels of a map that belong to two or more triangles of `low`, as in Report.checks without the severity."""
    covered = shared = 0
    for counts in coverage.counts(low, size, tiles):
        covered += int(np.count_nonzero(counts))
        shared += int(np.count_nonzero(counts > 1))
    return overlap_of(low, size, tiles, covered, shared)


def rough_overlap(low: Mesh, tiles: Sequence[int]) -> Check:
    """As `overlap`, on a coarse map and without the GPU: for what a panel says before a bake."""
    counts = [uv_overlap.shared(low, tile) for tile in tiles]
    covered, shared = (sum(each) for each in zip(*counts, strict=True))
    crossed = shared
    if shared > severity.MUCH_OVERLAP * covered:
        unique = replace(low, triangles=low.triangles[uv_islands.without_copies(low)])
        crossed = sum(uv_overlap.shared(unique, tile)[1] for tile in tiles)
    return share_of(shared, covered) | {"stacked": shared - crossed}


def overlap_of(low: Mesh, size: tuple[int, int], tiles: Sequence[int], covered: int, shared: int) -> Check:
    """As `overlap`, from the texels that triangles cover, and those that two or more share."""
    crossed = shared
    if shared > severity.MUCH_OVERLAP * covered:  # fewer are harmless, stacked on purpose or not
        unique = replace(low, triangles=low.triangles[uv_islands.without_copies(low)])
        crossed = sum(int(np.count_nonzero(counts > 1)) for counts in coverage.counts(unique, size, tiles))
    return share_of(shared, covered) | {"stacked": shared - crossed}


def share_of(count: int, of: int) -> dict[str, float]:
    """A check of so many texels."""
    return {"count": count, "of": of, "share": count / max(1, of)}


def count_of(is_counted: np.ndarray, of: int) -> dict[str, float]:
    """A check of so many faces or edges. is_counted: (N,) bool."""
    return {"count": int(np.count_nonzero(is_counted)), "of": of}
