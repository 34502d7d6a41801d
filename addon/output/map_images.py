# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the images of the maps of a bake, also the channels of a packed one, for the nodes of materials."""

from collections.abc import Mapping

from ..core.errors import shorten_list
from ..core.map_types import BY_NAME, MapType
from . import datablocks
from .nodes import surface_nodes
from .nodes.image_nodes import MapImage


def are_any(maps: Mapping[str, dict]) -> bool:
    """Whether an input of a material takes one of the maps, as in Report.maps."""
    return any(_parts(name, how) for name, how in maps.items())


def of_report(maps: Mapping[str, dict], space: str) -> tuple[dict[str, MapImage], list[str]]:
    """The images of maps as in Report.maps, by the names in map_types, and warnings about images that are gone or empty.

    A map that is packed as well comes from the packed image: the material then needs one image less. Maps that no input of a
    material takes, and those without a value, are left out. space: as in Settings.
    """
    found: dict[str, MapImage] = {}
    gone, empty = [], []
    for name, how in sorted(maps.items(), key=lambda item: "channels" in item[1]):
        parts = _parts(name, how)
        image = datablocks.get(how["image"])
        if parts and image is None:
            gone.append(how["image"])
            continue
        for channel, part in parts.items():
            map_type = _map_type(part)
            if part.get("empty"):  # an input that it fed would be black
                empty.append(map_type.label)
                continue
            found[map_type.name] = MapImage(
                image,
                role=name,
                label=map_type.label if not channel else "Packed",
                channel=channel.capitalize(),
                is_inverted=part.get("inverted", False),
                midlevel=part["midlevel"],
                scale=part["scale"],
                space=space,
            )
    warnings = []
    if gone:
        warnings.append(
            f"Images that were undone, renamed or deleted are not connected: {shorten_list(map(repr, gone))}."
        )
    if empty:
        warnings.append(f"Maps without a value are not connected: {shorten_list(dict.fromkeys(empty))}.")
    return found, warnings


def _parts(name: str, how: dict) -> dict[str, dict]:
    """The channels of an image of Report.maps that an input of a material takes. "" means the whole image."""
    parts = how["channels"] if "channels" in how else {"": how | {"map": name}}
    return {channel: part for channel, part in parts.items() if surface_nodes.takes(_map_type(part))}


def _map_type(part: dict) -> MapType | None:
    return BY_NAME.get(part.get("map", "").upper())
