# SPDX-License-Identifier: GPL-3.0-or-later
"""The truth about a map: what was covered, missed, shared and left out, in numbers."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..core import texel_state, udim
from ..core.errors import shorten_list
from ..core.report import Report
from ..core.settings import Settings
from ..engine import ray_casting, separation, uv_agreement
from ..mesh import face_shapes, uv_islands, uv_layout, uv_seams
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..passes import mesh_upload, target
from ..passes.audit import overlap
from . import mip_gaps, severity
from .sparse_maps import Sparse, at_most

TURNED_AWAY = 0.5
"""Share of normals that may point into the low mesh without a warning."""
FLAT = 0.5 * np.cos(np.radians(0.1))
"""Half the z of normals that lean by less than anybody sees: a map that holds no others shows nothing."""
SOME = np.s_[::4, ::4]
"""The texels whose normals are looked at, to see whether half of them point into the low mesh."""
PROBE = 1024
"""Texels a side, at most, of those on which overlaps and gaps are counted."""


@dataclass
class Tally:
    """What the texels of a map turned out to be, over all its tiles."""

    written: int = 0
    margin: int = 0
    missed: int = 0
    texels: int = 0
    probed: int = 0
    turned_away: int = 0
    leaning: int = 0
    backwards: int = 0
    states: list[np.ndarray] = field(default_factory=list)
    """Of each tile, the state of the texels that are `probed`."""

    def add(self, state: np.ndarray, upwards: np.ndarray | None, backwards: int) -> None:
        """Count one tile; state as rendering.Renderer.texels has it, upwards the part of its normals along the low mesh's on
        SOME texels, or None where they are not relative to it, and backwards as post_process.backwards counts them."""
        self.written += int(np.count_nonzero(state == texel_state.WRITTEN))
        self.margin += int(np.count_nonzero(state == texel_state.MARGIN))
        self.missed += int(np.count_nonzero(state == texel_state.MISSED))
        self.texels += state.size
        if upwards is not None:
            seen = state[SOME] == texel_state.WRITTEN
            self.probed += int(np.count_nonzero(seen))
            self.turned_away += int(np.count_nonzero(upwards[seen] < 0.0))
            self.leaning += int(np.count_nonzero(upwards[seen] < FLAT))
        self.backwards += backwards
        columns, rows = probed(state.shape[::-1]).steps
        self.states.append(state[::rows, ::columns].copy())


def tell(
    meshes: Meshes,
    tally: Tally,
    tiles: Sequence[int],
    settings: Settings,
    report: Report,
    *,
    ray_cast: ray_casting.RayCast | None = None,
) -> None:
    """Put into the report what was covered, what was missed and what was left out. shot: what was cast, if it was."""
    report.triangles = {"high": sum(len(high.triangles) for high in meshes.highs), "low": len(meshes.low.triangles)}
    report.coverage, report.margin = tally.written / tally.texels, tally.margin / tally.texels
    report.missed = tally.missed / max(1, tally.missed + tally.written)
    if tally.turned_away > TURNED_AWAY * max(1, tally.probed):
        report.warnings.append(
            f"Most high normals point into {report.low!r}: the normals of one of the two are flipped, recalculate them."
        )
    if tally.probed and not tally.leaning:
        report.warnings.append(_flat(meshes, report))
    with report.timed("audit"):
        _tell_of_uvs(meshes, settings, report)
        _tell_of_texels(meshes, tally, tiles, settings, report)
        _tell_of_gaps(meshes, tiles, settings, report)
        _tell_of_distances(meshes, tiles, settings, report, ray_cast)
        _tell_of_faces(meshes, report)
        _tell_of_normals(meshes, tally, report)
    chosen = replace(settings, method=report.method)
    for kind, check in report.checks.items():
        check["severity"] = severity.of(kind, check, chosen)
        if check["severity"] == severity.WRONG:
            report.warnings.append(severity.warning(kind, check, report.low, chosen))


def _flat(meshes: Meshes, report: Report) -> str:
    what = "its own modifiers" if meshes.is_own_base else shorten_list(map(repr, report.high))
    return f"The map is flat: nothing of {what} differs from {report.low!r}. Is that the right high object?"


def uv_space(settings: Settings) -> tuple[int, int]:
    """How many tiles along u and v there are to lie on."""
    return (udim.COLUMNS, udim.ROWS) if settings.udim else (1, 1)


def _tell_of_uvs(meshes: Meshes, settings: Settings, report: Report) -> None:
    low = meshes.low
    areas, outside = uv_layout.areas(low), uv_layout.outside(low, uv_space(settings))
    is_mirrored, count = areas < 0.0, len(low.triangles)
    report.mirrored = int(np.count_nonzero(is_mirrored))
    # With UDIM tiles nothing lies on what is inside: readers find no tile there.
    moved = uv_islands.moved_copies(low) if outside.any() and not settings.udim else np.zeros(1, bool)
    report.checks["mirrored"] = {
        "count": report.mirrored,
        "of": count,
        "islands": uv_islands.count_islands(low, is_mirrored) if report.mirrored else 0,
    }
    report.checks["outside"] = _count(outside, count) | {"moved": int(np.count_nonzero(moved))}
    report.checks["no_area"] = _count(areas == 0.0, count)
    for mesh in (low, *meshes.highs):
        _warn(report, mesh, mesh.not_finite, "left out: their coordinates are NaN or infinite")
    if report.method == "FLATTEN":
        for high in meshes.highs:
            _warn(report, high, np.count_nonzero(uv_layout.areas(high) == 0.0), NO_AREA)
            # Those that lie outside by whole tiles leave texels uncovered, or were moved there on purpose.
            outside = uv_layout.outside(high, uv_space(settings))
            if outside.any():
                _warn(report, high, np.count_nonzero(outside & uv_islands.crossing(high)), _outside(settings))


NO_AREA = "have no area in UV space and cannot be drawn"


def _outside(settings: Settings) -> str:
    return f"reach outside the {severity.TILES if settings.udim else severity.TILE} and are cut off there"


def _warn(report: Report, mesh: Mesh, count: int, what: str) -> None:
    if count:
        report.warnings.append(f"{mesh.name!r}: {count:,} of its triangles {what}.")


def _tell_of_texels(meshes: Meshes, tally: Tally, tiles: Sequence[int], settings: Settings, report: Report) -> None:
    low, size = meshes.low, (settings.width, settings.height)
    covered = shared = uncovered = 0
    for counts, state in zip(covering(low, size, tiles), tally.states, strict=True):
        covered += int(np.count_nonzero(counts))
        shared += int(np.count_nonzero(counts > 1.0))
        uncovered += int(np.count_nonzero((counts > 0.0) & (state != texel_state.WRITTEN)))
    crossed = shared
    if shared > severity.MUCH_OVERLAP * covered:  # fewer do no harm, stacked on purpose or not
        alone = replace(low, triangles=low.triangles[uv_islands.without_copies(low)])
        crossed = sum(int(np.count_nonzero(counts > 1.0)) for counts in covering(alone, size, tiles))
    report.checks["overlap"] = _share(shared, covered) | {"stacked": shared - crossed}
    report.overlap = report.checks["overlap"]["share"]
    is_cast = report.method == "CAST"
    report.checks["uncovered"] = (
        _share(tally.missed, tally.missed + tally.written) if is_cast else _share(uncovered, covered)
    )


def _tell_of_gaps(meshes: Meshes, tiles: Sequence[int], settings: Settings, report: Report) -> None:
    close = covered = border = 0
    overlaps = report.overlap > severity.MUCH_OVERLAP
    for found in mip_gaps.find(meshes.low, tiles, settings, mip_gaps.grid(settings), overlaps=overlaps):
        covered += int(np.count_nonzero(found.covered))
        close += int(np.count_nonzero(found.close | found.border))
        border += int(np.count_nonzero(found.border))
    report.checks["gaps"] = _share(close, covered) | {"border": border, "needed": mip_gaps.needed(settings)}


def _tell_of_distances(
    meshes: Meshes, tiles: Sequence[int], settings: Settings, report: Report, ray_cast: ray_casting.RayCast | None
) -> None:
    texels = meshes.apart
    if texels is None:
        texels = separation.probe(separation.glancing(meshes, ray_cast), (settings.width, settings.height), tiles)
    offset = separation.offset(texels, report.method)
    found = separation.distances(texels, offset)
    found = found[found >= 0.0]
    limit = separation.limit(meshes.low, settings)
    check = _share(int(np.count_nonzero(found > limit)), found.size)
    check["maximum"], check["percentile_99"] = (
        (float(found.max()), float(np.quantile(found, 0.99))) if found.size else (0.0, 0.0)
    )
    check["limit"], check["offset"] = limit, float(np.linalg.norm(offset))
    report.checks["far"] = check
    # Of a single mesh that is laid flat where it does not belong most texels are far; of several, one may be small.
    is_open = settings.method == "FLATTEN" and not meshes.is_own_base
    if is_open and (len(meshes.highs) > 1 or check["share"] > severity.MANY_FAR):
        other = uv_agreement.differing(meshes.low, [separation.thinned(high) for high in meshes.highs], tiles, offset)
        report.warnings += [f"Cast rays, or choose Auto: {other}."] if other else []


def _tell_of_faces(meshes: Meshes, report: Report) -> None:
    low = meshes.low
    polygons, uneven = face_shapes.non_triangles(low), face_shapes.non_planar(low)
    report.checks["polygons"] = _count(polygons, len(polygons))
    report.checks["uneven"] = _count(uneven, len(uneven)) | {"is_own_base": meshes.is_own_base}


def _tell_of_normals(meshes: Meshes, tally: Tally, report: Report) -> None:
    low = meshes.low
    report.checks["hard_edges"] = {"count": len(uv_seams.hard_edges(low))}
    report.checks["behind"] = _count(face_shapes.normals_behind(low), len(low.triangles))
    report.checks["backwards"] = _share(tally.backwards, tally.written)


def _share(count: int, of: int) -> dict[str, float]:
    return {"count": count, "of": of, "share": count / max(1, of)}


def _count(found: np.ndarray, of: int) -> dict[str, float]:
    return {"count": int(np.count_nonzero(found)), "of": of}


def probed(size: tuple[int, int]) -> Sparse:
    """Which texels of a map of width and height are looked at, evenly spaced: at most PROBE a side."""
    return at_most(size, PROBE)


def covering(low: Mesh, size: tuple[int, int], tiles: Sequence[int] = (1001,)) -> Iterator[np.ndarray]:
    """How many triangles of `low` cover the texels that are `probed`, of a map of width and height, tile by tile.

    (height, width) float32; the array is used again for the next tile.
    """
    sparse = probed(size)
    drawn = target.get("overlap", *sparse.small, "R16F")
    uploaded = mesh_upload.upload(low.triangles, uv=low.uv)
    counts = np.empty(sparse.small[::-1], np.float32)
    for tile in tiles:
        overlap.draw(drawn, uploaded, sparse.uv_to_clip(tile))
        drawn.read(counts)
        yield counts
