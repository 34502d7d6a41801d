# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads high objects: their own meshes, and all that they show by instances, as one mesh each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from ..core.errors import BakeError
from ..core.settings import Settings
from ..mesh import joining
from ..mesh.joining import Part
from ..mesh.triangle_mesh import Mesh
from . import instances, mesh_reader

MOST = 200_000_000
"""Triangles of one high object with its instances: more would not fit in any computer's memory, or on a GPU."""


@dataclass
class Reader:
    """Reads the high objects of one bake.

    low_layer: the low mesh's UV layer. materials: the names that were met, with the numbers that stand for them.
    """

    depsgraph: bpy.types.Depsgraph
    low_layer: str
    settings: Settings
    materials: dict[str, int] = field(default_factory=dict)

    def read(self, highs: Mapping[int, bpy.types.Object]) -> list[Mesh]:
        """The meshes of `highs`, which have their numbers as labels. Raises BakeError for one that has none."""
        owners = {number: high for number, high in highs.items() if instances.shows_more(high)}
        numbers = {high.session_uid: number for number, high in highs.items()}
        found = instances.read(
            self.depsgraph,
            list(owners.values()),
            lambda owner, obj, data: self._mesh(numbers[owner.session_uid], owner.name, obj, data, np.eye(4)),
        )
        shown = dict(zip(owners, found, strict=True))
        return [self._whole(number, high, shown.get(number, [])) for number, high in highs.items()]

    def _whole(self, number: int, high: bpy.types.Object, parts: Sequence[Part]) -> Mesh:
        """What `high` shows itself and by its instances."""
        to_world = mesh_reader.matrix(high)
        own = None
        if instances.shows_itself(high, for_render=self.settings.modifiers == "RENDER"):
            with mesh_reader.evaluated(high, self.depsgraph) as data:
                if data.polygons or not parts:
                    own = self._mesh(number, high.name, high, data, to_world)
        if not parts:
            if own is None or not len(own.vertices):
                raise BakeError(_nothing(high))
            return own
        if sum(len(part.places) * len(part.mesh.triangles) for part in parts) > MOST:
            raise BakeError(f"{high.name!r} shows more than {MOST:,} triangles by its instances: show fewer of them.")
        if own is not None:
            parts = [Part(own, to_world[None]), *parts]
        if self.settings.method == "AUTO" and max(len(part.places) for part in parts) > 1:
            # What stands in many places has one place in its UVs.
            parts = [Part(replace(part.mesh, uv=None), part.places) for part in parts]
        return joining.joined(high.name, to_world, parts)

    def _mesh(self, number: int, name: str, obj: bpy.types.Object, data: bpy.types.Mesh, to_world: np.ndarray) -> Mesh:
        """The mesh `data` of `obj`, which a high object called `name` shows."""
        layer, method = "", self.settings.method
        if not data.polygons:
            raise BakeError(_nothing(obj))
        if method == "FLATTEN" or (method == "AUTO" and data.uv_layers):
            # The layer of the same name is the shared one; else the one that the artist sees in the UV editor.
            layer = uv_layer(name, data, self.low_layer if self.low_layer in data.uv_layers else "")
        mesh = mesh_reader.surface(
            data, layer, name, to_world, is_laid_flat=method == "FLATTEN", with_faces=bool(self.settings.maps)
        )
        return self._labeled(mesh, number, obj, data) if self.settings.maps else mesh

    def _labeled(self, mesh: Mesh, number: int, obj: bpy.types.Object, data: bpy.types.Mesh) -> Mesh:
        """`mesh` with the numbers of its high object and of its materials as labels."""
        indices, names = mesh_reader.materials(obj, data, mesh)
        numbers = np.array([self.materials.setdefault(name or "none", len(self.materials) + 1) for name in names])
        labels = np.stack([np.full(len(indices), number), numbers[indices]], axis=1).astype(np.float32)
        return replace(mesh, labels=labels)


def uv_layer(name: str, data: bpy.types.Mesh, wanted: str) -> str:
    """The name of the UV layer to take of `data`, the mesh of an object called `name`. Raises BakeError without one."""
    if not data.polygons:
        raise BakeError(f"{name!r} has no faces.")
    if not data.uv_layers:
        raise BakeError(f"{name!r} has no UV layer: unwrap it first.")
    if wanted and wanted not in data.uv_layers:
        known = ", ".join(repr(layer.name) for layer in data.uv_layers)
        raise BakeError(f"{name!r} has no UV layer {wanted!r}: it has {known}.")
    return wanted or data.uv_layers.active.name


def _nothing(high: bpy.types.Object) -> str:
    if high.type == "META" and "." in high.name:
        return f"{high.name!r} has no faces: the surface of its metaballs belongs to {high.name.rpartition('.')[0]!r}."
    return f"{high.name!r} has no faces."
