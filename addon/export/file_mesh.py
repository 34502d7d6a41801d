# SPDX-License-Identifier: GPL-3.0-or-later
"""What a file holds of one object, as an engine reads it."""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class FileMesh:
    """The triangles of an object in a file, in Blender's axes and the object's space, with v upwards.

    One row per corner of each triangle, (T, 3, n) float32: positions, normals, uv, and tangents with the sign of the bitangent,
    None if they are unknown. materials (T,) int: indices into `pictures`, the files of normal maps, or None where there is
    none. uv: of the layer that the normal map uses. has_tangents: whether the tangents are the file's own, and not made of it.
    """

    positions: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    tangents: np.ndarray | None
    materials: np.ndarray
    pictures: list[bytes | None] = field(default_factory=list)
    has_tangents: bool = True
