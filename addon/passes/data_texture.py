# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays that shaders read: long textures, since the gpu module has no storage buffers."""

from __future__ import annotations

import numpy as np

from . import blender_gpu as gpu

WIDTH = 4096
"""As in shaders/lib/texture_lib.glsl."""


def limit() -> int:
    """How many texels of four floats a table can hold on this GPU."""
    return WIDTH * gpu.capabilities.max_texture_size_get()


def upload(values: np.ndarray) -> gpu.types.GPUTexture:
    """A texture with `values` (N, 3 or 4) float32, texel i in row i / WIDTH."""
    padded = room(len(values))
    padded[: len(values), : values.shape[1]] = values
    return _texture(padded)


def gathered(values: np.ndarray, places: np.ndarray, into: np.ndarray) -> gpu.types.GPUTexture:
    """As `upload` of values[places], values (N, 3) float32 and places (M,) int, which `into`, room for M, holds then."""
    wide = np.zeros((len(values), 4), np.float32)
    wide[:, :3] = values
    np.take(wide, places, axis=0, out=into[: len(places)], mode="clip")
    return _texture(into)


def room(count: int) -> np.ndarray:
    """An array (rows * WIDTH, 4) float32 for so many texels."""
    return np.zeros((max(1, -(-count // WIDTH)) * WIDTH, 4), np.float32)


def _texture(padded: np.ndarray) -> gpu.types.GPUTexture:
    data = gpu.types.Buffer("FLOAT", padded.shape, padded)
    return gpu.types.GPUTexture((WIDTH, len(padded) // WIDTH), format="RGBA32F", data=data)
