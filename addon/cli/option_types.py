# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the words of the command line as values. What cannot be read raises argparse.ArgumentTypeError, without a full stop."""

import argparse
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TypeVar

from ..core import udim
from ..core.declarations import kinds
from ..core.declarations.kinds import word_for
from ..core.errors import BakeError
from ..core.naming import Suffixes, did_you_mean
from ..core.scene_sets import Part
from .limits import Limit, parse

LAST_FRAME = 1_048_574
"""The last frame that Blender knows."""
MANY_FRAMES = 100_000
"""More frames than this are a typing error. The paths of all are compared before the first is baked."""
PAGES = ".html", ".htm"
"""The endings of pages for a browser."""
MOST_WORKERS = 256
"""Processes at once, each of which takes the memory of a Blender. More are a typing error."""
LEAST_SECONDS, MOST_SECONDS = 0.1, 365 * 24 * 3600
"""Less than the smallest bake takes, and a year."""
LEAST_MEMORY = 1 << 26
"""Bytes. Blender does not run in less: a smaller number lacks its unit."""


Value = TypeVar("Value")


def _read(read: Callable[[str], Value], value: str, problem: str = "") -> Value:
    """What `read` makes of a word. problem: what the word is if it raises ValueError; else its BakeError says it."""
    try:
        return read(value)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{value!r} {problem}") from error
    except BakeError as error:
        raise argparse.ArgumentTypeError(str(error).rstrip(".")) from error


def text(value: str) -> str:
    """A name, or a path."""
    try:
        value.encode()
    except UnicodeEncodeError as error:
        raise argparse.ArgumentTypeError(f"{value!r} is not UTF-8, as all names in Blender are") from error
    if "\0" in value:
        raise argparse.ArgumentTypeError(f"{value!r} contains a NUL character")
    return value


_OF_WINDOWS = re.compile(r"[A-Za-z]:[\\/]|\\\\")
"""The start of a path with a drive or a server."""
_VARIABLE = re.compile(r"\$(?:(\w+)|\{(\w+)\})")
"""A variable of the environment in a path."""


def path_in_file(value: str, *, is_untrusted: bool) -> str:
    """A path in a job file, as a shell would read it: with the user's home folder for ~, and the values of variables. Those are
    nothing that files of other people may read."""
    _check_system(value)
    names = [name or braced for name, braced in _VARIABLE.findall(value)]
    is_of_home = value == "~" or value.startswith(("~/", "~" + os.sep))
    if is_untrusted and (names or is_of_home):
        raise argparse.ArgumentTypeError(f"{value!r} has ~ or a variable, which files of other people cannot have")
    if unset := [name for name in names if name not in os.environ]:
        raise argparse.ArgumentTypeError(f"{value!r} needs the variable {unset[0]}, which is not set")
    if names:
        value = _VARIABLE.sub(lambda match: os.environ[match[1] or match[2]], value)
    return os.path.expanduser(value) if is_of_home else value


def _check_system(value: str) -> None:
    if os.name != "nt" and _OF_WINDOWS.match(value):
        raise argparse.ArgumentTypeError(f"{value!r} is a path of Windows, and this system has other ones")


def path(value: str) -> str:
    """A path. In a job file it starts at the job file's folder."""
    if not value:
        raise argparse.ArgumentTypeError("a path is empty")
    _check_system(value)
    # Two slashes are one to the system, and the folder of the open file to Blender. On Windows they start a server's name.
    has_more = os.name != "nt" and value.startswith("//")
    return text("/" + value.lstrip("/") if has_more else value)


def page(value: str) -> str:
    """The path of a page of HTML."""
    if not value.lower().endswith(PAGES):
        raise argparse.ArgumentTypeError(f"{value!r} does not end in {PAGES[0]}")
    return path(value)


def _is_number(word: str) -> bool:
    """Whether a word is a whole number without a sign. Python refuses to read thousands of digits."""
    return word.isdecimal() and len(word) < 100


def size(value: str) -> tuple[int, int]:
    sides = value.lower().split("x")
    if len(sides) > 2 or not all(_is_number(side.removesuffix("k")) for side in sides):
        raise argparse.ArgumentTypeError(
            f"{value!r} is neither a number of texels nor two of them, as 2048, 2k or 4096x1024"
        )
    texels = [int(side.removesuffix("k")) * (1024 if side.endswith("k") else 1) for side in sides]
    return texels[0], texels[-1]


def frames(value: str) -> tuple[int, int]:
    first, _, last = value.partition("-")
    if not (_is_number(first) and _is_number(last)) or int(first) > int(last):
        raise argparse.ArgumentTypeError(f"{value!r} is not a range of frames, such as 1-48")
    if int(last) > LAST_FRAME or int(last) - int(first) >= MANY_FRAMES:
        raise argparse.ArgumentTypeError(
            f"{value!r} is too long: frames go up to {LAST_FRAME}, and a sequence has {MANY_FRAMES} at most"
        )
    return int(first), int(last)


def shard(value: str) -> tuple[int, int]:
    part, _, count = value.partition("/")
    if not (_is_number(part) and _is_number(count)) or not 1 <= int(part) <= int(count):
        raise argparse.ArgumentTypeError(f"{value!r} is not a part K/N with K from 1 to N, such as 2/8")
    return int(part), int(count)


