# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads files back with Blender's importers, into a scene of their own that is removed afterwards.

Engines make MikkTSpace tangents of the triangles in such a file, as Blender does here.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from ...core.errors import BakeError
from ...output.files import atomic_file
from ...scene import mesh_reader
from ..baked_low import FileMesh
from ..staging import Staged

_COLLECTIONS = (
    "scenes",
    "collections",
    "objects",
    "meshes",
    "materials",
    "images",
    "armatures",
    "actions",
    "node_groups",
)
"""The kinds of datablocks that importers make."""


def read(path: Path, one: Staged, importer: Callable[[], object]) -> FileMesh:
    """Read an object back. importer: imports the file. Raises BakeError."""
    with _objects(path, importer) as objects:
        return _file_mesh(_found(objects, one.name), one)


@contextmanager
def _objects(path: Path, importer: Callable[[], object]) -> Iterator[list[bpy.types.Object]]:
    before = {name: set(getattr(bpy.data, name)) for name in _COLLECTIONS}
    try:
        scene = bpy.data.scenes.new("Imprint export")
        try:
            with bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0]):
                importer()
        except (RuntimeError, OSError) as error:
            raise BakeError(f"{path.name!r} could not be read back: {atomic_file.reason(error)}.") from error
        yield [obj for obj in bpy.data.objects if obj not in before["objects"] and obj.type == "MESH"]
    finally:
        new = [block for name in _COLLECTIONS for block in getattr(bpy.data, name) if block not in before[name]]
        bpy.data.batch_remove(new)


def _found(objects: list[bpy.types.Object], name: str) -> bpy.types.Object:
    """The object that was written with this name: formats replace signs in names, and Blender adds numbers."""
    plain = re.sub(r"\W", "_", name)
    found = [obj for obj in objects if re.sub(r"\W", "_", re.sub(r"\.\d{3,}$", "", obj.name)) == plain]
    if not found and len(objects) == 1:
        found = objects
    if len(found) != 1:
        raise BakeError(f"Blender's exporter left out {name!r}, or changed its name.")
    return found[0]


def _file_mesh(obj: bpy.types.Object, one: Staged) -> FileMesh:
    data = obj.data
    if not data.uv_layers:
        raise BakeError(f"The file has no UVs of {one.name!r}: it was not written.")
    mesh = mesh_reader.with_tangents(data, data.uv_layers[0].name, obj.name, mesh_reader.matrix(obj))
    slots = mesh.labels[:, 0].astype(np.int32)
    pages = np.full(max(len(obj.material_slots), int(slots.max()) + 1), -1)
    if len(slots) == len(one.faces):  # formats order materials as they like
        pages[slots] = one.faces
    pictures: list[bytes | None] = [None] * len(one.pages)
    for slot in obj.material_slots:
        page = pages[slot.slot_index]
        if page >= 0 and slot.material is not None:
            pictures[page] = _normal_map(slot.material)
    return FileMesh(
        mesh.positions[mesh.vertices][mesh.triangles],
        mesh.normals[mesh.triangles],
        mesh.uv[mesh.triangles],
        mesh.tangents[mesh.triangles],
        pages[slots],
        pictures,
        has_tangents=False,
    )


def _normal_map(material: bpy.types.Material) -> bytes | None:
    """The file of the image that a Normal Map node of a material shows, or None."""
    for node in material.node_tree.nodes:
        if node.bl_idname == "ShaderNodeNormalMap":
            image = _image_behind(node.inputs["Color"])
            if image is not None:
                packed = image.packed_file
                return packed.data if packed else Path(bpy.path.abspath(image.filepath)).read_bytes()
    return None


def _image_behind(socket: bpy.types.NodeSocket) -> bpy.types.Image | None:
    """The first image among the nodes that feed an input."""
    waiting = [link.from_node for link in socket.links]
    while waiting:
        node = waiting.pop()
        if node.bl_idname == "ShaderNodeTexImage":
            return node.image
        waiting += [link.from_node for other in node.inputs for link in other.links]
    return None
