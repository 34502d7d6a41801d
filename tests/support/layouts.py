# SPDX-License-Identifier: GPL-3.0-or-later
"""Flat squares whose UV layers are turned, mirrored and moved, and checkers on them, with the closed form of both."""

from dataclasses import dataclass

import bpy
import numpy as np

from tests.support import zoo
from tests.support.maps import texel_uv

PAINT = "Paint"
"""The UV layer of images."""


@dataclass(frozen=True)
class Layout:
    """UVs of points (x, y) of the square from -1 to 1: turned by `degrees`, mirrored, scaled, with `center` for (0, 0)."""

    degrees: float = 0.0
    is_mirrored: bool = False
    scale: float = 0.5
    center: tuple[float, float] = (0.5, 0.5)

    @property
    def linear(self) -> np.ndarray:
        """The matrix (2, 2) from (x, y) to (u, v)."""
        turn = np.radians(self.degrees)
        matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        return self.scale * matrix @ np.diag([-1.0 if self.is_mirrored else 1.0, 1.0])

    def uv(self, points: np.ndarray) -> np.ndarray:
        """The coordinates (..., 2) of points (..., 2)."""
        return points @ self.linear.T + self.center

    def points(self, uv: np.ndarray) -> np.ndarray:
        """The points (..., 2) at coordinates (..., 2)."""
        return (uv - self.center) @ np.linalg.inv(self.linear).T

    def texels(self, size: int) -> tuple[np.ndarray, np.ndarray]:
        """The points (size, size, 2) of texels, and whether they are on the square with a texel around them."""
        points = self.points(texel_uv(size, size))
        return points, np.abs(points).max(axis=-1) < 1.0 - 1.5 / (size * self.scale)

    def frame(self) -> np.ndarray:
        """Tangent, bitangent and normal (3, 3) as columns, in the square's space."""
        inverse = np.linalg.inv(self.linear)
        frame = np.eye(3)
        frame[:2, :2] = inverse / np.linalg.norm(inverse, axis=0)
        return frame


def square(name, layers, *, n=1, z=0.0) -> bpy.types.Object:
    """The square from -1 to 1 in n x n quads, facing +Z. layers: Layouts by the name of the UV layer.

    The first layer is active, the last one is rendered.
    """
    obj = zoo.plane(name, n)
    data = obj.data
    for layer in list(data.uv_layers):
        data.uv_layers.remove(layer)
    corners = np.array([data.vertices[loop.vertex_index].co[:2] for loop in data.loops])
    for layer, layout in layers.items():
        data.uv_layers.new(name=layer).uv.foreach_set("vector", layout.uv(corners).astype(np.float32).ravel())
    data.uv_layers.active = data.uv_layers[next(iter(layers))]
    data.uv_layers[list(layers)[-1]].active_render = True
    obj.location.z = z
    return obj


def checker(fields, pixels, *, dark=0.0, bright=1.0) -> np.ndarray:
    """Stored values (H, W) of a checker of fields x fields, each of pixels x pixels; the one at (0, 0) is dark."""
    return np.where(np.kron(np.indices((fields, fields)).sum(axis=0) % 2, np.ones((pixels, pixels))), bright, dark)


def fields_at(uv, fields) -> tuple[np.ndarray, np.ndarray]:
    """Whether the field of such a checker at (..., 2) is bright, and how far the field's border is, in fields."""
    at = uv * fields
    return np.floor(at).sum(axis=-1) % 2 == 1, np.abs(at - np.round(at)).min(axis=-1)


def linear(stored) -> np.ndarray:
    """Scene-linear values of stored sRGB ones (IEC 61966-2-1)."""
    stored = np.maximum(stored, 0.0)
    return np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)
