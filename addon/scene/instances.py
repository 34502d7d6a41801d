# SPDX-License-Identifier: GPL-3.0-or-later
"""What objects show beside a mesh of their own: instances, and the surfaces of curves, text and metaballs."""

from collections.abc import Callable, Iterator, Sequence

import bpy
import numpy as np

from ..mesh.joining import Part, standing
from .mesh_reader import Mesh

SURFACES = {"CURVE", "SURFACE", "FONT", "META"}
"""Types of objects, beside meshes, that Blender makes meshes of."""
WITH_NODES = {"CURVES", "POINTCLOUD"}
"""Types that show meshes if geometry nodes make some."""

Read = Callable[[bpy.types.Object, bpy.types.Object, bpy.types.Mesh], Mesh]
"""From the object that shows a mesh, the one that is shown, and the mesh, to what is to be known of it."""


def may_show(obj: bpy.types.Object) -> bool:
    """Whether `obj` may show a mesh, or instances."""
    if obj.type == "EMPTY":
        return obj.instance_type == "COLLECTION" and obj.instance_collection is not None
    return obj.type in {"MESH", *SURFACES} or (obj.type in WITH_NODES and _has_nodes(obj))


def shows_more(obj: bpy.types.Object) -> bool:
    """Whether `obj` may show more than a mesh of its own."""
    return obj.type != "MESH" or obj.instance_type != "NONE" or _has_nodes(obj) or len(obj.particle_systems) > 0


def shows_itself(obj: bpy.types.Object, *, for_render: bool) -> bool:
    """Whether `obj` shows its own mesh: one that makes instances of others may be no more than their place."""
    if obj.type != "MESH":
        return False
    if obj.instance_type == "NONE" and not len(obj.particle_systems):
        return True
    return obj.show_instancer_for_render if for_render else obj.show_instancer_for_viewport


def sources(obj: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """The objects that `obj` shows by what Blender does not count as a change of `obj`: a collection's, and its children."""
    if obj.instance_type in {"VERTS", "FACES"}:
        yield from obj.children
    elif obj.instance_type == "COLLECTION" and obj.instance_collection is not None:
        for inner in obj.instance_collection.all_objects:
            yield inner
            yield from sources(inner)


def shown(depsgraph: bpy.types.Depsgraph, owners: Sequence[bpy.types.Object]) -> Iterator[tuple]:
    """What `owners` show beside their own meshes: the number of the owner, the evaluated object shown, and its matrix.

    Blender takes the object back at the next step.
    """
    numbers = {owner.session_uid: number for number, owner in enumerate(owners)}
    for item in depsgraph.object_instances if owners else ():
        if item.is_instance and item.object.type == "MESH":
            number = numbers.get(item.parent.original.session_uid)
            if number is not None:
                yield number, item.object, item.matrix_world


def read(depsgraph: bpy.types.Depsgraph, owners: Sequence[bpy.types.Object], as_mesh: Read) -> list[list[Part]]:
    """For each of `owners` what it shows beside its own mesh. Each mesh is read once, however often it is shown."""
    found: list[dict[tuple, tuple[Mesh | None, list]]] = [{} for _ in owners]
    for number, obj, matrix in shown(depsgraph, owners):
        # Objects that share a mesh may show it in materials of their own.
        key = obj.data.as_pointer(), obj.original.session_uid
        if key not in found[number]:
            try:
                data = obj.to_mesh()
                found[number][key] = as_mesh(owners[number], obj, data) if data.polygons else None, []
            finally:
                obj.to_mesh_clear()
        found[number][key][1].append(matrix.copy())
    parts = [
        [Part(mesh, standing(np.array(places, np.float64))) for mesh, places in meshes.values() if mesh is not None]
        for meshes in found
    ]
    return [[part for part in of_one if len(part.places)] for of_one in parts]


def _has_nodes(obj: bpy.types.Object) -> bool:
    return any(modifier.type == "NODES" for modifier in obj.modifiers)
