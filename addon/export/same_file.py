# SPDX-License-Identifier: GPL-3.0-or-later
"""Puts maps into the .glb that low objects came from. Their materials and, where these need them, UVs and tangents change.

Everything else stays: nodes, names, other meshes, the order of vertices, skins, shape keys, animations, extras. A vertex whose
corners have several new UVs or tangents is there several times, the further ones behind all that were there.
"""

from collections.abc import Collection, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..core.errors import BakeError
from ..core.file_structure import gltf_files
from ..core.map_types import AO, BASE_COLOR, EMISSION, METALLIC, NORMAL, ROUGHNESS, WIDENED_ROUGHNESS
from ..core.report import Report
from ..output import datablocks
from ..scene import mesh_reader
from . import binary_gltf, map_pictures
from .baked_low import BakedLow
from .binary_gltf import Glb
from .staging import Staged

SAME_UV = 1e-6
"""By how much UVs of a set of the file may differ from those of the bake."""
OPACITY = {"OPAQUE": 0, "MASK": 1, "BLEND": 2}
"""glTF's alpha modes. One material has the last of those that it replaces."""
_OLD_COLORS = "_COLOR_0"
"""What vertex colors become that the base color map has already: glTF multiplies both."""
_KEYS = {
    AO.name: ("occlusionTexture",),
    NORMAL.name: ("normalTexture",),
    EMISSION.name: ("emissiveTexture", "emissiveFactor"),
    BASE_COLOR.name: ("baseColorTexture", "baseColorFactor"),
    **dict.fromkeys(
        (ROUGHNESS.name, WIDENED_ROUGHNESS.name, METALLIC.name),
        ("metallicRoughnessTexture", "metallicFactor", "roughnessFactor"),
    ),
}
"""The keys of a material that hold a map."""
_FACTORS = {"metallicFactor": {METALLIC.name}, "roughnessFactor": {ROUGHNESS.name, WIDENED_ROUGHNESS.name}}
"""The factors of the channels of one texture, by the maps in them."""
_STRENGTH = "KHR_materials_emissive_strength"
_VARIANTS = "KHR_materials_variants"


def with_maps_alone(low: BakedLow) -> BakedLow:
    """A low object for Blender's exporter, whose materials have nothing but the maps: the file has all else of them."""
    if low.reports[0].settings.get("one_material"):  # it has numbers that the old ones had alike
        return low
    return replace(low, materials=[None for _ in low.materials])


def rewritten(source: Path, made: Glb, staged: Sequence[Staged]) -> tuple[bytes, list[str]]:
    """The file at `source` with the maps of low objects that were imported from it, and warnings.

    made: a file that Blender's exporter has written of `staged`, whose materials are taken. Raises BakeError if the objects are
    no longer as they came.
    """
    if packed := gltf_files.compressions(source):
        raise BakeError(
            f"The meshes of {source.name!r} are compressed with {' and '.join(packed)}: save it without that."
        )
    file = Glb.read(source)
    triangles = [_as_imported(_parts(file, number)) for number in range(len(file.tree.get("meshes", ())))]
    staying = binary_gltf.unused(file.tree)
    lows, taken, targets, maps = [one.baked.low for one in staged], [], [], _Maps()
    for one in staged:
        if not any(target.one.baked.low.data == one.baked.low.data for target in targets):  # they show the same maps
            taken.append(_mesh_of(file, triangles, one.baked.low, taken, source))
            targets.append(_Target.of(file, taken[-1], one, lows=lows, maps=maps))
    materials = _Materials(file, made, _materials_of(file, targets), maps)
    materials.notes += [note for target in targets for note in target.notes]
    new_set = max((target.sets for target in targets if target.uv_set is None), default=0)
    for target in targets:
        _put(file, target, materials, new_set)
    binary_gltf.drop_unused(file, staying)
    return file.packed(), list(dict.fromkeys(materials.notes))


