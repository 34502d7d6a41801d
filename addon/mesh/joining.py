# SPDX-License-Identifier: GPL-3.0-or-later
"""One mesh of many that stand in many places, as instances do."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from . import threads
from .triangle_mesh import Mesh

ROWS = 2**18
"""Rows of an array that are filled at a time, so that intermediate values stay small."""


@dataclass(frozen=True)
class Part:
    """A mesh, and where it stands: (N, 4, 4) float64 matrices, from its space to the world's."""

    mesh: Mesh
    places: np.ndarray


def standing(places: np.ndarray) -> np.ndarray:
    """Those of `places` (N, 4, 4) in which a surface remains one: finite, and not pressed into a line or a point."""
    finite = places[np.isfinite(places).all(axis=(1, 2))]
    return finite[np.abs(_cofactors(finite[:, :3, :3])).max(axis=(1, 2), initial=0.0) > 0.0]


def joined(name: str, to_world: np.ndarray, parts: Sequence[Part]) -> Mesh:
    """One mesh in the space of `to_world` (4, 4) of all `parts` in all their places, which must be `standing`.

    Positions are in single precision there, and normals as the places turn them. UVs and labels are those of the parts, if
    all of them have some. It has no faces.
    """
    sizes = {
        field: sum(len(part.places) * len(getattr(part.mesh, field)) for part in parts)
        for field in ("positions", "vertices", "triangles")
    }
    points, corners, triangles = sizes.values()
    result = Mesh(
        name=name,
        positions=np.empty((points, 3), np.float32),
        vertices=np.empty(corners, np.int32),
        normals=np.empty((corners, 3), np.float32),
        triangles=np.empty((triangles, 3), np.int32),
        to_world=to_world,
        uv=_room(parts, "uv", corners),
        labels=_room(parts, "labels", triangles),
        not_finite=sum(len(part.places) * part.mesh.not_finite for part in parts),
        instances=sum(len(part.places) for part in parts),
    )
    from_world, start, runs = np.linalg.inv(to_world), np.zeros(3, np.int64), []
    for part in parts:
        size = np.array([len(part.mesh.positions), len(part.mesh.vertices), len(part.mesh.triangles)])
        step = max(1, ROWS // int(size.max()))
        runs += [
            (part.mesh, part.places[first : first + step], start + first * size)
            for first in range(0, len(part.places), step)
        ]
        start = start + len(part.places) * size
    threads.map_parallel(lambda run: _fill(result, run[0], from_world @ run[1], run[2]), runs)
    return result


def _fill(into: Mesh, mesh: Mesh, places: np.ndarray, start: np.ndarray) -> None:
    """Put `mesh` into the arrays of `into` once for each of `places` (N, 4, 4), from `start` on: rows of positions, of
    corners and of triangles."""
    count = len(places)
    matrices, cofactors = places[:, :3, :3], _cofactors(places[:, :3, :3])
    is_mirrored = np.linalg.det(matrices) < 0.0
    # The inverse transpose, but for a factor: it is there for what is pressed flat as well.
    turns = cofactors * np.where(is_mirrored, -1.0, 1.0)[:, None, None]
    turns /= np.abs(turns).max(axis=(1, 2), keepdims=True)
    points, corners, triangles = (
        slice(first, first + count * size)
        for first, size in zip(start, (len(mesh.positions), len(mesh.vertices), len(mesh.triangles)), strict=True)
    )
    moved = mesh.positions @ matrices.transpose(0, 2, 1) + places[:, None, :3, 3]
    with np.errstate(over="ignore"):  # what single precision cannot hold is refused for its size
        into.positions[points] = moved.reshape(-1, 3)
    into.normals[corners] = (mesh.normals @ turns.transpose(0, 2, 1).astype(np.float32)).reshape(-1, 3)
    numbers = np.arange(count, dtype=np.int32)
    before = start[0].astype(np.int32) + numbers * np.int32(len(mesh.positions))
    into.vertices[corners] = (before[:, None] + mesh.vertices).reshape(-1)
    # A mirror turns the winding, by which rays know a front from a back.
    winding = np.where(is_mirrored[:, None, None], mesh.triangles[:, ::-1], mesh.triangles)
    before = start[1].astype(np.int32) + numbers * np.int32(len(mesh.vertices))
    into.triangles[triangles] = (before[:, None, None] + winding).reshape(-1, 3)
    if into.uv is not None:
        into.uv[corners] = np.tile(mesh.uv, (count, 1))
    if into.labels is not None:
        into.labels[triangles] = np.tile(mesh.labels, (count, 1))


def _room(parts: Sequence[Part], field: str, rows: int) -> np.ndarray | None:
    """An array for what all `parts` have, or None."""
    values = [getattr(part.mesh, field) for part in parts]
    if any(value is None for value in values):
        return None
    return np.empty((rows, values[0].shape[1]), values[0].dtype)


def _cofactors(matrices: np.ndarray) -> np.ndarray:
    """The cofactors of matrices (N, 3, 3)."""
    a, b, c = matrices.transpose(1, 0, 2)
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
