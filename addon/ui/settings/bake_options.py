# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of a bake as Blender properties, for the scene and for operators, and the way back to plain data."""

from collections.abc import Collection
from dataclasses import fields

import bpy

from ...core import file_formats, udim
from ...core.declarations import kinds
from ...core.declarations.all_settings import DECLARED
from ...core.declarations.choices import Storage
from ...core.settings import Settings
from .declared_properties import declared


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

        names = [field.name for field in fields(Settings)]
        values = {
            name: None if is_switched_off(name) else _plain(DECLARED[name], getattr(owner(name), name))
            for name in names
        }
        if fallback is not None and owner("output") is self and owner("storage") is fallback:
            values["storage"] = Storage.FILE  # if a script sets a file name, the file is written
        if values["storage"] == Storage.FILE and not _is_set(owner("depth"), "depth"):
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


def _is_set(owner: Options, name: str) -> bool:
    """Whether a property of a scene's settings, or of an operator, has been set."""
    return getattr(owner, "properties", owner).is_property_set(name)


_NAMES = {field.name for field in fields(Settings)}
# Blender reads properties from the annotations of a class and of its bases.
Options.__annotations__ = {
    name: declared(name)
    for name, setting in DECLARED.items()
    if name in _NAMES or getattr(setting, "empties", None) is not None
}
