# SPDX-License-Identifier: GPL-3.0-or-later
"""The low mesh of a finished bake, as the bake read it, and what a file holds of one object, as an engine reads it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import bpy
import numpy as np

from ..core.declarations import bases
from ..core.declarations.bases import Basis
from ..core.declarations.choices import Modifiers, Space
from ..core.errors import BakeError
from ..core.report import Report
from ..mesh import triangle_mesh
from ..mesh.triangle_mesh import Mesh
from ..mesh.triangles import transformed
from ..scene import evaluation, mesh_reader
from ..scene.high_materials import materials_of
from . import deformation
from .deformation import Deformation

LEAST_TANGENT = 1e-3
"""The length of what is left of a direction across a normal above which it is a tangent there."""


@dataclass(frozen=True)
class FileMesh:
    """The triangles of an object in a file, in Blender's axes and the object's space, with v upwards.

    Attributes:
        positions, normals (T, 3, 3) float32: By corner.
        uv (T, 3, 2) float32: Of the layer that the normal map uses.
        tangents (T, 3, 4) float32: With the sign of the bitangent; None if they are unknown.
        materials (T,) int: Indices into `pictures`.
        pictures: The files of normal maps, or None where there is none.
        has_tangents: Whether the tangents are the file's own, and not made of it.
    """

    positions: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    tangents: np.ndarray | None
    materials: np.ndarray
    pictures: list[bytes | None] = field(default_factory=list)
    has_tangents: bool = True


@dataclass(frozen=True)
class BakedLow:
    """A low object with the reports of its maps, and its triangles in the order of its material slots.

    Attributes:
        vertices (V, 3) float32: Their positions.
        corners (T, 3): The vertices of each triangle.
        normals (T, 3, 3), tangents (T, 3, 4) float32: By corner; tangents have the sign of the bitangent.
        uvs: The UVs of each layer by name, that of the maps first.
        slots (T,) int32: The material slot.
        materials: In each slot, also those that modifiers set.
        name, names: Of the object and of these materials, "" without one; staged copies borrow the names of datablocks.
        matrix (4, 4) float64: From the positions to the scene.
        has_applied_scale: Whether the scale of the object is in the positions and not in the matrix, as of a mirrored or
            unevenly scaled one: engines differ in how they transform its tangents.
        deformation: What moves the mesh, which is in its rest pose; with an armature, positions are in the scene's space.
    """

    low: bpy.types.Object
    name: str
    materials: list[bpy.types.Material | None]
    names: list[str]
    reports: Sequence[Report]
    vertices: np.ndarray
    corners: np.ndarray
    normals: np.ndarray
    tangents: np.ndarray
    uvs: dict[str, np.ndarray]
    slots: np.ndarray
    matrix: np.ndarray
    has_applied_scale: bool
    deformation: Deformation

    @property
    def positions(self) -> np.ndarray:
        """The positions of the corners (T, 3, 3) float32."""
        return self.vertices[self.corners]

    @property
    def uv(self) -> np.ndarray:
        """The UVs of the maps (T, 3, 2) float32."""
        return next(iter(self.uvs.values()))

    @property
    def basis(self) -> Basis:
        """The basis that the normal map was made for."""
        return bases.of_name(self.reports[0].settings["basis"])

    @property
    def has_normal_map(self) -> bool:
        """Whether the bake stored a normal map."""
        return bool(self.reports[0].settings["normal"])

    def name_of(self, slot: int) -> str:
        """The name of the material in a slot; that of the object without one."""
        return (self.names[slot] if slot < len(self.names) else "") or self.name

    def report_of(self, slot: int) -> Report | None:
        """The report of the texture set that the material slot `slot` belongs to."""
        return next((report for report in self.reports if not report.slots or slot in report.slots), None)


def read(context: bpy.types.Context, reports: Sequence[Report]) -> BakedLow:
    """The low object of `reports`, which are of one bake: one for each texture set. Raises BakeError."""
    report = reports[0]
    low = report.refs[0].resolve()
    if report.space != Space.TANGENT and report.settings["normal"]:
        raise BakeError(
            f"The normal map of {low.name!r} is in {report.space.lower()} space, which engines do not read from files of "
            "meshes: bake it in tangent space."
        )
    is_own_base = report.refs[0].uid in {ref.uid for ref in report.refs[1 : 1 + len(report.high)]}
    modifiers = report.settings["modifiers"]
    own_base = low if is_own_base else None
    look = partial(evaluation.evaluate, context, [low], modifiers=modifiers, own_base=own_base)
    armature = deformation.armature_of(low, for_render=modifiers == Modifiers.RENDER)
    with (
        evaluation.in_object_mode(context, [low]),
        deformation.at_rest(look, low, only_base=is_own_base) as notes,
    ):
        surface = look(partial(_surface, low, report.uv_layer, is_own_base))
        deformed = deformation.read(look, low, armature, surface.mesh.positions, surface.own)
    mesh, own, order = surface.mesh, surface.own, surface.order
    deformed = replace(deformed, notes=notes + deformed.notes)
    if np.linalg.det(mesh.to_world[:3, :3]) < 0.0:
        own = own[:, ::-1]  # as the triangles become
    mesh, deformed, has_applied_scale = _with_scale(mesh, deformed, report)
    mesh, deformed = _in_scene(mesh, deformed)
    triangles = mesh.triangles[order]
    uv_layers = [report.uv_layer, *(name for name in surface.layers if name != report.uv_layer)]
    return BakedLow(
        low,
        low.name,
        surface.materials,
        [material.name if material else "" for material in surface.materials],
        reports,
        mesh.positions,
        mesh.vertices[triangles],
        mesh.normals[triangles],
        mesh.tangents[triangles],
        {name: surface.layers[name][own] for name in uv_layers},
        surface.slots[order],
        mesh.to_world,
        has_applied_scale,
        deformed,
    )


@dataclass(frozen=True)
class _Surface:
    """A low mesh with tangents.

    Attributes:
        layers: The UVs (C, 2) of its face corners by layer.
        slots (T,) int32: Of its triangles, and their order by slots (T,).
        own (T, 3): The face corners of the triangles in that order.
    """

    mesh: Mesh
    layers: dict[str, np.ndarray]
    materials: list[bpy.types.Material | None]
    slots: np.ndarray
    order: np.ndarray
    own: np.ndarray


def _surface(low: bpy.types.Object, uv_layer: str, is_own_base: bool, depsgraph: bpy.types.Depsgraph) -> _Surface:
    shown = low.evaluated_get(depsgraph)
    with mesh_reader.base(low) if is_own_base else mesh_reader.evaluated(low, depsgraph) as data:
        if uv_layer not in data.uv_layers:
            raise BakeError(f"{low.name!r} no longer has the UV map {uv_layer!r} of its maps: bake again.")
        layers = {layer.name: mesh_reader.uvs(data, layer.name) for layer in data.uv_layers}
        drawn = mesh_reader.triangles(data)
        mesh = _with_whole_tangents(mesh_reader.with_tangents(data, uv_layer, low.name, mesh_reader.matrix(shown)))
    materials = materials_of(low if is_own_base else shown)
    slots = mesh.labels[:, 0].astype(np.int32).clip(0, max(0, len(materials) - 1))
    order = np.argsort(slots, kind="stable")  # as files have them
    # With n-gons, the corners are those of the drawn triangles, else those of the faces.
    has_ngons = len(mesh.vertices) != len(layers[uv_layer])
    own = (drawn.reshape(-1)[mesh.triangles] if has_ngons else mesh.triangles)[order]
    return _Surface(mesh, layers, materials, slots, order, own)


def _with_whole_tangents(mesh: Mesh) -> Mesh:
    """A mesh whose tangents all have a length. MikkTSpace gives none to a corner whose normal sees its only triangle from the
    edge, and shaders that normalize it show no number there."""
    gone = np.flatnonzero(~mesh.tangents[:, :3].any(axis=1))
    if not len(gone):
        return mesh
    of_others, normals = np.zeros_like(mesh.normals), mesh.normals[gone]
    np.add.at(of_others, mesh.triangles, mesh.tangents[mesh.triangles, :3].sum(axis=1, keepdims=True))
    tangents = mesh.tangents.copy()
    for guess in (np.eye(3)[np.abs(normals).argmin(axis=1)], of_others[gone]):
        along = guess - (guess * normals).sum(axis=1, keepdims=True) * normals
        length = np.linalg.norm(along, axis=1, keepdims=True)
        tangents[gone, :3] = np.where(
            length > LEAST_TANGENT, along / np.maximum(length, LEAST_TANGENT), tangents[gone, :3]
        )
    return replace(mesh, tangents=tangents)


def _in_scene(mesh: Mesh, deformed: Deformation) -> tuple[Mesh, Deformation]:
    """`mesh` in the scene's space if it has an armature, as files have skinned meshes. One scaled unevenly is left out."""
    if deformed.armature is None:
        return mesh, deformed
    of_armature = np.array(deformed.armature.matrix_world, np.float64)
    if triangle_mesh.is_uneven(of_armature) or np.linalg.det(of_armature[:3, :3]) <= 0.0:
        note = (
            f"The armature {deformed.armature.name!r} is mirrored, or scaled more along one axis than along another: the file "
            "is without it. Apply its scale (Object > Apply > Scale), and export again."
        )
        return mesh, replace(deformed, armature=None, notes=[*deformed.notes, note])
    matrix = mesh.to_world
    turn = matrix[:3, :3] / np.cbrt(np.linalg.det(matrix[:3, :3]))
    tangents = np.concatenate([mesh.tangents[:, :3] @ turn.T, mesh.tangents[:, 3:]], axis=1)
    moved = replace(
        mesh,
        positions=transformed(mesh.positions, matrix).astype(np.float32),
        normals=(mesh.normals @ turn.T).astype(np.float32),
        tangents=tangents.astype(np.float32),
        to_world=np.eye(4),
    )
    return moved, deformed.moved(matrix)


