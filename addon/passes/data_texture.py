# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays that shaders read, stored in textures: the gpu module has no storage buffers."""

from __future__ import annotations

import numpy as np

from ..core import threads
from . import blender_gpu as gpu

WIDTH = 4096
"""As in shaders/lib/texture_lib.glsl."""
BLOCK = 2**14
"""Rows that a thread writes at once, so that they fit in a processor's cache."""
FIRST_NUMBER = 2**23
"""As in shaders/lib/triangle_lib.glsl."""


def limit() -> int:
    """The largest number of texels of four floats that a data texture can hold on this GPU."""
    return WIDTH * gpu.capabilities.max_texture_size_get()


def size_of(*textures: gpu.types.GPUTexture) -> int:
    """The GPU memory of data textures, in bytes."""
    return sum(texture.width * texture.height * 16 for texture in textures)


def upload(values: np.ndarray) -> gpu.types.GPUTexture:
    """Upload `values` (N, 3 or 4) float32 to a texture; element i is in row i / WIDTH."""
    padded = empty(len(values))

    def copy(part: slice) -> None:
        for axis in range(values.shape[1]):  # faster than all at once, into rows that are longer
            padded[part, axis] = values[part, axis]

    threads.for_blocks(len(values), copy, BLOCK)
    return upload_padded(padded)


def upload_gathered(values: np.ndarray, indices: np.ndarray, numbers: np.ndarray | None = None) -> gpu.types.GPUTexture:
    """Upload values[indices], with values (N, 3) float32 and indices (M,) int.

    numbers (M,) int from 0 below 2^30: the bits of the fourth components, plus FIRST_NUMBER; None for 0.
    """
    texels = empty(len(indices))
    bits = texels.view(np.int32)

    def gather(part: slice) -> None:
        rows = np.take(values, indices[part], axis=0, mode="clip")
        for axis in range(3):  # faster than all at once, into rows that are longer
            texels[part, axis] = rows[:, axis]
        if numbers is not None:
            bits[part, 3] = numbers[part] + FIRST_NUMBER

    threads.for_blocks(len(indices), gather, BLOCK)
    return upload_padded(texels)


def empty(count: int) -> np.ndarray:
    """A zeroed array (rows * WIDTH, 4) float32 with space for `count` texels."""
    return np.zeros((max(1, -(-count // WIDTH)) * WIDTH, 4), np.float32)


def upload_padded(padded: np.ndarray) -> gpu.types.GPUTexture:
    """Upload an array that `empty` made."""
    data = gpu.types.Buffer("FLOAT", padded.shape, padded)
    return gpu.types.GPUTexture((WIDTH, len(padded) // WIDTH), format="RGBA32F", data=data)
