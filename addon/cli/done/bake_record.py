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

from ...core import naming
from ...core.errors import BakeError
from ...output.files.atomic_file import replacing
from ..plan import plans
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
    report: str | None = None
    """The path of the bake's own report."""
    is_pictured: bool = False
    """Whether the run keeps its picture."""


@dataclass(frozen=True)
class Written:
    """A file that a bake wrote."""

    content: Content
    stamp: str
    """As `_stamp` returns it. A file with the same stamp has not changed."""


@dataclass(frozen=True)
class Record:
    """The content of a record's file."""

    key: Key
    key_value: str
    found: tuple[Content, ...]
    """The files that the bake read beside those of its key."""
    files: tuple[Written, ...]
    picture: str
    """The hash of its picture; empty if the run kept none."""
    result: dict[str, Any]
    """The bake's entry of the report."""


def path_of(options: argparse.Namespace, records: str | None = None) -> Path:
    """The path of a bake's record: that of its map, with another ending. records: the folder of all records; None if each is
    beside its map.

    Bakes of several low objects, whose names are not known, can have one path of maps, and so can sequences of other frames.
    A hash of what they bake is in the names of their records. In a folder of all records, all names have it: maps of two
    folders may have one name.
    """
    output = os.path.abspath(options.output)
    low = "" if options.levels else options.low or (Path(options.low_file).stem if options.low_file else "")
    folder, name = os.path.split(naming.fill(output, low) if low else output)
    plain = naming.file_name(name)
    is_long = len(os.fsencode(plain)) > LONGEST
    if is_long:
        plain = os.fsencode(plain)[:LONGEST].decode(errors="ignore")
    place = os.path.abspath(records) if records else folder
    if records or is_long or options.frames or naming.LOW in name or naming.MATERIAL in name:
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
    files = [[what, moved_paths.written(os.path.abspath(path), folder)] for path, what in plans.input_paths(options)]
    if arguments.is_folder(options):
        files.append(["", moved_paths.written(os.path.abspath(options.pairs), folder)])
    output = moved_paths.written(os.path.abspath(options.output), folder)
    names = [options.low, options.high, options.cage, options.frames, output]
    return hashlib.sha256(bake_key.canonical([files, names]).encode()).hexdigest()[:16]


def write(
    draft: Draft,
    result: dict[str, Any],
    found: Sequence[Content],
    files: Sequence[str],
    hashes: Contents,
    *,
    picture: bytes = b"",
) -> None:
    """Write the record of a bake whose files are complete.

    result: its entry of the report. found: the files that it read beside those of the key, as they were when it read them.
    files: the paths of all files that it wrote beside its report. hashes: may have read them. picture: that of the bake. Raises
    BakeError, also for a file that was changed since the bake began.
    """
    own = set(map(os.path.realpath, files))
    for each in (*draft.key.inputs, *found):
        is_touched = contents.stamp_of(each.path) != each.stamp and os.path.realpath(each.path) not in own
        if is_touched and not hashes.of(each.path).is_same(each):
            raise BakeError(f"{each.path!r} was changed during the bake, which --resume does again.")
    folder = str(draft.path.parent)
    paths = dict.fromkeys([*files, *([draft.report] if draft.report else [])])
    values = {
        "imprint_record": VERSION,
        "key": draft.key.value,
        "name": draft.name,
        "version": draft.key.imprint,
        "blender": draft.key.blender,
        "code": draft.key.code,
        "settings": draft.key.settings,
        "declared": [_plain(each, folder) for each in draft.key.inputs],
        "inputs": [_plain(each, folder) for each in found],
        "files": [_plain(hashes.of(path), folder) | {"stamp": _stamp(path)} for path in paths],
        "picture": hashlib.sha256(picture).hexdigest() if draft.is_pictured and picture else "",
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
        files = tuple(Written(_content(each, folder), each["stamp"]) for each in values["files"])
        key = Key(dict(values["settings"]), declared, values["version"], values["blender"], values["code"])
        return Record(key, values["key"], found, files, values["picture"], dict(values["result"]))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _plain(content: Content, folder: str) -> dict[str, Any]:
    path = moved_paths.written(content.path, folder)
    what = {"what": content.what} if content.what else {}
    return {"path": path, **what, "bytes": content.size, "sha256": content.sha256}


def _content(values: dict[str, Any], folder: str) -> Content:
    return Content(moved_paths.read(values["path"], folder), values.get("what", ""), values["bytes"], values["sha256"])


def is_unchanged(file: Written, hashes: Contents, *, is_trusted: bool = True) -> bool:
    """Whether a file is as a bake wrote it. If its stamp is to be trusted, it is read only if that differs, as that of a copy
    does."""
    if contents.size_of(file.content.path) != file.content.size:
        return False
    stamp = _stamp(file.content.path) if is_trusted else ""
    return (bool(stamp) and stamp == file.stamp) or hashes.of(file.content.path).is_same(file.content)


def _stamp(path: str) -> str:
    """What changes whenever a file is changed or replaced, whatever times a program gives it. It is the same for all machines
    that see the file. Empty where the system does not tell it."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):  # the next run will miss the file
        return ""
    # Windows has the time at which a file was made in its place.
    return f"{found.st_ino}:{found.st_mtime_ns}:{found.st_ctime_ns}" if os.name != "nt" else ""
