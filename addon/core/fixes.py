# SPDX-License-Identifier: GPL-3.0-or-later
"""What fixes the cause of a warning or an error: an option in a shell, a button in a window.

Reports and errors have the clause for the shell at their end. A window removes it and draws the button.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from .declarations.choices import Hit, Method


@dataclass(frozen=True)
class Fix:
    """in_shell: a clause. setting: the name of the setting that the button changes. value: what it becomes."""

    in_shell: str
    setting: str
    value: Any


AUTO, CAST, OWN_HIT, MEASURE, DEPTH, SAMPLES, NO_MATERIAL, MISS_MASK, TEXTURE_SETS = (
    *("AUTO", "CAST", "OWN_HIT", "MEASURE", "DEPTH", "SAMPLES", "NO_MATERIAL", "MISS_MASK", "TEXTURE_SETS"),
)
FIXES: Mapping[str, Fix] = MappingProxyType(
    {
        AUTO: Fix("--method auto casts rays where they do", "method", Method.AUTO.value),
        CAST: Fix("--method cast casts rays instead", "method", Method.CAST.value),
        OWN_HIT: Fix("--hit own chooses the layer that belongs to each texel", "hit", Hit.OWN.value),
        MEASURE: Fix("without --extrusion and --max-distance they are measured", "measure", True),
        DEPTH: Fix("--depth 32 keeps them", "depth", "32"),
        SAMPLES: Fix("--samples 16 shows it", "samples", "16"),
        NO_MATERIAL: Fix("--no-material leaves them as they are", "material", False),
        TEXTURE_SETS: Fix("--texture-sets bakes an image for each", "texture_sets", True),
        MISS_MASK: Fix("--mask shows them", "mask", True),
    }
)


def in_shell(cause: str, kind: str) -> str:
    """The sentence `cause`, which goes on with what fixes it in a shell. kind: of FIXES."""
    return f"{cause.removesuffix('.')}; {FIXES[kind].in_shell}."


def in_window(text: str) -> tuple[str, str]:
    """A sentence as a window shows it, and the kind of its fix in FIXES; empty if it has none."""
    for kind, fix in FIXES.items():
        if fix.in_shell in text:
            return text.replace(f"; {fix.in_shell}", ""), kind
    return text, ""
