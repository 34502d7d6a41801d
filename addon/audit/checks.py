# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks a finished map: coverage, missed rays, overlaps, unsure hits, and problems of the low mesh."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..core.declarations.choices import Method, Space
from ..core.errors import Fix, Length, shorten_list
from ..core.map_types import WRITTEN
from ..core.sentences import LOOK, WRONG, Sentence
from ..core.settings import MapSettings, SamplingSettings, Settings, TracingSettings
from ..engine import coverage, ray_casting, separation, uv_agreement
from ..engine.planning import Plan
from ..engine.ray_casting import RayCast
from ..engine.unsure_texels import REASONS, Explorer
from ..mesh import face_shapes, uv_islands, uv_layout, uv_seams
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from . import mip_gaps, severity, stacked_checks, uv_checks
from .appearance import Appearance
from .severity import Check
from .tally import Tally
from .uv_checks import count_of, share_of

TURNED_AWAY = 0.5
"""Share of normals that may point into the low mesh without a warning."""
MUCH_MISSED = 0.1
"""Share of the rays that hit nothing above which the place of the high mesh may be to blame, and not its holes."""

Checks = dict[str, Check]
"""By kind, as in Report.checks but without the severity."""


@dataclass(frozen=True)
class Findings:
    """What is known of a bake after its maps were checked and measured; as core.report.Report has it, unless noted."""

    triangles: dict[str, int]
    """Numbers of triangles of the meshes."""
    coverage: float
    """The share of the map that the low mesh covers."""
    margin: float
    missed: float
    checks: Checks
    """The results of the checks by their names."""
    warnings: tuple[Sentence, ...]
    """About the maps, by what they are about."""
    stopped_early: float = 0.0
    """The share of the texels that took fewer samples."""
    rays: float = 0.0
    targets: dict[str, dict[str, float | int | dict[str, float | int]]] = field(default_factory=dict)
    deviation: dict[str, float | int] = field(default_factory=dict)
    """Degrees at texels."""
    between: dict[str, float | int] = field(default_factory=dict)
    """Degrees between texels."""
    appearance: Appearance | None = None
    """None if it was not measured."""
    picture: np.ndarray | None = None
    """None unless it was asked for."""

    @property
    def overlap(self) -> float:
        return self.checks["overlap"]["share"]

    @property
    def mirrored(self) -> int:
        return self.checks["mirrored"]["count"]


def audit(
    plan: Plan,
    tally: Tally,
    settings: Settings,
    ray_cast: ray_casting.RayCast | None,
    *,
    length: Length,
    stacked: Check,
) -> Findings:
    """Check a map. ray_cast: the rays that were cast, or None. length: a length in scene units as text. stacked: from
    stacked_checks.check_stacked."""
    meshes, low = plan.meshes, plan.meshes.low
    uv_checks, uv_warnings = _uv_layout(plan, settings.sampling)
    texel_checks = _texels(plan, tally, settings.sampling)
    # Where rays only fill up Flatten, UVs say which layer is meant.
    unsure, distances = check_unsure(plan, settings.sampling, None if plan.has_rays else ray_cast)
    if plan.has_rays:
        texels = separation.sample(separation.full_probe(meshes, ray_cast), settings.sampling.size, plan.tiles)
        distances = separation.distances(texels, np.zeros(3))[texels[..., 3] > 0.0]
    distance_checks, placement = _distances(plan, settings, distances if ray_cast else None)
    checks = uv_checks | texel_checks | distance_checks | {"unsure": unsure} | _faces(meshes) | _normals(meshes, tally)
    checks["overlap"] |= stacked | {"materials": len(stacked["materials"])}
    checks["behind"]["backwards"] = checks["backwards"]["share"]
    with_method = settings.traced(method=Method.CAST) if plan.casts_rays else settings
    for kind, check in checks.items():
        check["severity"] = severity.rate(kind, check, with_method)
    return Findings(
        triangles={"high": sum(len(high.triangles) for high in meshes.highs), "low": len(low.triangles)},
        coverage=tally.written / tally.texels,
        margin=tally.margin / tally.texels,
        missed=tally.missed / max(1, tally.missed + tally.written),
        checks=checks,
        warnings=(
            *_direction_warnings(meshes, tally, settings.map),
            *uv_warnings,
            *_placement_warnings(plan, checks, settings.tracing, placement, length),
            *_crossed_warnings(plan, checks, settings),
            *stacked_checks.warnings(low, stacked),
            *(
                severity.warning(kind, check, low.name, with_method, length)
                for kind, check in checks.items()
                if check["severity"] == WRONG
            ),
        ),
    )


