# SPDX-License-Identifier: GPL-3.0-or-later
"""The shells around the low mesh where rays start and end, for display in the viewport."""

import bpy
import gpu
import numpy as np

from ..core.settings import Settings
from ..engine.rays import ray_casting, ray_distances, tree_cache
from ..mesh import subdividing
from ..mesh.inputs import Meshes
from ..mesh.local_space import LocalSpace, local_space_of
from ..passes import mesh_upload
from ..passes.bake import rays
from ..passes.viewport import draw_cage_shell
from ..scene import reading, vertex_weights

__all__ = ["draw_cage_shell", "upload"]

PARTS_OF_BLEND = 4
"""How many parts of a divided triangle lie across the width in which directions blend."""
PARTS = 8
"""Into how many parts the edges of triangles are divided where directions bend without a blend."""
MOST_PARTS = 32
"""The most parts along an edge of a triangle."""
MOST_PIECES = 2**18
"""The most triangles of a shell, beyond those of the low mesh."""
BULGE = 0.98
"""A triangle is divided if the mean of its corners' directions is shorter."""
SAME = 1e-6
"""Normals whose difference is less, squared, are the same."""


def upload(
    low: bpy.types.Object,
    cage: bpy.types.Object | None,
    depsgraph: bpy.types.Depsgraph,
    settings: Settings,
    *,
    blend_width: float,
    is_own_base: bool,
) -> gpu.types.GPUBatch:
    """The low mesh in world space with its rays, as draw_cage_shell takes it. Raises BakeError for a mesh that rays cannot use.

    A ray starts at the distance `start` times the extrusion or, with a cage, at the distance `start`. settings: of the rays; a
    vertex group that does not exist counts as unpainted. blend_width: in scene units; 0 if directions do not blend.
    is_own_base: whether rays start on the low mesh without its modifiers.
    """
    settings = vertex_weights.without_missing(low, settings)
    meshes = reading.read_low(depsgraph, low, cage, settings, is_own_base=is_own_base, with_uv=False)
    local_space = local_space_of([meshes.low])
    edges = tree_cache.upload_hard_edges(meshes.low, local_space)[0] if blend_width > 0.0 else rays.no_edges()
    directions = ray_distances.of_width(settings.tracing.directions, edges, blend_width / local_space.size)
    pieces = subdividing.divide(parts(meshes, local_space, directions.blend_width))
    found = ray_casting.rays_at_points(meshes, pieces, local_space, directions, extrusion=1.0)
    starts = found.starts if meshes.cage is None else found.starts * np.float32(local_space.size)
    return mesh_upload.upload(
        pieces.triangles,
        position=(found.places * local_space.size + local_space.origin).astype(np.float32),
        direction=found.directions,
        start=starts[:, None],
    )


def parts(meshes: Meshes, local_space: LocalSpace, blend_width: float) -> np.ndarray:
    """Into how many parts (T,) int the edges of each low triangle are divided: more where directions bend within it."""
    low, corners = meshes.low, meshes.low.triangles
    smooth, straight = _unit(meshes.smooth_normals), _unit(low.normals)
    is_turned = (((smooth - straight) ** 2).sum(axis=1) > SAME)[corners].any(axis=1)
    # Directions have length one between corners as well, so the shell bulges where they differ much.
    is_bent = is_turned & (blend_width > 0.0)
    for normals in (smooth, straight):
        is_bent |= np.linalg.norm(normals[corners].mean(axis=1), axis=1) < BULGE
    if meshes.cage is not None:
        is_bent[:] = False
    places = local_space.points(low)[low.vertices[corners]]
    longest = np.linalg.norm(places - np.roll(places, 1, axis=1), axis=2).max(axis=1)
    parts = np.full(len(longest), PARTS)
    if blend_width > 0.0:
        parts = np.clip(np.ceil(longest * (PARTS_OF_BLEND / blend_width)), 1, MOST_PARTS).astype(np.int64)
    parts = np.where(is_bent, parts, 1)
    pieces = int((parts[is_bent] ** 2).sum())
    return np.maximum(1, parts * MOST_PIECES**0.5 / pieces**0.5).astype(np.int64) if pieces > MOST_PIECES else parts


def _unit(normals: np.ndarray) -> np.ndarray:
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
