# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds UV islands, and faces that lie on the same place in UV space."""

from dataclasses import replace
from functools import partial

import numpy as np

from . import topology, uv_layout
from .topology import hashes
from .triangle_mesh import MaybeArray, Mesh

FEW_STEPS, NEAR = 2.5e-7, 1e-5
"""UVs that differ by less than this are the same. The limit is the first number, a few steps of single precision, on dense
meshes and rises to the second on coarse ones."""


def islands(mesh: Mesh) -> np.ndarray:
    """The number of each triangle's UV island, (T,) int from 0. The triangles of an island are connected on the surface and
    in UV space."""
    triangles = mesh.triangles
    if not len(triangles):
        return np.zeros(0, np.int64)
    # A UV and a vertex together identify a corner: the vertex alone would join islands across a seam, the UV alone would
    # join islands on the same place. Most vertices have one UV, so that the vertex is enough; only the rest needs sorting.
    uv, corners = mesh.uv.view(np.uint64)[:, 0], triangles.reshape(-1)
    vertices = mesh.vertices[corners]
    first = np.zeros(len(mesh.positions), corners.dtype)
    first[vertices] = corners
    node, has_other_uv = vertices.astype(np.int64), uv[corners] != uv[first[vertices]]
    keys = np.stack([vertices[has_other_uv].astype(np.uint64), uv[corners[has_other_uv]]], axis=1)
    node[has_other_uv] = len(mesh.positions) + np.unique(hashes(keys), return_inverse=True)[1]
    return topology.components(tuple(node.reshape(-1, 3).T), int(node.max()) + 1)[0]


