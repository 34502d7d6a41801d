# SPDX-License-Identifier: GPL-3.0-or-later
"""What moves a low mesh in a file: the armature that skins it, and its shape keys. Files have the rest pose, as bakes of it."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import bpy
import numpy as np

from ..mesh.triangles import transformed, unit
from ..scene import evaluation, mesh_reader

STILL = 1e-5
"""The share of a mesh's size by which points of the rest pose may be elsewhere."""


@dataclass(frozen=True)
class ShapeKey:
    """A shape key at its full value: the points (V, 3), and the normals (T, 3, 3) of the corners of the triangles.

    Attributes:
        name: As Blender has it.
    """

    name: str
    points: np.ndarray
    normals: np.ndarray


@dataclass(frozen=True)
class Deformation:
    """What deforms a low mesh.

    Attributes:
        armature: None without one.
        groups: The names of its vertex groups. Each row of vertices, numbers and weights (N,) is one weight: the vertex, the
            index of its group, and the value.
        notes: Sentences of what no file can have.
    """

    armature: bpy.types.Object | None = None
    groups: list[str] = field(default_factory=list)
    vertices: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    numbers: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    weights: np.ndarray = field(default_factory=lambda: np.zeros(0, np.float32))
    shapes: list[ShapeKey] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def moved(self, matrix: np.ndarray) -> "Deformation":
        """The same in other coordinates. matrix (4, 4): to them; if it mirrors, the corners of triangles change places."""
        inverse = np.linalg.inv(matrix[:3, :3])
        order = -1 if np.linalg.det(matrix[:3, :3]) < 0.0 else 1
        return replace(
            self,
            shapes=[
                replace(
                    shape,
                    points=transformed(shape.points, matrix).astype(np.float32),
                    normals=unit(shape.normals[:, ::order] @ inverse).astype(np.float32),
                )
                for shape in self.shapes
            ],
        )


Look = Callable[[Callable[[bpy.types.Depsgraph], Any]], Any]
"""Evaluates the objects, and returns what a function returns of the dependency graph."""


@contextmanager
def at_rest(look: Look, low: bpy.types.Object, *, only_base: bool) -> Iterator[list[str]]:
    """Put `low` into its rest pose, without shape keys, until the block ends. only_base: without all modifiers, too.

    Gives a sentence if the pose was another one.
    """
    armatures = [modifier for modifier in low.modifiers if modifier.type == "ARMATURE"]
    if not (armatures or _keys(low)):
        yield []
        return
    with ExitStack() as restore:
        before = look(partial(_points, low))
        for modifier in low.modifiers if only_base else armatures:
            evaluation.set_until(modifier, "show_viewport", False, restore)
            evaluation.set_until(modifier, "show_render", False, restore)
        if _keys(low):
            evaluation.set_until(low, "show_only_shape_key", True, restore)
            evaluation.set_until(low, "active_shape_key_index", 0, restore)
        notes = []
        if not only_base and _is_elsewhere(before, look(partial(_points, low))):
            notes = [
                f"{low.name!r} is posed, and the file has its rest pose: the map fits if it was baked at rest, or if the high "
                "object follows the pose as well."
            ]
        yield notes


def armature_of(low: bpy.types.Object, *, for_render: bool) -> bpy.types.Object | None:
    """The armature that deforms `low` by its vertex groups, or None. for_render: whether it does in renders."""
    armatures = (modifier for modifier in low.modifiers if modifier.type == "ARMATURE")
    modifiers = (
        modifier.object
        for modifier in armatures
        if (modifier.show_render if for_render else modifier.show_viewport)
        if modifier.use_vertex_groups and modifier.object
    )
    return next(modifiers, None)


def read(
    look: Look,
    low: bpy.types.Object,
    armature: bpy.types.Object | None,
    points: np.ndarray,
    corners: np.ndarray,
) -> Deformation:
    """What deforms `low`, which is `at_rest`. points (V, 3): those there. corners (T, 3): the face corners of the triangles."""
    groups, weights = [], np.zeros((3, 0))
    if armature is not None:
        groups, weights = look(partial(_weights, low))
    shapes, notes = _shapes(look, low, points, corners)
    vertices, numbers = weights[:2].astype(np.int32)
    return Deformation(armature, groups, vertices, numbers, weights[2].astype(np.float32), shapes, notes)


def _weights(low: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[list[str], np.ndarray]:
    """The names of the vertex groups, and a row of vertex, group and weight (3, N) float64 for each weight."""
    with mesh_reader.evaluated(low, depsgraph) as data:
        # Blender gives the weights of vertices one by one alone.
        rows = [(vertex.index, one.group, one.weight) for vertex in data.vertices for one in vertex.groups]
    groups = [group.name for group in low.evaluated_get(depsgraph).vertex_groups]
    return groups, np.array(rows, np.float64).reshape(-1, 3).T


def _keys(low: bpy.types.Object) -> list[bpy.types.ShapeKey]:
    """The shape keys of `low` behind the first, which is the mesh itself; none that follow each other in time."""
    keys = low.data.shape_keys
    return list(keys.key_blocks[1:]) if keys and keys.use_relative else []


def _shapes(
    look: Look, low: bpy.types.Object, points: np.ndarray, corners: np.ndarray
) -> tuple[list[ShapeKey], list[str]]:
    if not _keys(low):
        return [], []
    blocks = low.data.shape_keys.key_blocks
    seen: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    with ExitStack() as restore:
        for number, key in enumerate(blocks):
            evaluation.set_until(low, "active_shape_key_index", number, restore)
            seen[key.name] = look(partial(_points_and_normals, low))
    shapes, left_out = [], []
    for key in blocks[1:]:
        shown, normals = seen[key.name]
        if len(shown) != len(points):
            left_out.append(key.name)
        else:
            relative = seen[key.relative_key.name]
            offset = shown - relative[0]
            turned = normals - relative[1] + seen[blocks[0].name][1]
            shapes.append(ShapeKey(key.name, points + offset, unit(turned[corners]).astype(np.float32)))
    notes = []
    if left_out:
        notes.append(
            f"A modifier of {low.name!r} makes another mesh of {', '.join(map(repr, left_out))}: the file is without these "
            "shape keys."
        )
    return shapes, notes


def _points(low: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> np.ndarray:
    return _points_and_normals(low, depsgraph)[0]


def _points_and_normals(low: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[np.ndarray, np.ndarray]:
    with mesh_reader.evaluated(low, depsgraph) as data:
        return mesh_reader.points(data), mesh_reader.corner_normals(data)


def _is_elsewhere(points: np.ndarray, others: np.ndarray) -> bool:
    if points.shape != others.shape:
        return True
    size = float(np.ptp(others, axis=0).max(initial=0.0)) or 1.0
    return bool(np.abs(points - others).max(initial=0.0) > STILL * size)
