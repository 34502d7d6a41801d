# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks the shape of a mesh's faces, which the arrays hold as triangles."""

import numpy as np

from ..core import threads
from .triangle_mesh import Mesh
from .triangles import cross

PLANAR_DEGREES = 1.0
"""Degrees between the triangles of a face, above which the choice of its diagonals changes the surface."""
OFF_PARALLELOGRAM = 1e-3
"""Share of a quad's diagonal by which a corner may be off a parallelogram, before it matters along which diagonal it is cut."""
SLIVER_SINE = 1e-4
"""Sine of the angle at a triangle's first corner, below which single precision cannot tell front from back."""


def non_triangles(mesh: Mesh) -> np.ndarray:
    """Which faces (F,) bool have more than three corners. `mesh` must have faces."""
    return np.bincount(mesh.faces) > 1


def non_planar(mesh: Mesh) -> np.ndarray:
    """Which faces (F,) bool are not planar, so that their surface depends on how they are triangulated.

    `mesh` must have faces. A quad has two triangulations: it is not planar if a triangle of one leans away from a triangle
    of the other by more than PLANAR_DEGREES. An n-gon has too many: it is not planar if a triangle of the one that Blender
    draws leans away from the mean normal of the face by more than that.
    """
    cuts = np.bincount(mesh.faces)
    result = np.zeros(len(cuts), bool)
    if cuts.max(initial=0) < 2:
        return result
    x, y, z = (mesh.positions @ mesh.to_world[:3, :3].T).T
    positions = np.stack([x, y, z])  # one row per axis: the code below reads one axis at a time
    count = cuts[mesh.faces]

    triangles = mesh.triangles[count == 2].reshape(-1, 6)
    # The corners of a face are consecutive in every triangulation.
    a, b, c, d = (positions[:, mesh.vertices[triangles.min(axis=1) + corner]] for corner in range(4))
    b, c, d = b - a, c - a, d - a
    abc, acd, abd = (np.stack(cross(one, other)) for one, other in ((b, c), (c, d), (b, d)))
    bcd = abc + acd - abd  # areas add up, as vectors
    leans = np.logical_or.reduce([_lean(first, second) for first in (abc, acd) for second in (abd, bcd)])
    result[mesh.faces[count == 2][::2][leans]] = True

    many = count > 2
    faces = mesh.faces[many]
    a, b, c = (positions[:, mesh.vertices[corner]] for corner in mesh.triangles[many].T)
    normals = np.stack(cross(b - a, c - a))
    whole = np.stack([np.bincount(faces, axis, len(cuts)) for axis in normals])
    result[faces[_lean(normals, whole[:, faces])]] = True
    return result


def folded(mesh: Mesh) -> np.ndarray:
    """Which faces (F,) bool are quads that Blender divides from the second corner to the fourth. `mesh` must have faces.

    Blender divides from the first corner to the third unless that folds the quad by more than a right angle.
    """
    cuts = np.bincount(mesh.faces)
    count = cuts[mesh.faces]
    triangles = mesh.triangles[count == 2].reshape(-1, 6)
    first = triangles.min(axis=1)
    result = np.zeros(len(cuts), bool)
    # Divided from the first corner to the third, both triangles have the first corner.
    result[mesh.faces[count == 2][::2]] = (triangles == first[:, None]).sum(axis=1) < 2
    return result


def ambiguous_quads(mesh: Mesh) -> np.ndarray:
    """Which faces (F,) bool are quads that look different if they are divided along the other diagonal. `mesh` must have faces
    and UVs.

    The diagonal does not matter where positions, UVs and normals continue evenly from one side of the quad to the other.
    """
    cuts = np.bincount(mesh.faces)
    is_of_quad = cuts[mesh.faces] == 2
    # The corners of a face are consecutive in every triangulation.
    first = mesh.triangles[is_of_quad].reshape(-1, 6).min(axis=1)
    corners = first[:, None] + np.arange(4)
    matters = np.zeros(len(first), bool)
    for values, least in (
        (mesh.positions[mesh.vertices[corners]], None),
        (mesh.uv[corners], None),
        (mesh.normals[corners], 2.0 * np.sin(np.radians(PLANAR_DEGREES) / 2.0)),
    ):
        a, b, c, d = np.moveaxis(values.astype(np.float64), 1, 0)
        sizes = np.maximum(np.linalg.norm(c - a, axis=1), np.linalg.norm(d - b, axis=1))
        matters |= np.linalg.norm(a - b + c - d, axis=1) > (OFF_PARALLELOGRAM * sizes if least is None else least)
    result = np.zeros(len(cuts), bool)
    result[mesh.faces[is_of_quad][::2][matters]] = True
    return result


def normals_behind(mesh: Mesh) -> np.ndarray:
    """Which triangles (T,) bool have a corner whose shading normal points behind them, or along them.

    Triangles without area do not count: they have no sides.
    """
    result = np.zeros(len(mesh.triangles), bool)
    positions, normals = mesh.positions.T, mesh.normals.T

    def check(part: slice) -> None:
        corners = mesh.triangles[part].T
        a, b, c = (np.take(positions, mesh.vertices[corner], axis=1) for corner in corners)
        across, along = b - a, c - a
        face = np.stack(cross(across, along))
        area, largest = (face * face).sum(axis=0), (across * across).sum(axis=0) * (along * along).sum(axis=0)
        least = np.minimum.reduce([(np.take(normals, corner, axis=1) * face).sum(axis=0) for corner in corners])
        result[part] = (least <= 0.0) & (area > SLIVER_SINE * SLIVER_SINE * largest)

    threads.for_blocks(len(result), check)
    return result


def _lean(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Which pairs (N,) bool of vectors (3, N) lean away from each other by more than PLANAR_DEGREES; zero vectors never do."""
    dot, lengths = (a * b).sum(axis=0), (a * a).sum(axis=0) * (b * b).sum(axis=0)
    return dot < np.cos(np.radians(PLANAR_DEGREES)) * np.sqrt(lengths)