def _direction_warnings(meshes: Meshes, tally: Tally, map_settings: MapSettings) -> Iterator[Sentence]:
    low = meshes.low.name
    if tally.turned_away > TURNED_AWAY * max(1, tally.compared):
        text = f"Most high normals point into {low!r}: the normals of one of the two are flipped, recalculate them."
        yield Sentence(text, WRONG, severity.TURNED, 1.0)
    # A mesh that is baked onto itself has its own normals, and maps of other kinds.
    is_itself = meshes.is_own_base and bool(map_settings.drawn_maps)
    if map_settings.normal and tally.compared and not tally.leaning and not is_itself:
        names = shorten_list(repr(high.name) for high in meshes.listed_highs)
        text = f"The map is flat: nothing of {names} differs from {low!r}. Is that the right high object?"
        if meshes.is_own_base:
            text = (
                f"The map is flat: neither modifiers nor materials of {low!r} change its normals. Choose a high object, or "
                "other maps."
            )
        yield Sentence(text, LOOK, severity.FLAT, 1.0)


def _uv_layout(plan: Plan, sampling: SamplingSettings) -> tuple[Checks, list[Sentence]]:
    low, highs, space = plan.meshes.low, plan.meshes.listed_highs, uv_checks.space(sampling)
    areas = uv_layout.areas(low)
    is_mirrored, count = areas < 0.0, len(low.triangles)
    islands = uv_islands.count_islands(low, is_mirrored) if is_mirrored.any() else 0
    checks = {
        "mirrored": count_of(is_mirrored, count) | {"islands": islands},
        "outside": uv_checks.outside(low, sampling),
        "no_area": count_of(areas == 0.0, count),
    }
    if plan.meshes.is_own_base and all(len(high.triangles) == len(low.triangles) for high in highs):
        highs = []  # the same triangles, which are told once
    counts = [
        count
        for mesh in (low, *highs)
        for count in (
            (mesh, mesh.not_finite, "are left out: their coordinates are NaN or infinite", WRONG, severity.NOT_FINITE),
            (mesh, mesh.without_normals, "have normals without a length: they are shaded smooth", LOOK, ""),
        )
    ]
    if not plan.casts_rays:
        for high in highs:
            no_area = int(np.count_nonzero(uv_layout.areas(high) == 0.0))
            counts.append((high, no_area, "have no area in UV space and cannot be drawn", LOOK, ""))
            # Triangles outside by whole tiles leave texels uncovered, or were moved there on purpose.
            outside = uv_layout.outside(high, space)
            crossing = outside & uv_islands.crossing(high) if outside.any() else outside
            if uv_layout.cut_off(high, crossing, space) > severity.MUCH_CUT_OFF:
                where = f"reach outside the {severity.TILES if sampling.udim else severity.TILE} and are cut off there"
                counts.append((high, int(np.count_nonzero(crossing)), where, WRONG, ""))
    return checks, [
        Sentence(f"{mesh.name!r}: {count:,} of its triangles {problem}.", harm, kind)
        for mesh, count, problem, harm, kind in counts
        if count
    ]


