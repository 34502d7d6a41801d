# SPDX-License-Identifier: GPL-3.0-or-later
"""Tangents whose last bits are the same each time.

Blender's MikkTSpace adds up the tangents of the faces around a corner in the order in which its threads come to them, so the
sums differ by 1e-7 from one time to the next, and a map is not the same file when it is baked again. Here they are added up
again in one order, in double precision.
"""

from collections.abc import Iterator

import numpy as np

from ..mesh import topology
from ..mesh.triangles import Axes, dot

PARALLEL = 10_000
"""Faces up to which Blender uses one thread, whose sums are always the same."""
TOLERANCE = 1e-4
"""How far Blender's own sums, in single precision, may be from these: 2e-5 where triangles are tiny. What is farther has
another reason, as faces without an area, and stays as Blender has it."""
_BLOCK = 1 << 14
"""Triangles that are computed together, so that their values stay in the processor's cache."""


def steady(
    tangents: np.ndarray,
    *,
    positions: np.ndarray,
    normals: np.ndarray,
    uv: np.ndarray,
    starts: np.ndarray,
    sizes: np.ndarray,
) -> np.ndarray:
    """The tangents (C, 4) float32 of a mesh of triangles and quads, from those of MikkTSpace; w, the signs, stay.

    By corner, (C, n) float32: positions, normals, uv, tangents. By face: starts, its first corner, and sizes, 3 or 4.
    """
    # Corners whose values are all the same: MikkTSpace adds their faces up, and gives them one tangent.
    values = np.concatenate([positions, normals, uv, tangents], axis=1)
    values += np.float32(0.0)  # no -0
    groups, count = topology.first_rows(values.view(np.uint64)), len(values)
    with np.errstate(invalid="ignore", over="ignore"):  # corners with NaN or infinite values stay as they are
        sums = np.zeros((3, count))
        parts = list(_parts(positions, normals, uv, _triangles(positions, uv, starts, sizes)))
        added_to = np.take(groups, np.concatenate([corners for corners, _ in parts]))
        for axis in range(3):
            sums[axis] = np.bincount(added_to, np.concatenate([added[axis] for _, added in parts]), count)
        means = np.take(np.stack(_normalized(sums)).astype(np.float32), groups, axis=1)
        is_near = np.logical_and.reduce(np.abs(means - tangents.T[:3]) < TOLERANCE)
    result = tangents.copy()
    result[:, :3] = np.where(is_near, means, tangents.T[:3]).T
    return result


def _triangles(positions: np.ndarray, uv: np.ndarray, starts: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """The corners (T, 3) of triangles. MikkTSpace cuts quads along the shorter diagonal in UV space, or else in space."""
    first = starts[sizes == 3]
    quads = starts[sizes == 4]

    def shorter(values: np.ndarray) -> np.ndarray:
        """The length of the diagonal from 1 to 3, squared, without that from 0 to 2, in single precision as in MikkTSpace."""
        one, other = (values[quads + end] - values[quads + end - 2] for end in (2, 3))
        return (other * other).sum(axis=1) - (one * one).sum(axis=1)

    in_uv = shorter(uv)
    is_from_0 = np.where(in_uv != 0.0, in_uv > 0.0, shorter(positions) >= 0.0)
    from_0, from_1 = quads[is_from_0], quads[~is_from_0]
    cuts = [(first, (0, 1, 2)), (from_0, (0, 1, 2)), (from_0, (0, 2, 3)), (from_1, (0, 1, 3)), (from_1, (1, 2, 3))]
    return np.concatenate([each[:, None] + np.array(corners) for each, corners in cuts])


def _parts(
    positions: np.ndarray, normals: np.ndarray, uv: np.ndarray, triangles: np.ndarray
) -> Iterator[tuple[np.ndarray, Axes]]:
    """What triangles add to the tangents of their corners: their own in its plane, times its angle. Yields some of the corners
    (N,) and what is added to them (N,) float64, axis by axis."""
    columns = [np.ascontiguousarray(values.T, np.float64) for values in (positions, normals, uv)]
    for start in range(0, len(triangles), _BLOCK):
        corners = triangles[start : start + _BLOCK].T
        points, across, layout = ([np.take(column, corner, axis=1) for corner in corners] for column in columns)
        edge_1, edge_2 = points[1] - points[0], points[2] - points[0]
        uv_1, uv_2 = layout[1] - layout[0], layout[2] - layout[0]
        sign = np.sign(uv_1[0] * uv_2[1] - uv_1[1] * uv_2[0])
        own = (uv_2[1] * edge_1 - uv_1[1] * edge_2) * sign
        for number in range(3):
            normal, here = across[number], points[number]
            to_next, to_last, along = (
                _normalized(vectors - normal * dot(normal, vectors))
                for vectors in (points[(number + 1) % 3] - here, points[number - 1] - here, own)
            )
            yield corners[number], along * np.arccos(np.clip(dot(to_next, to_last), -1.0, 1.0))


def _normalized(vectors: np.ndarray) -> np.ndarray:
    """Vectors (3, N) at length one; those without length are 0."""
    lengths = np.sqrt(dot(vectors, vectors))
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0)
