# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh as plain arrays, and what can be said of it without Blender."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from . import threads


@dataclass(frozen=True)
class Mesh:
    """One object's surface, by face corners, in its own space.

    positions (V, 3) float32. One row a corner: vertices (C,) int32, indices into positions; normals (C, 3) float32;
    uv (C, 2) float32, or None where no layer was read; tangents (C, 4) float32, w the bitangent's sign, or None.
    triangles (T, 3) int32, indices into the corners; faces (T,) int32, the number of the face that each is of, or None
    where that was not asked for; labels (T, n), numbers that go with each triangle, or None. to_world (4, 4) float64.
    not_finite: how many triangles were left out for NaN or infinite values. instances: of how many meshes in their places it
    is made; 0 for an object's own mesh alone.
    """

    name: str
    positions: np.ndarray
    vertices: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    to_world: np.ndarray
    uv: np.ndarray | None = None
    tangents: np.ndarray | None = None
    not_finite: int = 0
    faces: np.ndarray | None = None
    labels: np.ndarray | None = None
    instances: int = 0

    def to_world_normals(self, normals: np.ndarray) -> np.ndarray:
        """`normals` (N, 3) of this mesh's space in the world's; float32, not of length one."""
        return normals @ normal_matrix(self.to_world).T.astype(np.float32)

    @cached_property
    def box(self) -> np.ndarray:
        """The lowest and the highest coordinates (2, 3) float64, in the mesh's space, of what its triangles use."""
        # Loose vertices, which may be anywhere, do not count.
        is_used = np.zeros(len(self.positions), bool)
        is_used[np.take(self.vertices, self.triangles, mode="clip")] = True
        used = self.positions if is_used.all() else self.positions[is_used]
        # One axis after another: reducing along a short last axis is ten times slower.
        return np.array([[pick(axis) for axis in used.T] for pick in (np.min, np.max)], np.float64)


FARTHEST = 1e8
"""Of a frame's units: single precision rounds anything farther by more than the frame is large."""


@dataclass(frozen=True)
class LocalSpace:
    """A space whose origin and unit fit some meshes, so that single precision is as good 10 km away as here.

    center (3,) float64 in world space; size in world units. World axes.
    """

    center: np.ndarray
    size: float

    def points(self, mesh: Mesh) -> np.ndarray:
        """The positions (V, 3) float32 of `mesh` in this space."""
        matrix = mesh.to_world[:3, :3] / self.size
        offset = (mesh.to_world[:3, 3] - self.center) / self.size
        return np.clip(mesh.positions @ matrix.T + offset, -FARTHEST, FARTHEST).astype(np.float32)


def local_space_of(meshes: Sequence[Mesh]) -> LocalSpace:
    """The space in which `meshes` together lie around the origin with a radius of about 1."""
    low, high = _world_box(meshes)
    return LocalSpace((low + high) / 2.0, float(np.linalg.norm(high - low)) / 2.0 or 1.0)  # a single point has no size


def _world_box(meshes: Sequence[Mesh]) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and highest coordinates (3,) float64 in world space of what the meshes' triangles use."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for mesh in meshes:
        # Of the box's corners, the transformed ones hold the transformed mesh.
        box = np.array(np.meshgrid(*mesh.box.T)).reshape(3, -1).T
        corners = box @ mesh.to_world[:3, :3].T + mesh.to_world[:3, 3]
        low, high = np.minimum(low, corners.min(axis=0)), np.maximum(high, corners.max(axis=0))
    return low, high


def gap(low: Mesh, highs: Sequence[Mesh]) -> float:
    """How far apart, in world units, the box around `low` and the one around `highs` are; 0 where they touch."""
    one, other = _world_box([low]), _world_box(highs)
    return float(np.linalg.norm(np.maximum(np.maximum(one[0] - other[1], other[0] - one[1]), 0.0)))


def keep_corners(mesh: Mesh, finite: np.ndarray | None) -> Mesh:
    """`mesh` without the triangles that touch a corner where `finite` (C,) is False; None stands for all True."""
    if finite is None:
        return mesh
    keep = finite[mesh.triangles].all(axis=1)
    left_out = len(keep) - int(np.count_nonzero(keep))
    faces, labels = (None if values is None else values[keep] for values in (mesh.faces, mesh.labels))
    return replace(
        mesh, triangles=mesh.triangles[keep], faces=faces, labels=labels, not_finite=mesh.not_finite + left_out
    )


