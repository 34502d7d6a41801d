# SPDX-License-Identifier: GPL-3.0-or-later
"""Decimates meshes by Blender's modifier: as they are, or with a UV layout whose borders stay."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property

import bpy
import numpy as np

from ...core import foreach, udim
from ...core.errors import UNWRAP_FIRST, BakeError
from ...core.progress import Task
from ...core.simplify import Candidate, making
from ...mesh import coarser_uvs
from ...mesh.triangle_mesh import Mesh
from ...passes import audit
from ...scene import evaluation, mesh_reader, reading
from .. import temporary
from ..temporary import TEMPORARY

LAYERS = 4
"""How many triangles on one texel are found: as many as mirrored or repeated parts usually share."""


def decimated(data: bpy.types.Mesh, triangles: int, is_free: np.ndarray | None = None) -> bpy.types.Mesh:
    """A mesh of about this many triangles, or of more where too many vertices are kept.

    is_free (V,) bool: vertices of `data` that are not kept; None for all.
    """
    with temporary.scene() as scene:
        obj = temporary.add_object(scene, data.copy())
        decimate = obj.modifiers.new(TEMPORARY, "DECIMATE")
        decimate.ratio = min(1.0, triangles / mesh_reader.count_triangles(data))
        decimate.use_collapse_triangulate = True
        if is_free is not None:
            remove_group(obj)  # of what making `data` has left
            group, free = obj.vertex_groups.new(name=TEMPORARY), np.flatnonzero(is_free)
            group.add(free.tolist(), 1.0, "REPLACE")
            decimate.vertex_group = group.name  # weight 0 locks a vertex
            if not len(free):  # the modifier takes a group without vertices for no group
                decimate.ratio = 1.0
        return temporary.evaluated(scene, obj)


def remove_group(level: bpy.types.Object) -> None:
    """Remove from the object of a finished mesh what making it has left."""
    group = level.vertex_groups.get(TEMPORARY)
    if group is not None:
        level.vertex_groups.remove(group)


@dataclass(frozen=True, eq=False)
class UvMesh:
    """A mesh with UVs, that coarser ones are made of.

    Attributes:
        layer: The UV layer of its map.
        name: Of the object that it stands for.
        to_world: (4, 4), the matrix of that object.
    """

    data: bpy.types.Mesh
    layer: str
    name: str
    to_world: np.ndarray

    @cached_property
    def surface(self) -> Mesh:
        """As bakes read it."""
        return mesh_reader.surface(self.data, self.layer, self.name, self.to_world, with_faces=True)

    @property
    def triangles(self) -> int:
        return len(self.surface.triangles)

    @cached_property
    def is_kept(self) -> np.ndarray:
        """The vertices (V,) bool that stay where they are, because they lie on a border."""
        surface, slots = self.surface, foreach.read(self.data.polygons, "material_index")
        layers = [mesh_reader.uvs(self.data, each.name) for each in self.data.uv_layers]
        result = np.ones(len(self.data.vertices), bool)  # vertices without a face, too
        on_border = coarser_uvs.kept_vertices(surface.vertices, surface.triangles, layers, slots[surface.faces])
        result[: len(on_border)] = on_border
        return result

    def remove(self) -> None:
        bpy.data.meshes.remove(self.data)

    def vertices_on(self, texels: np.ndarray) -> np.ndarray:
        """The vertices (V,) bool of the triangles on some texels (height, width) bool."""
        surface, result = self.surface, np.zeros(len(self.data.vertices), bool)
        if texels.any():
            uploaded = audit.upload_with_ids(surface.triangles, surface.uv)
            for numbers in audit.layers_of_triangles(uploaded, texels.shape[::-1], udim.uv_to_clip(), LAYERS):
                shown = np.unique(numbers[texels]).astype(np.int64)
                result[surface.vertices[surface.triangles[shown[shown > 0] - 1]]] = True
        return result


@dataclass(frozen=True, eq=False)
class UvDecimation:
    """Makes coarser meshes with the UV layout of an original.

    Attributes:
        mesh: What they are made of.
        original: Where their vertices take their UVs from.
        spared: (height, width) bool, the texels whose triangles keep their vertices.
    """

    mesh: UvMesh
    original: UvMesh
    spared: np.ndarray

    @property
    def is_corrected(self) -> bool:
        return bool(self.spared.any())

    def of(self, mesh: UvMesh) -> "UvDecimation":
        return replace(self, mesh=mesh)

    def uncorrected(self) -> "UvDecimation":
        return replace(self, spared=np.zeros_like(self.spared))

    def make(self, triangles: int) -> Task[list[UvMesh]]:
        """A mesh whose UVs are moved to where its vertices lie, and the same one with the UVs that collapsing edges left."""
        yield making(triangles)
        is_free = ~(self.mesh.is_kept | self.mesh.vertices_on(self.spared))
        plain = decimated(self.mesh.data, triangles, is_free)
        moved = with_moved_uvs(plain, self.original.data)
        return [replace(self.mesh, data=data) for data in (moved, plain)]

    def corrected(self, candidate: Candidate) -> "UvDecimation | None":
        is_beyond = candidate.deviation.by_texel > candidate.limit.degrees
        places = np.argwhere(is_beyond) * self.spared.shape // is_beyond.shape
        spared = self.spared.copy()
        spared[tuple(places.T)] = True
        return replace(self, spared=spared) if (spared & ~self.spared).any() else None


def with_moved_uvs(data: bpy.types.Mesh, original: bpy.types.Mesh) -> bpy.types.Mesh:
    """A copy of a coarser mesh whose vertices have the UVs of the nearest place on the original, where that is safe.

    Collapsing edges moves vertices off the place that their UVs stand for.
    """
    result = data.copy()
    mesh = UvMesh(result, result.uv_layers[0].name, result.name, np.eye(4))
    with temporary.scene() as scene:
        obj = temporary.add_object(scene, result.copy())
        with _uvs_of(temporary.add_object(scene, original.copy())) as nodes:
            obj.modifiers.new(TEMPORARY, "NODES").node_group = nodes
            nearest = temporary.evaluated(scene, obj)
    surface = mesh.surface
    for layer in result.uv_layers:
        before, after = (mesh_reader.uvs(each, layer.name) for each in (result, nearest))
        uv = coarser_uvs.moved_uvs(before, after, surface.vertices, surface.triangles, mesh.is_kept)
        layer.uv.foreach_set("vector", uv.reshape(-1))
    bpy.data.meshes.remove(nearest)
    return result


@contextmanager
def _uvs_of(target: bpy.types.Object) -> Iterator[bpy.types.NodeTree]:
    """Geometry nodes that give each corner the UVs of the nearest point of `target`, in all its layers.

    Blender's Data Transfer modifier does the same, but loses memory each time it transfers UVs.
    """
    nodes = bpy.data.node_groups.new(TEMPORARY, "GeometryNodeTree")
    try:
        for way in ("INPUT", "OUTPUT"):
            nodes.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
        start, end, info = map(nodes.nodes.new, ("NodeGroupInput", "NodeGroupOutput", "GeometryNodeObjectInfo"))
        info.inputs["Object"].default_value = target
        geometry = start.outputs[0]
        for layer in target.data.uv_layers:
            uv, sample, at_points, store = (
                nodes.nodes.new(f"GeometryNode{kind}")
                for kind in ("InputNamedAttribute", "SampleNearestSurface", "FieldOnDomain", "StoreNamedAttribute")
            )
            uv.data_type = sample.data_type = at_points.data_type = "FLOAT_VECTOR"
            at_points.domain = "POINT"  # once for all corners at a vertex
            store.data_type, store.domain = "FLOAT2", "CORNER"
            uv.inputs["Name"].default_value = store.inputs["Name"].default_value = layer.name
            nodes.links.new(info.outputs["Geometry"], sample.inputs["Mesh"])
            nodes.links.new(uv.outputs["Attribute"], sample.inputs["Value"])
            nodes.links.new(geometry, store.inputs["Geometry"])
            nodes.links.new(sample.outputs["Value"], at_points.inputs[0])
            nodes.links.new(at_points.outputs[0], store.inputs["Value"])
            geometry = store.outputs["Geometry"]
        nodes.links.new(geometry, end.inputs[0])
        yield nodes
    finally:
        bpy.data.node_groups.remove(nodes)


def read_original(
    context: bpy.types.Context,
    obj: bpy.types.Object,
    uv_layer: str,
    modifiers: str,
    *,
    with_normals: bool = False,
    is_own_base: bool = False,
) -> UvMesh:
    """Read an object with its modifiers. The copy is temporary. Raises BakeError.

    uv_layer: its name; empty for the active one. with_normals: whether custom normals stay. is_own_base: whether its mesh
    without modifiers is read, as by a bake onto itself.
    """

    def copied(depsgraph: bpy.types.Depsgraph) -> tuple[bpy.types.Mesh, np.ndarray]:
        shown = obj.evaluated_get(depsgraph)
        if is_own_base:
            copy = obj.data.copy()
        else:
            copy = bpy.data.meshes.new_from_object(shown, preserve_all_data_layers=True, depsgraph=depsgraph)
        copy.name = TEMPORARY
        return copy, mesh_reader.matrix(shown)

    data, to_world = evaluation.evaluate(context, [obj], copied, modifiers=modifiers)
    if not data.polygons:
        raise BakeError(f"{obj.name!r} has no faces: choose a mesh that has some.")
    if not data.uv_layers:
        raise BakeError(f"{obj.name!r} has no UV layer: {UNWRAP_FIRST}.")
    if uv_layer and uv_layer not in data.uv_layers:
        raise BakeError(f"{obj.name!r} has no UV layer {uv_layer!r}: choose one of its layers.")
    layer = uv_layer or mesh_reader.active_uv_layer(data)
    if (
        not with_normals and "custom_normal" in data.attributes
    ):  # corners collapse: levels get those that Blender computes
        data.attributes.remove(data.attributes["custom_normal"])
    mesh = UvMesh(data, layer, obj.name, to_world)
    if mesh.surface.not_finite:
        raise BakeError(
            f"{obj.name!r} has {mesh.surface.not_finite:,} triangles with NaN or infinite coordinates: remove them."
        )
    reading.check_surface([mesh.surface])
    return mesh
