# SPDX-License-Identifier: GPL-3.0-or-later
"""The truth about a map: what was covered, missed, shared and left out, in numbers."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..mesh import arrays, faces
from ..mesh.arrays import Mesh
from ..passes import batch, overlap, resolve, target
from . import agreement, apart, casting
from .errors import few
from .reading import Meshes
from .report import Report
from .settings import Settings

MUCH_OVERLAP = 1e-3
"""Share of texels that triangles may share without a warning: decimation leaves a few slivers."""
MANY_MISSES = 1e-3
"""Share of rays that may hit nothing without a warning."""
MANY_UNCOVERED = 1e-2
"""Share of texels without a high triangle, when nothing is cast, that raises no warning: rims of islands differ a little."""
MANY_FAR = 0.25
"""Share of texels that may lie farther apart than the limit without a warning, where the limit is nobody's wish."""
MANY_BEYOND = 1e-3
"""The same where somebody has set the limit."""
MANY_UNEVEN = 0.1
"""Share of faces that may depend on how they are cut into triangles without a warning."""
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
    states: list[np.ndarray] = field(default_factory=list)
    """Of each tile, the state of the texels that `looked_at` names."""

    def add(self, state: np.ndarray, upwards: np.ndarray | None) -> None:
        """Count one tile; state as render.Renderer.texels has it, upwards the part of its normals along the low mesh's on
        SOME texels, or None where they are not relative to it."""
        self.written += int(np.count_nonzero(state == resolve.WRITTEN))
        self.margin += int(np.count_nonzero(state == resolve.MARGIN))
        self.missed += int(np.count_nonzero(state == resolve.MISSED))
        self.texels += state.size
        self.states.append(state[looked_at(state.shape)].copy())
        if upwards is not None:
            seen = state[SOME] == resolve.WRITTEN
            self.probed += int(np.count_nonzero(seen))
            self.turned_away += int(np.count_nonzero(upwards[seen] < 0.0))
            self.leaning += int(np.count_nonzero(upwards[seen] < FLAT))


def tell(
    meshes: Meshes,
    tally: Tally,
    tiles: Sequence[int],
    settings: Settings,
    report: Report,
    *,
    shot: casting.Shot | None = None,
) -> None:
    """Put into the report what was covered, what was missed and what was left out. shot: what was cast, if it was."""
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
    if tally.probed and not tally.leaning:
        report.warnings.append(_flat(meshes, report))
    with report.timed("audit"):
        _tell_of_uvs(meshes, tiles, settings, report)
        _tell_of_texels(meshes, tally, tiles, settings, report)
        _tell_of_distances(meshes, tiles, settings, report, shot)
        _tell_of_faces(meshes, report)


def _flat(meshes: Meshes, report: Report) -> str:
    what = "its own modifiers" if meshes.is_own_base else few(map(repr, report.high))
    return f"The map is flat: nothing of {what} differs from {report.low!r}. Is that the right high object?"


def uv_space(settings: Settings) -> tuple[int, int]:
    """How many tiles along u and v there are to lie on."""
    return arrays.UDIM if settings.udim else (1, 1)


def _tell_of_uvs(meshes: Meshes, tiles: Sequence[int], settings: Settings, report: Report) -> None:
    where = "UDIM tiles" if settings.udim else "UV tile 0 to 1"
    for mesh in (meshes.low, *meshes.highs):
        no_area = outside = 0
        if mesh is meshes.low or report.method == "FLATTEN":
            areas = arrays.uv_areas(mesh)
            no_area = int(np.count_nonzero(areas == 0.0))
            outside = int(np.count_nonzero(arrays.outside(mesh, uv_space(settings))))
        if mesh is meshes.low:
            is_mirrored = areas < 0.0
            report.mirrored = int(np.count_nonzero(is_mirrored))
            report.checks["mirrored"] = {"count": report.mirrored, "islands": faces.islands(mesh, is_mirrored)}
            report.checks["outside"], report.checks["no_area"] = {"count": outside}, {"count": no_area}
        for count, what in (
            (mesh.not_finite, "left out: their coordinates are NaN or infinite"),
            (no_area, "have no area in UV space and cannot be drawn"),
            (outside, f"reach outside the {where} and are cut off there"),
        ):
            if count:
                report.warnings.append(f"{mesh.name!r}: {count:,} of its triangles {what}.")


