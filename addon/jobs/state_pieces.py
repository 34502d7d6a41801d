# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake has read, as short hashes with names: the state of a part. part_state compares it with that of now.

All is hashed as the engine gets it, after modifiers, poses and nodes: what changes none of that changes no map.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from types import MappingProxyType
from typing import Any

import bpy
import numpy as np

from ..core import versions
from ..core.contents import short
from ..core.declarations.choices import Method, Pack, Space, Storage
from ..core.map_types import BY_NAME, Family, Kind
from ..core.material_feeds import ExactFeed, HighMaterial, ImageFeed
from ..core.settings import Settings
from ..mesh.cutouts import KEY
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..output import value_encoding
from ..scene import content_keys
from .job import Request

MESH, PLACE, OTHERS, MATERIAL, SETTING = "mesh", "place", "others", "material", "setting"
IMAGE, CODE, PROBLEM = "image", "code", "problem"
"""Kinds of pieces: their names start with one and a colon."""


@dataclass(frozen=True)
class State:
    """What a bake reads, in pieces: hashes by names such as "mesh:high", in the order in which it reads them."""

    pieces: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))

    def of_kind(self, kind: str) -> dict[str, str]:
        """The pieces of a kind, by the rest of their names."""
        start = f"{kind}:"
        return {name.removeprefix(start): key for name, key in self.pieces.items() if name.startswith(start)}

    def to_json(self) -> str:
        """This state in text, as files keep it."""
        return json.dumps(dict(self.pieces), separators=(",", ":"))

    @classmethod
    def of_json(cls, text: str) -> "State | None":
        """The state in a text; None if there is none."""
        try:
            pieces = json.loads(text) if text else None
        except ValueError:
            return None
        return cls(pieces) if isinstance(pieces, dict) else None

    def with_images(self, maps: Mapping[str, str]) -> "State":
        """This state with the images of its maps, as map_contents.note returns them."""
        return State(dict(self.pieces) | {f"{IMAGE}:{name}": key for name, key in maps.items()})

    def joined(self, others: Iterable["State"]) -> "State":
        """This state with the pieces of others that it lacks."""
        pieces = dict(self.pieces)
        for other in others:
            pieces = dict(other.pieces) | pieces
        return State(pieces)


def of_read(request: Request, meshes: Meshes, others: Sequence[str] | None = None) -> State:
    """The state of a bake that has read `meshes`. others: the keys of those that shade it, if they are not in `meshes`."""
    pieces: dict[str, str] = {}
    settings = request.asked
    low = meshes.low if meshes.whole is None else meshes.whole
    _add(pieces, MESH, low.name, _of_mesh(low, labels=settings.map.texture_sets))
    _add(pieces, PLACE, low.name, _of_place(low))
    painted = [_crc(each) for each in (meshes.offset, meshes.straight) if each is not None]
    if painted:
        _add(pieces, MESH, f"{low.name} (vertex groups)", short(painted))
    for mesh in (*meshes.highs, *([meshes.cage] if meshes.cage else [])):
        _add(pieces, MESH, mesh.name, _of_mesh(mesh))
        _add(pieces, PLACE, mesh.name, _of_place(mesh))
    others = list(map(of_other, meshes.others)) if others is None else others
    if others:
        pieces[f"{OTHERS}:"] = short(sorted(others))
    for material in meshes.materials:
        _add(pieces, MATERIAL, material.name, _of_material(material))
    for name, value in deciding(settings).items():
        if name not in _SIZES:
            pieces[f"{SETTING}:{name}"] = short(value)
    pieces[f"{CODE}:"] = versions.code()[:16]
    return State(pieces).joined([of_size(request)])


def of_size(request: Request) -> State:
    """The size of the maps, which each texture set can have for itself."""
    material, sampling = request.job.material, request.asked.sampling
    names = (f"{SETTING}:{name} {material}".strip() for name in _SIZES)
    return State(dict(zip(names, map(short, sampling.size), strict=True)))


def _add(pieces: dict[str, str], kind: str, name: str, key: str) -> None:
    """Add a piece. Those of one name, as a linked object and its override, are told apart by numbers."""
    number, full = 1, f"{kind}:{name}"
    while full in pieces:
        number += 1
        full = f"{kind}:{name} ({number})"
    pieces[full] = key


def of_other(mesh: Mesh) -> str:
    """The key of a mesh that only shades others."""
    clear = [[*_crc(alpha.values), alpha.extension, alpha.outside, alpha.is_smooth] for alpha in mesh.alphas]
    layer = _crc(mesh.layers[KEY]) if KEY in mesh.layers else []
    return short([mesh.checksums("positions", "vertices", "triangles"), _of_place(mesh), layer, clear])