def _materials_of(file: Glb, targets: Sequence["_Target"]) -> list[dict]:
    """All materials that meshes show."""
    primitives = (each for target in targets for each in file.tree["meshes"][target.mesh]["primitives"])
    numbers = dict.fromkeys(primitive["material"] for primitive in primitives if "material" in primitive)
    return [file.tree["materials"][number] for number in numbers]


@dataclass(frozen=True)
class _Part:
    """A primitive of a mesh, as Blender's importer reads it."""

    number: int
    """Its place in the mesh."""
    triangles: np.ndarray
    """Its vertices (T, 3) int."""
    share: slice
    """Its triangles among those of the mesh."""


def _parts(file: Glb, mesh: int) -> list[_Part]:
    """The primitives of a mesh that have triangles."""
    result, begin = [], 0
    for number, primitive in enumerate(file.tree["meshes"][mesh]["primitives"]):
        if "indices" in primitive:
            indices = file.whole(primitive["indices"])[:, 0].astype(np.int64)
        else:
            indices = np.arange(file.tree["accessors"][primitive["attributes"]["POSITION"]]["count"])
        if (triangles := _triangles(indices, primitive.get("mode", 4))) is not None:
            result.append(_Part(number, triangles, slice(begin, begin + len(triangles))))
            begin += len(triangles)
    return result


def _triangles(indices: np.ndarray, mode: int) -> np.ndarray | None:
    """The triangles (T, 3) of a primitive, in the order of Blender's importer; None for points and lines."""
    if mode == 4:
        return indices.reshape(-1, 3)
    if mode == 5:  # each second one runs the other way round
        strip = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
        strip[1::2, 1:] = strip[1::2, :0:-1]
        return strip
    if mode == 6:
        return np.stack([np.broadcast_to(indices[0], len(indices) - 2), indices[1:-1], indices[2:]], axis=1)
    return None


def _as_imported(parts: Sequence[_Part]) -> np.ndarray:
    """The triangles (T, 3) of all parts, by the numbers that Blender's importer gives their vertices."""
    rows, begin = [np.zeros((0, 3), np.int64)], 0
    for part in parts:
        found, numbers = np.unique(part.triangles, return_inverse=True)
        rows.append(numbers.reshape(-1, 3) + begin)
        begin += len(found)
    return np.concatenate(rows)


def _kept(triangles: np.ndarray, data: bpy.types.Mesh) -> np.ndarray | None:
    """Which triangles (T,) bool of a file are the faces of a mesh: Blender leaves out those that have a vertex twice, and those
    that are there twice. None if the faces are others."""
    loops = np.empty(len(data.loops), np.int32)
    data.loops.foreach_get("vertex_index", loops)
    if len(loops) != 3 * len(data.polygons):
        return None
    if len(loops) == triangles.size:
        return np.ones(len(triangles), bool) if np.array_equal(triangles.reshape(-1), loops) else None
    if len(loops) > triangles.size:
        return None
    ordered = np.sort(triangles, axis=1)
    whole = (ordered[:, 1:] != ordered[:, :-1]).all(axis=1)
    first = np.zeros(len(triangles), bool)
    first[np.unique(ordered, axis=0, return_index=True)[1]] = True
    fitting = (kept for kept in (whole, whole & first) if np.array_equal(triangles[kept].reshape(-1), loops))
    return next(fitting, None)


def _mesh_of(
    file: Glb, triangles: Sequence[np.ndarray], low: bpy.types.Object, taken: Collection[int], source: Path
) -> int:
    """The number of the mesh that an object has in the file. Raises BakeError if there is none.

    triangles: of each mesh, as `_as_imported` returns them. taken: meshes of other objects; Blender may have made two of one.
    """
    data, fitting = low.data, []
    for number, mesh in enumerate(file.tree["meshes"][: len(triangles)]):
        if _kept(triangles[number], data) is not None:
            name = mesh.get("name", f"Mesh_{number}")
            nodes = {node.get("name") for node in file.tree.get("nodes", ()) if node.get("mesh") == number}
            # Blender adds numbers to names that are there twice.
            is_other = low.name not in nodes, data.name != name, not data.name.startswith(name)
            fitting.append((is_other, _distance(file, mesh, data), number in taken, number))
    if not fitting:
        raise BakeError(
            f"{low.name!r} has other faces than in {source.name!r}, so its maps cannot be put into that file: write another "
            "format, or do not change the mesh."
        )
    return min(fitting)[-1]


