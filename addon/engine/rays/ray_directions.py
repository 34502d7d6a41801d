# SPDX-License-Identifier: GPL-3.0-or-later
"""Decides how ray directions blend between the low mesh's smooth normals and its own, and measures how wide the blend is."""

import numpy as np

from ...core.declarations.choices import Directions, Hit
from ...mesh.inputs import Meshes
from ...passes.bake import cast, rays
from .low_surface import LowSurface, SharpPoints
from .ray_distances import WHOLE_WORLD, rounded, traced

BEVELS = 2.0
"""The width of the blend, in widths of the high mesh's bevels."""
CROSSING = 1.5
"""The least width of the blend, in distances between the two surfaces at hard edges: rays on a narrower one would cross."""
CROSSING_QUANTILE = 0.9
"""Distances beyond this quantile are outliers, as where another part hides an edge."""
LEAST_WIDTH = 1e-4
"""In local space. A blend of no width would be smooth directions everywhere, as if there were no hard edges."""
MOST_POINTS = 2**14
"""The most points on hard edges that are measured."""


def choose(which: str, meshes: Meshes, low_surface: LowSurface, tables: cast.Tables) -> rays.Directions:
    """The directions for the setting `which`. BLENDED is SMOOTH for a low mesh without hard edges, and with a cage."""
    blends = may_blend(which, has_cage=meshes.cage is not None) and low_surface.sharp is not None
    return of_width(which, low_surface.edges, _blend_width(meshes, low_surface.sharp, tables) if blends else 0.0)


def may_blend(which: str, *, has_cage: bool) -> bool:
    """Whether directions blend at hard edges. A cage decides the directions alone."""
    return which == Directions.BLENDED and not has_cage


def of_width(which: str, edges: rays.Edges, blend_width: float) -> rays.Directions:
    """The directions for the setting `which`. blend_width: in local space; 0 if they do not blend."""
    return rays.Directions(edges, straight_share=float(which == Directions.SPLIT), blend_width=blend_width)


def _blend_width(meshes: Meshes, sharp: SharpPoints, tables: cast.Tables) -> float:
    """How wide the blend along hard edges is, in local space.

    The high mesh's bevels show in how far its surface is from the low mesh's sharp edges, along their smooth normals.
    """
    low = meshes.low
    by_vertex = np.zeros((len(low.positions), 3), np.float32)
    by_vertex[low.vertices] = low.to_world_normals(meshes.smooth_normals)
    chosen = slice(None, None, -(-len(sharp.places) // MOST_POINTS))
    ends = by_vertex[sharp.vertices[chosen]]
    ends /= np.maximum(np.linalg.norm(ends, axis=2, keepdims=True), np.finfo(np.float32).tiny)
    heights, has_hit = _heights(sharp.places[chosen], ends.sum(axis=1), tables)
    if not has_hit.any():
        return 0.0
    distances = np.abs(heights[has_hit])
    bevels = distances / np.maximum(sharp.cosines[chosen][has_hit], 0.1)
    width = max(LEAST_WIDTH, BEVELS * np.median(bevels), CROSSING * np.quantile(distances, CROSSING_QUANTILE))
    return rounded(float(width))


def _heights(places: np.ndarray, normals: np.ndarray, tables: cast.Tables) -> tuple[np.ndarray, np.ndarray]:
    """How far the nearest high surface lies along normals (N, 3) from places (N, 3).

    Returns heights (N,), and which rays hit, (N,) bool.
    """
    drawn = rays.upload_points(places, normals, WHOLE_WORLD)
    texels = traced(
        tables, None, drawn, rule=Hit.NEAREST, inside=WHOLE_WORLD, max_t=2.0 * WHOLE_WORLD, facing_only=False
    )
    texels = texels.reshape(-1, 4)[: len(places)]
    return texels[:, 0], texels[:, 3] > 0.0
