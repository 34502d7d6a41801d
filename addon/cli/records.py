# SPDX-License-Identifier: GPL-3.0-or-later
"""The record of a bake, a file beside its map: what decided its result, what it wrote, and its entry of the report."""

import argparse
import functools
import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass, replace
from pathlib import Path, PurePath
from types import MappingProxyType
from typing import Any

from ..core import naming, versions
from ..core.contents import Content, Contents, canonical, size_of, stamp_of
from ..core.errors import BakeError
from ..output.atomic_file import replacing
from . import arguments, plans, run_report
from .options import FILE, JOBS, OPTIONS, RUN_OPTIONS, STRICT
from .plans import Plan
from .run_report import Entry, State, report_path
from .untrusted import Bounds


def path_from(path: str, folder: str) -> str:
    """An absolute path, relative to `folder` if both are below one folder, with slashes on each system.

    What has only the root in common with `folder` may be at the same place on another machine where `folder` is not.
    """
    try:
        common = os.path.commonpath([path, folder])
    except ValueError:  # on other drives
        common = ""
    is_apart = not common or common == os.path.dirname(common)
    return PurePath(path if is_apart else os.path.relpath(path, folder)).as_posix()


def path_in(text: str, folder: str) -> str:
    """The absolute path that was written as `text` to a file in `folder`."""
    return os.path.normpath(os.path.join(folder, text))


@dataclass(frozen=True)
class Key:
    """What decides the result of a bake, beside the files that are only found while it is done."""

    settings: dict[str, Any]
    """As plain data."""
    inputs: tuple[Content, ...]
    """The files that its options name."""
    imprint: str
    """The version."""
    blender: str
    """The version."""
    code: str
    """The hash of Imprint's code."""

    @functools.cached_property
    def value(self) -> str:
        """The hash. Files count by their content and name: they may be in another folder, as on another machine."""
        inputs = [[each.what, os.path.basename(each.path), each.size, each.sha256] for each in self.inputs]
        decided = [self.settings, inputs, self.imprint, self.blender, self.code]
        return hashlib.sha256(canonical(decided).encode()).hexdigest()


def key_of(options: argparse.Namespace, contents: Contents, open_file: str = "") -> Key:
    """The key of a bake. This reads its files. open_file: the path of the open .blend, which a bake without files uses."""
    inputs = tuple(contents.of(path, what) for path, what in plans.input_paths(options, open_file))
    return Key(deciding_settings(options), inputs, versions.imprint(), versions.blender(), versions.code())


def deciding_settings(options: argparse.Namespace) -> dict[str, Any]:
    """The options that decide the result, as plain data. Paths of what is written start at the folder of the map."""
    given = {name: value for name, value in vars(options).items() if name not in _NOT_SETTINGS}
    output = os.path.abspath(options.output)
    for name in _WRITTEN:
        path = getattr(options, name)
        given[name] = path and path_from(os.path.abspath(path), os.path.dirname(output))
    given["pairs"] = bool(options.pairs)  # a folder's meshes are inputs of their bakes
    return json.loads(json.dumps(given, default=_plain_value))


def _plain_value(value: Any) -> Any:
    if is_dataclass(value):
        return asdict(value)
    raise TypeError(f"{value!r} is not plain data")


def _names(options: dict[str, Any]) -> Iterator[str]:
    """The names of options as those of their values."""
    return (name.replace("-", "_") for name in options)


_WRITTEN = ("output", "export", "save_blend")
"""The options that name files to write."""
_PATHS = {name: option for each in OPTIONS.values() for name, option in each.items() if option.is_path}
_NOT_SETTINGS = {
    *_names({**_PATHS, "file": FILE, "jobs": JOBS, "strict": STRICT, **RUN_OPTIONS}),
    "name",
    "notes",
    "of_window",
}
"""The options that say where files are, those of a run, the name of the bake, and limits, which are compared with what a bake
has measured."""


RECORD_VERSION = 1
"""The version of the record's keys."""
ENDING, CLAIM = ".imprint.json", ".lock"
"""Of the names of records, and what the name of a claim has after that."""
LONGEST = 200
"""Bytes of a record's name before its ending. File systems take 255, of which a claim needs some."""


@dataclass(frozen=True)
class Assignment:
    """A bake that this process, or one of its workers, has to do. It can be pickled."""

    plan: Plan
    why: str = ""
    """Why it still has to run, in a sentence."""
    record: Path | None = None
    """The path of the record to write; None for a bake without one, or that cannot be done."""
    key: Key | None = None
    """That of the record."""


@dataclass(frozen=True)
class Record:
    """The content of a record's file."""

    key: Key
    key_value: str
    """The hash of `key`."""
    others: tuple[Content, ...]
    """The files that the bake read beside those of its key."""
    files: tuple[Content, ...]
    """The files that it wrote. Their stamps are those of `_shared_stamp`."""
    picture: str
    """The hash of its picture; empty if the run kept none."""
    result: Entry
    """The bake's entry of the report."""
    states: dict[str, str]
    """What it has read for each low object, as jobs.part_state has it, by names; empty for bakes of untrusted files."""


