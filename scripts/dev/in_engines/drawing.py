# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles on pixels and texels in float64: which triangle a pixel shows and at which point, and texels between centers."""

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

ANGLE = 30.0
"""The field of view of cameras, in degrees."""
EDGE = 1e-9
"""A pixel belongs to a triangle if no weight of its center is less than minus this."""


@dataclass(frozen=True)
class Drawn:
    """What lies on the pixels of a square of size S, bottom row first.

    triangle: (S, S), -1 for none. weights: (S, S, 3), of its corners. count: (S, S), how many triangles the center is in.
    """

    triangle: np.ndarray
    weights: np.ndarray
    count: np.ndarray

    @property
    def there(self) -> np.ndarray:
        return self.triangle >= 0


def draw(corners: np.ndarray, size: int, *, both_sides: bool = False) -> Drawn:
    """Draw triangles (T, 3, 4) in clip space. The nearest one wins, and the first of equal ones.

    both_sides: also triangles that the eye sees from behind, whose corners run clockwise.
    """
    w = corners[..., 3]
    place = (corners[..., :2] / w[..., None] * 0.5 + 0.5) * size
    depth = corners[..., 2] / w
    nearest = np.full((size, size), np.inf)
    triangle, weights = np.full((size, size), -1), np.zeros((size, size, 3))
    count = np.zeros((size, size), int)
    first = np.clip(np.ceil(place.min(axis=1) - 0.5), 0, size).astype(int)
    last = np.clip(np.floor(place.max(axis=1) - 0.5) + 1, 0, size).astype(int)
    area = _cross(place[:, 1] - place[:, 0], place[:, 2] - place[:, 0])
    shown = area != 0.0 if both_sides else area > 0.0
    for t in np.flatnonzero(shown & (first < last).all(axis=1)):
        a, b, c = place[t]
        x, y = np.meshgrid(*(np.arange(first[t, i], last[t, i]) + 0.5 for i in (0, 1)))
        p = np.stack([x, y], axis=-1)
        flat = np.stack([_cross(c - b, p - b), _cross(a - c, p - c), _cross(b - a, p - a)], axis=-1) / area[t]
        inside = (flat >= -EDGE).all(axis=-1)
        box = slice(first[t, 1], last[t, 1]), slice(first[t, 0], last[t, 0])
        count[box] += inside
        z = flat @ depth[t]
        closer = inside & (z < nearest[box])
        true = flat / w[t]
        true /= true.sum(axis=-1, keepdims=True)
        nearest[box][closer], triangle[box][closer], weights[box][closer] = z[closer], t, true[closer]
    return Drawn(triangle, weights, count)


def lay_out(uv: np.ndarray, size: int) -> Drawn:
    """Draw triangles on the texels of a map: uv (T, 3, 2) with v up."""
    flat = np.zeros((*uv.shape[:2], 4))
    flat[..., :2], flat[..., 3] = uv * 2.0 - 1.0, 1.0
    return draw(flat, size, both_sides=True)


def look_at(eye: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The view matrix (4, 4) of a camera at `eye` that looks at the point `at`, with Y up."""
    back = (eye - at) / np.linalg.norm(eye - at)
    right = np.cross((0.0, 1.0, 0.0), back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = right, np.cross(back, right), back
    matrix[:3, 3] = -matrix[:3, :3] @ eye
    return matrix


def perspective(angle: float, near: float, far: float) -> np.ndarray:
    """The projection (4, 4) of a square view with a field of view of `angle` degrees."""
    scale = 1.0 / np.tan(np.radians(angle) / 2.0)
    matrix = np.diag([scale, scale, (far + near) / (near - far), 0.0])
    matrix[2, 3], matrix[3, 2] = 2.0 * far * near / (near - far), -1.0
    return matrix


@dataclass(frozen=True)
class Sights:
    """Cameras around a mesh: their view matrices, what each shows of it, and the planes that bound it."""

    matrices: list[np.ndarray]
    drawn: list[Drawn]
    near: float
    far: float


def look_around(corners: np.ndarray, directions: Sequence[Sequence[float]], size: int) -> Sights:
    """Show all of the triangles (T, 3, 3) from each direction, in pictures of size x size pixels."""
    center = (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2.0
    radius = np.linalg.norm(corners - center, axis=-1).max()
    away = radius / np.sin(np.radians(ANGLE / 2.0))
    near, far = float(away - 1.5 * radius), float(away + 1.5 * radius)
    points = np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=-1)
    eyes = [center + away * np.array(direction) / np.linalg.norm(direction) for direction in directions]
    matrices = [look_at(eye, center) for eye in eyes]
    lens = perspective(ANGLE, near, far)
    return Sights(matrices, [draw(points @ (lens @ matrix).T, size) for matrix in matrices], near, far)


def footprint(uv: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """The columns and rows (N, 4), wrapped, of the four texels around points uv (N, 2) with v up."""
    first = np.floor(uv * size - 0.5).astype(int)
    steps = np.array([(0, 0), (1, 0), (0, 1), (1, 1)])
    texels = (first[:, None] + steps) % size
    return texels[..., 0], texels[..., 1]


def png(normals: np.ndarray) -> bytes:
    """An 8-bit RGB file of normals (S, S, 3), bottom row first, as normal * 0.5 + 0.5."""
    return png_of(np.round(np.clip(normals * 0.5 + 0.5, 0.0, 1.0) * 255.0).astype(np.uint8))


def png_of(colors: np.ndarray) -> bytes:
    """A file of colors (height, width, 3) uint8, bottom row first."""
    height, width = colors.shape[:2]
    rows = np.zeros((height, 1 + width * 3), np.uint8)
    rows[:, 1:] = colors[::-1].reshape(height, -1)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = ((b"IHDR", head), (b"IDAT", zlib.compress(rows.tobytes(), 6)), (b"IEND", b""))
    chunks = (
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in parts
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
