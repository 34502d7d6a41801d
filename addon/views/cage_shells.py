# SPDX-License-Identifier: GPL-3.0-or-later
"""The shells around the low mesh where rays start and end, for display in the viewport."""

import bpy
import gpu
import numpy as np

from ..core.declarations.choices import Directions
from ..core.settings import Settings
from ..engine.rays import low_surface, ray_points
from ..mesh import subdividing
from ..mesh.inputs import Meshes
from ..mesh.local_space import LocalSpace, local_space_of
from ..passes import mesh_upload
from ..passes.bake import rays
from ..passes.view.cage_shell import draw
from ..scene import reading, vertex_weights

__all__ = ["draw", "upload"]

PARTS_OF_BLEND = 4
"""How many parts of a divided triangle lie across the width in which directions blend."""
MOST_PARTS = 32
"""The most parts along an edge of a triangle."""
MOST_PIECES = 2**18
"""The most triangles of a shell, beyond those of the low mesh."""
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
    """The low mesh in world space with its rays, as cage_shell.draw takes it. Raises BakeError for a mesh that rays cannot use.

    A ray starts at the distance `start` times the extrusion or, with a cage, at the distance `start`. settings: of the rays; a
    vertex group that does not exist counts as unpainted. blend_width: in scene units; 0 if directions do not blend.
    is_own_base: whether rays start on the low mesh without its modifiers.
    """
    settings = vertex_weights.without_missing(low, settings)
    meshes = reading.read_low(depsgraph, low, cage, settings, is_own_base=is_own_base, with_uv=False)
    local_space = local_space_of([meshes.low])
    edges = low_surface.build(meshes.low, local_space).edges if blend_width > 0.0 else rays.no_edges()
    is_split = settings.directions == Directions.SPLIT
    directions = rays.Directions(edges, float(is_split), blend_width / local_space.size)
    pieces = subdividing.divide(_parts(meshes, local_space, directions.blend_width))
    found = ray_points.evaluate(meshes, pieces, local_space, directions, extrusion=1.0)
    starts = found.starts if meshes.cage is None else found.starts * np.float32(local_space.size)
    return mesh_upload.upload(
        pieces.triangles,
        position=(found.places * local_space.size + local_space.origin).astype(np.float32),
        direction=found.directions,
        start=starts[:, None],
    )


def _parts(meshes: Meshes, local_space: LocalSpace, blend_width: float) -> np.ndarray:
    """Into how many parts (T,) int the edges of each low triangle are divided: more where directions bend within it."""
    low = meshes.low
    is_bent = _differ(meshes.smooth_normals, low.normals)[low.triangles].any(axis=1)
    if meshes.cage is not None or (blend_width <= 0.0 and meshes.straight is None):
        is_bent[:] = False
    places = local_space.points(low)[low.vertices[low.triangles]]
    longest = np.linalg.norm(places - np.roll(places, 1, axis=1), axis=2).max(axis=1)
    parts = np.full(len(longest), PARTS_OF_BLEND)
    if blend_width > 0.0:
        parts = np.clip(np.ceil(longest * (PARTS_OF_BLEND / blend_width)), 1, MOST_PARTS).astype(np.int64)
    parts = np.where(is_bent, parts, 1)
    pieces = int((parts[is_bent] ** 2).sum())
    return np.maximum(1, parts * MOST_PIECES**0.5 / pieces**0.5).astype(np.int64) if pieces > MOST_PIECES else parts


def _differ(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Which rows (N,) bool of two arrays (N, 3) point into different directions."""
    a, b = (normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30) for normals in (a, b))
    return ((a - b) ** 2).sum(axis=1) > SAME
