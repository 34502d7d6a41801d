# SPDX-License-Identifier: GPL-3.0-or-later
"""What the channels of a packed image hold, for each layout."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from ..map_types import AO, BY_NAME, METALLIC, ROUGHNESS, WIDENED_ROUGHNESS, Kind, MapType, Range
from .choices import Pack
from .map_settings import ONE, SMOOTHNESS, ZERO

RGBA = ("red", "green", "blue", "alpha")
"""The channels by name, in their order."""


@dataclass(frozen=True)
class Channel:
    """The content of a channel: a map, or the number `constant` where `map` is empty. is_inverted: 1 - value."""

    map: str = ""
    is_inverted: bool = False
    constant: float = 0.0

    @classmethod
    def of(cls, value: str) -> "Channel":
        """The channel that the value of a setting such as pack_red describes."""
        if value in (ZERO, ONE):
            return cls(constant=float(value == ONE))
        return cls(ROUGHNESS.name, is_inverted=True) if value == SMOOTHNESS else cls(value)


WHITE = Channel(constant=1.0)
"""The content of an alpha that files need not store."""


@dataclass(frozen=True)
class Packing:
    """A layout. suffix, short_suffix: the endings of the names of its image and files, as those of a MapType. channels: red,
    green, blue and alpha."""

    suffix: str
    channels: tuple[Channel, Channel, Channel, Channel]
    short_suffix: str = ""

    @classmethod
    def of(cls, suffix: str, *values: str, short_suffix: str = "") -> "Packing":
        """The layout of the four values of settings such as pack_red."""
        red, green, blue, alpha = map(Channel.of, values)
        return cls(suffix, (red, green, blue, alpha), short_suffix)

    @property
    def maps(self) -> tuple[str, ...]:
        """The maps in it, by name."""
        return tuple(dict.fromkeys(channel.map for channel in self.channels if channel.map))

    @property
    def map_type(self) -> MapType:
        """A map type for the names and the depth of the image."""
        is_unbounded = any(BY_NAME[name].is_unbounded for name in self.maps)
        bounds = Range.SIGNED if is_unbounded else Range.UNIT
        return MapType("PACKED", "Packed", "", Kind.VALUE, self.suffix, self.short_suffix, range=bounds)

    def of_widened_roughness(self) -> "Packing":
        """The same layout with the widened roughness in place of the material's."""
        return replace(
            self,
            channels=tuple(
                replace(channel, map=WIDENED_ROUGHNESS.name) if channel.map == ROUGHNESS.name else channel
                for channel in self.channels
            ),
        )

    def by_name(self) -> dict[str, Channel]:
        """The channels by their names."""
        return dict(zip(RGBA, self.channels, strict=True))


_ORM = Packing.of("orm", AO.name, ROUGHNESS.name, METALLIC.name, ONE, short_suffix="ORM")

PRESETS: Mapping[str, Packing] = MappingProxyType(
    {
        # glTF 2.0 lets occlusion (red) share the image of roughness (green) and metallic (blue). Unreal's usual masks and
        # Godot's ORMMaterial3D have the same order.
        Pack.GLTF: _ORM,
        Pack.UNREAL: _ORM,
        Pack.GODOT: _ORM,
        Pack.URP: Packing.of("metallic_smoothness", METALLIC.name, ZERO, ZERO, SMOOTHNESS),
        # The detail mask in blue is 1 where a detail map shows. Without a mask it shows everywhere.
        Pack.HDRP: Packing.of("mask", METALLIC.name, AO.name, ONE, SMOOTHNESS),
    }
)
CUSTOM_SUFFIX = "packed"
"""The suffix of a layout of one's own."""