def _filled(options: argparse.Namespace, output: str, low: str) -> str:
    return naming.fill(output, low, low_suffix=arguments.low_suffix(options)) if low else output


def record_path(options: argparse.Namespace, records: str | None = None) -> Path:
    """The path of a bake's record: that of its map, with another ending. records: the folder of all records; None if each is
    beside its map.

    Bakes of several low objects, whose names are not known, can have one path of maps, and so can sequences of other frames.
    A hash of what they bake is in the names of their records. In a folder of all records, all names have it: maps of two
    folders may have one name.
    """
    output = os.path.abspath(options.output)
    low = "" if options.levels else arguments.only_low(options)
    low = low or (Path(options.low_file).stem if options.low_file and not options.levels else "")
    folder, name = os.path.split(_filled(options, output, low))
    plain = naming.file_name(name)
    is_long = len(os.fsencode(plain)) > LONGEST
    if is_long:
        plain = os.fsencode(plain)[:LONGEST].decode(errors="ignore")
    place = os.path.abspath(records) if records else folder
    if records or is_long or options.frames or naming.has_low(name) or naming.MATERIAL in name:
        plain = f"{plain}.{_identity(options, place)}"
    return Path(place, plain + ENDING)


def claim_of(record: Path) -> Path:
    """The path of the claim on the bake that has the record at `record`."""
    return record.with_name(record.name + CLAIM)


def record_files(options: argparse.Namespace, records: str | None = None) -> Iterator[tuple[str, str]]:
    """The paths of a bake's record and claim, and what they are. records: as in `record_path`."""
    record = record_path(options, records)
    yield str(record), "the record"
    yield str(claim_of(record)), "the claim on the bake"


def _identity(options: argparse.Namespace, folder: str) -> str:
    """A short hash of what is baked: names of files and objects, and frames. folder: of the record."""
    files = [[what, path_from(os.path.abspath(path), folder)] for path, what in plans.input_paths(options)]
    if arguments.is_folder(options):
        files.append(["", path_from(os.path.abspath(options.pairs), folder)])
    output = path_from(os.path.abspath(options.output), folder)
    names = [arguments.only_low(options) or options.low, options.high, options.cage, options.frames, output]
    if options.part:
        names.append(options.scene)
    return hashlib.sha256(canonical([files, names]).encode()).hexdigest()[:16]


