# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake changes of the open file and on the disk, as plain data: so that a bake in another process changes this file.

A few functions put all that a bake makes into the file: `recorded` ones, and those that call `Journal.note`. While a journal is
`recording`, each call is noted, with objects and images by their names and large data in files. No file is moved to its place
then. `replay` calls the same functions in the same order in the process whose file is meant.
"""

import functools
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..core import udim
from ..core.errors import BakeError
from ..core.settings import Settings
from . import atomic_file
from .atomic_file import Partial

Find = Callable[[str, str], bpy.types.Object | None]
"""The object with a name, and the path of its library, or empty, when the journal was written; None if it is gone."""
SHOW, PACKED = "datablocks.show", "datablocks.show_packed"
"""The functions whose first argument is the name of an image."""
PUT = "atomic_file.put"
_KIND = "imprint"
"""The key of plain data with the name of what it stands for."""
_functions: dict[str, Callable] = {}
_classes: dict[str, type] = {}
_now: ContextVar["Journal | None"] = ContextVar("_now", default=None)


def now() -> "Journal | None":
    """The journal that notes what happens now."""
    return _now.get()


def replayed(function: Callable) -> Callable:
    """Make a function one that journals may name."""
    return _functions.setdefault(_name(function), function)


def _name(function: Callable) -> str:
    """The name of a function in journals, wherever the package lies."""
    return f"{function.__module__.rpartition('.')[2]}.{function.__name__}"


def plain(kind: type) -> type:
    """Make a dataclass one whose values may be arguments of such functions."""
    return _classes.setdefault(kind.__name__, kind)


def recorded(function: Callable) -> Callable:
    """Note the calls of a function, and not what it calls itself."""
    replayed(function)

    @functools.wraps(function)
    def call(*arguments: Any, **options: Any) -> Any:
        journal = now()
        if journal is None:
            return function(*arguments, **options)
        arguments = [_listed(each) for each in arguments]
        journal.note(function, *arguments, **options)  # before: it may rename what it gets
        token = _now.set(None)
        try:
            return function(*arguments, **options)
        finally:
            _now.reset(token)

    return call


def _listed(value: Any) -> Any:
    """The value; what can be gone through only once, as a list."""
    return list(value) if isinstance(value, Iterator) else value


class Journal:
    """Notes what happens.

    Attributes:
        file: The path of the file that is meant; empty for one that was never saved.
    """

    def __init__(self, folder: Path, file: str):
        """folder: for large data, which belongs to the process that replays."""
        self._folder, self._count, self.file = folder, 0, file
        self.calls: list[list] = []
        """The functions' names, arguments and options, in their order, as JSON can store them."""
        self._files: list[Partial] = []

    @contextmanager
    def recording(self) -> Iterator[None]:
        """Note what happens in the block."""
        token = _now.set(self)
        try:
            yield
        finally:
            _now.reset(token)

    def note(self, function: Callable, *arguments: Any, **options: Any) -> None:
        """Note a call."""
        self.calls.append([_name(function), self._plain(list(arguments)), self._plain(options)])

    def hand_over(self, partial: Partial) -> None:
        """Note that the file is moved to its place, and keep it for that."""
        self.note(atomic_file.put, str(partial.temporary), str(partial.path))
        self._files.append(partial)

    @property
    def files(self) -> dict[str, str]:
        """The files that wait to be moved to their places, by the paths of these."""
        return {str(each.path): str(each.temporary) for each in self._files}

    def keep(self, content: bytes) -> str:
        """Keep bytes in a file. Returns its path. Raises BakeError."""
        path = self._new()
        with Partial(path).writing():
            path.write_bytes(content)
        return str(path)

    def keep_tiles(self, path: str) -> str:
        """Keep a copy of the tiles at a path with the token of tiles. Returns such a path. Raises BakeError."""
        kept = f"{self._new()}.{udim.TOKEN}{Path(path).suffix}"
        for tile, source in udim.files(path).items():
            copy = Path(udim.fill(kept, tile))
            with Partial(copy).writing():
                shutil.copyfile(source, copy)
        return kept

    def _new(self) -> Path:
        self._count += 1
        return self._folder / str(self._count)

    def taken(self) -> None:
        """The calls were replayed in the other process: here, show the files in their places, and forget all."""
        calls = self.calls
        self.close()
        token = _now.set(None)
        try:
            for name, arguments, options in calls:
                if name == SHOW and not options["pack"]:
                    _functions[name](*arguments, **options)
        finally:
            _now.reset(token)

    def close(self) -> None:
        """Forget all, and remove files that were not taken."""
        self.calls = []
        while self._files:
            self._files.pop().discard()

    def _plain(self, value: Any) -> Any:
        """A value as JSON can store it."""
        if isinstance(value, bpy.types.ID):
            library = bpy.path.abspath(value.library.filepath) if value.library else ""
            return {_KIND: type(value).__name__, "name": value.name, "library": library}
        if isinstance(value, Settings):
            return {_KIND: "Settings", "values": self._plain(value.flat())}
        if isinstance(value, np.ndarray):
            path = self._new()
            with Partial(path).writing(), path.open("wb") as file:
                np.save(file, value)
            return {_KIND: "array", "path": str(path)}
        if is_dataclass(value):
            values = {each.name: self._plain(getattr(value, each.name)) for each in fields(value)}
            return {_KIND: type(value).__name__, "values": values}
        if isinstance(value, Mapping):
            return {key: self._plain(each) for key, each in value.items()}
        if isinstance(value, Iterable) and not isinstance(value, str):
            return [self._plain(each) for each in value]
        return value.item() if isinstance(value, np.generic) else value


