# SPDX-License-Identifier: GPL-3.0-or-later
"""The bakes that --only chose, as the report has them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Only:
    """The patterns of --only, and the numbers of the bakes whose names match, in all parts of the job."""

    patterns: tuple[str, ...]
    numbers: frozenset[int]

    @classmethod
    def of(cls, patterns: Sequence[str], numbers: Iterable[int]) -> "Only | None":
        """None without patterns, where all bakes are meant."""
        return cls(tuple(patterns), frozenset(numbers)) if patterns else None

    @classmethod
    def from_dict(cls, values: dict[str, Any] | None, planned: int) -> "Only | None":
        """From a report of so many planned bakes. Raises KeyError, TypeError or ValueError."""
        return values and cls.of(list(map(str, values["patterns"])), _numbers(str(values["bakes"]), planned))

    def to_dict(self) -> dict[str, Any]:
        """Plain data for json.dump."""
        return {"patterns": list(self.patterns), "bakes": ranges(sorted(self.numbers))}

    @staticmethod
    def union(parts: Sequence["Only | None"]) -> "Only | None":
        """What several calls chose together; None if one of them meant all."""
        if None in parts:
            return None
        patterns = dict.fromkeys(pattern for part in parts for pattern in part.patterns)
        return Only.of(tuple(patterns), (number for part in parts for number in part.numbers))


def ranges(numbers: Iterable[int]) -> str:
    """Increasing numbers in words: "1, 3-7"."""
    found: list[list[int]] = []
    for number in numbers:
        if found and found[-1][1] == number - 1:
            found[-1][1] = number
        else:
            found.append([number, number])
    return ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in found)


def _numbers(text: str, most: int) -> Iterable[int]:
    """The numbers up to `most` that `ranges` has put into words. Raises ValueError."""
    for part in text.split(", "):
        first, _, last = part.partition("-")
        if int(last or first) > most:
            raise ValueError(text)
        yield from range(int(first), int(last or first) + 1)