def suffixes(value: str) -> Suffixes:
    parts = value.split(",")
    if len(parts) != 3:
        raise argparse.ArgumentTypeError(f"{value!r} is not three endings as _low,_high,_cage")
    return Suffixes(*parts)


def _three_numbers(value: str) -> tuple[float, float, float]:
    first, second, third = map(float, value.split(","))
    return first, second, third


def color(value: str) -> tuple[float, float, float]:
    return _read(_three_numbers, value, "is not three numbers as 1,0,1")


def axis(value: str) -> str:
    if value.upper() not in {"Y", "Z"}:
        raise argparse.ArgumentTypeError(f"{value!r} is not one of y, z")
    return value.upper()


def point(value: str) -> tuple[float, float, float]:
    numbers = _read(_three_numbers, value, "is not three numbers as 512300,5412300,0")
    if not math.isfinite(sum(numbers)):
        raise argparse.ArgumentTypeError(f"{value!r} has an infinite coordinate")
    return numbers


def tiles(value: str) -> tuple[int, ...]:
    return _read(udim.parse, value)


def number_or(word: str) -> Callable[[str], int | None]:
    """Reads a whole number, or `word` as None."""
    problem = f"is neither a whole number nor {word}"
    return lambda value: None if value.lower() == word else _read(int, value, problem)


def number(value: str) -> float:
    return _read(float, value, "is not a number")


def degrees(value: str) -> int:
    """A whole number of degrees from 0 to 180."""
    angle = whole_number(value)
    if not 0 <= angle <= 180:
        raise argparse.ArgumentTypeError(f"{angle} is outside 0 to 180")
    return angle


def whole_number(value: str) -> int:
    return _read(int, value, "is not a whole number")


def count(value: str) -> int:
    if not (value.isascii() and value.isdecimal() and int(value) > 0):
        raise argparse.ArgumentTypeError(f"{value!r} is not a whole number above 0")
    return int(value)


def workers(value: str) -> int:
    count = whole_number(value)
    if not 0 <= count <= MOST_WORKERS:
        raise argparse.ArgumentTypeError(f"{value!r} is not a number of processes from 0 to {MOST_WORKERS}")
    return count


def one_of(choice: kinds.Choice) -> Callable[[str], str]:
    """Reads a word as one of the values of a choice."""
    find = _among(choice.values, {former: item.value for item in choice.items for former in item.former})
    return lambda value: find([value])[0]


def some_of(choice: kinds.Flags) -> Callable[[str], tuple[str, ...]]:
    """Reads words between commas as some of the values of a choice, in its order."""
    find = _among((*choice.values, *choice.also))

    def names(value: str) -> tuple[str, ...]:
        wanted = find([part.strip() for part in value.split(",")])
        return tuple(value for value in choice.values if value in wanted)

    return names


def _among(
    values: Sequence[str], former: Mapping[str, str] = MappingProxyType({})
) -> Callable[[Sequence[str]], list[str]]:
    """Reads words as those of `values` that they stand for. The dashes between their parts may be left out. former: earlier
    values, and what they are now."""
    words = {word_for(value): value for value in values}
    known = {word_for(value): now for value, now in former.items()} | words
    joined = {_without_dashes(word): value for word, value in known.items()}

    def find(given: Sequence[str]) -> list[str]:
        chosen = [joined.get(_without_dashes(word_for(word))) for word in given]
        unknown = [word for word, value in zip(given, chosen, strict=True) if value is None]
        if unknown:
            are = "is not one of" if len(unknown) == 1 else "are not among"
            hint = did_you_mean(map(word_for, unknown), words)
            raise argparse.ArgumentTypeError(f"{', '.join(map(repr, unknown))} {are} {', '.join(words)}{hint}")
        return chosen

    return find


def _without_dashes(word: str) -> str:
    """The first character may be the sign of an axis."""
    return word[:1] + word[1:].replace("-", "")


def json_alone(value: str) -> str:
    if value != "json":
        raise argparse.ArgumentTypeError(f"{value!r} is not json")
    return value


def part(value: str) -> Part:
    """A low object of several with its high ones."""
    return _read(Part.of_text, text(value))


def limits(value: str) -> tuple[Limit, ...]:
    return _read(parse, value)


def seconds(value: str) -> float:
    limit = number(value)
    if not LEAST_SECONDS <= limit <= MOST_SECONDS:
        span = f"from {LEAST_SECONDS:g} to {MOST_SECONDS:,}"
        raise argparse.ArgumentTypeError(f"{value!r} is not a number of seconds {span}")
    return limit


def size_of_memory(value: str) -> int:
    match = re.fullmatch(r"(\d{1,12}(?:\.\d{1,6})?)([kmgt]?)(?:i?b)?", value.lower())
    size = int(float(match[1]) * 1024 ** " kmgt".index(match[2] or " ")) if match else 0
    if not size:
        raise argparse.ArgumentTypeError(f"{value!r} is not a size as 4G or 800M")
    if size < LEAST_MEMORY:
        raise argparse.ArgumentTypeError(f"{value!r} is less than Blender itself takes: give a size as 4G or 800M")
    return size
