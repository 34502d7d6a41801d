# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes one solid of solids that touch, as boxes of planks do: without the faces between them, which nobody sees.

A low mesh with these faces spends triangles on them, and shows them where a corner of another solid went.
"""

import bpy
import numpy as np

from ...core.progress import Progress, Task
from ...mesh import topology, welding
from ...mesh.topology import EdgeTable
from ...mesh.triangles import enclosed_volumes
from ...scene import mesh_reader
from .. import temporary
from ..temporary import TEMPORARY
from .low_meshes import new_mesh

MOST, MOST_IN_ALL = 10_000, 200_000
"""The most triangles that are united, and the most in all steps: each takes the next solid. Blender's exact Boolean takes up to
a second for 10,000."""
ROUNDING = 1e-5
"""The share of their volume by which the volume of one solid may differ from that of all."""


def united(points: np.ndarray, triangles: np.ndarray, step: Progress) -> Task[tuple[np.ndarray, np.ndarray] | None]:
    """The surface of one solid, for a surface of several that share edges and no volume; None for any other.

    Args:
        points: (V, 3) float32.
        triangles: (T, 3) int, with shared vertices.
        step: yielded for each solid.

    Returns:
        Points (P, 3) float32 and triangles (N, 3) int.
    """
    if len(triangles) > MOST or not EdgeTable.of(triangles).is_crowded.any():
        return None
    points, triangles = welding.parted(points, triangles)
    labels, count = topology.components(tuple(triangles.T), len(points))
    volumes = np.bincount(labels, enclosed_volumes(points.astype(np.float64), triangles), count)
    if count == 1 or count * len(triangles) > MOST_IN_ALL or not _is_closed(triangles):
        return None
    with temporary.scene() as scene:
        whole = temporary.add_object(scene, bpy.data.meshes.new(TEMPORARY))
        for label in np.argsort(-volumes, kind="stable").tolist():
            yield step
            used, corners = np.unique(triangles[labels == label], return_inverse=True)
            _add(scene, whole, new_mesh(points[used], corners.reshape(-1, 3)))
        read = mesh_reader.surface(whole.data, "", TEMPORARY, np.eye(4))
        points, triangles = welding.weld(read.positions, read.vertices[read.triangles])
    volume = enclosed_volumes(points.astype(np.float64), triangles).sum()
    is_all = abs(volume - volumes.sum()) <= ROUNDING * volumes.sum()
    return (points, triangles) if is_all and _is_closed(triangles) else None


def _is_closed(triangles: np.ndarray) -> bool:
    table = EdgeTable.of(triangles)
    return not table.is_open.any() and not table.is_against.any()


def _add(scene: bpy.types.Scene, whole: bpy.types.Object, part: bpy.types.Mesh) -> None:
    """Unite the mesh of an object of a scene with another mesh, which goes."""
    before, other = whole.data, temporary.add_object(scene, part)
    boolean = whole.modifiers.new(TEMPORARY, "BOOLEAN")
    boolean.operation, boolean.solver, boolean.object = "UNION", "EXACT", other
    whole.data = temporary.evaluated(scene, whole)
    whole.modifiers.clear()
    for data in (before, part):
        bpy.data.meshes.remove(data)  # and the object with it
