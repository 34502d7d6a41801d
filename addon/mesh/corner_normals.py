# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes the normals of corners anew: where faces were turned over, where vertices were not joined, and smoother ones."""

from dataclasses import replace

import numpy as np

from . import topology
from .edges import differ
from .orientation import edge_pairs
from .triangle_mesh import TANGENTS, Mesh
from .triangles import angles_between, dot, face_normals, unit, unit_normals

SMOOTH_COSINE = float(np.cos(np.radians(30.0)))
"""The cosine of the angle between two faces up to which the surface is smooth where the mesh itself cannot tell."""


def turned_over(mesh: Mesh, is_turned: np.ndarray, places: np.ndarray) -> Mesh:
    """`mesh` with some triangles (T,) bool turned over, and normals that fit. places: as Patches has them."""
    triangles = wound_over(mesh, is_turned).triangles
    layers = {
        key: _mirrored(values, mesh.triangles[is_turned]) if key[0] == TANGENTS else values
        for key, values in mesh.layers.items()
    }
    normals = _negated(mesh, is_turned)
    mesh = replace(mesh, triangles=triangles, face_corners=None, normals=normals, layers=layers)
    is_mixed = np.zeros(len(mesh.positions), bool)
    if mesh.normals_domain in {"POINT", "CORNER"}:
        vertices = places[mesh.vertices[triangles]]
        is_mixed[vertices[is_turned]] = True
        beside = np.zeros_like(is_mixed)
        beside[vertices[~is_turned]] = True
        is_mixed &= beside
    return _rebuilt(mesh, places, is_mixed | _is_split(mesh, places), is_turned)


def wound_over(mesh: Mesh, is_turned: np.ndarray) -> Mesh:
    """`mesh` with some triangles (T,) bool turned over, for what asks for no normals."""
    triangles = mesh.triangles.copy()
    triangles[is_turned, 1], triangles[is_turned, 2] = mesh.triangles[is_turned, 2], mesh.triangles[is_turned, 1]
    return replace(mesh, triangles=triangles, face_corners=None)


def joined(mesh: Mesh, places: np.ndarray) -> Mesh:
    """`mesh` with smooth normals where vertices are at one place, but not joined, and its faces are smooth."""
    is_bad = _is_split(mesh, places)
    return _rebuilt(mesh, places, is_bad, np.zeros(len(mesh.triangles), bool)) if is_bad.any() else mesh


def joined_at(mesh: Mesh, places: np.ndarray) -> Mesh:
    """`mesh` with one normal at places with several vertices: the mean by the angles of their faces, as if they were joined.
    places: as Patches has them. Vertices with several normals, or of flat faces, keep theirs."""
    is_at = np.bincount(places, minlength=len(places)) > 1
    corners = mesh.triangles[_touching(mesh, is_at[places])]
    vertices, numbers = topology.numbered(mesh.vertices[corners].reshape(-1))
    units, _ = unit_normals(mesh.positions, mesh.vertices[corners], np.float64)
    weighted = _angles(mesh, corners)[:, :, None] * units[:, None]
    weights = np.linalg.norm(topology.sums_of(numbers, weighted.reshape(-1, 3), len(vertices)), axis=1)
    of_corners, own = mesh.normals[corners].astype(np.float64), np.empty((len(vertices), 3))
    own[numbers] = of_corners.reshape(-1, 3)
    stays = ~is_at[places[vertices]]
    stays[numbers[(of_corners.reshape(-1, 3) != own[numbers]).any(axis=1)]] = True
    if mesh.normals_domain == "CORNER":
        stays[numbers.reshape(-1, 3)[(of_corners == of_corners[:, :1]).all(axis=(1, 2))]] = True
    sums = topology.sums_of(places[vertices], own * (weights * ~stays)[:, None], len(places))[places[vertices]]
    stays |= np.linalg.norm(sums, axis=1) < 1e-6
    is_changed, normals = ~stays[numbers], mesh.normals.copy()
    normals[corners.reshape(-1)[is_changed]] = unit(sums[numbers[is_changed]])
    return replace(mesh, normals=normals)


def share_alone(mesh: Mesh, places: np.ndarray) -> float:
    """The share of the triangles that have all corners at places with several vertices, as in a scan that was not welded."""
    is_split = _is_split(mesh, places)
    if not is_split.any():
        return 0.0
    return float(np.mean(is_split[places[mesh.vertices[mesh.triangles]]].all(axis=1)))


def bent(mesh: Mesh) -> float:
    """The mean angle in degrees between the normals of corners and their faces, by area: 0 where faces are flat."""
    faces, areas = unit_normals(mesh.positions, mesh.vertices[mesh.triangles], np.float64)
    angles = angles_between(unit(mesh.normals[mesh.triangles].astype(np.float64)), faces[:, None])
    return float(np.degrees((angles.mean(axis=1) * areas).sum() / max(float(areas.sum()), 1e-300)))


