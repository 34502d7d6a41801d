# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes Blender's properties from the declarations of the settings."""

from functools import singledispatch
from typing import Any

import bpy
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

from ...core.declarations import kinds
from ...core.declarations.all_settings import DECLARED
from ..translations import LABEL


def declared(name: str, **more: Any):
    """The property of the setting `name`. more: arguments that a declaration cannot have, such as `poll` or `update`."""
    return _property(DECLARED[name], more)


def _words(setting: kinds.Setting) -> dict[str, str]:
    return {"name": setting.label, "description": setting.panel_tooltip, "translation_context": LABEL}


@singledispatch
def _property(setting: kinds.Setting, more: dict[str, Any]):
    """The property for a declaration of any kind."""
    raise TypeError(f"there is no property for {setting!r}")


@_property.register
def _(setting: kinds.Switch, more):
    return BoolProperty(**_words(setting), default=setting.default, **more)


@_property.register
def _(setting: kinds.Choice, more):
    items = [(str(item.value), item.label, item.tooltip) for item in setting.items]
    return EnumProperty(**_words(setting), items=items, default=str(setting.default), **more)


@_property.register
def _(setting: kinds.Flags, more):
    items = [(item.value, item.label, item.tooltip) for item in setting.items]
    return EnumProperty(**_words(setting), items=items, default=set(setting.default), options={"ENUM_FLAG"}, **more)


@_property.register
def _(setting: kinds.WholeNumber, more):
    limits = {"min": setting.least, "max": setting.most, "soft_max": setting.usual_most or setting.most}
    if "get" not in more:
        limits["default"] = setting.default
    return IntProperty(**_words(setting), **limits, **more)


@_property.register
def _(setting: kinds.Distance, more):
    return FloatProperty(
        **_words(setting),
        default=setting.shown,
        min=setting.shown_least,
        soft_max=setting.usual_most,
        precision=4,
        subtype="DISTANCE",
        **more,
    )


@_property.register
def _(setting: kinds.Reach, more):
    if "get" not in more:
        more = {**more, "default": setting.shown}
    return FloatProperty(**_words(setting), min=1e-6, soft_max=setting.usual_most, precision=4, **more)


@_property.register
def _(setting: kinds.Color, more):
    return FloatVectorProperty(
        **_words(setting), default=setting.default, size=3, min=0.0, max=1.0, subtype="COLOR_GAMMA", **more
    )


@_property.register
def _(setting: kinds.Text, more):
    return StringProperty(**_words(setting), default=setting.default, **more)


@_property.register
def _(setting: kinds.FilePath, more):
    return StringProperty(
        **_words(setting),
        default=setting.default,
        subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        **more,
    )


@_property.register
def _(setting: kinds.Tiles, more):
    return StringProperty(**_words(setting), **more)


@_property.register
def _(setting: kinds.ObjectSlot, more):
    return PointerProperty(**_words(setting), type=bpy.types.Object, **more)


@_property.register
def _(setting: kinds.ObjectSlots, more):
    return CollectionProperty(**_words(setting), **more)
