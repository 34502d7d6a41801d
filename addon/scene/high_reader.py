# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads high objects, with their modifiers: joins the mesh and the instances of each into one mesh."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from ..core.declarations.choices import Method, Modifiers
from ..core.errors import BakeError
from ..core.map_types import BY_NAME
from ..core.material_feeds import HighMaterial, ImagePixels
from ..core.settings import Settings
from ..mesh import joining
from ..mesh.joining import Part, usable
from ..mesh.triangle_mesh import Mesh
from . import mesh_reader, moved_vertices, object_checks
from .high_materials import MaterialNumbers, Shown, read_layers
from .materials.material_reading import NORMAL
from .textures import ImageTextures

MOST = 200_000_000
"""The largest number of triangles of a high object with its instances: more do not fit into memory or on a GPU."""


ReadMesh = Callable[[bpy.types.Object, bpy.types.Object, bpy.types.Mesh], Mesh]
"""A function that converts a mesh to arrays. It takes the object that shows the instance, the instanced object and its mesh."""


@dataclass
class Reader:
    """Reads the high objects of one bake.

    low, low_layer: the low object, and its mesh's UV layer. before: the materials of an earlier reading, which keep their
    numbers. known: meshes of that reading, by the number of their high object; if only vertices have moved, little is read
    again. materials: those that were read so far.
    """

    depsgraph: bpy.types.Depsgraph
    low: bpy.types.Object
    low_layer: str
    settings: Settings
    before: Sequence[HighMaterial] = ()
    known: Mapping[int, Mesh] = field(default_factory=dict)

    def __post_init__(self):
        sockets = {BY_NAME[name].socket for name in self.settings.map.drawn_maps} - {""}
        if self.settings.map.detail_maps:
            sockets.add(NORMAL)
        self.materials = MaterialNumbers(ImageTextures(), self.low, sockets=sockets, before=self.before)

    def read(self, highs: Mapping[int, bpy.types.Object]) -> list[Mesh]:
        """Read the meshes of `highs`, labeled with their numbers. Raises BakeError for an object without a mesh."""
        owners = {number: high for number, high in highs.items() if object_checks.shows_more(high)}
        numbers = {high.session_uid: number for number, high in highs.items()}
        found = read_instances(
            self.depsgraph,
            list(owners.values()),
            lambda owner, obj, data: self._mesh(numbers[owner.session_uid], owner.name, obj, data, np.eye(4)),
        )
        shown = dict(zip(owners, found, strict=True))
        meshes = [self._joined(number, high, shown.get(number, [])) for number, high in highs.items()]
        return with_labels(meshes)

    def load_image(self, key: str, tile: int) -> ImagePixels:
        """The pixels of an image of the materials, as Meshes.load_image has it."""
        return self.materials.images.load(key, tile)

    def _joined(self, number: int, high: bpy.types.Object, parts: Sequence[Part]) -> Mesh:
        """The mesh of `high` joined with its instances."""
        to_world = mesh_reader.matrix(high)
        mesh = None
        if object_checks.shows_itself(high, for_render=self.settings.map.modifiers == Modifiers.RENDER):
            with mesh_reader.evaluated(high, self.depsgraph) as data:
                if data.polygons or not parts:
                    copied = mesh_reader.copied(high, self.depsgraph)
                    mesh = self._mesh(number, high.name, high, data, to_world, copied=copied)
        if not parts:
            if mesh is None or not len(mesh.vertices):
                raise BakeError(_no_faces(high))
            return mesh
        if sum(len(part.matrices) * len(part.mesh.triangles) for part in parts) > MOST:
            raise BakeError(
                f"{high.name!r} has more than {MOST:,} triangles with its instances: reduce the number of instances."
            )
        if mesh is not None:
            parts = [Part(mesh, to_world[None]), *parts]
        if self.settings.tracing.method == Method.AUTO and max(len(part.matrices) for part in parts) > 1:
            # All instances of a mesh have the same UVs, so Flatten would draw them on top of each other.
            parts = [Part(replace(part.mesh, uv=None), part.matrices) for part in parts]
        return joining.join(high.name, to_world, parts)

    def _mesh(
        self,
        number: int,
        name: str,
        obj: bpy.types.Object,
        data: bpy.types.Mesh,
        to_world: np.ndarray,
        *,
        copied: mesh_reader.Copied | None = None,
    ) -> Mesh:
        """Read the mesh `data` of `obj`, which belongs to the high object `name`. copied: as mesh_reader.surface has it."""
        layer, method = "", self.settings.tracing.method
        if not data.polygons:
            raise BakeError(_no_faces(obj))
        if method == Method.FLATTEN or (method == Method.AUTO and data.uv_layers):
            # Use the layer with the name of the low mesh's layer, or else the active one.
            layer = uv_layer(name, data, self.low_layer if self.low_layer in data.uv_layers else "")
        slots = self.materials.of_slots(obj, data)
        has_labels = bool(self.settings.map.drawn_maps) or self.settings.map.texture_sets
        if has_labels or self.settings.map.detail_maps:
            shown = [self.materials.read(material) for material in slots]
            has_labels = has_labels or any(material.detail is not None for material in shown)
        known, mesh = self.known.get(number), None
        if known is not None and known.name == name and not known.instances:
            mesh = moved_vertices.read(data, layer, known, to_world, with_faces=has_labels)
        if mesh is None:
            is_drawn_in_uv = method == Method.FLATTEN
            mesh = mesh_reader.surface(
                data,
                layer,
                name,
                to_world,
                is_drawn_in_uv=is_drawn_in_uv,
                with_faces=has_labels,
                copied=copied,
            )
        if not has_labels:
            return mesh
        return replace(self._labeled(mesh, number, slots, data), layers=read_layers(data, shown, self.settings.map))

    def _labeled(self, mesh: Mesh, number: int, slots: Sequence[Shown], data: bpy.types.Mesh) -> Mesh:
        """`mesh` labeled with the numbers of its high object and of its materials."""
        indices = mesh_reader.material_slots(data, mesh, len(slots))
        numbers = np.array([self.materials.number(material) for material in slots])
        labels = np.stack([np.full(len(indices), number), numbers[indices]], axis=1).astype(np.float32)
        return replace(mesh, labels=labels)


