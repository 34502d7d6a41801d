# SPDX-License-Identifier: GPL-3.0-or-later
"""Matches low, high and cage objects by their names: x_low, x_high, x_high_2, x_cage, x_LP_01, x_HP_01."""

import functools
import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from ..errors import BakeError

_COPY_NUMBER = re.compile(r"\.\d{3,}$")
_WORDS = {"low": "low|lo|lp|low[_ -]?poly", "high": "high|hi|hp|high[_ -]?poly", "cage": "cage"}
"""Usual endings of names. A default suffix matches all endings in its row."""


@dataclass(frozen=True)
class Suffixes:
    """The endings of the names, in any case. A default suffix also matches the usual variants of it in _WORDS."""

    low: str = "_low"
    high: str = "_high"
    cage: str = "_cage"

    def check(self) -> None:
        """Raise BakeError unless the suffixes are different and not empty."""
        given = [suffix.casefold() for suffix in (self.low, self.high, self.cage)]
        if not all(given) or len(set(given)) < 3:
            raise BakeError("The suffixes of low, high and cage objects must all be different, and none may be empty.")


@dataclass
class Pair:
    """The names of the objects of one bake. `name` is the part that they share."""

    name: str
    low: str = ""
    highs: list[str] = field(default_factory=list)
    cage: str = ""


def match(names: Iterable[str], suffixes: Suffixes) -> tuple[list[Pair], list[str]]:
    """Sort `names` into pairs.

    Returns the pairs that can be baked, sorted by name, and sentences about problems: a low object without high objects,
    high objects or a cage without a low object, two low objects or cages of one pair. Names without a suffix are ignored.

    A number may follow a suffix, to distinguish pairs of one name. An underscore and more may follow a high suffix. Blender's
    .001 at the end of a name is ignored.
    """
    suffixes.check()
    pairs: dict[tuple[str, int | None], Pair] = {}
    problems = []
    found = [(name, *_role(name, suffixes)) for name in sorted(names)]
    # High objects of one pair may also be numbered: the number belongs to the pair only if a low object has it too.
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
    complete = []
    for (_, number), pair in sorted(pairs.items(), key=lambda item: (item[0][0], item[0][1] or -1)):
        if pair.low and pair.highs:
            complete.append(pair)
        elif pair.low:
            problems.append(
                f"{pair.low!r} has no high object: none is called {_missing(pair, number, suffixes.high)!r}."
            )
        else:
            unpaired = ", ".join(map(repr, pair.highs or [pair.cage]))
            problems.append(f"{unpaired} has no low object: none is called {_missing(pair, number, suffixes.low)!r}.")
    return complete, problems


def _missing(pair: Pair, number: int | None, suffix: str) -> str:
    if number is None:
        return pair.name + suffix
    return f"{pair.name.removesuffix(f' {number}')}{suffix}_{number}"


@functools.lru_cache(maxsize=2**16)
def _role(name: str, suffixes: Suffixes) -> tuple[str, str, int | None]:
    """The role of an object by its name: "low", "high", "cage" or ""; the name without its suffix; and its number, or None.

    Cached, because a panel calls this for all objects at each redraw.
    """
    plain = _COPY_NUMBER.sub("", name)
    for role, pattern in _patterns(suffixes):
        found = pattern.fullmatch(plain)
        if found:
            return role, found[1], int(found[2]) if found[2] else None
    return "", "", None


@functools.lru_cache(maxsize=16)
def _patterns(suffixes: Suffixes) -> list[tuple[str, re.Pattern]]:
    """The role and pattern of each suffix. Suffixes that the user has changed come first."""
    result = []
    for role in ("low", "cage", "high"):
        suffix, default = getattr(suffixes, role), getattr(Suffixes, role)
        is_chosen = suffix.casefold() != default
        ending = re.escape(suffix) if is_chosen else f"[_ .-](?:{_WORDS[role]})"
        more = "(?:_.*)?" if role == "high" else ""
        pattern = re.compile(rf"(.+){ending}(?:[_ .-]?(\d{{1,9}}))?{more}", re.IGNORECASE)
        result.append((not is_chosen, role, pattern))
    return [(role, pattern) for _, role, pattern in sorted(result, key=lambda entry: entry[0])]