def _distance(file: Glb, mesh: dict, data: bpy.types.Mesh) -> float:
    """How far the first vertex is from where the file has it: two meshes may have faces alike."""
    primitive = mesh["primitives"][0]
    place = file.whole(primitive["attributes"]["POSITION"])[_first(file, primitive)].astype(np.float64)
    return float(np.abs(np.array(data.vertices[0].co) - [place[0], -place[2], place[1]]).max())


def _first(file: Glb, primitive: dict) -> int:
    return int(file.whole(primitive["indices"]).min()) if "indices" in primitive else 0


@dataclass(frozen=True)
class _Corners:
    """What the baked mesh has at its corners, in glTF's axes, for all triangles of the file (T, 3, n).

    Attributes:
        uv, tangents, normals: tangents and normals are None without a normal map.
        slots (T,), known (T,): The material slot of each triangle, and whether Blender has it.
    """

    uv: np.ndarray
    tangents: np.ndarray | None
    normals: np.ndarray | None
    slots: np.ndarray
    known: np.ndarray

    @classmethod
    def of(cls, one: Staged, known: np.ndarray, *, has_normals: bool) -> "_Corners":
        """Of a low object. has_normals: whether it has a normal map, which needs tangents."""
        low, layer, data = one.baked.low, next(iter(one.baked.uvs)), one.baked.low.data

        def spread(values: np.ndarray) -> np.ndarray:
            result = np.zeros((len(known), *values.shape[1:]), values.dtype)
            result[known] = values
            return result

        uv = mesh_reader.uvs(data, layer) * [1.0, -1.0] + [0.0, 1.0]
        tangents = normals = None
        if has_normals:
            mesh = mesh_reader.with_tangents(data, layer, low.name, mesh_reader.matrix(low))
            if len(mesh.tangents) == len(uv):
                tangents = spread(_y_up(mesh.tangents).reshape(-1, 3, 4))
                normals = spread(_y_up(mesh.normals).reshape(-1, 3, 3))
        slots = mesh_reader.face_values(data, "material_index").clip(0, max(0, len(low.material_slots) - 1))
        return cls(spread(uv.astype(np.float32).reshape(-1, 3, 2)), tangents, normals, spread(slots), known)

    def values(self, part: _Part, primitive: dict, uv_name: str) -> dict[str, np.ndarray]:
        """What a primitive lacks of it, by the names of attributes. uv_name: of the UVs; "" if it has them."""
        values = {uv_name: self.uv[part.share]} if uv_name else {}
        if self.tangents is not None:
            values["TANGENT"] = self.tangents[part.share]
            if "NORMAL" not in primitive["attributes"]:  # they would be flat, and tangents be ignored
                values["NORMAL"] = self.normals[part.share]
        return values


def _lost(old: dict, baked: set[str]) -> list[str]:
    """What a material loses with textures that baked maps take the place of, in sentences."""
    surface, lost = old.get("pbrMetallicRoughness", {}), []
    shares = [not baked.isdisjoint(names) for names in _FACTORS.values()]
    if "metallicRoughnessTexture" in surface and any(shares) and not all(shares):
        lost.append("roughness" if shares[0] else "metallic")
    if "baseColorTexture" in surface and old.get("alphaMode", "OPAQUE") != "OPAQUE" and BASE_COLOR.name in baked:
        lost += [] if "ALPHA" in baked else ["alpha"]
    return [
        f"Material {old.get('name', '')!r} loses the texture of its {what}, which is in one image with what was baked: bake "
        f"the {what} map as well."
        for what in lost
    ]


