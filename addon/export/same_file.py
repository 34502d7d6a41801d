# SPDX-License-Identifier: GPL-3.0-or-later
"""Puts maps into the .glb that low objects came from. Their materials and, where these need them, UVs and tangents change.

Everything else stays: nodes, names, other meshes, the order of vertices, skins, shape keys, animations, extras. A vertex whose
corners have several new UVs or tangents is there several times, the further ones behind all that were there.
"""

from collections.abc import Collection, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from ..core.errors import BakeError, shorten_list
from ..core.file_structure import gltf_files
from ..core.map_types import NORMAL
from ..scene import mesh_reader
from . import binary_gltf
from .baked_low import BakedLow
from .binary_gltf import Glb
from .primitives import (
    Part,
    as_imported,
    faces_kept,
    join_primitives,
    numbers_of,
    parts_of,
    surface_of,
    write_corners,
)
from .same_materials import Maps, Materials
from .staging import Staged

SAME_UV = 1e-6
"""By how much UVs of a set of the file may differ from those of the bake."""
SAME_POINT = 1e-5
"""By how much points may differ from the file's, by the largest coordinate."""


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
    triangles = [as_imported(parts_of(file, number)) for number in range(len(file.tree.get("meshes", ())))]
    staying = binary_gltf.unused(file.tree)
    lows, taken, targets, maps = [one.baked.low for one in staged], [], [], Maps()
    for one in staged:
        if not any(target.one.baked.low.data == one.baked.low.data for target in targets):  # they show the same maps
            taken.append(_mesh_of(file, triangles, one.baked.low, taken, source))
            targets.append(_Target.of(file, taken[-1], one, lows=lows, maps=maps))
    materials = Materials(file, made, _materials_of(file, targets), maps)
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


def _mesh_of(
    file: Glb, triangles: Sequence[np.ndarray], low: bpy.types.Object, taken: Collection[int], source: Path
) -> int:
    """The number of the mesh that an object has in the file. Raises BakeError if there is none, or if it cannot be told.

    triangles: of each mesh, as `as_imported` returns them. taken: meshes of other objects; Blender may have made two of one.
    """
    data, fitting, numbered = low.data, [], _by_number(file, low.data.name)
    for number, mesh in enumerate(file.tree.get("meshes", ())[: len(triangles)]):
        if faces_kept(triangles[number], data) is not None:
            name = mesh.get("name") or f"Mesh_{number}"
            nodes = {node.get("name") for node in file.tree.get("nodes", ()) if node.get("mesh") == number}
            # Blender adds numbers to names that are there twice.
            is_other = low.name not in nodes, data.name != name, not data.name.startswith(name)
            fitting.append(((is_other, _distance(file, number, data), number != numbered), number in taken, number))
    if not fitting:
        raise BakeError(
            f"{low.name!r} has other faces than in {source.name!r}, so its maps cannot be put into that file: write another "
            "format, or do not change the mesh."
        )
    best = min(fitting)
    if [how for how, *_ in fitting].count(best[0]) > 1:
        raise BakeError(
            f"{source.name!r} has several meshes like that of {low.name!r}, and none has its name: give each a name of its own."
        )
    return best[-1]


def _by_number(file: Glb, name: str) -> int | None:
    """The mesh of which Blender's importer has made the mesh `name`, by the number that it added to it."""
    nodes, made = file.tree.get("nodes", ()), []
    base, dot, number = name.rpartition(".")
    is_numbered = bool(dot) and number.isdecimal()
    children = {child for node in nodes for child in node.get("children", ())}
    waiting = [place for place in reversed(range(len(nodes))) if place not in children]
    while waiting:  # in the order of the importer
        node = nodes[waiting.pop()]
        waiting += reversed(node.get("children", ()))
        mesh = file.tree["meshes"][node["mesh"]] if "mesh" in node else {}
        is_own = any(each.get("targets") for each in mesh.get("primitives", ()))  # then Blender has one for each node
        key = node.get("mesh"), node.get("skin")
        if mesh and mesh.get("name") == (base if is_numbered else name) and (is_own or key not in made):
            made.append(key)
    place = int(number) if is_numbered else 0
    return made[place][0] if place < len(made) else None


def _distance(file: Glb, number: int, data: bpy.types.Mesh) -> float:
    """How far the first vertex is from where mesh `number` of the file has it: two meshes may have faces alike."""
    part = next(part for part in parts_of(file, number) if len(part.triangles))
    primitive = file.tree["meshes"][number]["primitives"][part.number]
    place = numbers_of(file, primitive["attributes"]["POSITION"])[part.triangles.min()]
    return float(np.abs(np.array(data.vertices[part.vertex].co) - _z_up(place[None])[0]).max())


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
    def of(cls, file: Glb, mesh: int, parts: Sequence[Part], one: Staged, *, has_normals: bool) -> "_Corners":
        """Of a low object that is a mesh of the file. has_normals: whether it has a normal map, which needs tangents."""
        low, layer, data = one.baked.low, next(iter(one.baked.uvs)), one.baked.low.data
        known = faces_kept(as_imported(parts), data)

        def spread(values: np.ndarray) -> np.ndarray:
            result = np.zeros((len(known), *values.shape[1:]), values.dtype)
            result[known] = values
            return result

        uv = mesh_reader.uvs(data, layer)
        tangents = normals = None
        if has_normals:
            surface = surface_of(file, file.tree["meshes"][mesh]["primitives"], parts)
            places, vertices, own_normals = (values[known].reshape(-1, *values.shape[2:]) for values in surface)
            places, own_normals = _z_up(places), _z_up(own_normals)
            points = mesh_reader.points(data)
            off = np.abs(places - points[vertices])
            if off.max(initial=0.0) <= SAME_POINT * np.abs(points).max(initial=0.0):
                read = mesh_reader.with_tangents(data, layer, low.name, mesh_reader.matrix(low))
            else:  # Blender's importer moves the points of skinned meshes: those of the file have other tangents
                points[vertices] = places
                with mesh_reader.of_triangles(points, vertices, own_normals, uv, layer) as own:
                    read = mesh_reader.with_tangents(own, layer, low.name, mesh_reader.matrix(low))
            if len(read.tangents) == len(uv):
                tangents = spread(_y_up(read.tangents).reshape(-1, 3, 4))
                normals = spread(_y_up(read.normals).reshape(-1, 3, 3))
        uv = uv * [1.0, -1.0] + [0.0, 1.0]
        slots = mesh_reader.face_values(data, "material_index").clip(0, max(0, len(low.material_slots) - 1))
        return cls(spread(uv.astype(np.float32).reshape(-1, 3, 2)), tangents, normals, spread(slots), known)

    def values(self, part: Part, primitive: dict, uv_name: str) -> dict[str, np.ndarray]:
        """What a primitive lacks of it, by the names of attributes. uv_name: of the UVs; "" if it has them."""
        values = {uv_name: self.uv[part.share]} if uv_name else {}
        if self.tangents is not None:
            values["TANGENT"] = self.tangents[part.share]
            if "NORMAL" not in primitive["attributes"]:  # they would be flat, and tangents be ignored
                values["NORMAL"] = self.normals[part.share]
        return values


