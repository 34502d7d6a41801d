# SPDX-License-Identifier: GPL-3.0-or-later
"""The sets of a scene as plain data, and as the keys of job files, so that the window and a shell have one description."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from . import file_formats
from .declarations import kinds
from .declarations.all_settings import DECLARED
from .declarations.choices import Storage
from .errors import BakeError
from .naming import Suffixes, did_you_mean, fill_low, has_low, of_shared_textures
from .settings import PART_OF, Settings
from .udim import TOKEN

_KEYS = {
    "low": "low",
    "highs": "high",
    "cage": "cage",
    "size": "size",
    "distance": "distance",
    "sizes": "sizes",
    "is_on": "on",
}
"""The keys of a part, by its fields."""


@dataclass(frozen=True)
class Part:
    """A low object of several, with what is its own."""

    low: str
    """Its name."""
    highs: tuple[str, ...] = ()
    """The names of its high objects; itself without any."""
    cage: str = ""
    size: int = 0
    """Of its square maps, in texels; 0 for that of all."""
    distance: float = 0.0
    """How far its rays reach outward and inward, in scene units; 0 for that of all."""
    sizes: tuple[tuple[str, int], ...] = ()
    """Of the images of materials that have a size of their own, by their names."""
    is_on: bool = True
    """Whether it is baked. Others keep their texels, and shade what is baked."""

    @classmethod
    def of_text(cls, text: str) -> "Part":
        """From "LOW=HIGH,HIGH", or a table as JSON. Raises BakeError."""
        if text.lstrip().startswith("{"):
            return cls._of_table(text)
        low, is_given, highs = text.partition("=")
        names = tuple(filter(None, (name.strip() for name in highs.split(","))))
        if not low.strip() or not (is_given and names):
            raise BakeError(f"{text!r} is not a low object with its high ones, as LOW=HIGH,HIGH.")
        return cls(low.strip(), names)

    @classmethod
    def _of_table(cls, text: str) -> "Part":
        try:
            table = json.loads(text)
        except ValueError as error:
            raise BakeError(f"{text!r} is not a table: {error}.") from error
        unknown = next((key for key in table if key not in _KEYS.values()), None)
        if unknown is not None:
            known = [*_KEYS.values()]
            raise BakeError(f"part has no key {unknown!r}{did_you_mean([unknown], known)}")
        values: dict[str, Any] = {"low": ""} | {name: table[key] for name, key in _KEYS.items() if key in table}
        highs = values.get("highs", [])
        values["highs"] = (highs,) if isinstance(highs, str) else tuple(highs) if isinstance(highs, list) else (None,)
        sizes = values.get("sizes", {})
        values["sizes"] = tuple(sizes.items()) if isinstance(sizes, dict) else ((None, 0),)
        part = cls(**values)
        if not _fits(part):
            kinds_of_values = "low, high and cage are names, size and distance numbers, sizes a table of numbers"
            raise BakeError(f"{text} is not a part: {kinds_of_values}, on is true or false.")
        return part

    @property
    def table(self) -> dict[str, Any]:
        """As in a job file."""
        usual = Part(self.low)
        values = {
            key: getattr(self, name) for name, key in _KEYS.items() if getattr(self, name) != getattr(usual, name)
        }
        tables = {"high": list(self.highs), "sizes": dict(self.sizes)}
        return {"low": self.low, **values, **{key: value for key, value in tables.items() if value}}


def _fits(part: Part) -> bool:
    """Whether all values of a part have their types, and numbers are not negative."""
    materials, sizes = zip(*part.sizes, strict=True) if part.sizes else ((), ())
    names = all(isinstance(name, str) for name in (part.low, part.cage, *part.highs, *materials)) and bool(part.low)
    whole = all(isinstance(size, int) and not isinstance(size, bool) and size >= 0 for size in (part.size, *sizes))
    is_length = isinstance(part.distance, int | float) and 0 <= part.distance < float("inf")
    return names and whole and is_length and isinstance(part.is_on, bool)


@dataclass(frozen=True)
class SceneSet:
    """A set of a scene.

    Attributes:
        is_on: Whether Bake All Sets bakes it.
        settings: As the scene has them.
        output: The path of its files, absolute; empty if it stores its maps in the .blend.
        export: The path of its mesh files, absolute; empty for none. LOW in it stands for each low object.
        share_image: As jobs.sets.SetJob has it.
        problem: Why nothing of it can be baked, in a sentence.
        left_out: Sentences about parts that cannot be baked.
        states: What the last bake of each low object has read, as jobs.part_state keeps it, by names.
    """

    name: str
    """Of the set, which no other one of its scene has."""
    scene: str
    """The name of its scene."""
    parts: tuple[Part, ...]
    settings: Settings
    output: str = ""
    export: str = ""
    share_image: bool = False
    is_on: bool = True
    problem: str = ""
    left_out: tuple[str, ...] = ()
    states: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))

    def keys(self, file: str) -> dict[str, Any]:
        """What a job file says of it. file: the path of the .blend."""
        output, image = self.output, self.settings.storing.image
        if self.share_image and self.settings.map.texture_sets:
            output, image = map(of_shared_textures, (output, image))
        elif self.share_image:
            suffix = self.settings.storing.low_suffix
            output, image = (fill_low(text, self.name, suffix) for text in (output, image))
        keys = keys_of(self.settings.stored(output=output, image=image))
        head = {"file": [file], "scene": self.scene, "name": self.name, "part": [part.table for part in self.parts]}
        return head | keys | ({"export": self.export} if self.export else {})


def keys_of(settings: Settings) -> dict[str, Any]:
    """The keys of a job file for settings: those that are not as usual there."""
    flat = settings.flat()
    keys: dict[str, Any] = {"size": f"{flat['width']}x{flat['height']}"}
    for name, setting in DECLARED.items():
        if setting.option is None or name not in PART_OF or name in {"width", "height"}:
            continue
        if flat[name] != setting.default or name == "depth":
            keys[setting.option.word or name.replace("_", "-")] = _value(setting, flat[name])
    usual = Suffixes()
    if flat["low_suffix"] != usual.low:
        keys["suffixes"] = [flat["low_suffix"], usual.high, usual.cage]
    return keys


def _value(setting: kinds.Setting, value: Any) -> Any:
    """A value as a job file has it."""
    match setting:
        case kinds.Switch():
            return True
        case kinds.Flags():
            return list(map(kinds.word_for, value))
        case kinds.Choice():
            return value if isinstance(setting.default, int) else kinds.word_for(value)
        case kinds.WholeNumber() if value is None:
            return setting.none_word
    return list(value) if isinstance(value, tuple) else value


@dataclass(frozen=True)
class JobSet:
    """A set of a job file, as the command line would bake it.

    Attributes:
        name: Empty if it has none.
        file, scene: What it is in, as it is written; empty for the open file and its scene.
        pairs: Whether it bakes all pairs by name, and not `parts`.
        by_name: The low objects among `parts` whose high ones nobody names.
        share_image: Whether all share one image, or one for each material.
        export: The file of the mesh, as it is written.
        others: Keys that are none of a set.
    """

    name: str
    file: tuple[str, ...]
    scene: str
    parts: tuple[Part, ...]
    by_name: frozenset[str]
    pairs: bool
    settings: Settings
    share_image: bool
    export: str = ""
    others: tuple[str, ...] = ()

    @classmethod
    def of_keys(cls, table: Mapping[str, Any]) -> "JobSet":
        """From the keys of a job file. Raises BakeError for values that are none."""
        keys = {key.replace("_", "-"): value for key, value in table.items() if value is not False and value != []}
        parts = [Part.of_text(each if isinstance(each, str) else json.dumps(each)) for each in _listed(keys, "part")]
        named = {part.low for part in parts}
        lows, highs, cage = _listed(keys, "low"), _listed(keys, "high"), str(keys.pop("cage", ""))
        if highs or cage:
            parts += [Part(low, tuple(map(str, highs)), cage) for low in lows]
        by_name = frozenset(low for low in lows if not (highs or cage) and low not in named)
        parts += [Part(low) for low in by_name]
        head = {name: str(keys.pop(name, "")) for name in ("name", "scene", "export")}
        file, pairs = tuple(map(str, _listed(keys, "file"))), keys.pop("pairs", False) is True
        settings, others = _settings_of(keys)
        is_shared = (pairs or len(parts) > 1) and not has_low(settings.storing.output)
        return cls(
            file=file,
            parts=tuple(parts),
            by_name=by_name,
            pairs=pairs,
            settings=settings,
            share_image=is_shared,
            others=tuple(others),
            **head,
        )


def _listed(keys: dict[str, Any], key: str) -> list[Any]:
    """The values of a key, which is removed: one stands for a list."""
    value = keys.pop(key, [])
    return value if isinstance(value, list) else [value]


def _settings_of(keys: Mapping[str, Any]) -> tuple[Settings, list[str]]:
    """The settings that keys of a job file stand for, and the keys that are none of settings. The way back of `keys_of`."""
    values: dict[str, Any] = {"storage": Storage.FILE}
    others = []
    for key, value in keys.items():
        name = _OF_WORDS.get(key, "")
        setting = DECLARED.get(name)
        if key == "size":
            values["width"], values["height"] = _size(value)
        elif key == "suffixes":
            values["low_suffix"] = (value.split(",") if isinstance(value, str) else value)[0]
        elif setting is None:
            others.append(key)
        else:
            values[name] = not setting.default if isinstance(setting, kinds.Switch) else setting.coerced(value)
    output = values.get("output", "")
    values.setdefault("udim", bool(values.get("tiles")) or TOKEN in output)
    if output and "depth" not in values:
        values["depth"] = file_formats.usual_depth(output)
    return Settings(**values), others


def _size(value: Any) -> tuple[int, int]:
    """The width and the height from "WIDTHxHEIGHT" or one number for both. Raises BakeError."""
    words = str(value).lower().split("x")
    if not all(word.strip().isdecimal() for word in words) or len(words) > 2:
        raise BakeError(f"Size: {value!r} is not a size, as 2048 or 2048x1024.")
    return int(words[0]), int(words[-1])


_OF_WORDS = {
    setting.option.word or name.replace("_", "-"): name
    for name, setting in DECLARED.items()
    if setting.option is not None and name in PART_OF and name not in {"width", "height"}
}
"""The settings by their keys."""
