# SPDX-License-Identifier: GPL-3.0-or-later
"""Tangents whose last bits are the same each time.

Blender's MikkTSpace adds up the tangents of the faces around a corner in the order in which its threads come to them, so the
sums differ by 1e-7 from one time to the next, and a map is not the same file when it is baked again. Here they are added up
again in one order, in double precision.
"""

import numpy as np

from ..mesh import topology

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
    values = np.concatenate([positions, normals, uv, tangents], axis=1) + np.float32(0.0)  # no -0
    groups, count = topology.first_rows(values), len(values)
    triangles = _triangles(positions, uv, starts, sizes)
    added_to, blocks = groups[triangles].reshape(-1), range(0, len(triangles), _BLOCK)
    with np.errstate(invalid="ignore", over="ignore"):  # corners with NaN or infinite values stay as they are
        parts = [_parts(positions, normals, uv, triangles[start : start + _BLOCK]) for start in blocks]
        sums = [np.bincount(added_to, np.concatenate([part[:, axis] for part in parts]), count) for axis in range(3)]
        means = _normalized(np.stack(sums, axis=1)).astype(np.float32)[groups]
        is_near = np.abs(means - tangents[:, :3]).max(axis=1) < TOLERANCE
    result = tangents.copy()
    result[is_near, :3] = means[is_near]
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


def _parts(positions: np.ndarray, normals: np.ndarray, uv: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """What each triangle adds to the tangents of its corners, (3 T, 3) float64: its own in their plane, times its angle."""
    points, layout = positions[triangles].astype(np.float64), uv[triangles].astype(np.float64)
    edge_1, edge_2 = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    uv_1, uv_2 = layout[:, 1] - layout[:, 0], layout[:, 2] - layout[:, 0]
    sign = np.sign(uv_1[:, 0] * uv_2[:, 1] - uv_1[:, 1] * uv_2[:, 0])
    own = (uv_2[:, 1, None] * edge_1 - uv_1[:, 1, None] * edge_2) * sign[:, None]
    across = normals[triangles].astype(np.float64)

    def flat(vectors: np.ndarray) -> np.ndarray:
        return _normalized(vectors - across * np.einsum("...i,...i", across, vectors)[..., None])

    to_next, to_last = flat(np.roll(points, -1, axis=1) - points), flat(np.roll(points, 1, axis=1) - points)
    angles = np.arccos(np.clip(np.einsum("...i,...i", to_next, to_last), -1.0, 1.0))
    return (flat(own[:, None]) * angles[..., None]).reshape(-1, 3)


def _normalized(vectors: np.ndarray) -> np.ndarray:
    lengths = np.sqrt(np.einsum("...i,...i", vectors, vectors))[..., None]
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0)
