# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes settings from options. What is wrong with them is found once for all bakes whose settings differ only in names."""

import argparse
import functools
import os
import re
from dataclasses import fields
from operator import itemgetter

from ...core import file_formats, udim
from ...core.conversion.stored_normals import StoredNormals
from ...core.declarations import kinds
from ...core.declarations.all_settings import DECLARED
from ...core.declarations.choices import Storage
from ...core.errors import BakeError
from ...core.settings import Settings

_GIVEN = ("size", *sorted(field.name for kind in (Settings, StoredNormals) for field in fields(kind)))
_SET_HERE = {"width", "height", "storage", "output"}
_NAMES = tuple(name for name in _GIVEN if name not in _SET_HERE)
"""The options that settings are made of, but for the path of the map."""
_values_of = itemgetter(*_NAMES)
_LOOSE = tuple(
    (index, DECLARED[name])
    for index, name in enumerate(_NAMES)
    if name in DECLARED and isinstance(DECLARED[name], kinds.Distance | kinds.Color | kinds.Text)
)
"""Settings that are checked alone: valid ones are alike. Texts are too, but for the placeholders in them."""
_MARKED = re.compile(r"[%{}<>]")
"""What begins or ends a placeholder, or may not be in the path of tiles."""
_HARMLESS = re.compile(r"(\{\w*\}|<UDIM>)|[^/\\%{}<>.]+")
"""What does not matter in a text for its check, after placeholders, which do."""


def settings(options: argparse.Namespace) -> Settings:
    """The settings of the bake. The map goes to a file, of the format's usual depth if no depth is given."""
    given = vars(options)
    values = {field.name: given[field.name] for field in fields(Settings) if field.name in given}
    values["width"], values["height"] = options.size
    values["storage"], values["output"] = Storage.FILE, os.path.abspath(options.output)
    values["udim"] = options.udim or bool(options.tiles) or udim.TOKEN in options.output
    if options.depth is None:
        values["depth"] = file_formats.usual_depth(options.output)
    return Settings(**values)


def stored_normals(options: argparse.Namespace) -> StoredNormals:
    """What the map to convert means."""
    return StoredNormals(**{field.name: vars(options)[field.name] for field in fields(StoredNormals)})


def fault(options: argparse.Namespace) -> str:
    """What is wrong with the settings, without a full stop, or ""."""
    head, ending = os.path.splitext(os.path.abspath(options.output))
    if not _fault_of_kind(kind(options), _without_names(head) + ending):
        return ""
    return _fault(options)  # again, for the names in the message


def _fault(options: argparse.Namespace) -> str:
    try:
        settings(options).check()
        stored_normals(options).check()
    except BakeError as error:
        return str(error).rstrip(".")
    return ""


def kind(options: argparse.Namespace) -> tuple:
    """The same for options whose settings, but for the path, are valid alike and make files of the same kinds."""
    return _alike(_values_of(vars(options)))


@functools.lru_cache(maxsize=4096)
def _alike(given: tuple) -> tuple:
    values = list(given)
    for index, setting in _LOOSE:
        value = values[index]
        if value == setting.default:
            continue
        if isinstance(setting, kinds.Text):
            values[index] = _without_names(value)
            continue
        try:
            setting.check(value)
        except BakeError:
            continue
        values[index] = setting.default
    return tuple(values)


def of_kind(values: tuple, output: str) -> argparse.Namespace:
    """Options of a kind, with this path."""
    return argparse.Namespace(**dict(zip(_NAMES, values, strict=True)), output=output)


@functools.lru_cache(maxsize=4096)
def _fault_of_kind(values: tuple, output: str) -> str:
    return _fault(of_kind(values, output))


def _without_names(text: str) -> str:
    """A text that is as valid."""
    if not _MARKED.search(text):  # most are like this
        return text and "x"
    return _HARMLESS.sub(r"\1x", text)