def _tell_of_texels(meshes: Meshes, tally: Tally, tiles: Sequence[int], settings: Settings, report: Report) -> None:
    covered = shared = uncovered = 0
    for counts, state in zip(covering(meshes.low, (settings.width, settings.height), tiles), tally.states, strict=True):
        covered += int(np.count_nonzero(counts))
        shared += int(np.count_nonzero(counts > 1.0))
        uncovered += int(np.count_nonzero((counts > 0.0) & (state != resolve.WRITTEN)))
    report.checks["overlap"] = _share(shared, covered)
    report.overlap = report.checks["overlap"]["share"]
    if report.overlap > MUCH_OVERLAP:
        report.warnings.append(
            f"{report.overlap:.2%} of the texels of {report.low!r} belong to two of its triangles or more: they show the "
            "detail of one of them."
        )
    is_cast = report.method == "CAST"
    missing = _share(tally.missed, tally.missed + tally.written) if is_cast else _share(uncovered, covered)
    report.checks["uncovered"] = missing
    if not is_cast and missing["share"] > MANY_UNCOVERED:
        report.warnings.append(
            f"{missing['share']:.2%} of the texels of {report.low!r} lie under no high triangle and stay empty."
        )


def _tell_of_distances(
    meshes: Meshes, tiles: Sequence[int], settings: Settings, report: Report, shot: casting.Shot | None
) -> None:
    texels = meshes.apart
    if texels is None:
        texels = apart.probe(apart.glancing(meshes, shot), (settings.width, settings.height), tiles)
    offset = apart.offset(texels, report.method)
    found = apart.distances(texels, offset)
    found = found[found >= 0.0]
    limit = apart.limit(meshes.low, settings)
    check = _share(int(np.count_nonzero(found > limit)), found.size)
    check["maximum"], check["percentile_99"] = (
        (float(found.max()), float(np.quantile(found, 0.99))) if found.size else (0.0, 0.0)
    )
    check["limit"], check["offset"] = limit, float(np.linalg.norm(offset))
    report.checks["far"] = check
    # Of a single mesh that is laid flat where it does not belong most texels are far; of several, one may be small.
    is_open = settings.method == "FLATTEN" and not meshes.is_own_base
    if is_open and (len(meshes.highs) > 1 or check["share"] > MANY_FAR):
        other = agreement.differing(meshes.low, [apart.thinned(high) for high in meshes.highs], tiles, offset)
        report.warnings += [f"Cast rays, or choose Auto: {other}."] if other else []
    if check["share"] > (MANY_FAR if settings.limit is None else MANY_BEYOND):
        report.warnings.append(
            f"On {check['share']:.2%} of the texels of {report.low!r} the high surface lies farther from it than "
            f"{limit:.4g}, at most {check['maximum']:.4g}."
        )


def _tell_of_faces(meshes: Meshes, report: Report) -> None:
    low = meshes.low
    many, uneven = int(np.count_nonzero(faces.polygons(low))), int(np.count_nonzero(faces.uneven(low)))
    report.checks["polygons"], report.checks["uneven"] = {"count": many}, {"count": uneven}
    total = int(low.faces.max()) + 1
    if uneven > MANY_UNEVEN * total and not meshes.is_own_base:  # whose modifiers are its detail
        report.warnings.append(
            f"{uneven:,} of the {total:,} faces of {report.low!r} are not flat and change their shape with the triangles "
            "that an exporter cuts them into: add a Triangulate modifier."
        )


def _share(count: int, of: int) -> dict[str, float]:
    return {"count": count, "of": of, "share": count / max(1, of)}


def looked_at(shape: tuple[int, int]) -> tuple[slice, slice]:
    """Rows and columns of a map with this height and width, evenly spaced: at most PROBE of each."""
    return tuple(slice(None, None, -(-side // PROBE)) for side in shape)


def covering(low: Mesh, size: tuple[int, int], tiles: Sequence[int] = (1001,)) -> Iterator[np.ndarray]:
    """How many triangles of `low` cover the texels that `looked_at` names, of a map of width and height, tile by tile.

    (height, width) float32; the array is used again for the next tile.
    """
    steps = [-(-side // PROBE) for side in size]
    small = [-(-side // step) for side, step in zip(size, steps, strict=True)]
    drawn = target.get("overlap", *small, "R16F")
    uploaded = batch.upload(low.triangles, uv=low.uv)
    counts = np.empty(small[::-1], np.float32)
    for tile in tiles:
        overlap.draw(drawn, uploaded, _sparse(tile, size, steps, small))
        drawn.read(counts)
        yield counts


def _sparse(tile: int, size: Sequence[int], steps: Sequence[int], small: Sequence[int]) -> tuple[float, ...]:
    """From uv to clip space, as target.window, so that texel i of `small` lies where texel i * step of the map does."""
    places = (tile - 1001) % 10, (tile - 1001) // 10
    scale = [2.0 * side / (step * few) for side, step, few in zip(size, steps, small, strict=True)]
    shift = [(step - 1.0) / (step * few) - 1.0 for step, few in zip(steps, small, strict=True)]
    return *scale, *(back - one * place for back, one, place in zip(shift, scale, places, strict=True))
