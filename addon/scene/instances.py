# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads what objects show besides their own mesh: instances, and the surfaces of curves, text and metaballs."""

from collections.abc import Callable, Iterator, Sequence

import bpy
import numpy as np

from ..mesh.joining import Part, usable
from .mesh_reader import Mesh

SURFACES = {"CURVE", "SURFACE", "FONT", "META"}
"""Object types, besides meshes, that Blender converts to meshes."""
WITH_NODES = {"CURVES", "POINTCLOUD"}
"""Object types that show meshes if geometry nodes create some."""

Read = Callable[[bpy.types.Object, bpy.types.Object, bpy.types.Mesh], Mesh]
"""A function that converts a mesh to arrays. It takes the object that shows the instance, the instanced object and its mesh."""


def may_show(obj: bpy.types.Object) -> bool:
    """Whether `obj` may show a mesh or instances."""
    if obj.type == "EMPTY":
        return obj.instance_type == "COLLECTION" and obj.instance_collection is not None
    return obj.type in {"MESH", *SURFACES} or (obj.type in WITH_NODES and _has_nodes(obj))


def shows_more(obj: bpy.types.Object) -> bool:
    """Whether `obj` may show more than its own mesh."""
    return obj.type != "MESH" or obj.instance_type != "NONE" or _has_nodes(obj) or len(obj.particle_systems) > 0


def shows_itself(obj: bpy.types.Object, *, for_render: bool) -> bool:
    """Whether `obj` shows its own mesh, which objects with instances can hide."""
    if obj.type != "MESH":
        return False
    if obj.instance_type == "NONE" and not len(obj.particle_systems):
        return True
    return obj.show_instancer_for_render if for_render else obj.show_instancer_for_viewport


def sources(obj: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """The objects that `obj` shows, but whose changes Blender does not report as changes of `obj`.

    These are the objects of an instanced collection, and children."""
    if obj.instance_type in {"VERTS", "FACES"}:
        yield from obj.children
    elif obj.instance_type == "COLLECTION" and obj.instance_collection is not None:
        for inner in obj.instance_collection.all_objects:
            yield inner
            yield from sources(inner)


def shown_by(owners: Sequence[bpy.types.Object]) -> dict[int, set[int]]:
    """The session_uids of the owners that show an object as an instance, by the session_uid of that object."""
    found: dict[int, set[int]] = {}
    for owner in owners:
        for obj in sources(owner):
            found.setdefault(obj.session_uid, set()).add(owner.session_uid)
    return found


def shown(depsgraph: bpy.types.Depsgraph, owners: Sequence[bpy.types.Object]) -> Iterator[tuple]:
    """Each instance that `owners` show: the owner's index, the evaluated object shown, and its matrix.

    The object is valid only until the next step of the iteration.
    """
    numbers = {owner.session_uid: number for number, owner in enumerate(owners)}
    for item in depsgraph.object_instances if owners else ():
        if item.is_instance and item.object.type == "MESH":
            number = numbers.get(item.parent.original.session_uid)
            if number is not None:
                yield number, item.object, item.matrix_world


def read(depsgraph: bpy.types.Depsgraph, owners: Sequence[bpy.types.Object], as_mesh: Read) -> list[list[Part]]:
    """The instances of each of `owners`. Each mesh is read once, however many instances it has."""
    found: list[dict[tuple, tuple[Mesh | None, list]]] = [{} for _ in owners]
    for number, obj, matrix in shown(depsgraph, owners):
        # Objects that share a mesh can have different materials.
        key = obj.data.as_pointer(), obj.original.session_uid
        if key not in found[number]:
            try:
                data = obj.to_mesh()
                found[number][key] = as_mesh(owners[number], obj, data) if data.polygons else None, []
            finally:
                obj.to_mesh_clear()
        found[number][key][1].append(matrix.copy())
    parts = [
        [Part(mesh, usable(np.array(matrices, np.float64))) for mesh, matrices in meshes.values() if mesh is not None]
        for meshes in found
    ]
    return [[part for part in of_owner if len(part.matrices)] for of_owner in parts]


def _has_nodes(obj: bpy.types.Object) -> bool:
    return any(modifier.type == "NODES" for modifier in obj.modifiers)
