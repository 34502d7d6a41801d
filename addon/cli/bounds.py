# SPDX-License-Identifier: GPL-3.0-or-later
"""The folders that bakes of untrusted files keep to, checked by the names of files before any of them is opened."""

import argparse
import os
import re
import stat
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..core import naming, udim
from ..core.errors import WrongPlace
from ..output.files.atomic_file import make_folder
from . import arguments
from .run_options import RunOptions

OUTPUT = "out"
"""The folder beside a job file that its bakes write to, unless the caller names one."""
MOST_BYTES = 1 << 26
"""Of a job file."""
MOST_READ = 32 << 30
"""Bytes of a file, which may have holes that take no place on the disk."""
MOST_FILES = 1_000_000
"""Maps that a run may name: bakes times frames."""
_PLACEHOLDER = re.compile("|".join(map(re.escape, (naming.LOW, naming.MATERIAL, udim.TOKEN))) + "|#+")


@dataclass(frozen=True)
class Bounds:
    """The folder that is read, and the one that is written, as absolute paths without links."""

    inputs: str
    outputs: str
    spelled: tuple[str, ...] = ()
    """The same folders as the caller named them, as absolute paths that may lead over links."""

    def check_read(self, path: str, title: str) -> None:
        """Raise WrongPlace unless `path` is in the input folder, or in the output folder, after its links. title: the file, for
        messages."""
        _check_name(path, title)
        for each in _with_tiles(path):
            real = os.path.realpath(each)
            if not (is_below(real, self.inputs) or is_below(real, self.outputs)):
                raise WrongPlace(self._not_read(path, title))
            _check_file(each, title)

    def check_write(self, path: str, title: str) -> None:
        """Raise WrongPlace unless `path` is in the output folder, after its links, and is itself none. title: the file, for
        messages."""
        _check_name(path, title)
        for each in _with_tiles(path):
            if not is_below(os.path.realpath(each), self.outputs):
                raise WrongPlace(
                    f"{_subject(title)}, {path!r}, is not in {self.outputs!r}, the only folder that --untrusted writes to: "
                    "choose a path there, or name another one with --output-folder."
                )
            if os.path.islink(each):
                raise WrongPlace(
                    f"{_subject(title)}, {path!r}, is a link, which --untrusted does not follow: remove it."
                )

    def may_read(self, path: str) -> bool:
        """Whether `path` is a file in one of the folders, or nothing is there."""
        return _passes(self.check_read, path)

    def may_write(self, path: str) -> bool:
        """Whether `path` is in the output folder, and a file if it exists."""
        return _passes(self.check_write, path) and _passes(_check_file, path)

    def check_sets(self, sets: Sequence[argparse.Namespace]) -> None:
        """Raise WrongPlace for folders of pairs elsewhere, and for more maps than a run with untrusted files may name."""
        for options in filter(arguments.is_folder, sets):
            if not is_below(os.path.realpath(options.pairs), self.inputs):
                raise WrongPlace(self._not_read(options.pairs, "the folder of pairs"))
        count = sum(each.frames[1] - each.frames[0] + 1 if each.frames else 1 for each in sets)
        if count > MOST_FILES:
            raise WrongPlace(
                f"{count:,} maps are more than {MOST_FILES:,}, the most that --untrusted plans: divide the job."
            )

    def _not_read(self, path: str, title: str) -> str:
        return (
            f"{_subject(title)}, {path!r}, is not in {self.inputs!r}, the only folder that --untrusted reads: move it "
            "there, or name another one with --input-folder."
        )

    def make(self) -> None:
        """Make the output folder. Raises WrongPlace."""
        try:
            make_folder(Path(self.outputs))
        except OSError as error:
            raise WrongPlace(f"The folder {self.outputs!r} cannot be made: {error.strerror}.") from error


