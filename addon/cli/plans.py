# SPDX-License-Identifier: GPL-3.0-or-later
"""The bakes of a call: their names, the files that they read, what they cost, and the part that a machine does."""

import argparse
import fnmatch
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import cache
from itertools import groupby
from pathlib import Path

from ..core import udim
from ..core.errors import BakeError, reason, shorten_list
from ..core.file_formats import OPENED
from ..core.naming import Pair, Suffixes, match, printable
from . import arguments
from .commands import WrongUsage


def folder_pairs(folder: str, suffixes: Suffixes) -> tuple[list[tuple[Pair, str]], list[str]]:
    """The pairs among the mesh files of a folder, as paths, each with what is wrong with it or "".

    Also sentences about unpaired files. Raises BakeError if there is no pair.
    """
    try:
        files = sorted(path for path in Path(folder).iterdir() if path.suffix.lower() in OPENED)
    except OSError as error:
        raise BakeError(f"The folder {folder!r} cannot be read: {reason(error)}.") from error
    files, strange = _split(files)
    places: dict[str, list[Path]] = {}
    for path in files:
        places.setdefault(path.stem, []).append(path)
    pairs, problems = match(places, suffixes)
    problems += [f"{str(path)!r} is left out: its name is not UTF-8, as all names in Blender are." for path in strange]
    if not pairs:
        raise BakeError(" ".join(problems) or f"No mesh file in {folder!r} has a name that ends in {suffixes.low!r}.")
    result = []
    for pair in pairs:
        names = [pair.low, *pair.highs, *([pair.cage] if pair.cage else [])]
        twice = next((places[name] for name in names if len(places[name]) > 1), None)
        problem = f"{twice[0].name!r} and {twice[1].name!r} share a name: remove one of them." if twice else ""
        low, highs, cage = str(places[pair.low][0]), [str(places[high][0]) for high in pair.highs], pair.cage
        result.append((Pair(pair.name, low, highs, str(places[cage][0]) if cage else ""), problem))
    return result, problems


