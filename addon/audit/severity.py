# SPDX-License-Identifier: GPL-3.0-or-later
"""Rates the results of the audit as good, worth a look, or harmful, and decides which warnings a bake gives."""

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any

from ..core.declarations.choices import Hit, Method, Space
from ..core.errors import Fix, Length, plain_length
from ..core.map_types import BY_NAME, Kind
from ..core.sentences import LOOK, NOTE, WRONG, Sentence, by_harm
from ..core.settings import Settings

GOOD = "GOOD"

SHARED = "shared"
"""The kind of sentences about texels that several objects have in one image."""
MUCH_OVERLAP = 1e-3
"""Share of texels that triangles may share without harm: decimation leaves a few slivers."""
MANY_DIFFERENT = 1e-2
"""Share of the texels of hidden parts whose own detail may differ from what they show without harm: symmetric meshes have a few
at the borders of layers."""
MANY_MISSES = 1e-3
"""Share of rays that may hit nothing without harm."""
MANY_UNCOVERED = 1e-2
"""Share of texels that may have no high triangle without harm, for Flatten: the borders of islands differ a little."""
MANY_FAR = 0.25
"""Share of texels that may lie beyond the default limit if high and low are in the same place, as with deep panels."""
NEARLY_ALL = 0.9
"""Share of texels beyond the default limit above which the high mesh touches the low one nowhere."""
MANY_BEYOND = 1e-3
"""Share of texels that may lie beyond a limit from the settings without harm."""
MANY_UNSURE = 1e-2
"""Share of texels that may show the wrong layer without a warning: where parts of the high mesh cross, some always do."""
MANY_CLOSE = 0.02
"""Share of texels that may lie closer to another island, or the border, than the mip level allows without harm."""
MANY_BACKWARDS = 1e-3
"""Share of texels whose normal may be wrong in engines that rebuild z, without harm."""
MUCH_CUT_OFF = 1e-3
"""Share of the UV area that may lie outside the tile without harm: decimation and subdivision move UVs at its border."""

TILE, TILES = "UV tile 0 to 1", "UDIM tiles"
"""The area for the UVs of a mesh, without and with UDIM."""

Check = dict[str, Any]


def rate(kind: str, check: Check, settings: Settings) -> str:
    """The rating of `check`, one of Report.checks: GOOD, LOOK or WRONG. settings: of the bake; their method is CAST if
    rays were cast."""
    if not check["count"] or (kind in _TANGENT_ONLY and not _has_directions(settings)):
        return GOOD
    return WRONG if kind in _HARMS and _HARMS[kind](check, settings) else LOOK


def _has_directions(settings: Settings) -> bool:
    """Whether a map has directions in tangent space."""
    if settings.map.space != Space.TANGENT:
        return False
    types = [BY_NAME[name] for name in settings.map.drawn_maps]
    return settings.map.normal or any(each.kind is Kind.NORMAL or each.is_vector for each in types)


def warning(kind: str, check: Check, low: str, settings: Settings, length: Length = plain_length) -> Sentence:
    """The warning about the map of the object `low`. check: one that `rate` finds WRONG. length: a length in scene units as
    text."""
    values = {"of": 1, "share": check["count"] / max(1, check.get("of", 1))} | check
    values |= {
        "where": TILES if settings.sampling.udim else TILE,
        "margin": check.get("needed", 0) / 2,
        "level": settings.sampling.mips,
    }
    values |= {name: length(check[name]) for name in ("limit", "maximum") if name in check}
    sentence = _SENTENCES[kind]
    if kind == "uncovered" and settings.tracing.method == Method.CAST:
        is_set = settings.tracing.extrusion is not None or settings.tracing.max_distance is not None
        sentence = _OUT_OF_REACH if is_set else _MISSED
    elif kind == "uncovered" and settings.tracing.method == Method.AUTO:
        sentence = _NOT_CAST
    elif kind == "unsure" and settings.tracing.hit != Hit.OWN:
        sentence = _OTHER_LAYER
    elif kind == "unsure" and check["backs"] > 0.5 * check["count"]:
        sentence = _BACKS
    elif kind == "unsure" and check["covered"] > 0.5 * check["count"]:
        sentence = _COVERED
    elif kind == "unsure" and check["beyond"] > 0.5 * check["count"]:
        sentence = _BEYOND
    if kind == "outside" and check.get("fits_udim"):
        sentence = Fix.UDIM.after(sentence)
    share = check["cut_off"] if kind == "outside" else min(1.0, values["share"]) if "of" in check else 0.0
    return sentence.but(sentence.format(low=repr(low), **values), kind=kind, share=share)