def _texels(plan: Plan, tally: Tally, sampling: SamplingSettings) -> Checks:
    low, tiles, size = plan.meshes.low, plan.tiles, (sampling.width, sampling.height)
    covered = shared = uncovered = 0
    for counts, state in zip(coverage.counts(plan.read.low, size, tiles), tally.states, strict=True):
        covered += int(np.count_nonzero(counts))
        shared += int(np.count_nonzero(counts > 1))
        if not plan.casts_rays:
            uncovered += int(np.count_nonzero((counts > 0) & (state != WRITTEN)))
    overlap_check = uv_checks.overlap_of(low, size, tiles, covered, shared)
    missed = share_of(tally.missed, tally.missed + tally.written)
    return {
        "overlap": overlap_check,
        "uncovered": missed if plan.casts_rays else share_of(uncovered, covered),
        "gaps": _gaps(low, tiles, sampling, overlaps=overlap_check["share"] > severity.MUCH_OVERLAP),
    }


def _gaps(low: Mesh, tiles: Sequence[int], sampling: SamplingSettings, *, overlaps: bool) -> Check:
    close = covered = border = 0
    for gaps in mip_gaps.find(low, tiles, sampling, mip_gaps.grid(sampling), overlaps=overlaps):
        covered += int(np.count_nonzero(gaps.covered))
        close += int(np.count_nonzero(gaps.close | gaps.border))
        border += int(np.count_nonzero(gaps.border))
    return share_of(close, covered) | {"border": border, "needed": mip_gaps.needed(sampling)}


@dataclass(frozen=True)
class _Placement:
    """How far the surfaces are apart.

    Attributes:
        offset (3,): Of the high meshes as wholes, which does not count.
        beyond: The share of the texels that are farther apart than `usual`, the default limit or a larger one, in scene units.
    """

    offset: np.ndarray
    beyond: float
    usual: float


def _distances(plan: Plan, settings: Settings, distances: np.ndarray | None) -> tuple[Checks, _Placement]:
    """distances: (N,) of the hits of rays, in scene units, or None without rays."""
    meshes, offset = plan.meshes, np.zeros(3, np.float32)
    if distances is None:
        texels = plan.choice.separation
        if texels is None:
            texels = separation.sample(separation.quick_probe(meshes), settings.sampling.size, plan.tiles)
        offset = separation.offset(texels, plan.method)
        distances = separation.distances(texels, offset)
        distances = distances[distances >= 0.0]
    limit = separation.limit(meshes.low, settings.tracing)
    usual = max(separation.usual_limit(meshes.low), limit)  # a larger one allows for more
    maximum, percentile_99 = (
        (float(distances.max()), float(np.quantile(distances, 0.99))) if distances.size else (0.0, 0.0)
    )
    check = share_of(int(np.count_nonzero(distances > limit)), distances.size) | {
        "maximum": maximum,
        "percentile_99": percentile_99,
        "limit": limit,
        "offset": math.hypot(*offset.tolist()),
    }
    return {"far": check}, _Placement(offset, np.count_nonzero(distances > usual) / max(1, distances.size), usual)


def _placement_warnings(
    plan: Plan, checks: Checks, tracing: TracingSettings, placement: _Placement, length: Length
) -> Iterator[Sentence]:
    """Why the surfaces do not meet."""
    meshes, missed, unsure = plan.meshes, checks["uncovered"], checks["unsure"]
    low, highs = repr(meshes.low.name), shorten_list(repr(high.name) for high in meshes.listed_highs)
    if meshes.is_own_base:
        return
    # A single high mesh with another UV layout is far on most texels. One of several may cover only a few.
    if tracing.method == Method.FLATTEN and (len(meshes.highs) > 1 or placement.beyond > severity.MANY_FAR):
        thinned = [separation.thinned(high) for high in meshes.drawn_highs]
        differing = uv_agreement.differing(meshes.low, thinned, plan.tiles, placement.offset)
        if differing:
            text = Fix.AUTO.after(f"{differing[:1].upper()}{differing[1:]}.")
            yield Sentence(text, WRONG, severity.LAYOUTS, 1.0)
            return
    is_missed = plan.casts_rays and missed["severity"] == WRONG
    are_backs = unsure["severity"] == WRONG and unsure["backs"] > 0.5 * unsure["count"]
    if meshes.cage is not None and (is_missed or are_backs):
        share = missed["share"] + unsure["backs"] / max(1, unsure["of"])
        yield Sentence(
            f"{min(1.0, share):.2%} of the rays from the cage {meshes.cage.name!r} hit nothing, or only backs of faces: it is "
            f"below the surface of {highs} there. Move it outward until it encloses {highs}.",
            WRONG,
            severity.CAGE,
            share,
        )
    if not plan.casts_rays:
        return  # what UVs put together may have any place and size
    if placement.beyond > severity.NEARLY_ALL:
        what = f"on {placement.beyond:.2%} of the texels, they are more than {length(placement.usual)} apart"
    elif missed["share"] > MUCH_MISSED and not separation.boxes_fit(meshes):
        what = f"{missed['share']:.2%} of the rays hit nothing"
    # A low mesh may stand for a part of a larger high one, with deep detail.
    elif placement.beyond > severity.MANY_FAR and not separation.boxes_fit(meshes, may_be_part=True):
        what = "the surfaces are far apart"
    else:
        return
    advice = "Put them in the same place, or set an extrusion from which rays start outside of them."
    yield Sentence(f"{highs} and {low} differ in place or size: {what}. {advice}", WRONG, severity.ELSEWHERE, 1.0)