def _of_mesh(mesh: Mesh, *, labels: bool = True) -> str:
    names = ["positions", "vertices", "normals", "triangles", "uv", *(["labels"] if labels else [])]
    layers = [[*key, _crc(values)] for key, values in sorted(mesh.layers.items()) if key != KEY]
    return short([mesh.checksums(*names), layers, mesh.not_finite])


def _crc(values: np.ndarray) -> list[Any]:
    return [content_keys.of_array(values), values.shape]


def _of_place(mesh: Mesh) -> str:
    return short(mesh.to_world.tolist())


def _of_material(material: HighMaterial) -> str:
    return short(_plain({"feeds": material.feeds, "detail": material.detail, "cutout": material.cutout}))


def _plain(value: Any) -> Any:
    """Feeds as plain data, in which images and nodes count by what they show."""
    if isinstance(value, ExactFeed):
        material = _block(bpy.data.materials, value.material)
        tree = material.node_tree if material is not None else None
        key = content_keys.of_tree(tree) if tree is not None else ""
        return [value.socket, value.layers, value.basis, key]
    if isinstance(value, dict):
        return [[name, _plain(value[name])] for name in sorted(value)]
    if is_dataclass(value):
        plain = {each.name: _plain(getattr(value, each.name)) for each in fields(value)}
        if isinstance(value, ImageFeed):
            uid, _, how = value.image.partition(":")
            plain["image"] = [content_keys.of_image(_block(bpy.data.images, int(uid))), how]
        return [type(value).__name__, plain]
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    return [_plain(each) for each in value] if isinstance(value, tuple | list) else value


def _block(blocks: Iterable[bpy.types.ID], uid: int) -> bpy.types.ID | None:
    return next((block for block in blocks if block.session_uid == uid), None)


# Which settings decide what a map shows

_READ = {
    *("uv_layer", "modifiers", "rest_pose", "exact_materials", "detail_maps", "attribute"),
    *("cut_outs", "offset_group", "straight_group", "occluders"),
}
"""Settings that only choose what is read, which is hashed."""
_BESIDE = {
    *("targets", "appearance", "limit", "mips", "low_suffix"),
    *("material", "one_material", "single_user", "connect_maps"),
}
"""Settings of checks, and of what is done with the maps."""
_SIZES = ("width", "height")
_OF_RAYS = ("hit", "extrusion", "max_distance", "directions", "facing_only")
_OF_FAMILIES = {
    "rays": (Family.OPENNESS, Family.THICKNESS, Family.CURVATURE),
    "distance_unit": (Family.OPENNESS, Family.THICKNESS, Family.CURVATURE),
    "two_sided": (Family.OPENNESS, Family.THICKNESS, Family.CURVATURE),
    "ao_distance": (Family.OPENNESS,),
    "ao_fade": (Family.OPENNESS,),
    "floor": (Family.OPENNESS,),
    "bias_angle": (Family.OPENNESS,),
    "thickness_distance": (Family.THICKNESS,),
    "curvature_radius": (Family.CURVATURE,),
}
"""Settings of maps, by name, with the families whose maps they change."""


def deciding(settings: Settings) -> dict[str, Any]:
    """The settings that decide what the maps show and where they are, beside what is read; without those that others make
    meaningless."""
    values = {name: value for name, value in settings.flat().items() if name not in _READ | _BESIDE}
    for name in _meaningless(settings):
        values.pop(name, None)
    return values


def _meaningless(settings: Settings) -> Iterator[str]:
    maps, tracing, sampling, storing = settings.map, settings.tracing, settings.sampling, settings.storing
    drawn = [BY_NAME[name] for name in maps.drawn_maps]
    families = {each.family for each in drawn}
    yield from (name for name, own in _OF_FAMILIES.items() if families.isdisjoint(own))
    if tracing.ao_distance is None:
        yield "ao_fade"
    yield from (name for each in BY_NAME.values() if each not in drawn for name in each.settings)
    if tracing.method == Method.FLATTEN:
        yield from _OF_RAYS
    if maps.space != Space.TANGENT:
        yield "basis"
    if not maps.normal and not any(each.kind is Kind.NORMAL for each in drawn):
        yield from ("red", "green", "blue")
    if maps.pack != Pack.CUSTOM:
        yield from ("pack_red", "pack_green", "pack_blue", "pack_alpha")
    if drawn or not sampling.are_adaptive(tracing.method):
        yield "adaptive"
    if storing.depth != 8 or storing.is_float:
        yield "dither"
    if storing.storage != Storage.FILE:
        yield from ("output", "alpha", "mip_files")
    if not any(value_encoding.needs_range(each, storing) for each in drawn):
        yield "value_range"
    if not sampling.udim:
        yield "tiles"
