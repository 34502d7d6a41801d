# SPDX-License-Identifier: GPL-3.0-or-later
"""Matches low, high and cage objects by their names: x_low, x_high, x_high_2, x_cage."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from .errors import BakeError

_COPY_NUMBER = re.compile(r"\.\d{3,}$")


@dataclass(frozen=True)
class Suffixes:
    """What the names end in, in any case."""

    low: str = "_low"
    high: str = "_high"
    cage: str = "_cage"

    def check(self) -> None:
        """Raise BakeError if names could not be told apart by these."""
        given = [suffix.casefold() for suffix in (self.low, self.high, self.cage)]
        if not all(given) or len(set(given)) < 3:
            raise BakeError(
                "The suffixes for low, high and cage objects must be three different ones, none of them empty."
            )


@dataclass
class Pair:
    """The names of the objects that belong together; `name` is what they share."""

    name: str
    low: str = ""
    highs: list[str] = field(default_factory=list)
    cage: str = ""


def match(names: Iterable[str], suffixes: Suffixes) -> tuple[list[Pair], list[str]]:
    """Sort `names` into pairs.

    Returns the pairs that can be baked, by name, and sentences about what is left over: a low without a high one, high
    ones without a low, two that claim the same place. Other names are nobody's business. A high suffix may be followed by
    an underscore and more, and Blender's .001 is not part of a name.
    """
    suffixes.check()
    pairs: dict[str, Pair] = {}
    problems = []
    for name in sorted(names):
        role, base = _role(name, suffixes)
        if not role:
            continue
        pair = pairs.setdefault(base.casefold(), Pair(base))
        if role == "high":
            pair.highs.append(name)
        elif getattr(pair, role):
            problems.append(f"{name!r} and {getattr(pair, role)!r} are both the {role} object of {pair.name!r}.")
        else:
            setattr(pair, role, name)
    whole = []
    for _, pair in sorted(pairs.items()):
        if pair.low and pair.highs:
            whole.append(pair)
        elif pair.low:
            problems.append(f"{pair.low!r} has no high object: none is called {pair.name + suffixes.high!r}.")
        else:
            lonely = ", ".join(map(repr, pair.highs or [pair.cage]))
            problems.append(f"{lonely} has no low object: none is called {pair.name + suffixes.low!r}.")
    return whole, problems


def _role(name: str, suffixes: Suffixes) -> tuple[str, str]:
    """What `name` is, as a field of Pair ("" for nothing of ours; highs as "high"), and what is left without its suffix."""
    plain = _COPY_NUMBER.sub("", name)
    for role, suffix, more in (
        ("low", suffixes.low, ""),
        ("cage", suffixes.cage, ""),
        ("high", suffixes.high, "(_.*)?"),
    ):
        found = re.fullmatch(f"(.+){re.escape(suffix)}{more}", plain, re.IGNORECASE)
        if found:
            return role, found[1]
    return "", ""