def _crossed_warnings(plan: Plan, checks: Checks, settings: Settings) -> Iterator[Sentence]:
    # In object and world space, overlaps are wrong in any order.
    if plan.method != Method.FLATTEN or plan.has_rays or settings.map.space != Space.TANGENT:
        return
    low, overlap_check = plan.meshes.low, checks["overlap"]
    is_stacked = overlap_check["stacked"] > severity.MUCH_OVERLAP * overlap_check["of"]
    if is_stacked and checks["far"]["maximum"] > separation.usual_limit(low):
        highs = [separation.thinned(high) for high in plan.meshes.drawn_highs]
        share = uv_agreement.crossed(low, highs, plan.tiles)
        if share > uv_agreement.CROSSED:
            text = (
                f"Parts of {low.name!r} share UVs, and on {share:.1%} of the texels the high normals are those of one part, "
                "and the tangents those of another."
            )
            yield Sentence(Fix.CAST.after(text), WRONG, severity.CROSSED, share)


def _faces(meshes: Meshes) -> Checks:
    polygons, uneven = face_shapes.non_triangles(meshes.low), face_shapes.non_planar(meshes.low)
    return {
        "polygons": count_of(polygons, len(polygons)),
        "uneven": count_of(uneven, len(uneven)) | {"is_own_base": meshes.is_own_base},
    }


def _normals(meshes: Meshes, tally: Tally) -> Checks:
    low = meshes.low
    return {
        "hard_edges": {"count": len(uv_seams.hard_edges(low))},
        "behind": count_of(face_shapes.normals_behind(low), len(low.triangles)),
        "backwards": share_of(tally.backwards, tally.written),
    }


UNSURE_SIDE = 128
"""Texels a side, at most, whose rays are followed farther."""


def check_unsure(plan: Plan, sampling: SamplingSettings, ray_cast: RayCast | None) -> tuple[Check, np.ndarray]:
    """The check "unsure" of Report.checks, without its severity, and the distances (N,) float32 of the hits, in scene units.

    ray_cast: the rays of the bake, or None: then both are empty.
    """
    names = "count", "of", "not_owned", *REASONS
    counts, distances = dict.fromkeys(names, 0), [np.empty(0, np.float32)]
    if ray_cast is not None:
        explorer = Explorer(ray_cast, plan.meshes.whole_low)
        sparse = coverage.at_most(sampling.size, UNSURE_SIDE)
        for tile in plan.tiles:
            doubts, far = explorer.sample(sparse.small, sparse.uv_to_clip(tile), sparse.uv_to_clip(tile, shift=1))
            masks = doubts.unsure, doubts.on_low, doubts.not_owned, *(getattr(doubts, reason) for reason in REASONS)
            for name, texels in zip(names, masks, strict=True):
                counts[name] += int(np.count_nonzero(texels))
            distances.append(far)
    return counts | {"share": counts["count"] / max(1, counts["of"])}, np.concatenate(distances)
