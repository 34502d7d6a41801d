# SPDX-License-Identifier: GPL-3.0-or-later
"""The truth about a map: what was covered, missed, shared and left out, in numbers."""

import numpy as np

from ..mesh import arrays
from ..mesh.arrays import Mesh
from ..passes import batch, overlap, resolve, target
from .reading import Meshes
from .report import Report

MUCH_OVERLAP = 1e-3
"""Share of texels that triangles may share without a warning: decimation leaves a few slivers."""
MANY_MISSES = 1e-3
"""Share of rays that may hit nothing without a warning."""
TURNED_AWAY = 0.5
"""Share of normals that may point into the low mesh without a warning."""
PROBE = 1024
"""Texels a side, at most, of the map on which overlaps are counted."""


def tell(meshes: Meshes, texels: np.ndarray, state: np.ndarray, report: Report) -> None:
    """Put into the report what was covered, what was missed and what was left out."""
    report.triangles = {"high": sum(len(high.triangles) for high in meshes.highs), "low": len(meshes.low.triangles)}
    written, in_margin, missed = (
        int(np.count_nonzero(state == which)) for which in (resolve.WRITTEN, resolve.MARGIN, resolve.MISSED)
    )
    report.coverage, report.margin = written / state.size, in_margin / state.size
    report.missed = missed / max(1, missed + written)
    if report.missed > MANY_MISSES:
        report.warnings.append(
            f"{report.missed:.2%} of the rays from {report.low!r} hit nothing: those texels have alpha 0. "
            "Look at the extrusion and the maximum distance."
        )
    if report.space == "TANGENT":
        # A look at some texels is enough for a half of them.
        blue, seen = texels[::4, ::4, 2], state[::4, ::4] == resolve.WRITTEN
        if np.count_nonzero(blue[seen] < 0.5) > TURNED_AWAY * max(1, np.count_nonzero(seen)):
            report.warnings.append(
                f"Most high normals point into {report.low!r}: the normals of one of the two are inside out, turn them round."
            )
    with report.timed("audit"):
        _tell_of_uvs(meshes, state, report)


def _tell_of_uvs(meshes: Meshes, state: np.ndarray, report: Report) -> None:
    report.overlap = overlap_share(meshes.low, (state.shape[1], state.shape[0]))
    report.mirrored = arrays.mirrored(meshes.low)
    if report.overlap > MUCH_OVERLAP:
        report.warnings.append(
            f"{report.overlap:.2%} of the texels of {report.low!r} belong to two of its triangles or more: they show the "
            "detail of one of them."
        )
    for mesh in (meshes.low, *meshes.highs):
        laid_flat = mesh is meshes.low or report.method == "FLATTEN"
        no_area, outside = arrays.uv_flaws(mesh) if laid_flat else (0, 0)
        for count, what in (
            (mesh.not_finite, "left out: their coordinates are NaN or infinite"),
            (no_area, "have no area in UV space and cannot be drawn"),
            (outside, "reach outside the UV tile 0 to 1 and are cut off there"),
        ):
            if count:
                report.warnings.append(f"{mesh.name!r}: {count:,} of its triangles {what}.")


def overlap_share(low: Mesh, size: tuple[int, int]) -> float:
    """Share of the texels under `low` that two or more of its triangles share; measured on at most PROBE a side."""
    width, height = (min(side, PROBE) for side in size)
    counts = target.get("overlap", width, height, "R16F")
    overlap.draw(counts, batch.upload(low.triangles, uv=low.uv), target.WHOLE_MAP)
    covered = np.empty((height, width), np.float32)
    counts.read(covered)
    return np.count_nonzero(covered > 1.0) / max(1, np.count_nonzero(covered))
