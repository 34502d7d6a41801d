# SPDX-License-Identifier: GPL-3.0-or-later
"""A triangle mesh as numpy arrays, and the spaces of its normals and tangents."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, TypeAlias, TypeVar

import numpy as np

from ..core import threads
from ..core.declarations import bases
from ..core.declarations.bases import Basis
from ..core.material_feeds import Extension
from .topology import ranges
from .triangles import unit, unit_normals

CORNER_BLOCK = 512
"""Corners that are left out together if they have no vertex that is looked for: those close in a mesh have close numbers."""


class FaceCorners:
    """The faces of a mesh, by corners.

    starts (F + 1,) int32: the first corner of each face, and at the end C. vertices (C,) int32: the vertex of each corner.
    """

    def __init__(self, starts: np.ndarray, vertices: np.ndarray):
        self.starts, self.vertices = starts, vertices

    def corners_at(self, vertices: np.ndarray, count: int) -> np.ndarray:
        """The corners of some of `count` vertices, ascending."""
        first, last = self._blocks
        is_near = np.searchsorted(vertices, first) < np.searchsorted(vertices, last, side="right")
        near = (np.flatnonzero(is_near)[:, None] * CORNER_BLOCK + np.arange(CORNER_BLOCK)).reshape(-1)
        near = near[: np.searchsorted(near, len(self.vertices))]
        is_wanted = np.zeros(count, bool)
        is_wanted[vertices] = True
        return near[is_wanted[self.vertices[near]]]

    def faces_of(self, corners: np.ndarray) -> np.ndarray:
        """The faces of some corners, each once, ascending."""
        return np.unique(np.searchsorted(self.starts, corners, side="right") - 1)

    def corners_of(self, faces: np.ndarray) -> np.ndarray:
        """The corners of some faces, face after face."""
        return ranges(self.starts[faces], self.sizes(faces))

    def triangles_of(self, faces: np.ndarray) -> np.ndarray:
        """The numbers of the triangles of some faces, if each face is divided into triangles without more corners."""
        return ranges(self.starts[faces] - 2 * faces, self.sizes(faces) - 2)

    def sizes(self, faces: np.ndarray) -> np.ndarray:
        """The number of corners of each of some faces."""
        return self.starts[faces + 1] - self.starts[faces]

    @cached_property
    def _blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """The lowest and the highest vertex of each block of corners."""
        starts = np.arange(0, len(self.vertices), CORNER_BLOCK)
        return np.minimum.reduceat(self.vertices, starts), np.maximum.reduceat(self.vertices, starts)


MaybeArray: TypeAlias = Any
"""np.ndarray | None. Functions say what a mesh must have; type checkers need not ask at each use."""
UV_LAYER, ATTRIBUTE, TANGENTS, GENERATED, CUTOUT = "UV map", "attribute", "tangents", "generated", "cut-out"
"""The kinds of Mesh.layers: UVs (C, 2), attributes (C, 4), tangents (C, 4) of a UV map, w the sign of the bitangent,
generated texture coordinates (C, 3), and where the mesh is clear (C, 3), as mesh/cutouts.py has it."""

Made = TypeVar("Made")
TRIANGLES_AT_ONCE = 2**20
"""Triangles that Mesh.box looks at together."""


@dataclass(frozen=True, eq=False)
class Alpha:
    """An image that says where a mesh is clear.

    Attributes:
        values: (h, w) float32, row 0 at v = 0. What is below 0 is clear.
        extension: what is beyond its pixels.
        outside: the value there, for CLIP.
        is_smooth: whether pixels are interpolated.
        of: the core.material_feeds.CutOut, and the UDIM tile or the place in UVs, that it was made of.
    """

    values: np.ndarray
    extension: Extension
    outside: float
    is_smooth: bool
    of: tuple

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        height, width = np.shape(self.values)
        return width, height

    def is_all(self, *, clear: bool) -> bool:
        """Whether all that it shows is clear, or opaque."""
        shown = (self.values, self.outside) if self.extension == Extension.CLIP else (self.values,)
        return all(bool(np.all((np.asarray(values) < 0.0) == clear)) for values in shown)


@dataclass(frozen=True)
class Mesh:
    """The surface of one object, by face corners, in the object's space.

    Attributes:
        name: of the object.
        positions: (V, 3) float32.
        vertices: (C,) int32, the vertex of each corner.
        normals: (C, 3) float32.
        triangles: (T, 3) int32, indices of corners.
        to_world: (4, 4) float64.
        uv: (C, 2) float32, or None if no layer was read.
        tangents: (C, 4) float32, w the sign of the bitangent, or None.
        not_finite: the number of triangles left out for NaN or infinite values.
        without_normals: the number of those whose own normals have no length, which got smooth ones.
        faces: (T,) int32, the face of each triangle, or None if not read.
        labels: (T, n), numbers that go with each triangle, or None.
        instances: the number of instances joined; 0 for the object's own mesh.
        layers: more values by corner (C, n) float32, by their kind, as UV_LAYER, and name.
        normals_domain: "POINT" or "FACE" if the normals are those that Blender computes of vertices or faces from the positions
            alone, "CORNER" if hard edges and flat faces count, too, and empty for the mesh's own normals.
        face_corners: which faces the corners belong to, or None if not read.
        stretch: (3, 3), the scale of the object that normals and tangents already have, see `with_stretch`; or None.
        alphas: the images of the layer CUTOUT.
        is_floater: whether it blocks no rays of ambient occlusion.
    """

    name: str
    positions: np.ndarray
    vertices: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    to_world: np.ndarray
    uv: MaybeArray = None
    tangents: MaybeArray = None
    not_finite: int = 0
    without_normals: int = 0
    faces: MaybeArray = None
    labels: MaybeArray = None
    instances: int = 0
    layers: dict[tuple[str, str], np.ndarray] = field(default_factory=dict)
    normals_domain: str = ""
    face_corners: FaceCorners | None = None
    stretch: np.ndarray | None = None
    alphas: "tuple[Alpha, ...]" = ()
    is_floater: bool = False
    _made: dict[str, tuple] = field(default_factory=dict, init=False, repr=False, compare=False)
    """What was made of this mesh, by name, and of which objects besides."""

    @classmethod
    def of_arrays(cls, name: str, positions: np.ndarray, triangles: np.ndarray, uv: np.ndarray | None = None) -> "Mesh":
        """A flat-shaded mesh in world space.

        Args:
            name: in messages.
            positions: (V, 3).
            triangles: (T, 3) indices of positions, counter-clockwise where seen from the front.
            uv: (V, 2).
        """
        vertices = np.ascontiguousarray(triangles, np.int32).ravel()
        points = np.ascontiguousarray(positions, np.float32)
        normals, _ = unit_normals(points, vertices.reshape(-1, 3), np.float64)
        return cls(
            name,
            points,
            vertices,
            np.repeat(normals.astype(np.float32), 3, axis=0),
            np.arange(len(vertices), dtype=np.int32).reshape(-1, 3),
            np.eye(4),
            uv=None if uv is None else np.ascontiguousarray(uv, np.float32)[vertices],
            faces=np.arange(len(vertices) // 3, dtype=np.int32),
        )

    @property
    def normal_matrix(self) -> np.ndarray:
        """The (3, 3) matrix that transforms `normals` to world space, see the function of this name."""
        matrix = normal_matrix(self.to_world)
        return matrix if self.stretch is None else matrix @ self.stretch.T

    def to_world_normals(self, normals: np.ndarray) -> np.ndarray:
        """Transform `normals` (N, 3) from this mesh's space to world space; float32, not of length one.

        The result may be `normals` itself.
        """
        matrix = normal_matrix(self.to_world)
        if np.array_equal(matrix, np.eye(3)):  # large meshes have many normals, and often no rotation
            return normals
        return normals @ matrix.T.astype(np.float32)

    @property
    def front_triangles(self) -> np.ndarray:
        """`triangles`, counter-clockwise in the scene where seen from the front: a mirrored matrix reverses the winding."""
        return self.triangles[:, ::-1] if np.linalg.det(self.to_world[:3, :3]) < 0.0 else self.triangles

    @property
    def tangent_space(self) -> dict[str, np.ndarray]:
        """What shaders that read a map take by corner: uv, normal and tangent, which is 0 if there are no tangents."""
        tangents = np.zeros((len(self.normals), 4), np.float32) if self.tangents is None else self.tangents
        return {"uv": self.uv, "normal": self.normals, "tangent": tangents}

    def remembered(self, name: str, of: tuple, make: Callable[[], Made]) -> Made:
        """The result of `make` for this mesh and these very objects, which is kept with the mesh until others are given.

        make: must not return this mesh, which would never be freed.
        """
        known = self._made.get(name)
        if known is None or not all(one is other for one, other in zip(known[0], of, strict=True)):
            known = self._made[name] = of, make()
        return known[1]

    def remembers(self, name: str) -> bool:
        """Whether `remembered` has a result of this name."""
        return name in self._made

    def checksums(self, *arrays: str) -> tuple:
        """What tells the content of some of its arrays, by their names, from other content. They are found once."""

        def checksum(name: str) -> tuple:
            array = getattr(self, name)
            return (0, ()) if array is None else (zlib.crc32(np.ascontiguousarray(array)), array.shape)

        new = [name for name in arrays if not self.remembers(f"checksum {name}")]
        for name, value in zip(new, threads.map_parallel(checksum, new), strict=True):
            self.remembered(f"checksum {name}", (), partial(tuple, value))
        return tuple(self.remembered(f"checksum {name}", (), tuple) for name in arrays)

    def with_triangles(self, kept: np.ndarray | slice) -> "Mesh":
        """This mesh with some of its triangles. kept: their indices, or (T,) bool, or a slice."""
        faces, labels = (None if values is None else values[kept] for values in (self.faces, self.labels))
        return replace(self, triangles=self.triangles[kept], faces=faces, labels=labels, face_corners=None)

    @cached_property
    def box(self) -> np.ndarray:
        """The minimum and maximum coordinates (2, 3) float64, in the mesh's space, of the vertices that triangles use."""
        # Loose vertices do not count: they can be anywhere.
        is_used = np.zeros(len(self.positions), bool)
        for first in range(
            0, len(self.triangles), TRIANGLES_AT_ONCE
        ):  # numbers of all triangles at once take much memory
            is_used[np.take(self.vertices, self.triangles[first : first + TRIANGLES_AT_ONCE], mode="clip")] = True
        used = self.positions if is_used.all() else self.positions[is_used]
        # One axis after another: reducing along a short last axis is ten times slower.
        return np.array([[pick(axis) for axis in used.T] for pick in (np.min, np.max)], np.float64)


