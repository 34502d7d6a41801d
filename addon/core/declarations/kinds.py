# SPDX-License-Identifier: GPL-3.0-or-later
"""The kinds of settings. The panels, the command line, job files and the manual are made from such declarations."""

from dataclasses import dataclass
from typing import Any, ClassVar

from ..errors import BakeError


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
    tooltip: str
    default: Any
    empty: str = ""
    """The value of a setting that is empty or not given, in words."""
    switch: str = ""
    """The name of the switch in the panel that sets the value to None."""
    option: Option | None = Option()
    """None if the command line does not have the setting."""
    former: str = ""
    """The earlier name of the setting, which still works in scripts, job files and .blend files, with a warning."""
    metavar: ClassVar[str] = ""

    def check(self, value: Any) -> None:
        """Raise BakeError for a value that is not valid."""

    @property
    def panel_tooltip(self) -> str:
        """The tooltip, with the value that an empty field means."""
        return f"{self.tooltip}. Leave empty to use {self.empty}" if self.empty and not self.switch else self.tooltip


@dataclass(frozen=True, kw_only=True)
class Switch(Setting):
    """On or off."""

    default: bool = False
    empties: bool | None = None
    """The state in which the settings that name this switch are None. None if no setting names it."""


@dataclass(frozen=True)
class Item:
    """One of the values of a choice. former: earlier values, which the command line and job files still take."""

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
            raise BakeError(f"{self.label}: {value!r} is not one of {', '.join(map(str, self.values))}.")


@dataclass(frozen=True, kw_only=True)
class Flags(Choice):
    """Any number of several values."""

    default: tuple = ()
    also: tuple[str, ...] = ()
    """More values that the command line takes, and that change nothing."""
    metavar: ClassVar[str] = "NAME,NAME..."

    def check(self, value: tuple) -> None:
        for part in value:
            super().check(part)


@dataclass(frozen=True, kw_only=True)
class WholeNumber(Setting):
    """A whole number between limits."""

    least: int
    most: int
    usual_most: int | None = None
    """The end of the panel's slider."""
    none_word: str = ""
    """The word for None on the command line."""
    metavar: ClassVar[str] = "N"

    def check(self, value: int | None) -> None:
        if value is None and self.none_word:
            return
        if value is None or not self.least <= value <= self.most:
            more = f", or {self.none_word}" if self.none_word else ""
            raise BakeError(f"{self.label}: {value} is outside {self.least} to {self.most}{more}.")


@dataclass(frozen=True, kw_only=True)
class Distance(Setting):
    """A distance in scene units. None to measure it, or to use the default in `empty`."""

    LARGEST: ClassVar[float] = 1e18
    """The square of this is still a valid float."""
    default: None = None
    shown: float
    """The initial value in the panel."""
    shown_least: float = 0.0
    """The lowest value in the panel."""
    usual_most: float
    """The end of the panel's slider."""
    may_be_zero: bool = False
    metavar: ClassVar[str] = "D"

    def check(self, value: float | None) -> None:
        if value is None or 0.0 < value <= self.LARGEST or (self.may_be_zero and value == 0.0):
            return
        least = "0 or more" if self.may_be_zero else "more than 0"
        raise BakeError(f"{self.label}: {value} is not a distance. It must be {least}, up to {self.LARGEST:g}.")


@dataclass(frozen=True, kw_only=True)
class Reach(Distance):
    """A distance in the unit that the setting distance_unit names."""


@dataclass(frozen=True, kw_only=True)
class Color(Setting):
    """Red, green and blue from 0 to 1, as they are stored."""

    metavar: ClassVar[str] = "R,G,B"

    def check(self, value: tuple[float, float, float]) -> None:
        if len(value) != 3 or not all(0.0 <= part <= 1.0 for part in value):
            numbers = ", ".join(map(str, value))
            raise BakeError(f"{self.label}: {numbers} is not a color. It must be three numbers from 0 to 1.")


@dataclass(frozen=True, kw_only=True)
class Text(Setting):
    """A name."""

    default: str = ""
    metavar: ClassVar[str] = "NAME"


@dataclass(frozen=True, kw_only=True)
class FilePath(Text):
    """A path to a file."""

    metavar: ClassVar[str] = "FILE"


@dataclass(frozen=True, kw_only=True)
class Tiles(Setting):
    """UDIM tiles by their numbers."""

    default: tuple[int, ...] = ()
    metavar: ClassVar[str] = "1001,1002..."


@dataclass(frozen=True, kw_only=True)
class ObjectSlot(Setting):
    """An object of the scene."""

    default: None = None
    metavar: ClassVar[str] = "NAME"


@dataclass(frozen=True, kw_only=True)
class ObjectSlots(ObjectSlot):
    """Several objects of the scene."""
