# SPDX-License-Identifier: GPL-3.0-or-later
"""The shells around the low mesh where rays start and end, for display in the viewport."""

import bpy
import gpu
import numpy as np

from ..core.declarations.choices import Directions
from ..passes import mesh_upload
from ..passes.view.cage_shell import draw
from ..scene import mesh_reader

__all__ = ["draw", "upload"]


def upload(low: bpy.types.Object, depsgraph: bpy.types.Depsgraph, directions: str) -> gpu.types.GPUBatch:
    """The low mesh in world space with unit directions, as cage_shell.draw takes it; directions as in Settings."""
    to_world = mesh_reader.matrix(low)
    with mesh_reader.evaluated(low, depsgraph) as data:
        mesh = mesh_reader.surface(data, "", low.name, to_world)
        away = mesh.to_world_normals(
            mesh.normals if directions == Directions.SPLIT else mesh_reader.smooth_normals(data, mesh)
        )
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
    positions = mesh.positions[mesh.vertices] @ to_world[:3, :3].T + to_world[:3, 3]
    return mesh_upload.upload(mesh.triangles, position=positions.astype(np.float32), direction=away)