def keep_corners(mesh: Mesh, finite: np.ndarray | None) -> Mesh:
    """`mesh` without the triangles that use a corner where `finite` (C,) is False; None stands for all True."""
    if finite is None:
        return mesh
    keep = finite[mesh.triangles].all(axis=1)
    left_out = len(keep) - int(np.count_nonzero(keep))
    return replace(mesh.with_triangles(keep), not_finite=mesh.not_finite + left_out)


def finite_rows(*arrays: np.ndarray) -> np.ndarray | None:
    """Which rows (N,) bool are finite in all `arrays` (N, n), or None if all rows are."""
    # A sum is finite unless a term is not, or it overflows: the common case takes one pass and no memory.
    with np.errstate(over="ignore", invalid="ignore"):
        if all(np.isfinite(array.sum()) for array in arrays):
            return None
    finite = np.logical_and.reduce([np.isfinite(array).all(axis=1) for array in arrays])
    return None if finite.all() else finite


def changed_rows(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The rows, ascending, in which two arrays (N, n) of 32 bits differ in any bit."""
    differs = a.reshape(-1).view(np.int32) != b.reshape(-1).view(np.int32)
    rows = np.flatnonzero(differs) // a.shape[1]
    return rows[np.diff(rows, prepend=-1) > 0]


def changed_share(a: np.ndarray, b: np.ndarray) -> float:
    """About which share of the rows of two arrays (N, n) differ, from a thousand of them."""
    some = slice(None, None, max(1, len(a) // 1000))
    return float((a[some] != b[some]).any(axis=1).mean()) if len(a) else 0.0


def normal_matrix(mesh_to_world: np.ndarray, space_to_world: np.ndarray | None = None) -> np.ndarray:
    """The (3, 3) matrix that transforms normals from a mesh's space to world space, or to another object's space.

    A normal n is the row vector of a plane. Where a matrix M transforms points, n becomes n M^-1. So world normals are
    M^-T n, and in the space of an object with matrix M' they are M'^T n_world. Mirrored objects need nothing more: unlike
    cofactors, the inverse transpose keeps normals pointing outwards. The results are not normalized.
    Raises numpy.linalg.LinAlgError for a matrix without volume.
    """
    matrix = np.linalg.inv(mesh_to_world[:3, :3]).T
    if space_to_world is not None:
        matrix = space_to_world[:3, :3].T @ matrix
    # Only directions matter, and a single-precision shader squares them: keep the numbers near 1.
    return matrix / np.abs(matrix).max()


UNEVEN_SCALE = 1e-4
"""How much the scales of an object along its axes may differ, as a share, to count as the same."""


def scale_of(to_world: np.ndarray) -> np.ndarray:
    """The scale in a matrix (4, 4), perhaps mirrored or sheared: (3, 3) float64. Without it, the matrix is a rotation."""
    _, scales, axes = np.linalg.svd(to_world[:3, :3])
    return np.sign(np.linalg.det(to_world[:3, :3])) * axes.T @ np.diag(scales) @ axes


def is_uneven(to_world: np.ndarray) -> bool:
    """Whether a matrix (4, 4) scales more in one direction than in another."""
    scales = np.linalg.svd(to_world[:3, :3], compute_uv=False)
    return bool(scales[-1] < scales[0] * (1.0 - UNEVEN_SCALE))


def with_stretch(low: Mesh, basis: str) -> Mesh:
    """`low`, as it was read, with the normals and tangents from which programs with a basis make the tangent space.

    With the same scale in all directions, nothing changes.
    """
    rules = bases.of_name(basis)
    if rules.in_object_space or not is_uneven(low.to_world):
        return low
    matrix = scale_of(low.to_world)
    normals, tangents = stretched(matrix, low.normals, low.tangents, rules)
    return replace(low, normals=normals, tangents=tangents, stretch=matrix)


def tangent_axes(
    basis: Basis, weights: np.ndarray, normals: np.ndarray, tangents: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tangent, bitangent and normal, (N, 3) float64 each, that a program with this basis has at points of triangles.

    weights (N, 3): of the corners. normals (N, 3, 3), tangents (N, 3, 4): of these, w the sign of the bitangent.
    """

    def mixed(corners: np.ndarray) -> np.ndarray:
        return np.einsum("nc,nck->nk", weights, corners)

    normals, tangents = normals.astype(np.float64), tangents.astype(np.float64)
    normal, tangent, signs = mixed(normals), mixed(tangents[..., :3]), tangents[..., 3]
    if basis.normalizes_normal:
        normal = unit(normal)
    if basis.normalizes_tangent:
        tangent = unit(tangent)
    if basis.bitangent_of_vertices:
        bitangent = mixed(signs[..., None] * np.cross(normals, tangents[..., :3]))
    else:
        bitangent = np.sign((signs * weights).sum(axis=1))[:, None] * np.cross(normal, tangent)
    return tangent, unit(bitangent) if basis.normalizes_bitangent else bitangent, normal


def without_stretch(low: Mesh, basis: str) -> Mesh:
    """`low` before `with_stretch`."""
    if low.stretch is None:
        return low
    normals, tangents = stretched(np.linalg.inv(low.stretch), low.normals, low.tangents, bases.of_name(basis))
    return replace(low, normals=normals, tangents=tangents, stretch=None)


def stretched(
    matrix: np.ndarray, normals: np.ndarray, tangents: np.ndarray, basis: Basis
) -> tuple[np.ndarray, np.ndarray]:
    """Normals (..., 3) and tangents (..., 4), w the sign of the bitangent, after a scale (3, 3): unit vectors, float32."""
    of_normals = np.linalg.inv(matrix)
    turned = unit(normals @ of_normals)
    along = unit(tangents[..., :3] @ (of_normals if basis.tangents_as_normals else matrix.T))
    signs = tangents[..., 3:] * np.sign(np.linalg.det(matrix))
    return turned.astype(np.float32), np.concatenate([along, signs], axis=-1).astype(np.float32)
