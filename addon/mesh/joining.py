# SPDX-License-Identifier: GPL-3.0-or-later
"""Joins many meshes, each with many instances, into one mesh."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core import threads
from .triangle_mesh import TANGENTS, Mesh
from .triangles import cross

ROWS = 2**18
"""Rows of an array filled at a time, so that intermediate values stay small."""


@dataclass(frozen=True)
class Part:
    """A mesh and its instances.

    Attributes:
        mesh: in its own space.
        matrices: (N, 4, 4) float64, from there to world space, one for each instance.
    """

    mesh: Mesh
    matrices: np.ndarray


def usable(matrices: np.ndarray) -> np.ndarray:
    """Those of `matrices` (N, 4, 4) that keep a surface: finite, and not flattened to a line or a point."""
    finite = matrices[np.isfinite(matrices).all(axis=(1, 2))]
    return finite[np.abs(_cofactors(finite[:, :3, :3])).max(axis=(1, 2), initial=0.0) > 0.0]


def join(name: str, to_world: np.ndarray, parts: Sequence[Part]) -> Mesh:
    """Join all instances of all `parts` into one mesh in the space of `to_world` (4, 4).

    The matrices must be `usable`. Positions are float32 in that space. The result has UVs and labels where all parts have
    them, and no faces.
    """
    sizes = {
        field: sum(len(part.matrices) * len(getattr(part.mesh, field)) for part in parts)
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
        uv=_empty(parts, "uv", corners),
        labels=_empty(parts, "labels", triangles),
        not_finite=sum(len(part.matrices) * part.mesh.not_finite for part in parts),
        without_normals=sum(len(part.matrices) * part.mesh.without_normals for part in parts),
        instances=sum(len(part.matrices) for part in parts),
        layers=_empty_layers(parts, corners),
        normals_domain=_common_domain(parts),
    )
    from_world, start, runs = np.linalg.inv(to_world), np.zeros(3, np.int64), []
    for part in parts:
        size = np.array([len(part.mesh.positions), len(part.mesh.vertices), len(part.mesh.triangles)])
        step = max(1, ROWS // int(size.max()))
        runs += [
            (part.mesh, part.matrices[first : first + step], start + first * size)
            for first in range(0, len(part.matrices), step)
        ]
        start = start + len(part.matrices) * size
    threads.map_parallel(lambda run: _fill(result, run[0], from_world @ run[1], run[2]), runs)
    return result


def _fill(into: Mesh, mesh: Mesh, matrices: np.ndarray, start: np.ndarray) -> None:
    """Write one instance of `mesh` for each of `matrices` (N, 4, 4) into the arrays of `into`.

    start (3,) int: the first rows to write, of positions, corners and triangles.
    """
    count = len(matrices)
    linear, cofactors = matrices[:, :3, :3], _cofactors(matrices[:, :3, :3])
    is_mirrored = np.linalg.det(linear) < 0.0
    # Up to a factor this is the inverse transpose, and it exists for flattened instances as well.
    turns = cofactors * np.where(is_mirrored, -1.0, 1.0)[:, None, None]
    turns /= np.abs(turns).max(axis=(1, 2), keepdims=True)
    points, corners, triangles = (
        slice(first, first + count * size)
        for first, size in zip(start, (len(mesh.positions), len(mesh.vertices), len(mesh.triangles)), strict=True)
    )
    moved = mesh.positions @ linear.transpose(0, 2, 1) + matrices[:, None, :3, 3]
    with np.errstate(over="ignore"):  # a later check refuses meshes that are too large for single precision
        into.positions[points] = moved.reshape(-1, 3)
    into.normals[corners] = (mesh.normals @ turns.transpose(0, 2, 1).astype(np.float32)).reshape(-1, 3)
    numbers = np.arange(count, dtype=np.int32)
    before = start[0].astype(np.int32) + numbers * np.int32(len(mesh.positions))
    into.vertices[corners] = (before[:, None] + mesh.vertices).reshape(-1)
    # A mirror reverses the winding, by which rays tell front faces from back faces.
    winding = np.where(is_mirrored[:, None, None], mesh.triangles[:, ::-1], mesh.triangles)
    before = start[1].astype(np.int32) + numbers * np.int32(len(mesh.vertices))
    into.triangles[triangles] = (before[:, None, None] + winding).reshape(-1, 3)
    if into.uv is not None:
        into.uv[corners] = np.tile(mesh.uv, (count, 1))
    if into.labels is not None:
        into.labels[triangles] = np.tile(mesh.labels, (count, 1))
    for key, values in mesh.layers.items():
        if key[0] == TANGENTS:
            turned = values[:, :3] @ linear.transpose(0, 2, 1).astype(np.float32)
            # A mirror turns the bitangent around.
            signs = np.where(is_mirrored, -1.0, 1.0)[:, None] * values[:, 3]
            into.layers[key][corners] = np.concatenate([turned, signs[..., None]], axis=2).reshape(-1, 4)
        else:
            into.layers[key][corners] = np.tile(values, (count, 1))


def _common_domain(parts: Sequence[Part]) -> str:
    """The normals_domain that all `parts` have; empty if they differ."""
    domains = {part.mesh.normals_domain for part in parts}
    return domains.pop() if len(domains) == 1 else ""


def _empty(parts: Sequence[Part], field: str, rows: int) -> np.ndarray | None:
    """An empty array for a field that all `parts` have, or None where one lacks it."""
    values = [getattr(part.mesh, field) for part in parts]
    if any(value is None for value in values):
        return None
    return np.empty((rows, values[0].shape[1]), values[0].dtype)


def _empty_layers(parts: Sequence[Part], rows: int) -> dict[tuple[str, str], np.ndarray]:
    """Arrays of zeros for all layers that any of `parts` has."""
    return {
        key: np.zeros((rows, values.shape[1]), np.float32) for part in parts for key, values in part.mesh.layers.items()
    }


def _cofactors(matrices: np.ndarray) -> np.ndarray:
    """The cofactors of matrices (N, 3, 3)."""
    a, b, c = matrices.transpose(1, 2, 0)
    return np.stack([np.stack(cross(one, other), axis=1) for one, other in ((b, c), (c, a), (a, b))], axis=1)
