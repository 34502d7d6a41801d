# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays that shaders read: long textures, since the gpu module has no storage buffers."""

import gpu
import numpy as np

WIDTH = 4096
"""As in shaders/texture_lib.glsl."""


def limit() -> int:
    """How many texels of four floats a table can hold on this GPU."""
    return WIDTH * gpu.capabilities.max_texture_size_get()


def upload(values: np.ndarray) -> gpu.types.GPUTexture:
    """A texture with `values` (N, 3 or 4) float32, texel i in row i / WIDTH."""
    rows = max(1, -(-len(values) // WIDTH))
    padded = np.zeros((rows * WIDTH, 4), np.float32)
    padded[: len(values), : values.shape[1]] = values
    return gpu.types.GPUTexture((WIDTH, rows), format="RGBA32F", data=gpu.types.Buffer("FLOAT", padded.shape, padded))
