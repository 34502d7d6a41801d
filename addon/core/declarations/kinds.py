# SPDX-License-Identifier: GPL-3.0-or-later
"""The kinds of settings. The panels, the command line, job files and the manual are made from such declarations."""

import numbers
import os
import reprlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NoReturn

from .. import udim
from ..errors import BakeError


def spelled(value: Any) -> str:
    """A word without what its spellings differ in: "Base Color", "base-color" and "BASE_COLOR" are the same."""
    return str(value).strip().lower().replace("_", "").replace("-", "").replace(" ", "")


def word_for(value: Any) -> str:
    """What the command line calls one of the values of a choice."""
    return str(value).lower().replace("_", "-")


def plain(value: Any) -> Any:
    """Numbers and arrays of numpy, and of libraries like it, as those of Python. Other values stay."""
    return value.tolist() if hasattr(value, "tolist") else value


def listed(value: Any) -> list | None:
    """The items of a list, an array, a generator and the like; None for a single value, a text and a dictionary."""
    value = plain(value)  # an array of numpy without dimensions has no items
    is_list = isinstance(value, Iterable) and not isinstance(value, str | bytes | Mapping)
    return [plain(item) for item in value] if is_list else None


def shown(value: Any) -> str:
    """A value of any type for a message."""
    try:
        return reprlib.repr(value)
    except ValueError:  # Python does not write numbers of thousands of digits
        return f"a {type(value).__name__} of that size"


def _is_number(value: Any, kind: type = numbers.Real) -> bool:
    return isinstance(value, kind) and not isinstance(value, bool)


@dataclass(frozen=True)
class Option:
    """How a setting is spelled on the command line and in job files, where the rule does not apply.

    The rule: the setting's name with dashes instead of underscores, and the metavar of its kind.
    """

    word: str = ""
    """Without the dashes."""
    metavar: str = ""
    note: str = ""
    """A sentence to add to the tooltip."""
    default: str | None = None
    """The value without the option, in words, if it differs from the declaration's `empty` and `default`."""
    explains: bool = True
    """Whether --help and the manual explain each item of a choice."""
    off: str = ""
    """For a switch that is on by default: the help of the option, which switches it off."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """The base of all kinds. Texts end without a full stop, as Blender's tooltips do."""

    label: str
    """In the panel."""
    tooltip: str
    """Also the help of the option."""
    default: Any
    """Also of scripts and shells."""
    empty: str = ""
    """The value of a setting that is empty or not given, in words."""
    switch: str = ""
    """The name of the switch in the panel that sets the value to None."""
    option: Option | None = Option()
    """None if the command line does not have the setting."""
    metavar: ClassVar[str] = ""

    def check(self, value: Any) -> None:
        """Raise BakeError for a value that is not valid."""

    def coerced(self, value: Any) -> Any:
        """What a program gives, as Settings has it: numbers of any library, choices in any spelling, lists.

        Raises BakeError for a value of a wrong type, and for one that is not valid.
        """
        typed = self._typed(plain(value))
        self.check(typed)
        return typed

    def _typed(self, value: Any) -> Any:
        """A value of the type that Settings has. Raises BakeError for other types."""
        return value

    def _refuse(self, value: Any, wanted: str) -> NoReturn:
        raise BakeError(f"{self.label}: {shown(value)} is not {wanted}.")

    @property
    def panel_tooltip(self) -> str:
        """The tooltip, with the value that an empty field means."""
        return f"{self.tooltip}. Leave empty to use {self.empty}" if self.empty and not self.switch else self.tooltip


@dataclass(frozen=True, kw_only=True)
class Switch(Setting):
    """On or off."""

    default: bool = False
    """On, where it is true."""
    empties: bool | None = None
    """The state in which the settings that name this switch are None. None if no setting names it."""

    def _typed(self, value: Any) -> bool:
        if not isinstance(value, int) or value not in (False, True):
            self._refuse(value, "True or False")
        return bool(value)


@dataclass(frozen=True)
class Item:
    """One of the values of a choice.

    Attributes:
        former: Earlier values, which the command line and job files still take.
        value: What settings hold.
        label: In the panel.
        tooltip: In the panel, and in the help of the option.
    """

    value: Any
    label: str
    tooltip: str
    former: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Choice(Setting):
    """One of several values: texts or numbers."""

    items: tuple[Item, ...]

    @property
    def values(self) -> tuple:
        """The values of the items."""
        return tuple(item.value for item in self.items)

    def check(self, value: Any) -> None:
        if value not in self.values:
            self._refuse(value, f"one of {', '.join(map(str, self.values))}")

    def _typed(self, value: Any) -> Any:
        word = int(value) if isinstance(value, float) and value.is_integer() else value
        known = {spelled(each): each for each in self.values}
        named = known.get(spelled(word if isinstance(word, str) else shown(word)))
        if named is None:
            self._refuse(value, f"one of {', '.join(map(str, self.values))}")
        return named


@dataclass(frozen=True, kw_only=True)
class Flags(Choice):
    """Any number of several values."""

    default: tuple = ()
    """Those that are chosen."""
    also: tuple[str, ...] = ()
    """More values that the command line takes, and that change nothing."""
    metavar: ClassVar[str] = "NAME,NAME..."

    def check(self, value: tuple) -> None:
        for part in value:
            super().check(part)

    def _typed(self, value: Any) -> tuple:
        parts = value.split(",") if isinstance(value, str) else listed(value)
        if parts is None:
            self._refuse(value, f"a list of some of {', '.join(map(str, self.values))}")
        return tuple(super(Flags, self)._typed(part) for part in parts)


