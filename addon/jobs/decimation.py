# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes coarser meshes of an object with Blender's Decimate modifier, in a scene of their own, and finds the vertices that it
must keep."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np

from ..core import udim
from ..core.errors import BakeError
from ..mesh.levels import kept_borders, uv_moves
from ..mesh.triangle_mesh import Mesh
from ..passes import audit
from ..scene import evaluation, mesh_reader

NAME = "Imprint level"
"""Of temporary datablocks, which exist only within one step of a task, except for meshes."""


class Meshes:
    """Temporary meshes. They are removed when the block ends, unless they are released."""

    def __init__(self):
        self._uids: set[int] = set()

    def __enter__(self) -> "Meshes":
        return self

    def __exit__(self, *_) -> None:
        for data in [data for data in bpy.data.meshes if data.session_uid in self._uids]:
            bpy.data.meshes.remove(data)

    def own(self, data: bpy.types.Mesh) -> bpy.types.Mesh:
        """Remove `data` at the end. Returns it."""
        self._uids.add(data.session_uid)
        return data

    def release(self, data: bpy.types.Mesh) -> None:
        """Keep `data`."""
        self._uids.discard(data.session_uid)

    def remove(self, data: bpy.types.Mesh) -> None:
        """Remove `data` now."""
        self._uids.discard(data.session_uid)
        bpy.data.meshes.remove(data)


@dataclass(frozen=True)
class Source:
    """A mesh that coarser ones are made of.

    data: the mesh. surface: as bakes read it, with UVs. is_kept (V,) bool: vertices that stay where they are, because they lie
    on a border. layer: the UV layer of the map. triangles: their number.
    """

    data: bpy.types.Mesh
    surface: Mesh
    is_kept: np.ndarray
    layer: str

    @property
    def triangles(self) -> int:
        return len(self.surface.triangles)


def read(context: bpy.types.Context, obj: bpy.types.Object, uv_layer: str, modifiers: str, meshes: Meshes) -> Source:
    """Read an object with its modifiers. uv_layer: its name; empty for the active one. meshes: owns the copy.

    Raises BakeError.
    """
    with evaluation.prepared(context, obj, [], None, modifiers) as depsgraph:
        data = meshes.own(
            bpy.data.meshes.new_from_object(
                obj.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph
            )
        )
    data.name = NAME
    if not data.polygons:
        raise BakeError(f"{obj.name!r} has no faces: choose a mesh that has some.")
    if not data.uv_layers:
        raise BakeError(f"{obj.name!r} has no UV layer: unwrap it first.")
    if uv_layer and uv_layer not in data.uv_layers:
        raise BakeError(f"{obj.name!r} has no UV layer {uv_layer!r}: choose one of its layers.")
    layer = uv_layer or data.uv_layers.active.name
    _drop_custom_normals(data)
    source = of_mesh(data, layer, obj.name, mesh_reader.matrix(obj))
    if source.surface.not_finite:
        raise BakeError(
            f"{obj.name!r} has {source.surface.not_finite:,} triangles with NaN or infinite coordinates: remove them."
        )
    return source


def of_mesh(data: bpy.types.Mesh, layer: str, name: str, to_world: np.ndarray) -> Source:
    """A mesh, to make coarser ones of. name: of its object. to_world (4, 4): the object's matrix."""
    surface = mesh_reader.surface(data, layer, name, to_world, with_faces=True)
    slots = np.empty(len(data.polygons), np.int32)
    data.polygons.foreach_get("material_index", slots)
    layers = [mesh_reader.uvs(data, each.name) for each in data.uv_layers]
    is_kept = np.ones(len(data.vertices), bool)  # vertices without a face, too
    on_border = kept_borders.kept(surface.vertices, surface.triangles, layers, slots[surface.faces])
    is_kept[: len(on_border)] = on_border
    return Source(data, surface, is_kept, layer)


def _drop_custom_normals(data: bpy.types.Mesh) -> None:
    """Levels get the normals that Blender computes: custom ones belong to corners that collapse."""
    if "custom_normal" in data.attributes:
        data.attributes.remove(data.attributes["custom_normal"])


def coarser(
    source: Source, triangles: int, is_frozen: np.ndarray, moved_to: bpy.types.Mesh | None = None
) -> bpy.types.Mesh:
    """A mesh of about this many triangles, or of more where too many vertices are kept. The caller removes it.

    is_frozen (V,) bool: vertices of `source` that are kept beside those on borders. moved_to: the mesh from which vertices
    inside islands get the UVs of the place where they lie now; None leaves them. Collapsing edges moves vertices off the place
    that their UVs stand for.
    """
    with _scene() as scene:
        obj = _object(scene, source.data.copy())
        finish(obj)  # of what making `source` has left
        group = obj.vertex_groups.new(name=NAME)
        free = np.flatnonzero(~(source.is_kept | is_frozen))
        group.add(free.tolist(), 1.0, "REPLACE")
        decimate = obj.modifiers.new(NAME, "DECIMATE")
        # The modifier takes a group without vertices for no group.
        decimate.ratio = min(1.0, triangles / source.triangles) if len(free) else 1.0
        decimate.use_collapse_triangulate = True
        decimate.vertex_group = group.name  # weight 0 locks a vertex
        result = _evaluated(scene, obj)
        if moved_to is not None:
            with _uvs_of(_object(scene, moved_to.copy()), group.name) as nodes:
                obj.modifiers.new(NAME, "NODES").node_group = nodes
                moved = _evaluated(scene, obj)
                _move(result, moved)
                bpy.data.meshes.remove(moved)
        return result


