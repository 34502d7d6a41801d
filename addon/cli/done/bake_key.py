# SPDX-License-Identifier: GPL-3.0-or-later
"""What decides the result of a bake, and a hash of it."""

import argparse
import functools
import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, is_dataclass
from typing import Any

from ...core import versions
from ..plan import plans
from ..usage.options import FILE, JOBS, OPTIONS, STRICT
from ..usage.run_options import RUN_OPTIONS
from . import moved_paths
from .contents import Content, Contents


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


def canonical(value: Any) -> str:
    """Plain data as JSON, the same text for the same data."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def of(options: argparse.Namespace, contents: Contents, open_file: str = "") -> Key:
    """The key of a bake. This reads its files. open_file: the path of the open .blend, which a bake without files uses."""
    found = tuple(contents.of(path, what) for path, what in plans.input_paths(options, open_file))
    return Key(settings(options), found, versions.imprint(), versions.blender(), versions.code())


def settings(options: argparse.Namespace) -> dict[str, Any]:
    """The options that decide the result, as plain data. Paths of what is written start at the folder of the map."""
    given = {name: value for name, value in vars(options).items() if name not in _NOT_SETTINGS}
    output = os.path.abspath(options.output)
    for name in _WRITTEN:
        path = getattr(options, name)
        given[name] = path and moved_paths.written(os.path.abspath(path), os.path.dirname(output))
    given["pairs"] = bool(options.pairs)  # a folder's meshes are inputs of their bakes
    return json.loads(json.dumps(given, default=_plain))


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return asdict(value)
    raise TypeError(f"{value!r} is no plain data")


def _names(options: dict[str, Any]) -> Iterator[str]:
    """The names of options as those of their values."""
    return (name.replace("-", "_") for name in options)


_WRITTEN = ("output", "export", "save_blend")
"""The options that name files to write."""
_PATHS = {name: option for each in OPTIONS.values() for name, option in each.items() if option.is_path}
_NOT_SETTINGS = {*_names({**_PATHS, "file": FILE, "jobs": JOBS, "strict": STRICT, **RUN_OPTIONS}), "name"}
"""The options that say where files are, those of a run, the name of the bake, and limits, which are compared with what a bake
has measured."""