FLAT = 1.5 / 255.0
"""By how much the texels of a normal map without detail may differ from straight up: by rounding, and by dither."""


class _Maps:
    """Which maps bakes have. Images are looked at once."""

    def __init__(self):
        self._flat: dict[str, bool] = {}

    def of(self, report: Report) -> set[str]:
        """The names of the maps of a bake that have something to show: a normal map may be flat."""
        parts = [part for how in report.maps.values() for part in (how, *how.get("channels", {}).values())]
        names = {name.upper() for name in report.maps} | {part["map"].upper() for part in parts if part.get("map")}
        if not report.settings["normal"]:
            return names
        if report.image not in self._flat:
            self._flat[report.image] = _is_flat(report)
        return names if self._flat[report.image] else names | {NORMAL.name}


def _is_flat(report: Report) -> bool:
    """Whether the normal map of a bake has no detail."""
    image = datablocks.get(report.image)
    texels = map_pictures.pixels(image) if image is not None else np.zeros((1, 4), np.float32)
    texels = texels[texels[..., 3] > 0.0]
    up = [{"+Z": 1.0, "-Z": 0.0}.get(report.settings[name], 0.5) for name in ("red", "green", "blue")]
    return not len(texels) or bool(np.abs(texels[:, :3] - up).max() <= FLAT)


def _y_up(values: np.ndarray) -> np.ndarray:
    """Vectors (N, n) of Blender in the axes of glTF. A fourth component stays."""
    return np.concatenate([values[:, :1], values[:, 2:3], -values[:, 1:2], values[:, 3:]], axis=1)


@dataclass(frozen=True)
class _Target:
    """A mesh of the file that gets maps."""

    mesh: int
    """Its number."""
    one: Staged
    parts: Sequence[_Part]
    corners: _Corners
    uv_set: int | None
    """The number of the set with the baked UVs; None if there is none."""
    sets: int
    """How many sets its primitives have, at most."""
    notes: Sequence[str]

    @classmethod
    def of(cls, file: Glb, mesh: int, one: Staged, *, lows: Sequence[bpy.types.Object], maps: _Maps) -> "_Target":
        """The mesh of a low object, which others than `lows` do not show then."""
        parts = _parts(file, mesh)
        has_normals = any(NORMAL.name in maps.of(report) for report in one.baked.reports)
        corners = _Corners.of(one, _kept(_as_imported(parts), one.baked.low.data), has_normals=has_normals)
        own, notes = _alone(file, mesh, one.baked.low, lows)
        counts, found = _uv_sets(file, file.tree["meshes"][own]["primitives"], parts, corners)
        return cls(own, one, parts, corners, found, max(counts, default=0), notes)


def _put(file: Glb, target: _Target, materials: "_Materials", new_set: int) -> None:
    """Put the maps of a low object into its mesh in the file. new_set: the number of UVs that it lacks."""
    mesh, corners = file.tree["meshes"][target.mesh], target.corners
    uv_set = new_set if target.uv_set is None else target.uv_set
    for part in target.parts:
        primitive = mesh["primitives"][part.number]
        values = corners.values(part, primitive, f"TEXCOORD_{uv_set}" if target.uv_set is None else "")
        if values:
            _write_corners(file, primitive, part, values, corners.known[part.share])
        for number in range(uv_set):  # sets have no gaps
            primitive["attributes"].setdefault(f"TEXCOORD_{number}", primitive["attributes"][f"TEXCOORD_{uv_set}"])
        slots = corners.slots[part.share][corners.known[part.share]]
        materials.put(primitive, target.one, int(slots[0]) if len(slots) else 0, uv_set)
    if target.one.baked.reports[0].settings.get("one_material"):
        _join_primitives(file, mesh)


