# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays need of the low mesh on the GPU: its triangles, which own hits, and its hard edges."""

from dataclasses import dataclass

import numpy as np

from ...core.errors import BakeError
from ...mesh import edges
from ...mesh.local_space import LocalSpace, local_space_of
from ...mesh.spatial import bvh, neighbors
from ...mesh.triangle_mesh import Mesh
from ...passes import data_texture
from ...passes.bake import owners, rays

BEND = np.cos(np.radians(30.0))
"""The cosine of the angle between two faces from which a hard edge is a feature of the shape. With flat shading, all edges are
hard."""

ROOM = 0.03
"""Share of the low mesh's diagonal that rays search on both sides at least, if hits have owners: parts that stand off the
surface are few, so that measuring does not see them all."""
PLACES = 0.2, 0.4, 0.6, 0.8
"""Where on a hard edge the points lie, as shares of its length."""


@dataclass(frozen=True)
class LowSurface:
    """The low mesh as rays see it.

    owners: its tree. numbers (T,) int: of its triangles in the tree, from 1. starts (T,) int: of the triangles where walks for
    their hits start. edges: its hard edges; none if none of them is a feature of the shape. sharp: points on those that are, or
    None.
    """

    owners: owners.Owners
    numbers: np.ndarray
    starts: np.ndarray
    edges: rays.Edges
    sharp: "SharpPoints | None"

    @property
    def bytes(self) -> int:
        """The GPU memory of both trees."""
        return data_texture.size_of(self.owners.nodes, self.owners.corners, self.edges.nodes, self.edges.ends)


@dataclass(frozen=True)
class SharpPoints:
    """Points on hard edges.

    places (N, 3) float32 in local space. vertices (N, 2) int: the ends of each point's edge. cosines (N,): of half the angle
    between the faces' normals.
    """

    places: np.ndarray
    vertices: np.ndarray
    cosines: np.ndarray


def build(low: Mesh, local_space: LocalSpace, *, has_clearances: bool = True) -> LowSurface:
    """Build and upload the tree over `low` and the one over its hard edges. Raises BakeError for too many triangles.

    has_clearances: as owners.upload has it.
    """
    if not fits(low):
        raise BakeError(
            f"{low.name!r} has {len(low.triangles):,} triangles; rays take at most {_most():,} of the low mesh on this GPU."
        )
    points = local_space.points(low)
    vertices = np.take(low.vertices, low.front_triangles, mode="clip")  # the winding decides where faces point
    tree = bvh.build(points, vertices)
    ordered = vertices[tree.order]
    corners, has_area = points[ordered], neighbors.has_area(points, ordered)
    # In one point, a triangle has a normal of exactly 0 on any GPU, which agrees with no hit.
    corners[~has_area] = corners[~has_area][:, :1]
    across, nearest = neighbors.past_flat(points, ordered, has_area)
    uploaded = owners.upload(
        tree.nodes,
        corners,
        across,
        first_leaf=tree.first_leaf,
        origin=tree.origin,
        scale=tree.scale,
        room=ROOM * 2.0 * local_space_of([low]).size / local_space.size,
        has_clearances=has_clearances,
    )
    numbers = np.empty(len(vertices), np.int64)
    numbers[tree.order] = np.arange(1, len(vertices) + 1)
    starts = 1 + nearest[numbers - 1]
    return LowSurface(uploaded, numbers, starts, *upload_hard_edges(low, local_space))


def fits(low: Mesh) -> bool:
    """Whether rays take so many triangles of a low mesh on this GPU."""
    return len(low.triangles) <= _most()


def _most() -> int:
    return min(rays.MOST_TRIANGLES, data_texture.limit() // owners.TEXELS)


def upload_hard_edges(low: Mesh, local_space: LocalSpace) -> tuple[rays.Edges, SharpPoints | None]:
    """Upload the hard edges of `low`, as LowSurface has them, and the points on those that are features of the shape."""
    points, (ends, cosines) = local_space.points(low), edges.hard_edges(low)
    is_sharp = cosines < BEND
    if not is_sharp.any():
        return rays.no_edges(), None
    tree = bvh.build(points, ends[:, [0, 1, 1]])
    uploaded = rays.upload_edges(
        tree.nodes, points[ends[tree.order]], first_leaf=tree.first_leaf, origin=tree.origin, scale=tree.scale
    )
    # Each place is on the edge itself, where another part may hide it: several on each edge see more.
    sharp = np.repeat(ends[is_sharp], len(PLACES), axis=0)
    half = np.repeat(np.sqrt(0.5 * (1.0 + np.clip(cosines[is_sharp], -1.0, 1.0))), len(PLACES))
    along = np.tile(np.float32(PLACES), np.count_nonzero(is_sharp))[:, None]
    return uploaded, SharpPoints(points[sharp[:, 0]] * (1.0 - along) + points[sharp[:, 1]] * along, sharp, half)
