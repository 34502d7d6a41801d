# SPDX-License-Identifier: GPL-3.0-or-later
"""Options of sets that scenes have: --set NAME is the bake that a job file of the set would name."""

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from ..core import naming
from ..core.errors import BakeError
from ..core.naming import did_you_mean, printable
from ..core.scene_sets import SceneSet
from ..core.settings import PART_OF
from . import arguments, job_file, run_report
from .blender_process import load_blender
from .commands import WrongUsage

VERSION = 1
"""Of the keys of the JSON."""
read: Callable[[], list[SceneSet]] | None = None
"""Returns the sets of the open file. It needs the properties of the window, which this package may not import: whoever starts
it fills this in."""


def expanded(
    all_options: Sequence[argparse.Namespace], own: Mapping[str, Any], *, is_of_run: bool
) -> list[argparse.Namespace]:
    """The options of all bakes, with those of each set in place of --set.

    own: options of the command line that override. is_of_run: whether the report is of all bakes. Raises WrongUsage, BakeError.
    """
    result = []
    for options in all_options:
        result += _of_sets(options, vars(options).pop("own", own)) if options.set else [options]
    for options in result if is_of_run else ():
        options.report = None
    return result


def of_file(file: str, scene: str = "") -> list[SceneSet]:
    """The sets of a .blend, or of the open one. scene: the name of theirs; empty for all. Raises BakeError."""
    if read is None:
        raise BakeError("Sets of scenes cannot be read here: start Imprint by its own script, or in Blender.")
    load_blender()
    from . import scene_files  # needs Blender

    with scene_files.opened_blend(file) if file else nullcontext():
        return [one for one in read() if scene in {"", one.scene}]


def print_sets(options: argparse.Namespace, *, as_json: bool) -> int:
    """Print the sets of the .blend files that the options name, a line each. Returns the exit code. Raises BakeError."""
    found = [(file, one) for file in options.file for one in of_file(file, options.scene)]
    if as_json:
        plain = [
            {
                "file": os.path.abspath(file),
                "name": one.name,
                "scene": one.scene,
                "on": one.is_on,
                "problem": one.problem,
            }
            | {"parts": [part.table for part in one.parts], "output": one.output}
            for file, one in found
        ]
        print(json.dumps({"imprint_sets": VERSION, "sets": plain}, indent=1))
    for file, one in () if as_json else found:
        parts = f"{len(one.parts)} part{'s' * (len(one.parts) != 1)}"
        cells = (
            one.name,
            one.problem or parts,
            one.output or "in the .blend",
            *([file] if len(options.file) > 1 else []),
        )
        print("\t".join(map(printable, cells)))
    if not found:
        print(f"imprint: {options.file[0]!r} has no sets.", file=sys.stderr)
    return run_report.DONE


def _of_sets(options: argparse.Namespace, own: Mapping[str, Any]) -> Iterator[argparse.Namespace]:
    over = {name: value for name, value in own.items() if name not in {"set", "file", "scene"}}
    folders = [name for name in options.file if os.path.isdir(name)]
    found = False
    for file in _files(options.file):
        try:
            sets = _named(of_file(file, options.scene), options.set, file)
        except _NoSuchSet:
            if not folders:
                raise
            continue
        for one in sets:
            found = True
            yield _of_set(one, file, options, over)
    if not found:
        raise BakeError(f"No .blend in {folders[0]!r} has a set {options.set[0]!r}.")


def _files(names: Sequence[str]) -> Iterator[str]:
    """The paths of all .blend files; an empty one for that which is open."""
    if not names:
        yield ""
    for name in names:
        path = Path(name)
        yield from map(str, sorted(path.glob("*.blend"))) if path.is_dir() else [name]


def _of_set(one: SceneSet, file: str, options: argparse.Namespace, over: Mapping[str, Any]) -> argparse.Namespace:
    """The options of a set. Raises WrongUsage, BakeError."""
    if one.problem:
        raise BakeError(f"{one.name!r}: {one.problem}")
    made = job_file.of_keys(one.keys(file), over)
    made.file = [file] if file else []
    for name in ("report", "strict", "save_blend", "allow_missing_files", "floater"):
        setattr(made, name, getattr(options, name))
    title = f"the set {one.name!r}"
    if not made.output:
        raise WrongUsage(f"{title} has no file for its maps: give --output, or store them in a file in the panel")
    if len(made.low) > 1 and one.share_image == naming.has_low(made.output):
        raise WrongUsage(
            f"{title} has one image for all that share it: leave {{low}} and {{name}} out of --output"
            if one.share_image
            else f"{title} has an image for each part: put {{low}} into --output"
        )
    if problems := list(arguments.mistakes(made)):
        raise WrongUsage(f"{title}: {'; '.join(problems)}")
    made.notes = one.left_out
    if not over.keys() & {*PART_OF, "size"}:
        made.of_window = dict(one.states), one.settings, one.share_image
    return made


class _NoSuchSet(BakeError):
    """A file has no set of a name."""


def _named(sets: Iterable[SceneSet], names: Iterable[str], file: str) -> list[SceneSet]:
    """The sets of these names, each once; for "*", all that are on. Raises BakeError."""
    sets = list(sets)
    found: dict[str, SceneSet] = {}
    for name in names:
        same = [one for one in sets if one.name == name or (name == "*" and one.is_on)]
        if not same:
            raise _NoSuchSet(_no_such(name, sets, file))
        if name != "*" and len(same) > 1:
            scenes = " and ".join(repr(one.scene) for one in same)
            raise BakeError(f"{file!r} has a set {name!r} in the scenes {scenes}: choose one with --scene.")
        found |= {f"{one.scene}\n{one.name}": one for one in same}
    return list(found.values())


def _no_such(name: str, sets: Iterable[SceneSet], file: str) -> str:
    known = list(dict.fromkeys(one.name for one in sets))
    if not known:
        return f"{file!r} has no sets: add one in the panel, or name objects with --low."
    if name == "*":
        return f"No set of {file!r} is on: name one with --set."
    hint = did_you_mean([name], known)
    return (
        f"{file!r} has no set {name!r}{hint}"
        if hint
        else f"{file!r} has no set {name!r}: it has {', '.join(map(repr, known))}."
    )