def _alone(file: Glb, mesh: int, low: bpy.types.Object, lows: Sequence[bpy.types.Object]) -> tuple[int, list[str]]:
    """The number of a mesh that the nodes of `lows` alone have: a copy, if others show it. Returns a note if it has none."""
    nodes = [node for node in file.tree.get("nodes", ()) if node.get("mesh") == mesh]
    names = [each.name for each in lows if each.data == low.data]
    own = [node for node in nodes if node.get("name") in names]
    if len(nodes) == len(names):
        return mesh, []
    if len(own) != len(names):
        return mesh, [f"Other objects have the mesh of {low.name!r}, and show its maps, too."]
    copy = file.add("meshes", deepcopy(file.tree["meshes"][mesh]))
    for node in own:
        node["mesh"] = copy
    return copy, []


def _uv_sets(
    file: Glb, primitives: Sequence[dict], parts: Sequence[_Part], corners: _Corners
) -> tuple[list[int], int | None]:
    """How many UV sets each primitive has, and the first one that has the baked UVs on all of them, if there is one."""
    counts: list[int] = []
    same: set[int] = set(range(8))
    for part in parts:
        attributes, share, number = primitives[part.number]["attributes"], part.share, 0
        while (name := f"TEXCOORD_{number}") in attributes:
            stored = _numbers(file, attributes[name])[part.triangles]
            off = np.abs(stored - corners.uv[share])[corners.known[share]]
            if off.size and off.max() > SAME_UV:
                same.discard(number)
            number += 1
        counts.append(number)
    return counts, min((number for number in same if number < min(counts)), default=None)


def _numbers(file: Glb, accessor: int) -> np.ndarray:
    """The values of an accessor as float64, also of normalized whole numbers."""
    how, values = file.tree["accessors"][accessor], file.whole(accessor)
    if not how.get("normalized"):
        return values.astype(np.float64)
    return np.maximum(values.astype(np.float64) / np.iinfo(values.dtype).max, -1.0)


def _write_corners(
    file: Glb, primitive: dict, part: _Part, values: Mapping[str, np.ndarray], known: np.ndarray
) -> None:
    """Write attributes of a primitive. values: by their names (T, 3, n). known (T,): which triangles have them."""
    widths = [each.shape[-1] for each in values.values()]
    rows = np.concatenate(list(values.values()), axis=-1).reshape(-1, sum(widths)).astype(np.float32)
    attributes = primitive["attributes"]
    count = file.tree["accessors"][attributes["POSITION"]]["count"]
    indices, origin, rows = _split(part.triangles.reshape(-1), rows, np.repeat(known, 3), count)
    if len(origin) > count:
        _repeat_vertices(file, primitive, origin)
        primitive.pop("mode", None)
        primitive["indices"] = file.add_indices(indices)
    for name, each in zip(values, np.split(rows, np.cumsum(widths)[:-1], axis=1), strict=True):
        attributes[name] = file.add_accessor(np.ascontiguousarray(each))


STEPS = 1e5
"""Of values of corners, by which vertices are told apart: tangents of one vertex may differ by rounding."""


