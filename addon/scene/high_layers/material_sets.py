# SPDX-License-Identifier: GPL-3.0-or-later
"""Restricts meshes to the faces of one material, for texture sets."""

from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...core.errors import BakeError
from ...mesh.inputs import Meshes
from ...mesh.triangle_mesh import Mesh
from .. import mesh_reader

NO_MATERIAL = "none"
"""The name of the set of faces without a material."""


@dataclass(frozen=True)
class MaterialSet:
    """The faces of a low object with one material. slots: the numbers of the slots that have it."""

    name: str
    slots: tuple[int, ...]


def sets_of(low: bpy.types.Object) -> list[MaterialSet]:
    """The materials on the faces of `low`, in the order of its slots."""
    names = [slot.material.name if slot.material else NO_MATERIAL for slot in low.material_slots] or [NO_MATERIAL]
    if low.type != "MESH" or not low.data.polygons:  # a check refuses it with a sentence
        return [MaterialSet(names[0], (0,))]
    indices = np.empty(len(low.data.polygons), np.int32)
    low.data.polygons.foreach_get("material_index", indices)
    used = np.unique(indices.clip(0, len(names) - 1)).tolist()
    return [
        MaterialSet(name, tuple(number for number in used if names[number] == name))
        for name in dict.fromkeys(names[number] for number in used)
    ]


def with_slots(mesh: Mesh, data: bpy.types.Mesh, obj: bpy.types.Object) -> Mesh:
    """`mesh`, which was read from `data` with faces, labeled with the slots of `obj`: (T, 1)."""
    slots = mesh_reader.material_slots(data, mesh, max(1, len(obj.material_slots)))
    return replace(mesh, labels=slots[:, None].astype(np.float32))


def restricted(meshes: Meshes, obj: bpy.types.Object, chosen: MaterialSet) -> Meshes:
    """`meshes` with only those triangles of the low mesh and of its basis that are in a texture set of `obj`.

    Both are labeled by `with_slots`. `whole` keeps the low mesh as it was. Raises BakeError if no triangle is left.
    """
    last = max(0, len(obj.material_slots) - 1)
    kept = np.flatnonzero(np.isin(meshes.low.labels[:, 0], chosen.slots))
    if not len(kept):
        raise BakeError(f"{obj.name!r} has no faces with the material {chosen.name!r}.")
    basis = meshes.basis
    if basis is not None:
        # A face whose index is too high shows the last slot.
        basis = basis.with_triangles(np.isin(basis.labels[:, 0].clip(0, last), chosen.slots))
    return replace(
        meshes, low=meshes.low.with_triangles(kept), basis=basis, whole=meshes.low, kept=kept, material=chosen.name
    )
