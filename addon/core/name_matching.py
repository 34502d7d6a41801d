# SPDX-License-Identifier: GPL-3.0-or-later
"""Matches low, high and cage objects by their names: x_low, x_high, x_high_2, x_cage, x_LP_01, x_HP_01."""

import functools
import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from .errors import BakeError

_COPY_NUMBER = re.compile(r"\.\d{3,}$")
_WORDS = {"low": "low|lo|lp|low[_ -]?poly", "high": "high|hi|hp|high[_ -]?poly", "cage": "cage"}
"""What people call them; each stands for all of its row where the suffix is the one that we suggest."""


@dataclass(frozen=True)
class Suffixes:
    """What the names end in, in any case. Those that are here by default stand for the usual words for it as well."""

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
    ones without a low, two that claim the same place. Other names are nobody's business. A suffix may be followed by a
    number, by which several pairs are told apart, and a high one by an underscore and more; Blender's .001 is not part of a
    name.
    """
    suffixes.check()
    pairs: dict[tuple[str, int | None], Pair] = {}
    problems = []
    found = [(name, *_role(name, suffixes)) for name in sorted(names)]
    # A high object's number may be its own: it is that of a pair where a low object has it too.
    numbered = {(base.casefold(), number) for _, role, base, number in found if role == "low"}
    for name, role, base, number in found:
        if not role:
            continue
        key = base.casefold(), number
        if role == "high" and key not in numbered:
            key = base.casefold(), None
        pair = pairs.setdefault(key, Pair(base if key[1] is None else f"{base} {number}"))
        if role == "high":
            pair.highs.append(name)
        elif getattr(pair, role):
            problems.append(f"{name!r} and {getattr(pair, role)!r} are both the {role} object of {pair.name!r}.")
        else:
            setattr(pair, role, name)
    whole = []
    for (_, number), pair in sorted(pairs.items(), key=lambda item: (item[0][0], item[0][1] or -1)):
        if pair.low and pair.highs:
            whole.append(pair)
        elif pair.low:
            problems.append(
                f"{pair.low!r} has no high object: none is called {_wanted(pair, number, suffixes.high)!r}."
            )
        else:
            lonely = ", ".join(map(repr, pair.highs or [pair.cage]))
            problems.append(f"{lonely} has no low object: none is called {_wanted(pair, number, suffixes.low)!r}.")
    return whole, problems


def _wanted(pair: Pair, number: int | None, suffix: str) -> str:
    if number is None:
        return pair.name + suffix
    return f"{pair.name.removesuffix(f' {number}')}{suffix}_{number}"


@functools.lru_cache(maxsize=2**16)
def _role(name: str, suffixes: Suffixes) -> tuple[str, str, int | None]:
    """What `name` is, as a field of Pair ("" for nothing of ours; highs as "high"), what is left without its suffix, and the
    number behind that, or None. Kept, since a panel asks for all objects at each redraw."""
    plain = _COPY_NUMBER.sub("", name)
    for role, pattern in _patterns(suffixes):
        found = pattern.fullmatch(plain)
        if found:
            return role, found[1], int(found[2]) if found[2] else None
    return "", "", None


@functools.lru_cache(maxsize=16)
def _patterns(suffixes: Suffixes) -> list[tuple[str, re.Pattern]]:
    """What names of each role look like: those that somebody has chosen come first."""
    result = []
    for role in ("low", "cage", "high"):
        suffix, default = getattr(suffixes, role), getattr(Suffixes, role)
        is_chosen = suffix.casefold() != default
        ending = re.escape(suffix) if is_chosen else f"[_ .-](?:{_WORDS[role]})"
        more = "(?:_.*)?" if role == "high" else ""
        pattern = re.compile(rf"(.+){ending}(?:[_ .-]?(\d{{1,9}}))?{more}", re.IGNORECASE)
        result.append((not is_chosen, role, pattern))
    return [(role, pattern) for _, role, pattern in sorted(result, key=lambda entry: entry[0])]