def objects_of(calls: Iterable[list]) -> list[tuple[str, str]]:
    """The names and libraries of the objects in the calls of a journal, each once."""
    found: dict[tuple[str, str], None] = {}

    def visit(value: Any) -> None:
        if isinstance(value, dict) and value.get(_KIND) == "Object":
            found[value["name"], value["library"]] = None
        elif isinstance(value, dict | list):
            for each in value.values() if isinstance(value, dict) else value:
                visit(each)

    visit(list(calls))
    return list(found)


def images_of(calls: Iterable[list]) -> list[str]:
    """The names of the images that the calls of a journal fill."""
    return list(dict.fromkeys(arguments[0] for name, arguments, _ in calls if name in {SHOW, PACKED}))


def files_of(calls: Iterable[list]) -> list[str]:
    """The paths of the files that the calls of a journal replace."""
    return [arguments[1] for name, arguments, _ in calls if name == PUT]


def replay(calls: Iterable[list], find: Find) -> Iterator[None]:
    """Do what a journal has noted: first all files at once, or none, and then one call after the other. Yields between them.

    Raises BakeError if a file cannot be replaced. All objects_of the calls must be there.
    """
    calls = list(calls)
    with atomic_file.all_or_none():
        for call in calls:
            if call[0] == PUT:
                _do(call, find)
    for call in calls:
        if call[0] != PUT:
            yield
            _do(call, find)


def _do(call: list, find: Find) -> None:
    name, arguments, options = call
    _functions[name](*_real(arguments, find), **_real(options, find))


def _real(value: Any, find: Find) -> Any:
    """What a plain value stands for. Raises BakeError if an object or an image is gone."""
    if isinstance(value, list):
        return [_real(each, find) for each in value]
    if not isinstance(value, dict):
        return value
    match value.get(_KIND):
        case None:
            return {key: _real(each, find) for key, each in value.items()}
        case "Settings":
            return Settings.of_json(value["values"])
        case "array":
            return np.load(value["path"])
        case "Object":
            found = find(value["name"], value["library"])
        case "Image":
            found = bpy.data.images.get((value["name"], value["library"] or None))
        case kind:
            return _classes[kind](**{name: _real(each, find) for name, each in value["values"].items()})
    if found is None:
        raise BakeError(f"{value['name']!r} was deleted during the bake.")
    return found


replayed(atomic_file.put)
