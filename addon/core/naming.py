# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of objects: in paths of files, as they tell which objects belong together, and in messages."""

import difflib
import functools
import re
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from .errors import BakeError, shorten_list
from .udim import TOKEN

LOW, NAME, MATERIAL = "{low}", "{name}", "{material}"
"""The placeholders for the name of the low object, for that name without its suffix and, in texture sets, for that of its
material."""

ATLAS = "atlas"
"""Replaces the low object's name in the name of a map that several low objects share."""

USUAL = f"{LOW}_normal"
"""How maps are named where nothing else is set."""

LEVELS = "_LODs"
"""What is added to the name of an object in that of the collection of its levels of detail."""
FIRST_LEVEL = "_LOD0"
"""What is added to the name of a low object that is the finest of several levels of detail."""

COPY_OF = "imprint_copy_of"
"""The custom property of a copy of a material that a bake has made: the `name` of the copy, and whose copy it is."""

_REFUSED = re.compile(r'[<>:"/\\|?*%\x00-\x1f\x7f\ud800-\udfff]|[. ](?=[. ]*$)')
"""Characters that some file systems refuse in a name, or remove from its end, and %, which Blender refuses in paths of UDIM."""
_DEVICE = re.compile(r"^(con|prn|aux|nul|com\d|lpt\d)(?=\.|$)", re.IGNORECASE)
"""Names of devices on Windows, whatever their ending."""
_NAME = re.compile(rf"[^/\\]+?(?=[._ -]?{TOKEN}|(?:\.[^./\\]*)?$)")
"""The name in a path to a file, without what starts with the number of its tile, and without its ending."""


def file_name(name: str) -> str:
    """`name` with an underscore in place of each character that some file system refuses."""
    return _DEVICE.sub(r"\1_", _REFUSED.sub("_", name))


def fill(path: str, low_name: str, material: str = "", *, low_suffix: str = "") -> str:
    """`path` with the low object's name in its placeholders and, for a texture set, the material's in place of MATERIAL.
    low_suffix: as in without_suffix."""
    filled = path.replace(MATERIAL, file_name(material)) if material else path
    return fill_low(filled, file_name(low_name), low_suffix) if has_low(filled) else filled


def fill_low(text: str, low_name: str, low_suffix: str = "") -> str:
    """`text` with the low object's name in place of LOW, and without its suffix in place of NAME. Textures are not called after
    the first level, since others share them: "crate_low" is the name of "crate_low_LOD0". low_suffix: as in without_suffix."""
    return text.replace(LOW, of_levels(low_name, low_suffix)).replace(NAME, without_suffix(low_name, low_suffix))


def of_levels(low_name: str, low_suffix: str = "") -> str:
    """The name that the levels of detail of a low object share: "crate_low" for "crate_low_LOD0", and for itself."""
    is_low = role(low_name, Suffixes(low_suffix) if low_suffix else Suffixes()) == "low"
    return low_name.removesuffix(FIRST_LEVEL) if is_low else low_name


def of_new_levels(low_name: str, low_suffix: str = "") -> str:
    """What new levels of detail of a low object are called after: "crate_low" also for "crate_low_LOD0.001", as Blender calls
    the first level while an object that no scene shows has its name. low_suffix: as in without_suffix."""
    plain = _COPY_NUMBER.sub("", low_name)
    return of_levels(plain if plain.endswith(FIRST_LEVEL) else low_name, low_suffix)


def has_low(text: str) -> bool:
    """Whether low objects of other names have other texts."""
    return LOW in text or NAME in text


def without_suffix(low_name: str, low_suffix: str = "") -> str:
    """The name of a low object without its ending: "crate" for "crate_low", "crate_2" for "crate_low_2". low_suffix: the ending
    as in Suffixes; empty for the usual ones."""
    role, key = _role(low_name, Suffixes(low_suffix) if low_suffix else Suffixes())
    return key.name() if role == "low" and key is not None else low_name


def renamed(path: str, name: str) -> str:
    """`path` with another name. Its folder, the number of its tile and its ending stay; an empty path stays empty."""
    return _NAME.sub(lambda _: name, path, count=1)