def _y_up(values: np.ndarray) -> np.ndarray:
    """Vectors (N, n) of Blender in the axes of glTF. A fourth component stays."""
    return np.concatenate([values[:, :1], values[:, 2:3], -values[:, 1:2], values[:, 3:]], axis=1)


def _z_up(values: np.ndarray) -> np.ndarray:
    """Vectors (N, 3) of glTF in the axes of Blender."""
    return values[:, [0, 2, 1]] * [1.0, -1.0, 1.0]


@dataclass(frozen=True)
class _Target:
    """A mesh of the file that gets maps."""

    mesh: int
    """Its number."""
    one: Staged
    parts: Sequence[Part]
    corners: _Corners
    uv_set: int | None
    """The number of the set with the baked UVs; None if there is none."""
    sets: int
    """How many sets its primitives have, at most."""
    notes: Sequence[str]

    @classmethod
    def of(cls, file: Glb, mesh: int, one: Staged, *, lows: Sequence[bpy.types.Object], maps: Maps) -> "_Target":
        """The mesh of a low object, which others than `lows` do not show then."""
        parts = parts_of(file, mesh)
        has_normals = any(NORMAL.name in maps.of(report) for report in one.baked.reports)
        corners = _Corners.of(file, mesh, parts, one, has_normals=has_normals)
        own, notes = _alone(file, mesh, one.baked.low, lows)
        counts, found = _uv_sets(file, file.tree["meshes"][own]["primitives"], parts, corners)
        return cls(own, one, parts, corners, found, max(counts, default=0), notes)


def _put(file: Glb, target: _Target, materials: Materials, new_set: int) -> None:
    """Put the maps of a low object into its mesh in the file. new_set: the number of UVs that it lacks."""
    mesh, corners = file.tree["meshes"][target.mesh], target.corners
    uv_set = new_set if target.uv_set is None else target.uv_set
    for part in target.parts:
        primitive = mesh["primitives"][part.number]
        values = corners.values(part, primitive, f"TEXCOORD_{uv_set}" if target.uv_set is None else "")
        if values:
            write_corners(file, primitive, part, values, corners.known[part.share])
        for number in range(uv_set):  # sets have no gaps
            primitive["attributes"].setdefault(f"TEXCOORD_{number}", primitive["attributes"][f"TEXCOORD_{uv_set}"])
        slots = corners.slots[part.share][corners.known[part.share]]
        materials.put(primitive, target.one, int(slots[0]) if len(slots) else 0, uv_set)
    if target.one.baked.reports[0].settings.get("one_material"):
        join_primitives(file, mesh)


def _alone(file: Glb, mesh: int, low: bpy.types.Object, lows: Sequence[bpy.types.Object]) -> tuple[int, list[str]]:
    """The number of a mesh that the nodes of `lows` alone have: a copy, if others show it. Returns a note if it has none."""
    nodes = [node for node in file.tree.get("nodes", ()) if node.get("mesh") == mesh]
    names = [each.name for each in lows if each.data == low.data]
    own = [node for node in nodes if node.get("name") in names]
    if len(nodes) == len(names):
        return mesh, []
    if len(own) != len(names):
        shown_by = shorten_list(repr(node.get("name", "")) for node in nodes)
        return mesh, [f"In the file, {shown_by} have the mesh of {low.name!r}, and all of them show its maps."]
    copy = file.add("meshes", deepcopy(file.tree["meshes"][mesh]))
    for node in own:
        node["mesh"] = copy
    return copy, []


def _uv_sets(
    file: Glb, primitives: Sequence[dict], parts: Sequence[Part], corners: _Corners
) -> tuple[list[int], int | None]:
    """How many UV sets each primitive has, and the first one that has the baked UVs on all of them, if there is one."""
    counts: list[int] = []
    same: set[int] = set(range(8))
    for part in parts:
        attributes, share, number = primitives[part.number]["attributes"], part.share, 0
        while (name := f"TEXCOORD_{number}") in attributes:
            stored = numbers_of(file, attributes[name])[part.triangles]
            off = np.abs(stored - corners.uv[share])[corners.known[share]]
            if off.size and off.max() > SAME_UV:
                same.discard(number)
            number += 1
        counts.append(number)
    return counts, min((number for number in same if number < min(counts)), default=None)
