# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake reads of the inputs of the high meshes' materials, and what it leaves out."""

from ..core.map_types import BY_NAME
from ..core.material_feeds import ExactFeed, HighMaterial
from ..core.report import BY_CYCLES, BY_IMPRINT, LEFT_OUT
from ..core.settings import MapSettings
from ..mesh.inputs import Meshes


def notes(meshes: Meshes, map_settings: MapSettings) -> list[str]:
    """What could not be read of the high meshes' materials, of those parts that the bake wanted."""
    wanted = _sockets(map_settings)
    sockets = [*wanted, ""] if wanted else []
    sockets += ["Normal"] if map_settings.detail_maps else []
    found = (note for material in meshes.materials for socket in sockets for note in material.notes.get(socket, ()))
    return list(dict.fromkeys(found))


def ways(meshes: Meshes, map_settings: MapSettings) -> dict[str, dict[str, str]]:
    """How each input that the maps show is read, as Report.materials has it."""
    sockets = dict.fromkeys(_sockets(map_settings))
    found: dict[str, dict[str, str]] = {}
    for material in meshes.materials if sockets else ():
        found.setdefault(material.name, {}).update({socket: _way(material, socket) for socket in sockets})
    return found


def _sockets(map_settings: MapSettings) -> list[str]:
    return [BY_NAME[name].socket for name in map_settings.drawn_maps if BY_NAME[name].socket]


def _way(material: HighMaterial, socket: str) -> str:
    feed = material.feeds.get(socket)
    if feed is None:
        return LEFT_OUT
    return BY_CYCLES if isinstance(feed, ExactFeed) else BY_IMPRINT
