# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake has read, as short hashes with names: the state of a part. part_state compares it with that of now.

All is hashed as the engine gets it, after modifiers, poses and nodes: what changes none of that changes no map.
"""

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from types import MappingProxyType
from typing import Any

import bpy
import numpy as np

from ..core import versions
from ..core.contents import short
from ..core.declarations.choices import Method, Pack, Space, Storage, VertexDomain, Wrap
from ..core.map_types import BY_NAME, Family, Kind, Labeled, Range
from ..core.material_feeds import ExactFeed, HighMaterial, ImageFeed
from ..core.settings import Settings, StorageSettings
from ..engine import rounded_edges
from ..mesh.cutouts import KEY
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..output import map_names, value_encoding
from ..scene import content_keys
from ..scene.materials import exact_keys
from .job import Request

MESH, UVS, PLACE, OTHERS, MATERIAL, SETTING = "mesh", "uvs", "place", "others", "material", "setting"
IMAGE, TARGET, ORDER, CODE, PROBLEM = "image", "target", "order", "code", "problem"
"""Kinds of pieces: their names start with one and a colon."""


@dataclass(frozen=True)
class State:
    """What a bake reads, in pieces: hashes by names such as "mesh:high", in the order in which it reads them."""

    pieces: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    earlier: tuple["State", ...] = ()
    """Of a low object that several sets bake: the states of its maps in other images."""

    def of_kind(self, kind: str) -> dict[str, str]:
        """The pieces of a kind, by the rest of their names."""
        start = f"{kind}:"
        return {name.removeprefix(start): key for name, key in self.pieces.items() if name.startswith(start)}

    @property
    def images(self) -> dict[str, str]:
        """What tells its maps from others, also those of earlier states, by the names of images."""
        return {name: key for state in (*self.earlier, self) for name, key in state.of_kind(IMAGE).items()}

    def after(self, before: "State | None") -> "State":
        """This state, with those before it whose maps are in other places, which are still there."""
        states = [before, *before.earlier] if before is not None else []
        filled = self._filled()
        apart = [
            State(each.pieces) for each in states if filled and each._filled() and filled.isdisjoint(each._filled())
        ]
        return State(self.pieces, tuple(apart[: MOST - 1]))

    def _filled(self) -> set[str]:
        """Where the maps are: the names of images, what tells them from others, and the attribute of points."""
        images = self.of_kind(IMAGE)
        no_attribute = {None, short(VertexDomain.NONE)}
        attribute = (
            {f"{SETTING}:vertex_domain"} if self.pieces.get(f"{SETTING}:vertex_domain") not in no_attribute else {}
        )
        return {*images, *images.values(), *attribute}

    def to_json(self) -> str:
        """This state in text, as files keep it."""
        states = [dict(each.pieces) for each in (self, *self.earlier)]
        return json.dumps(states if self.earlier else states[0], separators=(",", ":"))

    @classmethod
    def of_json(cls, text: str) -> "State | None":
        """The state in a text; None if there is none."""
        try:
            found = json.loads(text) if text else None
        except ValueError:
            return None
        states = found if isinstance(found, list) else [found]
        if not states or not all(isinstance(pieces, dict) for pieces in states):
            return None
        return cls(states[0], tuple(map(cls, states[1:])))

    def with_images(self, maps: Mapping[str, str]) -> "State":
        """This state with the images of its maps, as map_contents.note returns them."""
        return State(dict(self.pieces) | {f"{IMAGE}:{name}": key for name, key in maps.items()})

    def joined(self, others: Iterable["State"]) -> "State":
        """This state with the pieces of others that it lacks."""
        pieces = dict(self.pieces)
        for other in others:
            pieces = dict(other.pieces) | pieces
        return State(pieces)


_NUMBERED = {Labeled.OBJECTS, Labeled.PARTS}
"""What has numbers, and so colors, in the order of the high objects."""
MOST = 8
"""The states that a low object keeps."""
SUMS = 4
"""The weighted sums that are kept of UVs which a modifier makes."""
EXACT = 2
"""The length of a key of UVs that are the same only to the bit, and where those of others are alike."""
_CHUNK = 1 << 16
"""UVs that are summed at once."""


def of_read(request: Request, meshes: Meshes, others: "Sequence[Other] | None" = None) -> State:
    """The state of a bake that has read `meshes`. others: those that shade it, if they are not in `meshes`."""
    pieces: dict[str, str] = {}
    settings = request.asked
    low = meshes.low if meshes.whole is None else meshes.whole
    is_made = not meshes.is_own_base and _is_made(request.job.low)
    key = _of_mesh(low, smooth=meshes.smooth_normals, labels=settings.map.texture_sets)
    _add(pieces, MESH, low.name, short([key, "base"]) if meshes.is_own_base else key)
    _add(pieces, UVS, low.name, _of_uvs(low, is_made=is_made))
    boxed = [name for name in settings.map.drawn_maps if BY_NAME[name].range is Range.BOX]  # points, also as floats
    is_of_world = settings.map.space == Space.WORLD and bool(boxed)
    is_of_world = is_of_world or any(map(_looks_around, meshes.materials))
    _add(pieces, PLACE, low.name, short(_place(low, None if is_of_world else low)))
    painted = [_crc(each) for each in (meshes.offset, meshes.straight) if each is not None]
    if painted:
        _add(pieces, MESH, f"{low.name} (vertex groups)", short(painted))
    shows_object = any(feed.is_of_object for material in meshes.materials for feed in _exact_feeds(material))
    objects = [*request.job.highs, *([request.job.cage] if meshes.cage else [])]
    owners = request.job.highs if shows_object else []
    numbered = []
    for number, mesh in enumerate((*meshes.highs, *([meshes.cage] if meshes.cage else []))):
        is_made = number >= len(objects) or _is_made(objects[number])
        key = _of_mesh(mesh)
        _add(pieces, MESH, mesh.name, short([key, _of_object(owners[number])]) if number < len(owners) else key)
        uvs, place = _of_uvs(mesh, is_made=is_made), short(_place(mesh, low))
        _add(pieces, UVS, mesh.name, uvs)
        numbered.append([key, "" if is_made else uvs, place])
        _add(pieces, PLACE, mesh.name, place)
        if mesh.is_floater and any(BY_NAME[name].family is Family.OPENNESS for name in settings.map.drawn_maps):
            _add(pieces, MESH, f"{mesh.name} (floater)", "1")
    if any(BY_NAME[name].labeled in _NUMBERED for name in settings.map.drawn_maps):
        pieces[f"{ORDER}:"] = short(numbered[: len(meshes.highs)])
    others = list(map(Other.of, meshes.others)) if others is None else others
    if others:
        pieces[f"{OTHERS}:"] = short(sorted([each.key, (each.place - low.to_world[:3, 3]).tolist()] for each in others))
    sockets = {BY_NAME[name].socket for name in settings.map.drawn_maps}
    for material in meshes.materials:
        _add(pieces, MATERIAL, material.name, _of_material(material, sockets))
    values = deciding(settings)
    if settings.map.edge_radius and settings.sampling.wrap == Wrap.NONE and not rounded_edges.has_hard_edges(meshes):
        values["edge_radius"] = 0.0  # it rounds nothing
    for name, value in values.items():
        if name not in _SIZES:
            pieces[f"{SETTING}:{name}"] = short(value)
    pieces[f"{CODE}:"] = versions.code()[:16]
    return State(pieces).joined([of_texture(request)])


def of_texture(request: Request) -> State:
    """What each texture set can have for itself: the size of its maps, and which image and file they fill.

    The name of an image that a low object has alone is no piece: one that shows the same under a former name is as good.
    """
    material, sampling, storing = request.job.material, request.asked.sampling, request.settings.storing
    names = (f"{SETTING}:{name} {material}".strip() for name in _SIZES)
    pieces = dict(zip(names, map(short, sampling.size), strict=True))
    slots = " ".join(map(str, request.job.slots or ()))  # not the material, which may be renamed
    pieces[f"{TARGET}:image {slots}"] = short(storing.image if request.is_shared else "")
    if storing.storage == Storage.FILE:
        pieces[f"{TARGET}:file {slots}"] = short(storing.output)
    return State(pieces)


def _add(pieces: dict[str, str], kind: str, name: str, key: str) -> None:
    """Add a piece. Those of one name, as a linked object and its override, are told apart by numbers."""
    number, full = 1, f"{kind}:{name}"
    while full in pieces:
        number += 1
        full = f"{kind}:{name} ({number})"
    pieces[full] = key


@dataclass(frozen=True)
class Other:
    """A mesh that only shades others.

    Attributes:
        key: Of all but where it is.
        place: (3,), in world space.
    """

    key: str
    place: np.ndarray

    @classmethod
    def of(cls, mesh: Mesh) -> "Other":
        """Of a mesh that was read."""
        clear = [[*_crc(alpha.values), alpha.extension, alpha.outside, alpha.is_smooth] for alpha in mesh.alphas]
        layer = _crc(mesh.layers[KEY]) if KEY in mesh.layers else []
        shape = mesh.checksums("positions", "vertices", "triangles")
        return cls(short([shape, mesh.to_world[:3, :3].tolist(), layer, clear]), mesh.to_world[:3, 3])


def _is_made(obj: bpy.types.Object) -> bool:
    """Whether modifiers, or other objects, make the mesh of an object."""
    return obj.type != "MESH" or len(obj.modifiers) > 0


def _all_uvs(mesh: Mesh) -> np.ndarray | None:
    """The UVs of a mesh, and those that its materials read, (C, 2)."""
    found = [mesh.uv, *(mesh.layers[key] for key in sorted(mesh.layers) if _is_uvs(mesh, key))]
    found = [uvs for uvs in found if uvs is not None]
    return np.concatenate(found) if found else None


def _is_uvs(mesh: Mesh, key: tuple) -> bool:
    return key != KEY and mesh.layers[key].ndim == 2 and mesh.layers[key].shape[1] == 2


def _of_uvs(mesh: Mesh, *, is_made: bool) -> str:
    """The key of the UVs of a mesh, which `are_same_uvs` compares. is_made: whether modifiers make them."""
    uvs = _all_uvs(mesh)
    return of_made_uvs(uvs) if is_made else of_uvs(uvs)


def of_uvs(uvs: np.ndarray | None) -> str:
    """The key of UVs (C, 2) that are the same only to the bit."""
    return "-" if uvs is None or not len(uvs) else json.dumps([content_keys.of_array(uvs), len(uvs)])


def of_made_uvs(uvs: np.ndarray | None) -> str:
    """The key of UVs (C, 2) that modifiers make: Bevel's differ in their last bit each time."""
    if uvs is None or not len(uvs):
        return "-"
    weights = np.random.default_rng(1).uniform(-1.0, 1.0, (_CHUNK * 2, SUMS))
    starts = range(0, len(uvs), _CHUNK)
    of_chunks = np.random.default_rng(2).uniform(0.5, 1.0, len(starts))  # so that two chunks cannot be exchanged
    sums = np.zeros(SUMS)
    for start, weight in zip(starts, of_chunks, strict=True):
        values = np.nan_to_num(uvs[start : start + _CHUNK].ravel().astype(np.float64))
        with np.errstate(
            over="ignore", invalid="ignore"
        ):  # of UVs beyond all measures, which are compared by their hash
            sums += weight * (values @ weights[: len(values)])
    most = float(np.abs(np.nan_to_num(uvs)).max())
    return json.dumps([content_keys.of_array(uvs), len(uvs), most, *sums.tolist()], separators=(",", ":"))


