# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages that the user reads: errors, what fixes their cause, and lengths and lists in words."""

from collections.abc import Callable, Iterable
from enum import Enum
from typing import Any

from .declarations.choices import Hit, Method
from .sentences import Sentence

UNWRAP_FIRST = "unwrap it first"
"""What to do with a mesh without UVs."""


class BakeError(Exception):
    """The bake is not possible. The message is one sentence that says what to fix."""


class WrongPlace(BakeError):
    """An output path cannot be used: it would overwrite a file that is needed, or it leads to something other than a file."""


class Incomplete(BakeError):
    """Objects lack files, or what their modifiers need."""


class NothingDrawn(BakeError):
    """No texel of a map shows a high mesh."""

    def __init__(self, message: str, *, is_covered: bool = True):
        """is_covered: whether UV islands cover texels at all."""
        super().__init__(message)
        self.is_covered = is_covered


NO_BLENDER = "Imprint bakes with Blender's Python package, which is missing: pip install 'imprint-bake[bpy]'"


class NoGpu(BakeError):
    """Blender, or its gpu module, does not start on this machine."""


class NoGpuMemory(BakeError):
    """The GPU refused memory."""

    def __init__(self, needed: int):
        """needed: the bytes on the GPU that the bake holds, with those that were refused."""
        super().__init__(
            f"This bake needs about {max(needed / 2**30, 0.1):.1f} GiB of the GPU's memory, which it does not get: bake fewer "
            "maps at once or a smaller map, close other programs, or simplify the high mesh."
        )


def sentence(error: BakeError | MemoryError) -> str:
    """The message for the user."""
    if isinstance(error, BakeError):
        return str(error)
    return f"There is not enough memory{f' ({error})' if str(error) else ''}: choose a smaller map, or bake less at a time."


def reason(error: OSError | RuntimeError) -> str:
    """The message of an error of the system or of Blender: one line without a full stop."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    # Blender raises several reports at once; the first is the cause.
    return str(error).strip().partition("\n")[0].removeprefix("Error: ").rstrip(".")


class Fix(Enum):
    """What fixes the cause of a warning or an error: an option in a shell, a button in a window.

    Reports and errors have the clause for the shell at their end. A window removes it and draws the button.
    """

    AUTO = "--method auto casts rays where they do", "method", Method.AUTO.value
    CAST = "--method cast casts rays instead", "method", Method.CAST.value
    OWN_HIT = "--hit own chooses the layer that belongs to each texel", "hit", Hit.OWN.value
    MEASURE = "without --extrusion and --max-distance they are measured", "measure", True
    DEPTH = "--depth 32 keeps them", "depth", "32"
    SAMPLES = "--samples 16 shows it", "samples", "16"
    NO_MATERIAL = "--no-material leaves them as they are", "material", False
    TEXTURE_SETS = "--texture-sets bakes an image for each", "texture_sets", True
    MISS_MASK = "--mask shows them", "mask", True
    REST_POSE = "--rest-pose bakes them without that", "rest_pose", True
    BC7 = "--compression bc7 stores all three channels", "compression", "BC7"
    UDIM = "--udim bakes a map for each tile", "udim", True

    def __init__(self, in_shell: str, setting: str, value: Any):
        """Describe a fix.

        Args:
            in_shell: A clause.
            setting: The name of the setting that the button changes.
            value: What it becomes.
        """
        self.in_shell, self.setting, self.new_value = in_shell, setting, value

    def after(self, cause: str) -> Sentence:
        """The sentence `cause`, which goes on with what fixes it in a shell."""
        return Sentence.of(cause).but(f"{cause.removesuffix('.')}; {self.in_shell}.")


UNWRAPS = "Unwrap gives each face a place of its own"
"""A clause of sentences that a window draws with the button Unwrap, too."""


PACKS = "Pack UV Maps lays their islands side by side"
"""A clause of sentences that a window draws with the button Pack UV Maps, too."""


def in_window(text: str) -> tuple[str, str]:
    """A sentence as a window shows it, and the name of its Fix; empty if it has none."""
    for fix in Fix:
        if fix.in_shell in text:
            return text.replace(f"; {fix.in_shell}", ""), fix.name
    return text, ""


def shorten_list(items: Iterable[object], most: int = 3) -> str:
    """The first `most` items, separated by commas, and the number of the others: "a, b, c and 5 more". See also `named`."""
    words = list(map(str, items))
    more = len(words) - most
    return ", ".join(words) if more < 1 else f"{', '.join(words[:most])} and {more} more"


def named(names: Iterable[str]) -> str:
    """Objects in a plan, which keeps its height: a few names, or else the first and the number of the others."""
    names = [*map(repr, names)]
    return shorten_list(names, 3 if len(names) <= 3 else 1)


Length = Callable[[float], str]
"""A function that gives a length in scene units as text."""
LENGTH_DIGITS = 4
"""Significant digits of a length without a unit, and the most after the point of one with a unit."""


def plain_length(value: float) -> str:
    """A length without a unit."""
    return f"{value:.{LENGTH_DIGITS}g}"