def of_material(material: Any) -> str:
    """What the textures of a material, a datablock, are named after. Those of a copy that a bake has made, and that was not
    renamed, stay those of the material that the artist has named."""
    copy = material.get(COPY_OF)
    return copy["of"] if copy is not None and copy["name"] == material.name else material.name


def of_texture_sets(names: str) -> str:
    """`names` with the material's name after that of the low object."""
    return names.replace(LOW, f"{LOW}_{MATERIAL}").replace(NAME, f"{NAME}_{MATERIAL}")


def of_one_texture(names: str) -> str:
    """What `of_texture_sets` was made of."""
    return names.replace(f"{LOW}_{MATERIAL}", LOW).replace(f"{NAME}_{MATERIAL}", NAME)


def of_shared_textures(names: str) -> str:
    """`names` for a texture that all low objects with a material share: that of the material takes the place of theirs."""
    names = names.replace(f"{LOW}_{MATERIAL}", MATERIAL).replace(f"{NAME}_{MATERIAL}", MATERIAL)
    return names if MATERIAL in names else names.replace(LOW, MATERIAL).replace(NAME, MATERIAL)


_COPY_NUMBER = re.compile(r"\.(\d{3,})$")
_WORDS = {"low": "low|lo|lp|low[_ -]?poly", "high": "high|hi|hp|high[_ -]?poly", "cage": "cage"}
"""Usual endings of names. A default suffix matches all endings in its row."""


@dataclass(frozen=True)
class Suffixes:
    """The endings of the names, in any case. A default suffix also matches the usual variants of it in _WORDS.

    Attributes:
        high: That of high objects; an underscore and more may follow it.
    """

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


@dataclass(frozen=True)
class _Key:
    """What the names of a pair share: the part before the suffix in any case, the number after it, and that of Blender."""

    folded: str
    number: int | None
    copy: int | None
    base: str = field(compare=False)

    @property
    def own(self) -> tuple[str, int | None]:
        """What names have in common that differ in Blender's number alone."""
        return self.folded, self.number

    @property
    def order(self) -> tuple[str, int, int]:
        return self.folded, self.number or -1, self.copy or -1

    def name(self, suffix: str = "", before_number: str = "_") -> str:
        """The name of an object of the pair; without a suffix, that of the pair."""
        number = "" if self.number is None else f"{before_number}{self.number}"
        return f"{self.base}{suffix}{number}" + ("" if self.copy is None else f".{self.copy:03}")


def match(names: Iterable[str], suffixes: Suffixes) -> tuple[list[Pair], list[str]]:
    """Sort `names` into pairs.

    Returns the pairs that can be baked, sorted by name, and sentences about problems: a low object without high objects,
    high objects or a cage without a low object, two low objects or cages of one pair. Names without a suffix are ignored.

    A number may follow a suffix, to distinguish pairs of one name. An underscore and more may follow a high suffix. Blender's
    .001 at the end distinguishes low objects of one name, and their high objects; where there is one low object, it is ignored.
    A low object without high objects gets the one that is called as the pair, as "rock" for "rock_low": assets of "rock" are.
    """
    suffixes.check()
    pairs: dict[_Key, Pair] = {}
    problems = []
    roles = [(name, *_role(name, suffixes)) for name in sorted(names)]
    # High objects of one pair may also be numbered: a number belongs to the pair only if a low object has it too.
    lows = {key for _, role, key in roles if role == "low" and key is not None}
    shared = Counter(key.own for key in lows)
    for name, role, full in roles:
        if full is None:
            continue
        key = full
        if role == "high" and not shared[key.own]:
            key = replace(key, number=None)
        if shared[key.own] < 2 or key not in lows:
            key = replace(key, copy=None)
        pair = pairs.setdefault(key, Pair(key.name(before_number=" ")))
        if role == "high":
            pair.highs.append(name)
        elif getattr(pair, role):
            problems.append(f"{name!r} and {getattr(pair, role)!r} are both the {role} object of {pair.name!r}.")
        else:
            setattr(pair, role, name)
    bare = {name.casefold(): name for name, role, _ in roles if not role}
    complete = []
    for key, pair in sorted(pairs.items(), key=lambda item: item[0].order):
        if pair.low and not pair.highs and key.number is key.copy is None and key.folded in bare:
            pair.highs.append(bare[key.folded])
        if pair.low and pair.highs:
            complete.append(pair)
        elif pair.low:
            problems.append(f"{pair.low!r} has no high object: none is called {key.name(suffixes.high)!r}.")
        else:
            unpaired = ", ".join(map(repr, pair.highs or [pair.cage]))
            problems.append(f"{unpaired} has no low object: none is called {key.name(suffixes.low)!r}.")
    return complete, problems