def with_labels(meshes: Sequence[Mesh]) -> list[Mesh]:
    """`meshes`, all with labels if one has them. The number 0 stands for no object and no material."""
    if all(mesh.labels is None for mesh in meshes):
        return list(meshes)
    return [
        replace(mesh, labels=np.zeros((len(mesh.triangles), 2), np.float32)) if mesh.labels is None else mesh
        for mesh in meshes
    ]


def instances_shown(depsgraph: bpy.types.Depsgraph, owners: Sequence[bpy.types.Object]) -> Iterator[tuple]:
    """Each instance that `owners` show: the owner's index, the evaluated object shown, and its matrix.

    The object is valid only until the next step of the iteration.
    """
    numbers = {owner.session_uid: number for number, owner in enumerate(owners)}
    for item in depsgraph.object_instances if owners else ():
        if item.is_instance and item.object.type == "MESH":
            number = numbers.get(item.parent.original.session_uid)
            if number is not None:
                yield number, item.object, item.matrix_world


def read_instances(
    depsgraph: bpy.types.Depsgraph, owners: Sequence[bpy.types.Object], as_mesh: ReadMesh
) -> list[list[Part]]:
    """The instances of each of `owners`. Each mesh is read once, however many instances it has."""
    found: list[dict[tuple, tuple[Mesh | None, list]]] = [{} for _ in owners]
    for number, obj, matrix in instances_shown(depsgraph, owners):
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


def uv_layer(name: str, data: bpy.types.Mesh, wanted: str) -> str:
    """The name of the UV layer to read from `data`, the mesh of the object `name`. Raises BakeError if there is none."""
    if not data.polygons:
        raise BakeError(f"{name!r} has no faces.")
    if not data.uv_layers:
        raise BakeError(f"{name!r} has no UV layer: unwrap it first.")
    if wanted and wanted not in data.uv_layers:
        existing = ", ".join(repr(layer.name) for layer in data.uv_layers)
        raise BakeError(f"{name!r} has no UV layer {wanted!r}: it has {existing}.")
    return wanted or data.uv_layers.active.name


def _no_faces(high: bpy.types.Object) -> str:
    if high.type == "META" and "." in high.name:
        return f"{high.name!r} has no faces: the surface of its metaballs belongs to {high.name.rpartition('.')[0]!r}."
    return f"{high.name!r} has no faces."
