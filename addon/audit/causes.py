# SPDX-License-Identifier: GPL-3.0-or-later
"""Decides which warnings a bake gives: one for each cause, and none for what follows from it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

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


@dataclass(frozen=True)
class Warned:
    """A warning, as a sentence. kind: of Report.checks, or one of this module; empty for one that stands for itself."""

    text: str
    kind: str = ""


def remaining(found: Iterable[Warned]) -> list[str]:
    """The sentences of what does not follow from another warning, each of them once."""
    found = list(found)
    hidden = frozenset().union(*(_HIDES.get(each.kind, frozenset()) for each in found))
    return list(dict.fromkeys(each.text for each in found if each.kind not in hidden))