def of(options: RunOptions, first: argparse.Namespace) -> Bounds | None:
    """The bounds of a run whose files are not trusted; None for others. Raises WrongPlace.

    Args:
        first: The options of the first bake, by whose files the folders are chosen where there is no job file.
    """
    if not options.untrusted:
        return None
    if options.jobs:
        folder = os.path.dirname(os.path.abspath(options.jobs))
        inputs, outputs = folder, os.path.join(folder, OUTPUT)
    else:
        inputs = options.folder or os.path.dirname(os.path.abspath(next(iter(first.file), first.low_file)))
        outputs = os.path.dirname(_PLACEHOLDER.split(os.path.abspath(first.output))[0])
    named = options.input_folder or inputs
    inputs = os.path.realpath(named)
    if not os.path.isdir(inputs):
        raise WrongPlace(f"There is no folder {inputs!r}.")
    outputs = options.output_folder or outputs
    for path in (
        outputs,
        options.report,
        options.report and f"{options.report}.lines",
        options.log,
        options.sheet,
        options.pictures,
        options.records,
    ):
        if path:
            _check_links(path, inputs)
    spelled = os.path.abspath(named), os.path.abspath(outputs)
    outputs = os.path.realpath(outputs)
    _check_records(options.records, (inputs, outputs, options.log and os.path.realpath(options.log)))
    return Bounds(inputs, outputs, spelled)


def check_job_file(name: str) -> None:
    """Raise WrongPlace for a job file that is too large, or no file. One that is missing is left to its reader."""
    _check_file(name, "the job file")
    if os.path.exists(name) and os.path.getsize(name) > MOST_BYTES:
        raise WrongPlace(
            f"{name!r} has more than {MOST_BYTES >> 20} MiB, the most that --untrusted reads as a job file."
        )


def _check_records(path: str | None, folders: Sequence[str | None]) -> None:
    """Raise WrongPlace if the records would be where files of others are, or where these can write."""
    for folder in filter(None, folders):
        if path and is_below(os.path.realpath(path), folder):
            raise WrongPlace(
                f"--records: {path!r} is in {folder!r}, where untrusted files can be: name a folder elsewhere."
            )


def _check_links(path: str, inputs: str) -> None:
    """Raise WrongPlace if a path of the caller leads out of the input folder by a link there, which came with the files."""
    path = os.path.abspath(path)
    for each in (path, *map(str, Path(path).parents)):
        is_inside = is_below(os.path.realpath(os.path.dirname(each)), inputs)
        if is_inside and os.path.islink(each) and not is_below(os.path.realpath(each), inputs):
            raise WrongPlace(
                f"{each!r} is a link out of {inputs!r}, the folder of the untrusted files: choose another path."
            )


def _passes(check: Callable[[str, str], None], path: str) -> bool:
    try:
        check(path, "the file")
    except WrongPlace:
        return False
    return True


def is_below(path: str, folder: str) -> bool:
    """Whether a path is in a folder. Both are absolute and without links."""
    return Path(path).is_relative_to(folder)


def _check_name(path: str, title: str) -> None:
    """Raise WrongPlace for what the system does not take as a path: a process that lies can name anything."""
    try:
        is_path = "\0" not in os.fsdecode(os.fsencode(path))
    except UnicodeError:
        is_path = False
    if not is_path:
        raise WrongPlace(f"{_subject(title)}, {path!r}, is no path of this system.")


def _with_tiles(path: str) -> Iterator[str]:
    """The path, and those of the tiles that it stands for and that exist."""
    yield path
    if udim.is_tiled(path):
        yield from udim.files(path).values()


def _check_file(path: str, title: str) -> None:
    """Raise WrongPlace for pipes, devices and folders, whose opening may wait for ever, and for a file that takes very long to
    read. What is missing is left to its reader."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return
    if not stat.S_ISREG(found.st_mode):
        raise WrongPlace(f"{_subject(title)}, {path!r}, is no file.")
    if found.st_size > MOST_READ:
        raise WrongPlace(
            f"{_subject(title)}, {path!r}, has more than {MOST_READ >> 30} GiB, the most that --untrusted reads."
        )


def _subject(title: str) -> str:
    return title[:1].upper() + title[1:]