def finite_rows(*arrays: np.ndarray) -> np.ndarray | None:
    """Which rows hold finite numbers alone in all `arrays` (N, n): (N,) bool, or None when every row does."""
    # A sum is finite unless a term is not, or the sum overflows: the common case costs one pass and no memory.
    with np.errstate(over="ignore", invalid="ignore"):
        if all(np.isfinite(array.sum()) for array in arrays):
            return None
    finite = np.logical_and.reduce([np.isfinite(array).all(axis=1) for array in arrays])
    return None if finite.all() else finite


ON_THE_RIM = 1e-5
"""How far outside the tile a UV may lie before it counts: subdivision rounds."""


def uv_areas(mesh: Mesh) -> np.ndarray:
    """Twice the triangles' areas in UV space (T,) float32: below 0 where they turn the other way round than on the
    surface, which is mirrored, and exactly 0 where nothing can be drawn."""
    areas = np.empty(len(mesh.triangles), np.float32)

    def measure(part: slice) -> None:
        a, b, c = _uv_corners(mesh, part)
        with np.errstate(over="ignore", invalid="ignore"):  # of UVs that lie far outside
            b, c = b - a, c - a
            areas[part] = b.real * c.imag - b.imag * c.real

    threads.for_blocks(len(areas), measure)
    return areas


def outside(mesh: Mesh, tiles: tuple[int, int] = (1, 1)) -> np.ndarray:
    """Which triangles (T,) bool reach outside the `tiles` along u and v."""
    low, (u_high, v_high) = -ON_THE_RIM, np.add(tiles, ON_THE_RIM)
    # NaN lies in corners that no triangle uses any more, and must not pass for being inside.
    if mesh.uv.min() >= low and mesh.uv[:, 0].max() <= u_high and mesh.uv[:, 1].max() <= v_high:
        return np.zeros(len(mesh.triangles), bool)
    corners = np.stack(_uv_corners(mesh), axis=1)
    u, v = corners.real, corners.imag
    return ((u < low) | (u > u_high) | (v < low) | (v > v_high)).any(axis=1)


UDIM = (10, 100)
"""How many tiles there are along u and along v."""


def tiles(mesh: Mesh) -> list[int]:
    """The numbers of the UDIM tiles that triangles with area may cover, 1001 + u + 10 v."""
    corners = np.stack(_uv_corners(mesh), axis=1)
    corners = corners[np.isfinite(corners).all(axis=1)]
    spans = []
    for values, count in zip((corners.real, corners.imag), UDIM, strict=True):
        low, high = values.min(axis=1), values.max(axis=1)
        # What lies on the rim between two tiles belongs to one of them; what has no extent, to none.
        first, last = np.floor(low + ON_THE_RIM), np.ceil(high - ON_THE_RIM) - 1.0
        last = np.where(low < high, np.maximum(last, first), first - 1.0)
        spans += [np.maximum(first, 0.0), np.minimum(last, count - 1.0)]
    boxes = np.stack(spans, axis=1)
    boxes = np.unique(boxes[(boxes[:, 0] <= boxes[:, 1]) & (boxes[:, 2] <= boxes[:, 3])], axis=0).astype(int)
    found = {
        1001 + u + 10 * v
        for u_first, u_last, v_first, v_last in boxes.tolist()
        for u in range(u_first, u_last + 1)
        for v in range(v_first, v_last + 1)
    }
    return sorted(found)


def _uv_corners(mesh: Mesh, which: slice = slice(None)) -> list[np.ndarray]:
    """The UVs of three corners of the triangles `which`, (T,) each, as u + v i: one gather for both."""
    uv = mesh.uv.view(np.complex64)[:, 0]
    return [np.take(uv, corner, mode="clip") for corner in mesh.triangles[which].T]


def normal_matrix(mesh_to_world: np.ndarray, space_to_world: np.ndarray | None = None) -> np.ndarray:
    """The (3, 3) matrix that takes normals from a mesh's space to world space, or to that of another object.

    A normal n is a plane's row vector: a matrix M that takes points takes it to n M^-1, so that world normals are
    M^-T n, and M'^T n_world is what an object with matrix M' has for them. Mirrored objects need no more than this:
    unlike cofactors, the inverse transpose leaves outside what was outside. Not normalized.
    Raises numpy.linalg.LinAlgError for a matrix without volume.
    """
    matrix = np.linalg.inv(mesh_to_world[:3, :3]).T
    if space_to_world is not None:
        matrix = space_to_world[:3, :3].T @ matrix
    # Only directions matter, and a single-precision shader squares them: keep the numbers near 1.
    return matrix / np.abs(matrix).max()