def are_same_uvs(then: str, now: str) -> bool:
    """Whether two keys are of the same UVs; but for the last bit of some, if modifiers make both."""
    if then == now or "-" in {then, now}:
        return then == now
    before, after = json.loads(then), json.loads(now)
    if min(len(before), len(after)) == EXACT:
        return before[:EXACT] == after[:EXACT]
    (_, count, most, *before), (_, count_now, _, *after) = before, after
    # Seven sigma of a last bit that turns in each value, below 1: what a change of one UV by 1e-3 exceeds up to millions.
    rounding = 1.5 * np.finfo(np.float32).eps * max(1.0, most) * np.sqrt(count)
    return count == count_now and bool(np.abs(np.subtract(before, after)).max() < rounding)


def _of_mesh(mesh: Mesh, *, smooth: np.ndarray | None = None, labels: bool = True) -> str:
    """The key of a mesh without its UVs, which have a piece of their own.

    Args:
        smooth: The vertex normals of a low mesh. Of a high one, it counts who computes its normals: they are computed anew
            where faces are turned over or vertices joined.
    """
    names = ["positions", "vertices", "normals", "triangles", *(["labels"] if labels else [])]
    counted = [key for key in sorted(mesh.layers) if key != KEY]
    layers = [[*key, [] if _is_uvs(mesh, key) else _crc(mesh.layers[key])] for key in counted]
    facts = [
        mesh.normals_domain if smooth is None else _crc(smooth),
        mesh.not_finite,
        mesh.without_normals,
        mesh.instances,
    ]
    return short([mesh.checksums(*names), layers, facts])


