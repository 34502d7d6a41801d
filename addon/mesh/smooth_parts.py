# SPDX-License-Identifier: GPL-3.0-or-later
"""Divides a mesh along its hard edges into the parts between them."""

from dataclasses import dataclass

import numpy as np

from . import edges, topology
from .topology import EdgeTable
from .triangle_mesh import Mesh


@dataclass(frozen=True)
class SmoothParts:
    """The parts of a mesh within which neighboring triangles have the same normals at the edges that they share.

    Attributes:
        numbers: (T,) int, the part of each triangle, from 0.
        ends: (E, 2) int, the vertices of each hard edge.
        beside: (E, 2) int, the parts on its two sides, which may be the same. An edge of more than two triangles is listed for
            each two that follow each other.
    """

    numbers: np.ndarray
    ends: np.ndarray
    beside: np.ndarray


def smooth_parts(mesh: Mesh, joined: np.ndarray | None = None) -> SmoothParts | None:
    """The smooth parts of `mesh`; None if it has no hard edge.

    Vertices in one place are one, as exporters split them. The borders of open meshes are not hard.

    joined: the first vertex (V,) int of those that are one, although they lie on opposite sides of a tile; None for none.
    """
    if joined is None and not edges.is_split(mesh).any():
        return None
    places = topology.places(mesh.positions)
    vertices = (places if joined is None else joined[places])[mesh.vertices[mesh.triangles]]
    table = EdgeTable.of(vertices)
    one, other = _neighboring_sides(table)
    has_length = table.first[one] != table.last[one]
    one, other = one[has_length], other[has_length]
    start, stop = (np.roll(mesh.triangles, -i, axis=1).reshape(-1) for i in range(2))
    is_same_way = table.first[one] == table.first[other]
    across = np.where(is_same_way, start[other], stop[other]), np.where(is_same_way, stop[other], start[other])
    is_hard = np.zeros(len(one), bool)
    for corner, beyond in zip((start[one], stop[one]), across, strict=True):
        is_hard |= edges.differ(mesh.normals[corner], mesh.normals[beyond])
    if not is_hard.any():
        return None
    roots = topology.connected(len(vertices), one[~is_hard] // 3, other[~is_hard] // 3)
    _, numbers = topology.numbered(roots)
    ends = mesh.vertices[np.stack([start[one], stop[one]], axis=1)[is_hard]]
    beside = np.stack([numbers[one[is_hard] // 3], numbers[other[is_hard] // 3]], axis=1)
    return SmoothParts(numbers, ends, beside)


def _neighboring_sides(table: EdgeTable) -> tuple[np.ndarray, np.ndarray]:
    """The sides of each edge two by two, as they follow each other, (P,) int each."""
    follows = np.ones(len(table.sides), bool)
    follows[table.begins] = False
    places = np.flatnonzero(follows)
    return table.sides[places - 1], table.sides[places]
