# SPDX-License-Identifier: GPL-3.0-or-later
"""The bakes of a call, with their names."""

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

from ...core.errors import BakeError
from ...core.names.printable import printable
from ..usage import arguments
from . import folder_pairs


@dataclass(frozen=True)
class Plan:
    """A bake to do: its name, its options, why it cannot be done, if that is known, and its place among all bakes, from 1."""

    name: str
    options: argparse.Namespace
    problem: str = ""
    number: int = 1
    chain: int = 0
    """The number of the first bake whose changes of the scene it needs, since it or a later one saves them; 0 for none."""
    rivals: tuple[argparse.Namespace, ...] = ()
    """The options of other bakes of its file, if it would replace an image that the file names: none of them may read it."""


def open_file() -> str:
    """The path of the .blend that is open in this process; "" for none, or where Blender is not loaded."""
    bpy = sys.modules.get("bpy")
    return bpy.data.filepath if bpy else ""


def plans(sets: Sequence[argparse.Namespace], open_file: str = "") -> tuple[list[Plan], list[str]]:
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
            found, left = folder_pairs.pairs(options.pairs, options.suffixes)
        except BakeError as error:
            result.append(Plan(name, options, str(error), len(result) + 1))
            continue
        problems += left
        for pair, problem in found:
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
        return printable(options.low or stem(options.low_file))
    place = options.pairs if arguments.is_folder(options) else (*options.file, open_file)[0]
    return printable(os.path.basename(os.path.abspath(place)))  # a folder may be called "."


def stem(path: str) -> str:
    """The name of a file without its ending."""
    name = os.path.basename(path)
    return os.path.splitext(name)[0] if name.strip(".") == name else Path(path).stem


def frames(options: argparse.Namespace) -> range:
    """The frames of a sequence; none for a single map."""
    return range(options.frames[0], options.frames[1] + 1) if options.frames else range(0)