def _crc(values: np.ndarray) -> list[Any]:
    return [content_keys.of_array(values), values.shape]


def _place(mesh: Mesh, beside: Mesh | None) -> list[Any]:
    """Where a mesh is, relative to another one or in the scene: all arithmetic of a bake starts at the meshes, so that nothing
    changes if all of them are moved by the same step."""
    offset = mesh.to_world[:3, 3] - (0.0 if beside is None else beside.to_world[:3, 3])
    return [mesh.to_world[:3, :3].tolist(), offset.tolist()]


def _looks_around(material: HighMaterial) -> bool:
    """Whether nodes of a material may look at where in the scene a point is."""
    return any(_of_exact(feed)[1] for feed in _exact_feeds(material))


def _exact_feeds(material: HighMaterial) -> list[ExactFeed]:
    feeds = [*material.feeds.values(), material.detail, material.cutout and material.cutout.feed]
    return [feed for feed in feeds if isinstance(feed, ExactFeed)]


def _of_object(obj: bpy.types.Object) -> list[Any]:
    """What nodes read of an object itself, as cycles_values gives it to Cycles."""
    own = {name: value for name, value in obj.items() if isinstance(value, int | float) or hasattr(value, "to_list")}
    return [list(obj.color), obj.pass_index, [[name, content_keys.plain_value(own[name])] for name in sorted(own)]]


