# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings in the form in which the list of maps draws them: a switch for each map, and distances with units."""

from bpy.props import BoolProperty

from ...core import map_types
from ...core.declarations import kinds
from ...core.declarations.all_settings import DECLARED
from ...core.declarations.choices import DistanceUnit
from ...core.map_types import MapType
from ..translations import LABEL
from .declared_properties import declared

REACHES = tuple(name for name, setting in DECLARED.items() if isinstance(setting, kinds.Reach))
"""The settings in the unit of the setting distance_unit."""


def switch(name: str) -> str:
    """The name of the property that is on while the map `name` is in the setting `maps`."""
    return f"bakes_{name.lower()}"


def length(name: str) -> str:
    """The name of the property that shows the setting `name` as a length."""
    return f"{name}_length"


class MapList:
    """Properties that stand for a part of the setting `maps`, or for a distance. Their values are not stored."""

    def shown(self, reach: str) -> str:
        """The property that shows a setting of REACHES in the chosen unit."""
        return length(reach) if self.distance_unit == DistanceUnit.SCENE else reach


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
MapList.__annotations__ = {switch(map_type.name): _switch_of(map_type) for map_type in map_types.OTHERS} | {
    length(name): _length_of(name) for name in REACHES
}
