# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of a bake as Blender properties, made from their declarations, and the way back to plain data."""

from collections.abc import Callable, Collection
from typing import Any

import bpy
import numpy as np
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..core import file_formats, map_types, udim
from ..core.declarations import kinds
from ..core.declarations.all_settings import DECLARED, PANELS
from ..core.declarations.choices import DistanceUnit, Storage
from ..core.map_types import MapType
from ..core.settings import PART_OF, Settings
from .texts import LABEL


def declared(name: str, **more: Any):
    """The property of the setting `name`. more: arguments that a declaration cannot have, such as `poll` or `update`."""
    setting = DECLARED[name]
    kind, own = _property(setting)
    if "get" in more:  # its value is made, and so has no default
        own.pop("default", None)
    if options := {*own.get("options", ()), *more.get("options", ())}:
        more["options"] = options
    words = {"name": setting.label, "description": setting.panel_tooltip, "translation_context": LABEL}
    return kind(**words, **(own | more))


def _property(setting: kinds.Setting) -> tuple[Callable, dict[str, Any]]:
    """The kind of property for a declaration of any kind, and its arguments."""
    match setting:
        case kinds.Switch():
            return BoolProperty, {"default": setting.default}
        case kinds.Flags():
            items = [(item.value, item.label, item.tooltip) for item in setting.items]
            return EnumProperty, {"items": items, "default": set(setting.default), "options": {"ENUM_FLAG"}}
        case kinds.Choice():
            items = [(str(item.value), item.label, item.tooltip) for item in setting.items]
            return EnumProperty, {"items": items, "default": str(setting.default)}
        case kinds.WholeNumber():
            limits = {"min": setting.least, "max": setting.most, "soft_max": setting.usual_most or setting.most}
            return IntProperty, {"default": setting.default, **limits}
        case kinds.Amount():
            return FloatProperty, {"default": setting.default, "min": setting.least, "max": setting.most}
        case kinds.Reach():
            return FloatProperty, {
                "default": setting.shown,
                "min": 1e-6,
                "soft_max": setting.usual_most,
                "precision": 4,
            }
        case kinds.Distance():
            limits = {"min": setting.shown_least, "soft_max": setting.usual_most, "precision": 4}
            return FloatProperty, {"default": setting.shown, "subtype": "DISTANCE", **limits}
        case kinds.Color():
            limits = {"size": 3, "min": 0.0, "max": 1.0}
            return FloatVectorProperty, {"default": setting.default, "subtype": "COLOR_GAMMA", **limits}
        case kinds.FilePath():
            options = {"subtype": "FILE_PATH", "options": {"PATH_SUPPORTS_BLEND_RELATIVE"}}
            return StringProperty, {"default": setting.default, **options}
        case kinds.Text() | kinds.Tiles():
            return StringProperty, {"default": setting.default or ""}
        case kinds.ObjectSlots():
            return CollectionProperty, {}
        case kinds.ObjectSlot():
            return PointerProperty, {"type": bpy.types.Object}
    raise TypeError(f"there is no property for {setting!r}")


class Options:
    """The fields of Settings, under the same names, and the switches that make some of them None."""

    def to_settings(
        self,
        fallback: "Options | None" = None,
        own: bpy.types.PropertyGroup | None = None,
        of_own: Collection[str] = (),
    ) -> Settings:
        """The settings as plain data. Those that were not set here come from `fallback`, and those of the names `of_own` from
        `own`, which a low object has for itself.

        A number that a script sets is used, whatever the number's switch is.
        """

        def owner(name: str) -> Options:
            if fallback is not None and self.properties.is_property_set(name):
                return self
            return own if own is not None and name in of_own else fallback or self

        def is_switched_off(name: str) -> bool:
            """Whether the switch of a number makes it None."""
            switch = DECLARED[name].switch
            if not switch or getattr(owner(switch), switch) != DECLARED[switch].empties:
                return False
            is_named = fallback is not None and owner(name) is self
            return not is_named or (switch == "unlimited" and owner(switch) is self)

        values = {
            name: None if is_switched_off(name) else _plain(DECLARED[name], getattr(owner(name), name))
            for name in PART_OF
        }
        if fallback is not None and owner("output") is self and owner("storage") is fallback:
            values["storage"] = Storage.FILE  # if a script sets a file name, the file is written
        is_named = fallback is not None and owner("depth") is self
        if values["storage"] == Storage.FILE and not is_named:
            is_other = owner("output") is not owner("depth") and not file_formats.takes(
                values["output"], values["depth"]
            )
            if is_other or not _is_set(owner("depth"), "depth"):
                values["depth"] = file_formats.usual_depth(values["output"])  # Targa has only 8 bits
        return Settings(**values).read_by((fallback or self).id_data.render.engine)