def level_names(name: str, count: int) -> list[str]:
    """The names of the levels of detail of an object, unless other objects have them."""
    return [f"{name}_LOD{number}" for number in range(1, count + 1)]


def low_name_of(high_name: str, suffixes: Suffixes) -> str:
    """The name of the low object that a high one is baked to: "crate_low" for "crate_high", and for "crate"."""
    role, key = _role(high_name, suffixes)
    return key.name(suffixes.low) if role == "high" and key is not None else f"{high_name}{suffixes.low}"


def made_names(high_name: str, suffixes: Suffixes, levels: int) -> list[str]:
    """The names of what is made of a high object: of its low object without and with levels of detail, and of these."""
    low = low_name_of(high_name, suffixes)
    return [low, low + FIRST_LEVEL, *level_names(low, levels)]


def role(name: str, suffixes: Suffixes) -> str:
    """The role of an object by its name: "low", "high", "cage" or ""."""
    return _role(name, suffixes)[0]


@functools.lru_cache(maxsize=2**16)
def _role(name: str, suffixes: Suffixes) -> tuple[str, _Key | None]:
    """The role of an object by its name, "low", "high", "cage" or "", and what the names of its pair share.

    Cached, because a panel calls this for all objects at each redraw.
    """
    copied = _COPY_NUMBER.search(name)
    plain, copy = (name[: copied.start()], int(copied[1])) if copied else (name, None)
    for role, pattern in _patterns(suffixes):
        match = pattern.fullmatch(plain)
        if match:
            return role, _Key(match[1].casefold(), int(match[2]) if match[2] else None, copy, match[1])
    return "", None


@functools.lru_cache(maxsize=16)
def _patterns(suffixes: Suffixes) -> list[tuple[str, re.Pattern]]:
    """The role and pattern of each suffix. Suffixes that the user has changed come first."""
    result = []
    for role in ("low", "cage", "high"):
        suffix, default = getattr(suffixes, role), getattr(Suffixes, role)
        is_chosen = suffix.casefold() != default
        ending = re.escape(suffix) if is_chosen else f"[_ .-](?:{_WORDS[role]})"
        more = {"high": "(?:_.*)?", "low": f"(?:{FIRST_LEVEL})?"}.get(role, "")
        pattern = re.compile(rf"(.+){ending}(?:[_ .-]?(\d{{1,9}}))?{more}", re.IGNORECASE)
        result.append((not is_chosen, role, pattern))
    return [(role, pattern) for _, role, pattern in sorted(result, key=lambda entry: entry[0])]


_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
"""Also those that begin lines or turn the direction of text."""


def printable(text: str) -> str:
    """`text` with a question mark in place of each control character."""
    return _CONTROL.sub("?", text)


def no_such_object(name: str, there: Collection[str]) -> str:
    """Says that no object is called `name`, with similar names. there: the names of all objects."""
    close = difflib.get_close_matches(name, there, n=3, cutoff=0.4)
    listed = f"it has {shorten_list(map(repr, there))}." if there else "it has no objects."
    hint = f"did you mean {' or '.join(map(repr, close))}?" if close else listed
    return f"There is no object called {name!r} in the file: {hint}"


SIMILAR = 0.75
"""How similar a word must be to be suggested. With less, "preset" would suggest "pairs"."""


def did_you_mean(words: Iterable[str], known: Iterable[str]) -> str:
    """The end of a sentence about unknown words, with a suggestion for each that is similar to a known one."""
    known = list(known)
    close = [match for word in words for match in difflib.get_close_matches(word, known, n=1, cutoff=SIMILAR)]
    return f", did you mean {' and '.join(map(repr, dict.fromkeys(close)))}?" if close else ""