def parts(mesh: Mesh) -> np.ndarray:
    """The number of each triangle's part, (T,) int from 0, in the order of their first triangles.

    A part is a UV island, or that side of an island that is folded over along the middle of a mirrored mesh. `mesh` must have
    faces: all triangles of a face are on the same side.
    """
    is_mirrored = (np.bincount(mesh.faces, uv_layout.areas(mesh)) < 0.0)[mesh.faces]
    sides = np.zeros(len(mesh.triangles), np.int64)
    for side in (~is_mirrored, is_mirrored):
        numbers_of_side = islands(replace(mesh, triangles=mesh.triangles[side]))
        sides[side] = numbers_of_side + sides.max(initial=-1) + 1
    _, first, numbers = np.unique(sides, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[numbers]


def count_islands(mesh: Mesh, chosen: np.ndarray) -> int:
    """The number of islands that the `chosen` triangles (T,) bool form."""
    return int(islands(replace(mesh, triangles=mesh.triangles[chosen])).max(initial=-1)) + 1


def welded(mesh: Mesh) -> Mesh:
    """`mesh` with vertices in the same place merged: many file formats split vertices at hard edges and seams."""
    return replace(mesh, vertices=topology.places(mesh.positions)[mesh.vertices])


def stacks(mesh: Mesh, uv: MaybeArray = None) -> np.ndarray:
    """A number for each face, (F,) int, that is equal for faces on the same place in UV space. `mesh` must have faces.

    Faces are on the same place if their corners have the same UVs in any order: mirrored halves laid on each other count.
    uv (C, 2): UVs to use instead of the mesh's own.
    """
    uv = mesh.uv if uv is None else uv
    owner = _owners(mesh)
    used = np.flatnonzero(owner >= 0)
    places = hashes(np.stack([_near(uv[used, axis]) for axis in range(2)], axis=1))
    sums = np.zeros(int(mesh.faces.max()) + 1, np.uint64)
    np.add.at(sums, owner[used], places)  # a sum does not depend on the order of corners
    return np.unique(sums, return_inverse=True)[1]


def stacked(mesh: Mesh, kinds: np.ndarray) -> np.ndarray:
    """As `islands`, where those with faces of one kind on the same place are one. `mesh` must have faces.

    kinds: (T,) int from 0, of each triangle.
    """
    numbers, places = islands(mesh), stacks(mesh)[mesh.faces].astype(np.int64)
    joined = numbers, numbers.max(initial=-1) + 1 + places * (int(kinds.max(initial=0)) + 1) + kinds
    return topology.components((*joined, joined[1]), int(joined[1].max(initial=-1)) + 1)[0]


def places(mesh: Mesh) -> np.ndarray:
    """A number for each corner, (C,) int, that is equal for those on the same place in UV space, nearly."""
    return np.unique(np.stack([_near(mesh.uv[:, axis]) for axis in range(2)], axis=1), axis=0, return_inverse=True)[1]


def points_at_a_place(mesh: Mesh) -> float:
    """How many points of the surface, in the mean, have the same UV, of the points of corners. 0 without triangles."""
    used = np.unique(mesh.triangles)
    if not len(used):
        return 0.0
    places = hashes(np.stack([_near(mesh.uv[used, axis]) for axis in range(2)], axis=1))
    points = hashes(np.stack([places, mesh.vertices[used].astype(np.uint64)], axis=1))
    return len(np.unique(points)) / len(np.unique(places))


def without_copies(mesh: Mesh) -> np.ndarray:
    """Which triangles (T,) bool to keep, so that only one of the faces on the same place in UV space is left."""
    first = np.unique(stacks(mesh), return_index=True)[1]
    stays = np.zeros(int(mesh.faces.max()) + 1, bool)
    stays[first] = True
    return stays[mesh.faces]


def moved_copies(mesh: Mesh) -> np.ndarray:
    """Which triangles (T,) bool lie outside the tile 0 to 1 and, moved back by whole tiles, on faces inside it.

    Artists move mirrored parts like this so that only one half is baked. `mesh` must have faces. They are found once.
    """
    return mesh.remembered("moved copies", (), partial(_moved_copies, mesh))


def _moved_copies(mesh: Mesh) -> np.ndarray:
    outside = uv_layout.outside(mesh)
    if not outside.any():
        return outside
    owner = _owners(mesh)
    used = np.flatnonzero(owner >= 0)
    count = int(mesh.faces.max()) + 1
    corners = np.maximum(np.bincount(owner[used], minlength=count), 1)
    back, is_whole, island = np.zeros_like(mesh.uv), True, islands(mesh)
    for axis in range(2):
        tile = np.floor(np.bincount(owner[used], mesh.uv[used, axis], count) / corners)
        back[used, axis] = mesh.uv[used, axis] - tile[owner[used]]
        island_tile = np.zeros(int(island.max()) + 1)
        island_tile[island] = tile[mesh.faces]
        is_part = np.bincount(island, island_tile[island] != tile[mesh.faces]) > 0.0
        is_whole &= ~is_part[island]
    was_outside = np.zeros(count, bool)
    was_outside[mesh.faces[outside]] = True
    place = stacks(mesh, back)
    has_inside = np.zeros(len(place), bool)
    has_inside[place[~was_outside]] = True
    return outside & is_whole & has_inside[place][mesh.faces]


def crossing(mesh: Mesh) -> np.ndarray:
    """Which triangles (T,) bool cross the border between two UV tiles."""
    corners = mesh.uv[mesh.triangles]
    lowest, highest = corners.min(axis=1), corners.max(axis=1)
    tile = np.floor(lowest + uv_layout.ON_THE_RIM)
    return (highest > tile + 1.0 + uv_layout.ON_THE_RIM).any(axis=1)


def _owners(mesh: Mesh) -> np.ndarray:
    """The face of each corner, (C,) int, -1 for corners that no triangle uses."""
    owner = np.full(len(mesh.vertices), -1, np.int64)
    owner[mesh.triangles] = mesh.faces[:, None]
    return owner


def _near(values: np.ndarray) -> np.ndarray:
    """A number for each of `values` (N,), equal for values that are nearly the same."""
    order = np.argsort(values)
    near = np.clip(0.1 / max(1, len(values)), FEW_STEPS, NEAR)
    groups = np.empty(len(values), np.uint64)
    groups[order] = np.cumsum(np.diff(values[order], prepend=values[order[:1]]) > near)
    return groups