def _overlap(check: Check, settings: Settings) -> bool:
    # Stacked parts share their detail on purpose. In object and world space, the map still has the normals of only one part.
    shared = check["count"] - (check["stacked"] if settings.map.space == Space.TANGENT else 0)
    return shared > MUCH_OVERLAP * check["of"] or check.get("other_material", 0.0) > MUCH_OVERLAP


def _uncovered(check: Check, settings: Settings) -> bool:
    return check["share"] > (MANY_MISSES if settings.tracing.method == Method.CAST else MANY_UNCOVERED)


def _far(check: Check, settings: Settings) -> bool:
    # Deep panels are far and correct: only a limit that was set says what is too far.
    return settings.tracing.limit is not None and check["share"] > MANY_BEYOND


def _beyond(share: float) -> Callable[[Check, Settings], bool]:
    return lambda check, _settings: check["count"] > share * check["of"]


_TANGENT_ONLY = {"polygons", "hard_edges", "backwards", "behind"}
"""Kinds that only harm tangent-space maps."""
_HARMS: dict[str, Callable[[Check, Settings], bool]] = {
    "overlap": _overlap,
    "uncovered": _uncovered,
    "far": _far,
    "unsure": _beyond(MANY_UNSURE),
    "gaps": _beyond(MANY_CLOSE),
    "backwards": _beyond(MANY_BACKWARDS),
    "outside": lambda check, _settings: check["cut_off"] > MUCH_CUT_OFF,
    "no_area": _beyond(0.0),
    # A texel of such a triangle is wrong if its normal has no z above 0.
    "behind": lambda check, _settings: check["backwards"] > MANY_BACKWARDS,
    "hard_edges": lambda _check, _settings: True,
}
"""When a kind is harmful. Mirrored UVs and faces that are not triangles never are, unless another program reads the map."""

