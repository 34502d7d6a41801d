# SPDX-License-Identifier: GPL-3.0-or-later
"""What cures a warning or an error: an option in a shell, a button in a window.

Reports and errors have the clause for the shell at their end. A window takes it off and draws the button.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from .declarations.choices import Hit, Method


@dataclass(frozen=True)
class Cure:
    """in_shell: a clause. setting: the name of the setting that the button changes. value: what it becomes."""

    in_shell: str
    setting: str
    value: Any


AUTO, CAST, OWN_HIT, MEASURE, DEPTH, SAMPLES, NO_MATERIAL, MISS_MASK, TEXTURE_SETS = (
    *("AUTO", "CAST", "OWN_HIT", "MEASURE", "DEPTH", "SAMPLES", "NO_MATERIAL", "MISS_MASK", "TEXTURE_SETS"),
)
CURES: Mapping[str, Cure] = MappingProxyType(
    {
        AUTO: Cure("--method auto casts rays where they do", "method", Method.AUTO.value),
        CAST: Cure("--method cast casts rays instead", "method", Method.CAST.value),
        OWN_HIT: Cure("--hit own chooses the layer that belongs to each texel", "hit", Hit.OWN.value),
        MEASURE: Cure("without --extrusion and --max-distance they are measured", "measure", True),
        DEPTH: Cure("--depth 32 keeps them", "depth", "32"),
        SAMPLES: Cure("--samples 16 shows it", "samples", "16"),
        NO_MATERIAL: Cure("--no-material leaves them as they are", "material", False),
        TEXTURE_SETS: Cure("--texture-sets bakes an image for each", "texture_sets", True),
        MISS_MASK: Cure("--mask shows them", "mask", True),
    }
)


def in_shell(cause: str, kind: str) -> str:
    """The sentence `cause`, which goes on with what cures it in a shell. kind: of CURES."""
    return f"{cause.removesuffix('.')}; {CURES[kind].in_shell}."


def in_window(text: str) -> tuple[str, str]:
    """A sentence as a window shows it, and the kind of its cure in CURES; empty if it has none."""
    for kind, cure in CURES.items():
        if cure.in_shell in text:
            return text.replace(f"; {cure.in_shell}", ""), kind
    return text, ""
