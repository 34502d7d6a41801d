# SPDX-License-Identifier: GPL-3.0-or-later
"""The setting Engine, which sets all that a target engine needs at once, and a line that says what it or a preset sets."""

import re
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

import bpy

from ..core import file_formats, naming
from ..core.declarations import kinds, targets
from ..core.declarations.all_settings import DECLARED
from ..core.declarations.choices import Pack, Storage
from .texts import label, message

CUSTOM = "CUSTOM"
"""The value of the setting while others are not those of an engine."""
_NAMES = (CUSTOM, *targets.CHOICES)
_items: list[tuple[str, str, str, int]] = []
"""Blender needs the texts to stay in memory."""


def engine_items(_settings: bpy.types.PropertyGroup, _context: bpy.types.Context) -> list[tuple[str, str, str, int]]:
    """The items of the setting, with tooltips in the language of the interface."""
    lines = [describe(_all_values(engine)) for engine in targets.CHOICES.values()]
    names = [label("Custom"), *targets.CHOICES]
    tooltips = [message("Settings that were changed one by one"), *lines]
    _items[:] = [(_NAMES[at], names[at], tooltips[at], at) for at in range(len(_NAMES))]
    return _items


def _all_values(engine: targets.Engine) -> dict[str, Any]:
    return {**engine.values, "names": engine.names, "export": engine.export}


def get_engine(settings: bpy.types.PropertyGroup) -> int:
    """The number of the engine that was chosen, while the settings are still those that it needs."""
    name = settings.engine_name
    engine = targets.CHOICES.get(name)
    fits = engine is not None and all(getattr(settings, key) == value for key, value in engine.values.items())
    return _NAMES.index(name if fits else CUSTOM)


def set_engine(settings: bpy.types.PropertyGroup, number: int) -> None:
    """Set all that an engine needs. number: as get_engine gives it."""
    if _NAMES[number] != CUSTOM:
        choose_engine(settings, _NAMES[number])


def choose_engine(settings: bpy.types.PropertyGroup, name: str) -> None:
    """Set all that an engine needs. name: among targets.CHOICES."""
    engine = targets.CHOICES[name]
    for setting, value in engine.values.items():
        setattr(settings, setting, value)
    settings.engine_name = name
    if engine.export:
        if not _is_file(settings.output) or not file_formats.takes(settings.output, int(settings.depth)):
            settings.output = f"{_without_ending(settings.output) or '//map'}.png"
        settings.storage = Storage.FILE
    else:
        settings.storage = Storage.PACK
    settings.names = engine.names
    settings.export = (
        f"{_without_ending(settings.export) or f'//{naming.NAME}'}{engine.export}" if engine.export else ""
    )


def _is_file(path: str) -> bool:
    """Whether a path is that of an image file."""
    return PurePath(path).suffix.lower() in file_formats.BY_ENDING


def _without_ending(path: str) -> str:
    return re.sub(r"\.[^./\\]*$", "", path)


def describe(values: Mapping[str, Any]) -> str:
    """What a preset or an engine sets, in a line. values: settings by their names."""
    return ", ".join(filter(None, (_value(name, values[name]) for name in _DESCRIBED if name in values)))


_DESCRIBED = ("width", "samples", "maps", "green", "basis", "depth", "pack", "names", "output", "export")
"""The settings that `describe` names."""


def _value(name: str, value: Any) -> str:
    setting = DECLARED.get(name)
    if isinstance(setting, kinds.Flags):
        return ", ".join(label(item.label) for item in setting.items if item.value in value)
    if isinstance(setting, kinds.Choice):
        shown = next((label(item.label) for item in setting.items if str(item.value) == value), str(value))
        return "" if value == Pack.NONE else f"{label(setting.label)} {shown}"
    return str(value)