_MISSED = Sentence(
    "{share:.2%} of the rays from {low} hit nothing: the high mesh has no surface there, and those texels have alpha 0.",
    WRONG,
)
_OUT_OF_REACH = Fix.MEASURE.after(
    Sentence(
        "{share:.2%} of the rays from {low} hit nothing within the extrusion and the maximum distance that were set: those "
        "texels have alpha 0.",
        WRONG,
    )
)
_NOT_CAST = Sentence(
    "{share:.2%} of the texels of {low} have no high triangle and stay empty. Auto casts rays there if high and low are two "
    "objects in the same place.",
    WRONG,
)
_OTHER_LAYER = Fix.OWN_HIT.after(
    Sentence(
        "{share:.2%} of the texels of {low} show a layer of the high mesh that belongs to another part of {low}, or to none.",
        WRONG,
    )
)
_BACKS = Sentence(
    "{share:.2%} of the texels of {low} may be wrong: most of their rays hit only backs of high faces. Recalculate the normals "
    "of the high mesh.",
    WRONG,
)
# Bricks before a plane, a lid on a pot: no measure tells that the surface which was chosen is the wrong one.
_COVERED = Sentence(
    "{share:.2%} of the texels of {low} can show two surfaces of the high mesh: the map has the outer one. With the hit "
    "nearest it has the inner one.",
    NOTE,
)
_BEYOND = Sentence(
    "{share:.2%} of the texels of {low} can show two surfaces of the high mesh: the map has the inner one. Increase the "
    "extrusion to have the outer one.",
    NOTE,
)
HARD_EDGES = Sentence(
    "{low} has {count:,} hard edges without a UV seam. Each shows as a line in tangent space: mark seams and unwrap there, or "
    "shade them smooth.",
    WRONG,
)
OVERLAP = Sentence(
    "{share:.2%} of the texels of {low} belong to two or more of its triangles (overlapping UVs): they show the detail of only "
    "one of them. Unwrap gives each face a place of its own.",  # as UNWRAPS has it
    WRONG,
)
OUTSIDE = Sentence("{low}: {count:,} of its triangles reach outside the {where} and are cut off there.", WRONG)
_SENTENCES = {
    "overlap": OVERLAP,
    "uncovered": Fix.CAST.after(
        Sentence("{share:.2%} of the texels of {low} have no high triangle and stay empty.", WRONG)
    ),
    "far": Sentence(
        "On {share:.2%} of the texels of {low}, the high surface is farther away than {limit}, at most {maximum}.", LOOK
    ),
    "unsure": Sentence(
        "{share:.2%} of the texels of {low} may show the wrong layer of the high mesh: their rays hit several. Move {low} "
        "closer to the right layer there, or paint an offset group.",
        LOOK,
    ),
    "gaps": Sentence(
        "{share:.2%} of the texels of {low} are within {needed} texels of another UV island, or {margin} of the border: mip "
        "level {level} mixes them. Pack the islands with a larger margin.",
        LOOK,
    ),
    "backwards": Sentence(
        "{share:.2%} of the texels of {low} have a normal whose z is 0 or less: engines that rebuild z from x and y show a "
        "wrong normal. Split the UVs and normals where the low mesh faces away from the high one, or add faces there.",
        LOOK,
    ),
    "outside": OUTSIDE,
    "no_area": Sentence("{low}: {count:,} of its triangles have no area in UV space and cannot be drawn.", LOOK),
    "hard_edges": HARD_EDGES,
    "behind": Sentence(
        "{low}: {count:,} of its triangles have shading normals that point behind them, and no tangent-space map is right "
        "there: fix the normals, or add edges.",
        WRONG,
    ),
}


FLIPPED, TURNED, FLAT, ELSEWHERE, CAGE = "flipped", "turned", "flat", "elsewhere", "cage"
UNFIT, LAYOUTS, CROSSED, NOT_FINITE, REBUILT, HIDDEN_MISSES = (
    "unfit",
    "layouts",
    "crossed",
    "not_finite",
    "rebuilt",
    "hidden_misses",
)
OTHER_DETAIL, MATERIALS = "other_detail", "materials"
"""The kinds of warnings that have no check in Report.checks."""

_LOST_Z = frozenset(("backwards", REBUILT))
_OF_RAYS = (
    frozenset(("uncovered", "far", "unsure", "behind", TURNED, FLAT, HIDDEN_MISSES, OTHER_DETAIL, MATERIALS)) | _LOST_Z
)
_HIDES: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        FLIPPED: _OF_RAYS | {ELSEWHERE, CAGE},
        CAGE: _OF_RAYS | {ELSEWHERE},
        LAYOUTS: _OF_RAYS | {ELSEWHERE},
        UNFIT: _OF_RAYS | {ELSEWHERE, FLIPPED},
        ELSEWHERE: _OF_RAYS,
        TURNED: _LOST_Z | {"unsure", "behind"},
        NOT_FINITE: frozenset(("uncovered", HIDDEN_MISSES)),
        CROSSED: frozenset((OTHER_DETAIL,)),
        MATERIALS: frozenset(("overlap", CROSSED)),
        "overlap": frozenset((OTHER_DETAIL,)),
        "uncovered": frozenset((HIDDEN_MISSES,)),
        "behind": _LOST_Z | {"unsure"},
        "backwards": frozenset((REBUILT,)),
        "outside": frozenset(("gaps",)),
    }
)
"""The kinds that follow from each kind."""


def remaining(warnings: Iterable[Sentence]) -> list[Sentence]:
    """What does not follow from another warning, each of them once, the worst first."""
    warnings = list(warnings)
    hidden = frozenset().union(*(_HIDES.get(each.kind, frozenset()) for each in warnings))
    return by_harm(each for each in warnings if each.kind not in hidden)
