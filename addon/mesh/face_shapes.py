# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be said of a mesh's faces, which the arrays hold in triangles."""

import numpy as np

from . import threads
from .triangle_mesh import Mesh

FLAT = 1.0
"""Degrees by which triangles of a face may lean away from each other before it matters which triangles it is cut into."""
SLIVER = 1e-4
"""Sine of the angle at a triangle's first corner below which single precision does not tell its two sides apart."""


def polygons(mesh: Mesh) -> np.ndarray:
    """Which faces (F,) bool have more than three corners. Takes a mesh with faces."""
    return np.bincount(mesh.faces) > 1


def uneven(mesh: Mesh) -> np.ndarray:
    """Which faces (F,) bool change their surface with the triangles that they are cut into. Takes a mesh with faces.

    Of a quad both ways to cut it are compared: a triangle of one leans away by more than FLAT from one of the other. An
    n-gon has too many ways: a triangle of the one that Blender draws leans away by more than FLAT from the face as a whole.
    """
    cuts = np.bincount(mesh.faces)
    result = np.zeros(len(cuts), bool)
    if cuts.max(initial=0) < 2:
        return result
    x, y, z = (mesh.positions @ mesh.to_world[:3, :3].T).T
    positions = np.stack([x, y, z])  # an axis a row: what follows reads them one by one
    count = cuts[mesh.faces]

    triangles = mesh.triangles[count == 2].reshape(-1, 6)
    # The corners of a face follow one another, whichever way it is cut.
    a, b, c, d = (positions[:, mesh.vertices[triangles.min(axis=1) + corner]] for corner in range(4))
    b, c, d = b - a, c - a, d - a
    abc, acd, abd = _cross(b, c), _cross(c, d), _cross(b, d)
    bcd = abc + acd - abd  # areas add up, as vectors
    leans = np.logical_or.reduce([_lean(one, other) for one in (abc, acd) for other in (abd, bcd)])
    result[mesh.faces[count == 2][::2][leans]] = True

    many = count > 2
    faces = mesh.faces[many]
    a, b, c = (positions[:, mesh.vertices[corner]] for corner in mesh.triangles[many].T)
    normals = _cross(b - a, c - a)
    whole = np.stack([np.bincount(faces, axis, len(cuts)) for axis in normals])
    result[faces[_lean(normals, whole[:, faces])]] = True
    return result


def folded(mesh: Mesh) -> np.ndarray:
    """Which faces (F,) bool are quads that Blender cuts from the second corner to the fourth. Takes a mesh with faces.

    It cuts from the first to the third unless that would fold the quad by more than a right angle.
    """
    cuts = np.bincount(mesh.faces)
    count = cuts[mesh.faces]
    triangles = mesh.triangles[count == 2].reshape(-1, 6)
    first = triangles.min(axis=1)
    result = np.zeros(len(cuts), bool)
    # From the first to the third, both triangles hold the first corner.
    result[mesh.faces[count == 2][::2]] = (triangles == first[:, None]).sum(axis=1) < 2
    return result


def behind(mesh: Mesh) -> np.ndarray:
    """Which triangles (T,) bool have a corner whose shading normal points behind them, or along them.

    Those without an area have no side to be behind.
    """
    result = np.zeros(len(mesh.triangles), bool)
    positions, normals = mesh.positions.T, mesh.normals.T

    def look(part: slice) -> None:
        corners = mesh.triangles[part].T
        a, b, c = (np.take(positions, mesh.vertices[corner], axis=1) for corner in corners)
        across, along = b - a, c - a
        face = _cross(across, along)
        area, largest = (face * face).sum(axis=0), (across * across).sum(axis=0) * (along * along).sum(axis=0)
        least = np.minimum.reduce([(np.take(normals, corner, axis=1) * face).sum(axis=0) for corner in corners])
        result[part] = (least <= 0.0) & (area > SLIVER * SLIVER * largest)

    threads.each(len(result), look)
    return result


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The vectors (3, N) that stand on a and b (3, N); np.cross takes three times as long."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _lean(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Where vectors (3, N) lean away from each other by more than FLAT; what has no length leans nowhere."""
    dot, lengths = (a * b).sum(axis=0), (a * a).sum(axis=0) * (b * b).sum(axis=0)
    return dot < np.cos(np.radians(FLAT)) * np.sqrt(lengths)