def finish(level: bpy.types.Object) -> None:
    """Remove from the object of a finished mesh what making it has left."""
    group = level.vertex_groups.get(NAME)
    if group is not None:
        level.vertex_groups.remove(group)


def _move(data: bpy.types.Mesh, moved: bpy.types.Mesh) -> None:
    """Give `data` the UVs of `moved`, which has the same topology, where that is safe."""
    source = of_mesh(data, data.uv_layers[0].name, data.name, np.eye(4))
    surface = source.surface
    for layer in data.uv_layers:
        before, after = (mesh_reader.uvs(mesh, layer.name) for mesh in (data, moved))
        uv = uv_moves.accepted(before, after, surface.vertices, surface.triangles, source.is_kept)
        layer.uv.foreach_set("vector", uv.reshape(-1))


@contextmanager
def _uvs_of(target: bpy.types.Object, group: str) -> Iterator[bpy.types.NodeTree]:
    """Geometry nodes that give each corner in a vertex group the UVs of the nearest point of `target`, in all its layers.

    Blender's Data Transfer modifier does the same, but loses memory each time it transfers UVs.
    """
    nodes = bpy.data.node_groups.new(NAME, "GeometryNodeTree")
    try:
        for way in ("INPUT", "OUTPUT"):
            nodes.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
        kinds = "NodeGroupInput", "NodeGroupOutput", "GeometryNodeObjectInfo", "GeometryNodeInputNamedAttribute"
        start, end, info, chosen = map(nodes.nodes.new, kinds)
        info.inputs["Object"].default_value, chosen.inputs["Name"].default_value = target, group
        geometry = start.outputs[0]
        for layer in target.data.uv_layers:
            uv, sample, store = (
                nodes.nodes.new(f"GeometryNode{kind}")
                for kind in ("InputNamedAttribute", "SampleNearestSurface", "StoreNamedAttribute")
            )
            uv.data_type = sample.data_type = "FLOAT_VECTOR"
            store.data_type, store.domain = "FLOAT2", "CORNER"
            uv.inputs["Name"].default_value = store.inputs["Name"].default_value = layer.name
            nodes.links.new(info.outputs["Geometry"], sample.inputs["Mesh"])
            nodes.links.new(uv.outputs["Attribute"], sample.inputs["Value"])
            nodes.links.new(geometry, store.inputs["Geometry"])
            nodes.links.new(chosen.outputs["Attribute"], store.inputs["Selection"])
            nodes.links.new(sample.outputs["Value"], store.inputs["Value"])
            geometry = store.outputs["Geometry"]
        nodes.links.new(geometry, end.inputs[0])
        yield nodes
    finally:
        bpy.data.node_groups.remove(nodes)


@contextmanager
def _scene() -> Iterator[bpy.types.Scene]:
    """An empty scene. At the end it is removed, with its objects and their meshes."""
    scene = bpy.data.scenes.new(NAME)
    try:
        yield scene
    finally:
        for obj in list(scene.collection.objects):
            bpy.data.meshes.remove(obj.data)  # and the object with it
        bpy.data.scenes.remove(scene)


def _object(scene: bpy.types.Scene, data: bpy.types.Mesh) -> bpy.types.Object:
    obj = bpy.data.objects.new(NAME, data)
    scene.collection.objects.link(obj)
    return obj


def _evaluated(scene: bpy.types.Scene, obj: bpy.types.Object) -> bpy.types.Mesh:
    """The mesh of `obj` with its modifiers and without its vertex groups."""
    layer = scene.view_layers[0]
    layer.update()
    return bpy.data.meshes.new_from_object(obj.evaluated_get(layer.depsgraph), depsgraph=layer.depsgraph)


LAYERS = 4
"""How many triangles on one texel are found: as many as mirrored or repeated parts usually share."""


def frozen_vertices(source: Source, texels: np.ndarray) -> np.ndarray:
    """Which vertices (V,) bool belong to a triangle on one of these `texels` (height, width) bool."""
    surface, result = source.surface, np.zeros(len(source.is_kept), bool)
    if texels.any():
        uploaded = audit.upload_with_ids(surface.triangles, surface.uv)
        for numbers in audit.layers_of_triangles(uploaded, texels.shape[::-1], udim.uv_to_clip(), LAYERS):
            found = np.unique(numbers[texels]).astype(np.int64)
            result[surface.vertices[surface.triangles[found[found > 0] - 1]]] = True
    return result
