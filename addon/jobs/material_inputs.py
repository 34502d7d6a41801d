# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake reads of the inputs of the high meshes' materials, and what it leaves out."""

from collections.abc import Sequence

import bpy
import numpy as np

from ..core.errors import shorten_list
from ..core.map_types import BY_NAME, Family
from ..core.material_feeds import DetailFeed, ExactFeed, Feed
from ..core.report import BY_CYCLES, BY_IMPRINT, LEFT_OUT
from ..core.settings import MapSettings
from ..mesh.inputs import Meshes
from ..scene import high_materials, mesh_elements
from ..scene.materials.material_reading import CUT_OUTS, NORMAL


def notes(meshes: Meshes, map_settings: MapSettings) -> list[str]:
    """What could not be read of the high meshes' materials, of those parts that the bake wanted."""
    wanted = _sockets(map_settings)
    sockets = [*wanted, ""] if wanted else []
    sockets += [NORMAL] if map_settings.detail_maps else []
    sockets += [CUT_OUTS]
    notes = (note for material in meshes.materials for socket in sockets for note in material.notes.get(socket, ()))
    return list(dict.fromkeys(notes))


def bare_notes(meshes: Meshes, highs: Sequence[bpy.types.Object], map_settings: MapSettings) -> list[str]:
    """That maps of materials were asked for, and that no high mesh has a material or colors: a sentence, which names attributes
    that may be meant. Maps that are only packed can be so on purpose. highs: the objects, as far as they exist."""
    types = [BY_NAME[name] for name in map_settings.maps]
    asked = [each.title for each in types if each.family is Family.MATERIAL and each.socket]
    plain = [number for number, each in enumerate(meshes.materials, start=1) if each.key == high_materials.Bare.PLAIN]
    if not asked or not meshes.highs or not all(np.isin(high.labels[:, 1], plain).all() for high in meshes.highs):
        return []
    has, their, them = ("has", "its", "it") if len(meshes.highs) == 1 else ("have", "their", "them")
    cause = (
        f"Nothing was found for the {shorten_list(asked)}, which {'is' if len(asked) == 1 else 'are'} one value: "
        f"{shorten_list(repr(high.name) for high in meshes.listed_highs)} {has} no material"
    )
    attributes = dict.fromkeys(name for high in highs for name in mesh_elements.own_attributes(high))
    if not attributes:
        return [f"{cause} and no colors. Give {them} one."]
    return [f"{cause}. The attribute map shows one of {their} attributes: {shorten_list(map(repr, attributes), 6)}."]


def ways(meshes: Meshes, map_settings: MapSettings) -> dict[str, dict[str, str]]:
    """How each input that the maps show is read, as Report.materials has it."""
    sockets, shows_normals = dict.fromkeys(_sockets(map_settings)), map_settings.normal and map_settings.detail_maps
    ways: dict[str, dict[str, str]] = {}
    for material in meshes.materials:
        found = {socket: _way(material.feeds.get(socket)) for socket in sockets}
        if shows_normals and (material.detail is not None or NORMAL in material.notes):
            found[NORMAL] = _way(material.detail)
        if found:
            ways.setdefault(material.name, {}).update(found)
    return ways


def _sockets(map_settings: MapSettings) -> list[str]:
    return [BY_NAME[name].socket for name in map_settings.drawn_maps if BY_NAME[name].socket]


def _way(feed: Feed | DetailFeed | None) -> str:
    if feed is None:
        return LEFT_OUT
    return BY_CYCLES if isinstance(feed, ExactFeed) else BY_IMPRINT