def _with_scale(mesh: Mesh, deformed: Deformation, report: Report) -> tuple[Mesh, Deformation, bool]:
    """Apply the scale of the object of `mesh` if engines would differ in showing it. Returns both, and whether it was.

    Raises BakeError for a normal map that fits only the mesh without it.
    """
    is_uneven, is_mirrored = triangle_mesh.is_uneven(mesh.to_world), np.linalg.det(mesh.to_world[:3, :3]) < 0.0
    if not (is_uneven or is_mirrored):
        return mesh, deformed, False
    basis = bases.of_name(report.settings["basis"])
    if is_uneven and basis.in_object_space and report.settings["normal"]:
        raise BakeError(
            f"{mesh.name!r} is scaled more along one axis than along another, and only {basis.label} can show its normal map "
            "then: bake it for the basis of your engine, or apply the scale (Object > Apply > Scale) and bake again."
        )
    scale = triangle_mesh.scale_of(mesh.to_world)
    normals, tangents = triangle_mesh.stretched(scale, mesh.normals, mesh.tangents, basis)
    to_world = mesh.to_world.copy()
    to_world[:3, :3] = mesh.to_world[:3, :3] @ np.linalg.inv(scale)
    positions = (mesh.positions @ scale.T).astype(np.float32)
    applied = replace(mesh, positions=positions, normals=normals, tangents=tangents, to_world=to_world)
    if is_mirrored:  # its triangles are seen from behind until their winding is turned
        applied = replace(applied, triangles=mesh.triangles[:, ::-1])
    matrix = np.eye(4)
    matrix[:3, :3] = scale
    return applied, deformed.moved(matrix), True