def _of_exact(feed: ExactFeed) -> tuple[str, bool]:
    """The key of a value that Cycles evaluates, and whether it may change with the place in the scene."""
    material = _block(bpy.data.materials, feed.material)
    return exact_keys.of_socket(material, feed.socket) if material is not None else ("", False)


def _of_material(material: HighMaterial, sockets: Collection[str]) -> str:
    """The key of a material. sockets: those that maps show: faces without a material have values for others as well."""
    feeds = {socket: feed for socket, feed in material.feeds.items() if socket in sockets}
    return short(_plain({"feeds": feeds, "detail": material.detail, "cutout": material.cutout}))


def _plain(value: Any) -> Any:
    """Feeds as plain data, in which images and nodes count by what they show."""
    if isinstance(value, ExactFeed):
        return [value.socket, value.layers, value.basis, *_of_exact(value)]
    if isinstance(value, dict):
        return [[name, _plain(value[name])] for name in sorted(value)]
    if is_dataclass(value):
        plain = {each.name: _plain(getattr(value, each.name)) for each in fields(value)}
        if isinstance(value, ImageFeed):
            uid, _, how = value.image.partition(":")
            plain["image"] = [content_keys.of_image(_block(bpy.data.images, int(uid))), how]
        return [type(value).__name__, plain]
    if isinstance(value, float):  # the values of faces without a material have more digits than nodes
        return float(np.float32(value)) if np.isfinite(value) else str(value)
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
    *("material", "one_material", "single_user", "connect_maps", "export_webp", "export_ktx2"),
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
    meaningless. Those of compressors are lists, with what they mean for each map."""
    stored = [each.storing for each in map_names.settings_by_map(settings.stored(dither=True)).values()]
    values = {name: value for name, value in settings.flat().items() if name not in _READ | _BESIDE}
    values["compression"] = [str(each.compression) for each in stored if each.is_blocks]
    values["quality"] = [each.quality for each in stored if each.is_lossy and not each.is_blocks]
    for name in _meaningless(settings, stored):
        values.pop(name, None)
    return values


def _meaningless(settings: Settings, stored: Sequence[StorageSettings]) -> Iterator[str]:
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
    if not any(each.dither and each.depth == 8 for each in stored):
        yield "dither"
    if storing.storage != Storage.FILE:
        yield from ("output", "alpha", "mip_files")
    if not storing.is_auto:
        yield from ("format", "most_degrees", "most_steps")
    yield "lossy_normals"  # which decides the quality of one map
    if any(each.is_blocks for each in stored):  # files of blocks have all levels
        yield "mip_files"
    if not any(value_encoding.needs_range(each, storing) for each in drawn):
        yield "value_range"
    if not sampling.udim:
        yield "tiles"