def _split(files: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """The files that Blender can open, and those whose names are not UTF-8."""
    strange = [path for path in files if str(path) != str(path).encode(errors="replace").decode()]
    return [path for path in files if path not in strange], strange


OPENED_FILE = "the file to open"


def input_paths(options: argparse.Namespace, open_file: str = "") -> Iterator[tuple[str, str]]:
    """The paths of the files, in their order, and what they are. open_file: of the open .blend, for a bake without files."""
    opened = options.file or ([open_file] if not (options.low_file or arguments.is_folder(options)) else [])
    parts = [*((path, OPENED_FILE) for path in opened), (options.low_file, "the low mesh's file")]
    parts += [*((path, "the high mesh's file") for path in options.high_file), (options.cage_file, "the cage's file")]
    parts.append((options.convert, "the map to convert"))
    return ((path, what) for path, what in parts if path)


def scene_paths(options: argparse.Namespace, open_file: str = "") -> list[str]:
    """As `inputs`, the paths of mesh files and .blend files, each once."""
    return list(dict.fromkeys(path for path, _ in input_paths(options, open_file) if path != options.convert))


@dataclass(frozen=True)
class Plan:
    """A planned bake: its name, its options, its error if it is known to fail, and its place among all bakes, from 1."""

    name: str
    options: argparse.Namespace
    problem: str = ""
    """Why it is known to fail, as a sentence."""
    number: int = 1
    """Its place among all bakes of the call, from 1."""
    chain: int = 0
    """The number of the first bake whose changes of the scene it needs, since it or a later one saves them; 0 for none."""
    rivals: tuple[argparse.Namespace, ...] = ()
    """The options of other bakes of its file, if it would replace an image that the file names: none of them may read it."""


def open_file() -> str:
    """The path of the .blend that is open in this process; "" for none, or where Blender is not loaded."""
    bpy = sys.modules.get("bpy")
    return bpy.data.filepath if bpy else ""


def plans_of(sets: Sequence[argparse.Namespace], open_file: str = "") -> tuple[list[Plan], list[str]]:
    """The bakes of several sets, and sentences about unpaired files. A folder of pairs makes a bake for each pair.

    open_file: the path of the open .blend, which sets without a file bake.
    """
    result, problems = [], []
    for number, options in enumerate(sets, 1):
        label = "{}" if len(sets) == 1 else f"set {number} ({{}})"
        name = label.format(subject(options, open_file))
        if not arguments.is_folder(options):
            result.append(Plan(name, options, number=len(result) + 1))
            continue
        try:
            pairs, left = folder_pairs(options.pairs, options.suffixes)
        except BakeError as error:
            result.append(Plan(name, options, str(error), len(result) + 1))
            continue
        problems += left
        for pair, problem in pairs:
            own = copy(options)
            own.report, own.name = None, ""  # the report and the name are of all pairs
            own.pairs, own.low_file, own.high_file, own.cage_file = None, pair.low, pair.highs, pair.cage
            result.append(Plan(label.format(subject(own, open_file)), own, problem, len(result) + 1))
    return list(_chained(result)), problems


def _chained(planned: Sequence[Plan]) -> Iterator[Plan]:
    """The plans with their chains: sets in a row that open the same files, up to the last one that saves the scene."""
    for files, same in groupby(planned, lambda plan: (plan.options.file, plan.options.origin)):
        members = list(same)
        last = max((place for place, plan in enumerate(members) if plan.options.save_blend), default=0)
        for place, plan in enumerate(members):
            yield replace(plan, chain=members[0].number) if files[0] and 0 < last >= place else plan


def subject(options: argparse.Namespace, open_file: str = "") -> str:
    """A short name for what is baked: its own, the low object, its file, or the scene. open_file: as in `plans`."""
    if options.name:
        return printable(options.name)
    if options.low or options.low_file:
        return printable(shorten_list(options.low) or stem(options.low_file))
    place = options.pairs if arguments.is_folder(options) else (*options.file, open_file)[0]
    return printable(os.path.basename(os.path.abspath(place)))  # a folder may be called "."


def stem(path: str) -> str:
    """The name of a file without its ending."""
    name = os.path.basename(path)
    return os.path.splitext(name)[0] if name.strip(".") == name else Path(path).stem


def frames(options: argparse.Namespace) -> range:
    """The frames of a sequence; none for a single map."""
    return range(options.frames[0], options.frames[1] + 1) if options.frames else range(0)


BYTE_COST = 2
"""What reading a byte of a mesh costs, in samples of a texel."""
LEAST_BYTES = 1 << 20
"""Smaller files do not decide which machine does a bake."""


def shares(planned: Sequence[Plan]) -> dict[int, int]:
    """What each bake counts where the bakes are divided among machines, by its number: about its cost.

    Of bytes only the power of two counts, from LEAST_BYTES on, and files that a bake of the call saves do not count at all. So
    each machine finds the same parts, also after a file was edited or a scene was saved.
    """
    saved = {os.path.realpath(plan.options.save_blend) for plan in planned if plan.options.save_blend}

    @cache
    def size(path: str) -> int:
        total = 0 if os.path.realpath(path) in saved else _bytes(path)
        return 1 << total.bit_length() - 1 if total >= LEAST_BYTES else 0

    return {plan.number: cost(plan.options, size) for plan in planned}


def cost(options: argparse.Namespace, size: Callable[[str], int] | None = None) -> int:
    """The cost of a bake: the samples of all texels of its maps, and BYTE_COST for each byte of its files.

    size: the bytes of a file; None for those that it has.
    """
    maps = options.normal + len(arguments.settings(options).map.drawn_maps)
    texels = options.size[0] * options.size[1] * max(1, len(options.tiles)) * max(1, len(frames(options)))
    of_files = sum((size or _bytes)(path) for path, _ in input_paths(options))
    return BYTE_COST * of_files + (texels if options.convert else texels * options.samples * maps)


def _bytes(path: str) -> int:
    """The bytes of a file, or of the files of all its tiles; 0 for one that is not there."""
    total = 0
    for each in udim.files(path).values() if udim.is_tiled(path) else (path,):
        with suppress(OSError, ValueError):
            total += os.path.getsize(each)
    return total


def named_plans(planned: Sequence[Plan], patterns: Sequence[str]) -> list[Plan]:
    """The plans whose names match a pattern; all without patterns. Capitals count. Raises WrongUsage if none matches one."""
    if not patterns:
        return list(planned)
    matches = [[fnmatch.fnmatchcase(plan.name, each) for plan in planned] for each in patterns]
    for pattern, matched in zip(patterns, matches, strict=True):
        if not any(matched):
            raise WrongUsage(f"--only: no bake has a name that matches {pattern!r}")
    return [plan for plan, *matched in zip(planned, *matches, strict=True) if any(matched)]


def shard_part(planned: Sequence[Plan], shard: tuple[int, int] | None, cost: Callable[[Plan], int]) -> list[Plan]:
    """Part K of N, in the order of the plans; all without `shard`.

    The parts take turns at the plans, of which the most expensive ones come first, and of equal ones the first one. Plans of a
    chain stay together.
    """
    if shard is None:
        return list(planned)
    number, count = shard
    units: dict[int, list[Plan]] = {}  # a chain needs one process
    for plan in planned:
        units.setdefault(plan.chain or plan.number, []).append(plan)
    by_cost = sorted((-sum(map(cost, unit)), first) for first, unit in units.items())
    mine = (plan for _, first in by_cost[number - 1 :: count] for plan in units[first])
    return sorted(mine, key=lambda plan: plan.number)
