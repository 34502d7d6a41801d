# SPDX-License-Identifier: GPL-3.0-or-later
"""The record of a bake, a file beside its map: what decided its result, what it wrote, and its entry of the report."""

import argparse
import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.errors import BakeError
from ...core.names import file_names
from ...output.files.atomic_file import replacing
from ..usage import arguments
from . import bake_key, contents, moved_paths
from .bake_key import Key
from .contents import Content, Contents

VERSION = 1
"""The version of the record's keys."""
ENDING, CLAIM = ".imprint.json", ".lock"
"""Of the names of records, and what the name of a claim has after that."""
LONGEST = 200
"""Bytes of a record's name before its ending. File systems take 255, of which a claim needs some."""


@dataclass(frozen=True)
class Draft:
    """What is known of a record before its bake. It can be pickled for another process."""

    path: Path
    name: str
    """The name of the bake."""
    key: Key


@dataclass(frozen=True)
class Written:
    """A file that a bake wrote."""

    content: Content
    modified: int
    """When it was written, in nanoseconds of its file system's clock. A file of the same size and time has not changed."""


@dataclass(frozen=True)
class Record:
    """The content of a record's file."""

    key: Key
    key_value: str
    found: tuple[Content, ...]
    """The files that the bake read beside those of its key."""
    files: tuple[Written, ...]
    result: dict[str, Any]
    """The bake's entry of the report."""


def path_of(options: argparse.Namespace, records: str | None = None) -> Path:
    """The path of a bake's record: that of its map, with another ending. records: the folder of all records; None if each is
    beside its map.

    Bakes of several low objects, whose names are not known, can have one path of maps. A hash of what they bake is in the
    names of their records. In a folder of all records, all names have it: maps of two folders may have one name.
    """
    output = os.path.abspath(options.output)
    low = "" if options.levels else options.low or (Path(options.low_file).stem if options.low_file else "")
    folder, name = os.path.split(file_names.fill(output, low) if low else output)
    plain = file_names.file_name(name)
    is_long = len(os.fsencode(plain)) > LONGEST
    if is_long:
        plain = os.fsencode(plain)[:LONGEST].decode(errors="ignore")
    place = os.path.abspath(records) if records else folder
    if records or is_long or file_names.LOW in name or file_names.MATERIAL in name:
        plain = f"{plain}.{_identity(options, place)}"
    return Path(place, plain + ENDING)


def claim_of(record: Path) -> Path:
    """The path of the claim on the bake that has the record at `record`."""
    return record.with_name(record.name + CLAIM)


def files(options: argparse.Namespace, records: str | None = None) -> Iterator[tuple[str, str]]:
    """The paths of a bake's record and claim, and what they are. records: as in `path_of`."""
    record = path_of(options, records)
    yield str(record), "the record"
    yield str(claim_of(record)), "the claim on the bake"


def _identity(options: argparse.Namespace, folder: str) -> str:
    """A short hash of what is baked: names of files and objects, and frames. folder: of the record."""
    files = [[what, moved_paths.written(os.path.abspath(path), folder)] for path, what in bake_key.inputs(options)]
    if arguments.is_folder(options):
        files.append(["", moved_paths.written(os.path.abspath(options.pairs), folder)])
    output = moved_paths.written(os.path.abspath(options.output), folder)
    names = [options.low, options.high, options.cage, options.frames, output]
    return hashlib.sha256(bake_key.canonical([files, names]).encode()).hexdigest()[:16]


def write(
    draft: Draft, result: dict[str, Any], found: Sequence[Content], files: Sequence[str], hashes: Contents
) -> None:
    """Write the record of a bake whose files are complete.

    result: its entry of the report. found: the files that it read beside those of the key, as they were when it read them.
    files: the paths of all files that it wrote. hashes: may have read them. Raises BakeError, also for a file that was changed
    since the bake began.
    """
    own = set(map(os.path.realpath, files))
    for each in (*draft.key.inputs, *found):
        if contents.stamp_of(each.path) != each.stamp and os.path.realpath(each.path) not in own:
            raise BakeError(f"{each.path!r} was changed during the bake, which --resume does again.")
    folder = str(draft.path.parent)
    values = {
        "imprint_record": VERSION,
        "key": draft.key.value,
        "name": draft.name,
        "version": draft.key.imprint,
        "blender": draft.key.blender,
        "settings": draft.key.settings,
        "declared": [_plain(each, folder) for each in draft.key.inputs],
        "inputs": [_plain(each, folder) for each in found],
        "files": [_plain(hashes.of(path), folder) | {"modified": _modified(path)} for path in dict.fromkeys(files)],
        "result": result,
    }
    with replacing(draft.path) as partial:
        partial.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")


def read(path: Path) -> Record | None:
    """The record at `path`; None if there is none, or it cannot be read."""
    folder = str(path.parent)
    try:
        values = json.loads(path.read_bytes())
        if values["imprint_record"] != VERSION:
            return None
        declared, found = (tuple(_content(each, folder) for each in values[key]) for key in ("declared", "inputs"))
        files = tuple(Written(_content(each, folder), each["modified"]) for each in values["files"])
        key = Key(dict(values["settings"]), declared, values["version"], values["blender"])
        return Record(key, values["key"], found, files, dict(values["result"]))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _plain(content: Content, folder: str) -> dict[str, Any]:
    path = moved_paths.written(content.path, folder)
    what = {"what": content.what} if content.what else {}
    return {"path": path, **what, "bytes": content.size, "sha256": content.sha256}


def _content(values: dict[str, Any], folder: str) -> Content:
    return Content(moved_paths.read(values["path"], folder), values.get("what", ""), values["bytes"], values["sha256"])


def is_unchanged(file: Written, hashes: Contents, *, is_trusted: bool = True) -> bool:
    """Whether a file is as a bake wrote it. If its time is to be trusted, it is read only if that differs, as that of a copy
    does."""
    try:
        found = os.stat(file.content.path)
    except (OSError, ValueError):
        return False
    if found.st_size != file.content.size:
        return False
    return (is_trusted and found.st_mtime_ns == file.modified) or hashes.of(file.content.path).is_same(file.content)


def _modified(path: str) -> int:
    try:
        return os.stat(path).st_mtime_ns
    except OSError:  # the next run will miss the file
        return 0
