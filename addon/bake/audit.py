# SPDX-License-Identifier: GPL-3.0-or-later
"""The truth about a map: what was covered, missed, shared and left out, in numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..mesh import arrays
from ..mesh.arrays import Mesh
from ..passes import batch, overlap, resolve, target
from .reading import Meshes
from .report import Report
from .settings import Settings

MUCH_OVERLAP = 1e-3
"""Share of texels that triangles may share without a warning: decimation leaves a few slivers."""
MANY_MISSES = 1e-3
"""Share of rays that may hit nothing without a warning."""
TURNED_AWAY = 0.5
"""Share of normals that may point into the low mesh without a warning."""
PROBE = 1024
"""Texels a side, at most, of the map on which overlaps are counted."""


@dataclass
class Tally:
    """What the texels of a map turned out to be, over all its tiles."""

    written: int = 0
    margin: int = 0
    missed: int = 0
    texels: int = 0
    probed: int = 0
    turned_away: int = 0

    def add(self, state: np.ndarray, upwards: np.ndarray | None) -> None:
        """Count one tile; state as render.Renderer.texels has it, upwards (height, width) the part of its normals along
        the low mesh's, or None where they are not relative to it."""
        counts = np.bincount(state.reshape(-1), minlength=4)
        self.written += int(counts[resolve.WRITTEN])
        self.margin += int(counts[resolve.MARGIN])
        self.missed += int(counts[resolve.MISSED])
        self.texels += state.size
        if upwards is not None:
            # A look at some texels is enough for a half of them.
            seen = state[::4, ::4] == resolve.WRITTEN
            self.probed += int(np.count_nonzero(seen))
            self.turned_away += int(np.count_nonzero(upwards[::4, ::4][seen] < 0.0))


def tell(meshes: Meshes, tally: Tally, tiles: Sequence[int], settings: Settings, report: Report) -> None:
    """Put into the report what was covered, what was missed and what was left out."""
    report.triangles = {"high": sum(len(high.triangles) for high in meshes.highs), "low": len(meshes.low.triangles)}
    report.coverage, report.margin = tally.written / tally.texels, tally.margin / tally.texels
    report.missed = tally.missed / max(1, tally.missed + tally.written)
    if report.missed > MANY_MISSES:
        report.warnings.append(
            f"{report.missed:.2%} of the rays from {report.low!r} hit nothing: those texels have alpha 0. "
            "Look at the extrusion and the maximum distance."
        )
    if tally.turned_away > TURNED_AWAY * max(1, tally.probed):
        report.warnings.append(
            f"Most high normals point into {report.low!r}: the normals of one of the two are inside out, turn them round."
        )
    with report.timed("audit"):
        _tell_of_uvs(meshes, tiles, settings, report)


def _tell_of_uvs(meshes: Meshes, tiles: Sequence[int], settings: Settings, report: Report) -> None:
    report.overlap = overlap_share(meshes.low, (settings.width, settings.height), tiles)
    report.mirrored = arrays.mirrored(meshes.low)
    if report.overlap > MUCH_OVERLAP:
        report.warnings.append(
            f"{report.overlap:.2%} of the texels of {report.low!r} belong to two of its triangles or more: they show the "
            "detail of one of them."
        )
    space = arrays.UDIM if settings.udim else (1, 1)
    for mesh in (meshes.low, *meshes.highs):
        laid_flat = mesh is meshes.low or report.method == "FLATTEN"
        no_area, outside = arrays.uv_flaws(mesh, space) if laid_flat else (0, 0)
        where = "UDIM tiles" if settings.udim else "UV tile 0 to 1"
        for count, what in (
            (mesh.not_finite, "left out: their coordinates are NaN or infinite"),
            (no_area, "have no area in UV space and cannot be drawn"),
            (outside, f"reach outside the {where} and are cut off there"),
        ):
            if count:
                report.warnings.append(f"{mesh.name!r}: {count:,} of its triangles {what}.")


def overlap_share(low: Mesh, size: tuple[int, int], tiles: Sequence[int] = (1001,)) -> float:
    """Share of the texels under `low` that two or more of its triangles share; measured on at most PROBE a side."""
    width, height = (min(side, PROBE) for side in size)
    counts = target.get("overlap", width, height, "R16F")
    uploaded = batch.upload(low.triangles, uv=low.uv)
    count, covered, shared = np.empty((height, width), np.float32), 0, 0
    for tile in tiles:
        overlap.draw(counts, uploaded, target.window(tile))
        counts.read(count)
        covered, shared = covered + np.count_nonzero(count), shared + np.count_nonzero(count > 1.0)
    return shared / max(1, covered)
