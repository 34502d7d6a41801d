# SPDX-License-Identifier: GPL-3.0-or-later
"""A float64 rasterizer, which shares no code with the shaders, and the mesh data that it needs."""

import functools
from dataclasses import dataclass

import bpy
import numpy as np


@dataclass(frozen=True)
class Corners:
    """The triangles of an object as (T, 3, n) float64 by corner, in the object's space, and its matrix (4, 4)."""

    position: np.ndarray
    normal: np.ndarray
    uv: np.ndarray
    tangent: np.ndarray
    matrix: np.ndarray

    @property
    def to_world_normals(self):
        """The (3, 3) matrix: inverse transpose."""
        return np.linalg.inv(self.matrix[:3, :3]).T


def corners(obj, *, with_tangents=True):
    """Read `obj`, an unmodified mesh of triangles and quads with one UV layer, loop by loop."""
    data = obj.data
    if with_tangents:
        data.calc_tangents()
    data.calc_loop_triangles()
    loops = [loop for triangle in data.loop_triangles for loop in triangle.loops]
    points = np.array([data.vertices[data.loops[loop].vertex_index].co for loop in loops], np.float64)
    normals = np.array([data.corner_normals[loop].vector for loop in loops], np.float64)
    uv = np.array([data.uv_layers.active.uv[loop].vector for loop in loops], np.float64)
    tangents = np.zeros((len(loops), 4))
    if with_tangents:
        tangents = np.array([(*data.loops[loop].tangent, data.loops[loop].bitangent_sign) for loop in loops])
    bpy.context.view_layer.update()
    matrix = np.array(obj.matrix_world, np.float64)
    return Corners(*(values.reshape(-1, 3, values.shape[1]) for values in (points, normals, uv, tangents)), matrix)


def rasterize(points, matrix, size):
    """The front triangle at each pixel's center, and the position on it.

    points (T, 3, 3) world; matrix (4, 4) world to clip space, with all points before the eye; size (width, height).
    Returns triangle (H, W) int, -1 for none, and perspective-correct weights (H, W, 3).
    """
    given = (np.ascontiguousarray(values, np.float64) for values in (points, matrix))
    return _rasterized(*(values.tobytes() for values in given), tuple(size))


@functools.lru_cache(maxsize=4)
def _rasterized(points, matrix, size):
    """As `rasterize`, from the bytes of both arrays: tests draw the same picture again and again."""
    points, matrix = np.frombuffer(points).reshape(-1, 3, 3), np.frombuffer(matrix).reshape(4, 4)
    width, height = size
    clip = np.concatenate([points, np.ones((*points.shape[:2], 1))], axis=-1) @ matrix.T
    w = clip[..., 3]
    screen = (clip[..., :2] / w[..., None] * 0.5 + 0.5) * size
    depth = clip[..., 2] / w
    nearest, owner, weights = (
        np.full((height, width), np.inf),
        np.full((height, width), -1),
        np.zeros((height, width, 3)),
    )
    for t, (a, b, c) in enumerate(screen):
        area = cross(b - a, c - a)
        low = np.maximum(np.ceil(np.min([a, b, c], axis=0) - 0.5), 0).astype(int)
        high = np.minimum(np.floor(np.max([a, b, c], axis=0) - 0.5) + 1, size).astype(int)
        if area == 0.0 or (low >= high).any():
            continue
        x, y = np.arange(low[0], high[0]) + 0.5, (np.arange(low[1], high[1]) + 0.5)[:, None]
        sides = ((b, c - b), (c, a - c), (a, b - a))
        flat = np.stack([way[0] * (y - start[1]) - way[1] * (x - start[0]) for start, way in sides], axis=-1) / area
        z = flat @ depth[t]
        box = slice(low[1], high[1]), slice(low[0], high[0])
        closer = (flat >= 0.0).all(axis=-1) & (z < nearest[box])
        true = flat / w[t]
        true /= true.sum(axis=-1, keepdims=True)
        nearest[box][closer], owner[box][closer], weights[box][closer] = z[closer], t, true[closer]
    return owner, weights


def interpolate(values, owner, weights):
    """Interpolate `values` (T, 3, n) on the pixels with a triangle: (N, n)."""
    drawn = owner >= 0
    return np.einsum("pcn,pc->pn", values[owner[drawn]], weights[drawn])


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def bilinear(texels, uv):
    """Interpolate `texels` (H, W, n) between their centers at `uv` (N, 2), and extend the border."""
    size = np.array(texels.shape[1::-1])
    place = uv * size - 0.5
    first = np.floor(place).astype(int)
    total = 0.0
    for step in ((0, 0), (1, 0), (0, 1), (1, 1)):
        i, j = np.clip(first + step, 0, size - 1).T
        weight = np.prod(np.where(step, place - first, 1.0 - (place - first)), axis=-1)
        total = total + weight[:, None] * texels[j, i].astype(np.float64)
    return total


def decode(colors, channels=("+X", "+Y", "+Z")):
    """Normals (N, 3), not of length one, from colors (N, 3), whose channels hold these axes."""
    normals = np.zeros_like(colors)
    for channel, axis in enumerate(channels):
        normals[:, "XYZ".index(axis[1])] = (colors[:, channel] * 2.0 - 1.0) * (1.0 if axis[0] == "+" else -1.0)
    return normals


def look_at(eye, at, up=(0.0, 0.0, 1.0)):
    """The view matrix (4, 4) of a camera at `eye` that looks at the point `at`."""
    back = unit(np.subtract(eye, at, dtype=np.float64))
    right = unit(np.cross(up, back))
    matrix = np.eye(4)
    matrix[:3, :3] = right, np.cross(back, right), back
    matrix[:3, 3] = -matrix[:3, :3] @ eye
    return matrix


def perspective(angle, near, far, aspect=1.0):
    """The perspective projection (4, 4) with a vertical field of view of `angle` degrees."""
    scale = 1.0 / np.tan(np.radians(angle) / 2.0)
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = scale / aspect, scale
    matrix[2, 2:] = (far + near) / (near - far), 2.0 * far * near / (near - far)
    matrix[3, 2] = -1.0
    return matrix


def parallel(height, near, far, aspect=1.0):
    """The orthographic projection (4, 4) of a view that is `height` high."""
    matrix = np.diag([2.0 / (height * aspect), 2.0 / height, 2.0 / (near - far), 1.0])
    matrix[2, 3] = (far + near) / (near - far)
    return matrix


def cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