def _split(
    indices: np.ndarray, rows: np.ndarray, known: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices whose corners agree.

    indices (C,), rows (C, n), known (C,): the vertex of each corner, its values, and whether they are known. count: of
    vertices. Returns the new vertex of each corner, which old one each new vertex (V,) is, and their values (V, n).
    """
    keys = np.column_stack([indices[known], np.round(rows[known] * STEPS).astype(np.int64)])
    found, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    owner = found[:, 0]
    is_new = np.r_[np.zeros(min(1, len(owner)), bool), owner[1:] == owner[:-1]]
    number = np.where(is_new, count + np.cumsum(is_new) - 1, owner)
    result, values = indices.copy(), np.zeros((count + int(is_new.sum()), rows.shape[1]), np.float32)
    result[known] = number[inverse.reshape(-1)]
    values[number] = rows[known][first]
    return result, np.concatenate([np.arange(count), owner[is_new]]), values


def _repeat_vertices(file: Glb, primitive: dict, origin: np.ndarray) -> None:
    """Give a primitive the vertices `origin` (V,) of those that it has."""
    for owner in (primitive["attributes"], *primitive.get("targets", ())):
        for name, number in owner.items():
            how = file.tree["accessors"][number]
            like = {key: how[key] for key in ("normalized", "min", "max", "name") if key in how}
            owner[name] = file.add_accessor(file.whole(number)[origin], **like)


def _join_primitives(file: Glb, mesh: dict) -> None:
    """Make one primitive of those with one material, if they have the same attributes and nothing of their own."""
    groups: dict[object, list[dict]] = {}
    for number, primitive in enumerate(mesh["primitives"]):
        is_plain = primitive.get("mode", 4) == 4 and not {"extras", "extensions"} & primitive.keys()
        has_all = "indices" in primitive and "material" in primitive
        groups.setdefault(_shape(file, primitive) if is_plain and has_all else number, []).append(primitive)
    mesh["primitives"] = [_joined(file, group) if len(group) > 1 else group[0] for group in groups.values()]


def _shape(file: Glb, primitive: dict) -> tuple:
    """What primitives must have in common to become one."""

    def kinds(owner: dict) -> tuple:
        hows = {name: file.tree["accessors"][number] for name, number in owner.items()}
        return tuple((name, *map(hows[name].get, ("componentType", "type", "normalized"))) for name in sorted(hows))

    return primitive["material"], kinds(primitive["attributes"]), tuple(map(kinds, primitive.get("targets", ())))


def _joined(file: Glb, group: Sequence[dict]) -> dict:
    """One primitive of several of the same shape, with their vertices one after the other."""
    first, begin, indices = group[0], 0, []
    owners = [[each["attributes"], *each.get("targets", ())] for each in group]
    share_vertices = all(each == owners[0] for each in owners)
    for primitive in group:
        indices.append(file.whole(primitive["indices"])[:, 0].astype(np.int64) + begin)
        begin += 0 if share_vertices else file.tree["accessors"][primitive["attributes"]["POSITION"]]["count"]
    for same in zip(*owners, strict=True) if not share_vertices else ():
        for name in same[0]:
            numbers = [owner[name] for owner in same]
            how, values = file.tree["accessors"][numbers[0]], np.concatenate([file.whole(number) for number in numbers])
            like = {"normalized": how["normalized"]} if "normalized" in how else {}
            if "min" in how:
                like |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
            same[0][name] = file.add_accessor(values, **like)
    first["indices"] = file.add_indices(np.concatenate(indices))
    return first


class _Materials:
    """Takes materials over from the file that Blender has written, each once. notes: warnings.

    replaced: the materials of the file that `made` ones may replace.
    """

    def __init__(self, file: Glb, made: Glb, replaced: Sequence[dict], maps: _Maps):
        self.file, self.made, self.replaced, self.maps = file, made, replaced, maps
        self.notes: list[str] = []
        self._images: dict[bytes, int] = {}
        self._added: list[int] = []

    def put(self, primitive: dict, one: Staged, slot: int, uv_set: int) -> None:
        """Give a primitive the material of a slot of a staged object."""
        texture = next((number for number, (each, _) in enumerate(one.textures) if each == slot), None)
        report = one.baked.report_of(slot)
        number = None if texture is None or report is None else self._of(one)[texture].get("material")
        if number is None:
            return
        baked = self.maps.of(report)
        material = self.made.tree["materials"][number]
        if NORMAL.name not in baked:
            material = {key: value for key, value in material.items() if key not in _KEYS[NORMAL.name]}
        taken = self._taken(material, uv_set) | {"name": one.baked.name_of(slot)}
        if report.settings.get("one_material"):
            material = self._with_surface(taken, has_alpha="ALPHA" in baked)
            if primitive.get("extensions", {}).pop(_VARIANTS, None):
                self.notes.append(f"{one.baked.name!r} has one material, and no variants of it any more.")
            if not primitive.get("extensions", True):
                del primitive["extensions"]
        else:
            old = primitive.get("material")
            before = {} if old is None else self.file.tree["materials"][old]
            material = self._merged(before, taken, baked)
            self.notes += _lost(before, baked)
        primitive["material"] = self._number(material)
        if BASE_COLOR.name in baked and "COLOR_0" in primitive["attributes"]:
            primitive["attributes"][_OLD_COLORS] = primitive["attributes"].pop("COLOR_0")

    def _of(self, one: Staged) -> list[dict]:
        """The primitives of a staged object."""
        tree = self.made.tree
        node = next(node for node in tree["nodes"] if node.get("name") == one.name and "mesh" in node)
        return tree["meshes"][node["mesh"]]["primitives"]

    def _taken(self, material: dict, uv_set: int) -> dict[str, Any]:
        """A material whose textures are in the file."""
        result = deepcopy(material)
        for info in binary_gltf.textures_of(result):
            info["index"] = self._texture(info["index"])
            info["texCoord"] = uv_set
        names = self.file.tree.setdefault("extensionsUsed", [])
        names += [name for name in result.get("extensions", ()) if name not in names]
        if not names:
            del self.file.tree["extensionsUsed"]
        return result

    def _texture(self, number: int) -> int:
        """The number in the file of a texture of the other one."""
        made = self.made.tree
        data = self.made.image(number)
        if data not in self._images:
            texture = made["textures"][number]
            image = made["images"][texture["source"]]
            kept = {key: image[key] for key in ("name", "mimeType") if key in image}
            entry = {"source": self.file.add("images", kept | {"bufferView": self.file.add_view(data)})}
            if "sampler" in texture:
                entry["sampler"] = self.file.add("samplers", deepcopy(made["samplers"][texture["sampler"]]))
            self._images[data] = self.file.add("textures", entry)
        return self._images[data]

    def _with_surface(self, material: dict, *, has_alpha: bool) -> dict[str, Any]:
        """One material with the alpha mode and the sides of those that it replaces."""
        result = {
            key: value for key, value in material.items() if key not in ("alphaMode", "alphaCutoff", "doubleSided")
        }
        mode = max((old.get("alphaMode", "OPAQUE") for old in self.replaced), key=OPACITY.get, default="OPAQUE")
        if has_alpha and OPACITY[mode]:
            result["alphaMode"] = mode
        if any(old.get("doubleSided") for old in self.replaced):
            result["doubleSided"] = True
        return result

    def _merged(self, old: dict, made: dict, baked: set[str]) -> dict[str, Any]:
        """A material of the file with the baked maps, and all else as it was."""
        result = deepcopy(old)
        keys = {key for name in baked for key in _KEYS.get(name, ())}
        surfaces = result.setdefault("pbrMetallicRoughness", {}), made.get("pbrMetallicRoughness", {})
        for owner, source in ((result, made), surfaces):
            for key in keys & {*owner, *source}:
                if key in source:
                    owner[key] = source[key]
                else:
                    owner.pop(key, None)
        before = old.get("pbrMetallicRoughness", {})
        for factor, names in _FACTORS.items():
            if baked.isdisjoint(names):  # the texture is white there
                surfaces[0].pop(factor, None)
                surfaces[0].update({factor: before[factor]} if factor in before else {})
        if not result["pbrMetallicRoughness"]:
            del result["pbrMetallicRoughness"]
        if EMISSION.name in baked:
            extensions = {**result.get("extensions", {})}
            extensions.pop(_STRENGTH, None)
            extensions |= {name: how for name, how in made.get("extensions", {}).items() if name == _STRENGTH}
            result |= {"extensions": extensions}
        return {key: value for key, value in result.items() if key != "extensions" or value}

    def _number(self, material: dict) -> int:
        """The number of a material in the file, which is added if it is not there yet."""
        tree = self.file.tree
        known = (number for number in self._added if tree["materials"][number] == material)
        number = next(known, None)
        if number is None:
            number = self.file.add("materials", material)
            self._added.append(number)
        return number