def _plain(setting: kinds.Setting, value):
    """The value of a property as in Settings."""
    if isinstance(setting, kinds.Flags):
        return tuple(name for name in setting.values if name in value)
    if isinstance(setting, kinds.Choice):
        return next(known for known in setting.values if str(known) == value)
    if isinstance(setting, kinds.Color):
        return tuple(value)
    return udim.parse(value) if isinstance(setting, kinds.Tiles) else value


def put_settings(target: Options, settings: Settings) -> None:
    """The way back of `to_settings`: set what differs. The setting texture_sets stays: sets have another one for it."""
    for name, value in settings.flat().items():
        setting = DECLARED[name]
        is_same = value is None or _is_same(_plain(setting, getattr(target, name)), value)
        if setting.switch:
            switched = DECLARED[setting.switch].empties != (value is not None)
            if not is_same or getattr(target, setting.switch) != switched:
                setattr(target, setting.switch, switched)
        if not is_same and name != "texture_sets":
            setattr(target, name, _for_property(setting, value))


def _is_same(one: Any, other: Any) -> bool:
    """Whether two values are the same in a property, which has single precision."""
    if isinstance(one, float) or (isinstance(one, tuple) and one and isinstance(one[0], float)):
        return bool(np.array_equal(np.float32(one), np.float32(other)))
    return one == other


def _for_property(setting: kinds.Setting, value: Any) -> Any:
    """A value of Settings as its property takes it."""
    if isinstance(setting, kinds.Flags):
        return set(value)
    if isinstance(setting, kinds.Choice):
        return str(value)
    return ", ".join(map(str, value)) if isinstance(setting, kinds.Tiles) else value


def _is_set(owner: Options, name: str) -> bool:
    """Whether a property of a scene's settings, or of an operator, has been set."""
    return getattr(owner, "properties", owner).is_property_set(name)


# Blender reads properties from the annotations of a class and of its bases.
Options.__annotations__ = {
    name: declared(name)
    for name, setting in DECLARED.items()
    if name in PART_OF or getattr(setting, "empties", None) is not None
}


class OfPanels:
    """The settings of panels that no bake has: of pairs, levels, assets and conversions."""


OfPanels.__annotations__ = {
    name: declared(name) for panel in ("pairs", "levels", "asset", "convert") for name in PANELS[panel].settings
}


REACHES = tuple(name for name, setting in DECLARED.items() if isinstance(setting, kinds.Reach))
"""The settings in the unit of the setting distance_unit."""


def map_switch(name: str) -> str:
    """The name of the property that is on while the map `name` is in the setting `maps`."""
    return f"bakes_{name.lower()}"


def length_name(name: str) -> str:
    """The name of the property that shows the setting `name` as a length."""
    return f"{name}_length"


class MapList:
    """Properties that stand for a part of the setting `maps`, or for a distance. Their values are not stored."""

    def shown(self, reach: str) -> str:
        """The property that shows a setting of REACHES in the chosen unit."""
        return length_name(reach) if self.distance_unit == DistanceUnit.SCENE else reach


def _switch_of(map_type: MapType):
    """A switch, since Blender's own buttons for a set of values keep only the last one that is clicked."""

    def get(settings: MapList) -> bool:
        return map_type.name in settings.maps

    def put(settings: MapList, is_on: bool) -> None:
        settings.maps = settings.maps | {map_type.name} if is_on else settings.maps - {map_type.name}

    return BoolProperty(name=map_type.label, description=map_type.tooltip, get=get, set=put, translation_context=LABEL)


def _length_of(name: str):
    def get(settings: MapList) -> float:
        return getattr(settings, name)

    def put(settings: MapList, value: float) -> None:
        setattr(settings, name, value)

    return declared(name, subtype="DISTANCE", get=get, set=put)


# Blender reads properties from the annotations of a class and of its bases.
MapList.__annotations__ = {map_switch(map_type.name): _switch_of(map_type) for map_type in map_types.OTHERS} | {
    length_name(name): _length_of(name) for name in REACHES
}