@dataclass(frozen=True, kw_only=True)
class WholeNumber(Setting):
    """A whole number between limits."""

    least: int
    """The smallest value."""
    most: int
    """The largest value."""
    usual_most: int | None = None
    """The end of the panel's slider."""
    none_word: str = ""
    """The word for None on the command line."""
    metavar: ClassVar[str] = "N"

    def check(self, value: int | None) -> None:
        if value is None and self.none_word:
            return
        if value is None or not self.least <= value <= self.most:
            raise BakeError(f"{self.label}: {shown(value)} is outside {self._allowed}.")

    def _typed(self, value: Any) -> int | None:
        if self.none_word and (value is None or value == self.none_word):
            return None
        if not _is_number(value, numbers.Integral):
            self._refuse(value, f"a whole number from {self._allowed}")
        return int(value)

    @property
    def _allowed(self) -> str:
        return f"{self.least} to {self.most}" + (f", or {self.none_word}" if self.none_word else "")


@dataclass(frozen=True, kw_only=True)
class Amount(Setting):
    """A number between limits."""

    least: float
    """The smallest value."""
    most: float
    """The largest value."""
    metavar: ClassVar[str] = "X"

    def check(self, value: float) -> None:
        if not self.least <= value <= self.most:
            raise BakeError(f"{self.label}: {shown(value)} is outside {self.least:g} to {self.most:g}.")

    def _typed(self, value: Any) -> float:
        # What is compared here has any size: float() of a large whole number is an error.
        if not (_is_number(value) and abs(value) <= Distance.LARGEST):
            self._refuse(value, f"a number from {self.least:g} to {self.most:g}")
        return float(value)


@dataclass(frozen=True, kw_only=True)
class Distance(Setting):
    """A distance in scene units. None to measure it, or to use the default in `empty`. A default of 0 is none at all."""

    LARGEST: ClassVar[float] = 1e18
    """The square of this is still a valid float."""
    default: float | None = None
    shown: float
    """The initial value in the panel."""
    shown_least: float = 0.0
    """The lowest value in the panel."""
    usual_most: float
    """The end of the panel's slider."""
    may_be_zero: bool = False
    """Whether 0 is a distance."""
    metavar: ClassVar[str] = "D"

    def check(self, value: float | None) -> None:
        if value is None or 0.0 < value <= self.LARGEST or (self.may_be_zero and value == 0.0):
            return
        self._refuse_distance(value)

    def _typed(self, value: Any) -> float | None:
        # What is compared here has any size: float() of a large whole number is an error.
        if value is not None and not (_is_number(value) and abs(value) <= self.LARGEST):
            self._refuse_distance(value)
        return None if value is None else float(value)

    def _refuse_distance(self, value: Any) -> NoReturn:
        least = "0 or more" if self.may_be_zero else "more than 0"
        self._refuse(value, f"a distance. It must be {least}, up to {self.LARGEST:g}")


@dataclass(frozen=True, kw_only=True)
class Reach(Distance):
    """A distance in the unit that the setting distance_unit names."""


@dataclass(frozen=True, kw_only=True)
class Color(Setting):
    """Red, green and blue from 0 to 1, as they are stored."""

    metavar: ClassVar[str] = "R,G,B"

    def check(self, value: tuple[float, float, float]) -> None:
        if len(value) != 3 or not all(0.0 <= part <= 1.0 for part in value):
            raise BakeError(
                f"{self.label}: {', '.join(map(shown, value))} is not a color. It must be three numbers from 0 to 1."
            )

    def _typed(self, value: Any) -> tuple[float, ...]:
        parts = listed(value)
        if parts is None or not all(_is_number(part) and 0.0 <= part <= 1.0 for part in parts):
            self._refuse(value, "a color. It must be three numbers from 0 to 1")
        return tuple(map(float, parts))


@dataclass(frozen=True, kw_only=True)
class Text(Setting):
    """A name.

    Attributes:
        default: Empty for none.
    """

    default: str = ""
    metavar: ClassVar[str] = "NAME"

    def _typed(self, value: Any) -> str:
        # Blender's own look-ups raise errors of other kinds for text that is no UTF-8 or has a null character.
        if not isinstance(value, str) or "\0" in value or value != value.encode(errors="ignore").decode():
            self._refuse(value, "a name")
        return str(value)


@dataclass(frozen=True, kw_only=True)
class FilePath(Text):
    """A path to a file."""

    metavar: ClassVar[str] = "FILE"

    def _typed(self, value: Any) -> str:
        path = os.fspath(value) if isinstance(value, str | os.PathLike) else None
        if not isinstance(path, str) or "\0" in path:
            self._refuse(value, "the path of a file")
        return path


@dataclass(frozen=True, kw_only=True)
class Tiles(Setting):
    """UDIM tiles by their numbers.

    Attributes:
        default: Empty for all that the low mesh covers.
    """

    default: tuple[int, ...] = ()
    metavar: ClassVar[str] = "1001,1002..."

    def _typed(self, value: Any) -> tuple[int, ...]:
        words = value.replace(",", " ").split() if isinstance(value, str) else ()
        parts = [int(word) if len(word) == 4 and word.isdecimal() else None for word in words] or listed(value)
        if parts is None or not all(_is_number(part, numbers.Integral) and part in udim.TILES for part in parts):
            self._refuse(value, f"a list of UDIM tiles: their numbers are {udim.TILES[0]} to {udim.TILES[-1]}")
        return tuple(int(part) for part in parts if part is not None)


@dataclass(frozen=True, kw_only=True)
class ObjectSlot(Setting):
    """An object of the scene.

    Attributes:
        default: No object.
    """

    default: None = None
    metavar: ClassVar[str] = "NAME"


@dataclass(frozen=True, kw_only=True)
class ObjectSlots(ObjectSlot):
    """Several objects of the scene."""