def write_record(
    assigned: Assignment,
    entry: Entry,
    others: Sequence[Content],
    hashes: Contents,
    *,
    is_pictured: bool = False,
    states: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write the record of a bake whose files are complete. Raises BakeError, also for a file that was changed meanwhile.

    Args:
        others: The files that it read beside those of the key, as they were when it read them.
        hashes: May have read the files that it wrote.
        is_pictured: Whether the run keeps its picture.
        states: As in Record.
    """
    path, key, report = assigned.record, assigned.key, report_path(assigned.plan.options.report)
    files = [each["path"] for each in entry.files]
    own = set(map(os.path.realpath, files))
    for each in (*key.inputs, *others):
        is_touched = stamp_of(each.path) != each.stamp and os.path.realpath(each.path) not in own
        if is_touched and not hashes.of(each.path).is_same(each):
            raise BakeError(f"{each.path!r} was changed during the bake, which --resume does again.")
    folder = str(path.parent)
    written = dict.fromkeys([*files, *([str(report)] if report else [])])
    values = {
        "imprint_record": RECORD_VERSION,
        "key": key.value,
        "name": assigned.plan.name,
        "version": key.imprint,
        "blender": key.blender,
        "code": key.code,
        "settings": key.settings,
        "declared": [_plain(each, folder) for each in key.inputs],
        "inputs": [_plain(each, folder) for each in others],
        "files": [_plain(hashes.of(each), folder) | {"stamp": _shared_stamp(each)} for each in written],
        "picture": hashlib.sha256(entry.image).hexdigest() if is_pictured and entry.image else "",
        "result": entry.to_dict(),
        "states": dict(states),
    }
    with replacing(path) as partial:
        partial.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")


def read_record(path: Path) -> Record | None:
    """The record at `path`; None if there is none, or it cannot be read."""
    folder = str(path.parent)
    try:
        values = json.loads(path.read_bytes())
        if values["imprint_record"] != RECORD_VERSION:
            return None
        declared, others = (tuple(_content(each, folder) for each in values[key]) for key in ("declared", "inputs"))
        files = tuple(replace(_content(each, folder), stamp=each["stamp"]) for each in values["files"])
        key = Key(dict(values["settings"]), declared, values["version"], values["blender"], values["code"])
        return Record(
            key,
            values["key"],
            others,
            files,
            values["picture"],
            Entry.from_dict(values["result"]),
            dict(values["states"]),
        )
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _plain(content: Content, folder: str) -> dict[str, Any]:
    path = path_from(content.path, folder)
    what = {"what": content.what} if content.what else {}
    return {"path": path, **what, "bytes": content.size, "sha256": content.sha256}


def _content(values: dict[str, Any], folder: str) -> Content:
    return Content(path_in(values["path"], folder), values.get("what", ""), values["bytes"], values["sha256"])


def is_unchanged(file: Content, hashes: Contents, *, is_trusted: bool = True) -> bool:
    """Whether a file of a record is as the bake wrote it. If its stamp is to be trusted, it is read only if that differs, as
    that of a copy does."""
    if size_of(file.path) != file.size:
        return False
    stamp = _shared_stamp(file.path) if is_trusted else ""
    return (bool(stamp) and stamp == file.stamp) or hashes.of(file.path).is_same(file)


def _shared_stamp(path: str) -> str:
    """What changes whenever a file is changed or replaced, whatever times a program gives it. It is the same for all machines
    that see the file. Empty where the system does not have it."""
    try:
        state = os.stat(path)
    except (OSError, ValueError):  # the next run will miss the file
        return ""
    # Windows has the time at which a file was made in its place.
    return f"{state.st_ino}:{state.st_mtime_ns}:{state.st_ctime_ns}" if os.name != "nt" else ""


def finish_record(
    assigned: Assignment,
    entry: Entry,
    others: Sequence[Content],
    hashes: Contents,
    *,
    is_pictured: bool = False,
    not_followed: Sequence[str] = (),
    states: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write the record of a bake if it has one and is done. A record that cannot be written is a warning of the entry.

    found, hashes, is_pictured, states: as in `write_record`. not_followed: why files that the bake read are not known, in
    clauses.
    """
    if assigned.record is None or entry.state not in {State.DONE, State.GATE}:
        return
    try:
        if not_followed:
            raise BakeError(f"{not_followed[0]}, so --resume does it again.")
        write_record(assigned, entry, others, hashes, is_pictured=is_pictured, states=states)
    except BakeError as error:
        entry.warnings.append(f"The bake has no record: {error}")


def check_untrusted(
    assigned: Assignment,
    entry: Entry,
    bounds: Bounds,
    unplanned: Callable[[Sequence[str]], Sequence[str]],
    *,
    is_pictured: bool = False,
    check: Callable[[], None] = lambda: None,
) -> Entry:
    """The entry of a bake of untrusted files, which its process may have made up, and the bake's record.

    The files in the entry are compared with those on the disk. A bake has failed if its process names what it may not have
    written or read.

    Args:
        unplanned: Returns the paths among others to which the bake may not have written, as clashes.RunFiles.unplanned.
        check: As in Contents.
    """
    plan, hashes = assigned.plan, Contents(check)
    entry.number, entry.name, entry.signal, entry.log, entry.picture = plan.number, plan.name, "", "", ""
    try:
        _check_written(entry, bounds, unplanned, hashes)
        for each in entry.inputs:
            bounds.check_read(each["path"], each["what"])
    except BakeError as error:
        return Entry.failed(plan.number, plan.name, BakeError(f"Its process gave a wrong result: {error}"))
    named = {os.path.abspath(path) for path, _ in plans.input_paths(plan.options)}
    inputs = [hashes.of(each["path"], each["what"]) for each in entry.inputs]
    changed = next((now for now, then in zip(inputs, entry.inputs, strict=True) if now.facts() != then), None)
    if changed is not None:
        why = " and the bake has no record" if assigned.record else ""
        entry.warnings.append(f"{changed.path!r} is not as it was in the bake{why}.")
        return entry
    others = [each for each in inputs if each.path not in named]
    finish_record(assigned, entry, others, hashes, is_pictured=is_pictured)
    return entry


def _check_written(
    entry: Entry, bounds: Bounds, unplanned: Callable[[Sequence[str]], Sequence[str]], hashes: Contents
) -> None:
    """Raise BakeError unless the files of an entry are those that the bake may write, and have the content that it names."""
    if entry.state == State.RESUMED:
        raise BakeError("it was not done by an earlier call.")
    if entry.state in {State.DONE, State.GATE} and not entry.files:
        raise BakeError("it names no file.")
    paths = {each["path"] for each in entry.files}
    for each in entry.files:
        bounds.check_write(each["path"], "a file")
    for path in unplanned(sorted(paths)):
        raise BakeError(f"{path!r} is not a file that it may write.")
    named = {
        path
        for each in entry.reports
        for paths_of_kind in run_report.written_paths(each).values()
        for path in paths_of_kind
    }
    if more := named - paths:
        raise BakeError(f"a report names {min(more)!r}, which is not among its files.")
    for each in entry.files:
        content = hashes.of(each["path"], each["what"])
        if not os.path.isfile(each["path"]) or content.facts() != each:
            raise BakeError(f"{content.path!r} is not as reported.")