def _mirrored(tangents: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """`tangents` (C, 4) with the other sign of the bitangent at some corners: with the face, its UVs are seen from behind."""
    tangents = tangents.copy()
    tangents[np.unique(corners), 3] *= -1.0
    return tangents


def _negated(mesh: Mesh, is_turned: np.ndarray) -> np.ndarray:
    """The normals of `mesh`; those of the turned triangles point to their new sides. The triangles are not turned yet."""
    normals, some = mesh.normals.copy(), mesh.triangles[is_turned]
    faces = face_normals(mesh.positions, mesh.vertices[some], np.float64).astype(np.float32)
    # A mesh may have normals of its own that were right where its faces were not.
    against = (normals[some] * faces[:, None]).sum(axis=2) >= 0.0
    is_negated = np.zeros(len(normals), bool)
    is_negated[some[against]] = True
    normals[is_negated] *= -1.0
    return normals


def _is_split(mesh: Mesh, places: np.ndarray) -> np.ndarray:
    """Which places (V,) bool have several vertices, of a mesh whose normals Blender computed for vertices."""
    is_split = np.zeros(len(places), bool)
    if mesh.normals_domain == "POINT":
        is_split[places[places != np.arange(len(places))]] = True
    return is_split


def _rebuilt(mesh: Mesh, places: np.ndarray, is_bad: np.ndarray, is_turned: np.ndarray) -> Mesh:
    """`mesh` with new normals at some places (V,) bool: means of the faces around, by their angles, between hard edges.

    Without a normal of its own, an edge is hard where its faces meet at more than SMOOTH_COSINE.
    """
    if not is_bad.any():
        return mesh
    some = _touching(mesh, is_bad[places])
    corners = mesh.triangles[some]
    of_corners = mesh.vertices[corners]
    vertices = places[of_corners]
    units, _ = unit_normals(mesh.positions, of_corners, np.float64)
    whole = np.flatnonzero(topology.has_corners(vertices))
    pairs, cosines = edge_pairs(vertices[whole], units[whole])
    # Corners of one vertex have one normal, unless the mesh says otherwise.
    nodes, numbers = topology.numbered(of_corners if mesh.normals_domain == "POINT" else corners)
    # Both sides of an edge: the corner at its start and at its end; the other side runs the other way.
    starts, ends = numbers.reshape(-1), np.roll(numbers, -1, axis=1).reshape(-1)
    one, other = (3 * whole[side // 3] + side % 3 for side in (pairs.first, pairs.second))
    beside = (
        np.where(pairs.is_against, starts[other], ends[other]),
        np.where(pairs.is_against, ends[other], starts[other]),
    )
    first, next_to = np.concatenate([starts[one], ends[one]]), np.concatenate(beside)
    is_soft = np.tile(cosines >= SMOOTH_COSINE, 2)
    if mesh.normals_domain != "POINT":
        is_mixed = is_turned[some[one // 3]] != is_turned[some[other // 3]]
        corner, across = nodes[first], nodes[next_to]
        is_known = np.tile(~is_mixed, 2) & (mesh.vertices[corner] == mesh.vertices[across])
        differs = differ(mesh.normals[corner], mesh.normals[across]).reshape(2, -1).any(axis=0)
        is_soft = np.where(is_known, ~np.tile(differs, 2), is_soft)
    groups = topology.connected(len(nodes), first[is_soft], next_to[is_soft])[numbers]
    weighted = _angles(mesh, corners)[:, :, None] * units[:, None]
    sums = topology.sums_of(groups.reshape(-1), weighted.reshape(-1, 3), len(nodes))
    is_used = is_bad[vertices]
    used, new = corners[is_used], sums[groups[is_used]]
    lengths = np.linalg.norm(new, axis=1)
    normals, is_known = mesh.normals.copy(), lengths > 1e-6
    normals[used[is_known]] = (new[is_known] / lengths[is_known, None]).astype(np.float32)
    return replace(mesh, normals=normals, normals_domain="" if mesh.normals_domain == "POINT" else mesh.normals_domain)


def _touching(mesh: Mesh, chosen: np.ndarray) -> np.ndarray:
    """The triangles (N,) int that have one of the chosen vertices (V,) bool."""
    is_chosen = chosen[mesh.vertices]
    a, b, c = (is_chosen[mesh.triangles[:, corner]] for corner in range(3))
    return np.flatnonzero(a | b | c)


def _angles(mesh: Mesh, corners: np.ndarray) -> np.ndarray:
    """The angles (T, 3) of triangles (T, 3), indices of corners."""
    points = mesh.positions[mesh.vertices[corners.T]].astype(np.float64)
    along = np.moveaxis(np.roll(points, -1, axis=0) - points, 2, 0)
    along = along / np.maximum(np.sqrt(dot(along, along)), 1e-300)
    return np.arccos(np.clip(-dot(along, np.roll(along, 1, axis=1)), -1.0, 1.0)).T


def smoothed(mesh: Mesh, rounds: int, places: np.ndarray | None = None) -> tuple[Mesh, np.ndarray]:
    """`mesh` with normals that are means of those around, and by how many degrees each corner of a triangle was turned (N,).

    In each round, a corner takes the mean of the triangles around it, by their angles there. Corners of one vertex with other
    normals, as at hard edges, stay apart. places: as Patches has them, if vertices in one place count as one.
    """
    used = mesh.triangles.reshape(-1)
    normals = mesh.normals[used].astype(np.float64)
    # Corners of one vertex with the same normal are one.
    vertices = mesh.vertices[used] if places is None else places[mesh.vertices[used]].astype(np.int32)
    group = topology.first_rows(np.column_stack([vertices.view(np.uint32), mesh.normals[used].view(np.uint32)]))
    angles, before = _angles(mesh, mesh.triangles).reshape(-1), normals
    for _ in range(rounds):
        of_triangle = np.repeat(unit(normals.reshape(-1, 3, 3).sum(axis=1)), 3, axis=0)
        sums = topology.sums_of(group, angles[:, None] * of_triangle, len(group))[group]
        normals = np.where(np.linalg.norm(sums, axis=1, keepdims=True) > 1e-9, unit(sums), normals)
    turned = np.degrees(angles_between(unit(before), normals))
    changed = mesh.normals.copy()
    changed[used] = normals.astype(np.float32)
    domain = "" if mesh.normals_domain == "FACE" else mesh.normals_domain
    return replace(mesh, normals=changed, normals_domain=domain), turned
