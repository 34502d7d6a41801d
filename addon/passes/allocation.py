# SPDX-License-Identifier: GPL-3.0-or-later
"""Creates all textures and buffers on the GPU, and raises a BakeError that says what to do where a driver refuses memory."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import BakeError, NoGpuMemory
from . import blender_gpu as gpu

if TYPE_CHECKING:
    from collections.abc import Iterator

TEXEL_BYTES = {"RGBA32F": 16, "RGBA32UI": 16, "RGBA16F": 8, "RGBA8": 4, "R16F": 2, "R16I": 2, "R8": 1}
TEXEL_BYTES |= {"R32F": 4, "R32I": 4, "DEPTH_COMPONENT32F": 4}
"""The memory of a texel, by format."""

held: list[Callable[[], int]] = []
"""Functions that return how many bytes on the GPU an owner holds, for the message."""


BUDGET = 1536 * 2**20
"""Bytes that the targets of a bake may take: Blender does not say how much memory a GPU has, and few have less than 4 GiB."""
VARIABLE = "IMPRINT_GPU_MEMORY"
"""The environment variable with another budget, in MiB."""
LEAST_BUDGET = 64
"""The least budget, in MiB."""


def no_preference() -> int | None:
    """There are no preferences of Blender's."""
    return None


preferred: Callable[[], int | None] = no_preference
"""Returns the budget of Blender's preferences in MiB; None without one. The interface replaces it."""


def budget() -> int:
    """The bytes on the GPU that the targets of a bake may take. Raises BakeError if the environment has no such number."""
    text = os.environ.get(VARIABLE, "")
    if text and not (text.isascii() and text.isdigit() and int(text) >= LEAST_BUDGET):
        raise BakeError(f"{VARIABLE} is {text!r}: set a whole number of MiB, at least {LEAST_BUDGET}.")
    megabytes = int(text) if text else preferred()
    return BUDGET if megabytes is None else max(megabytes, LEAST_BUDGET) * 2**20


def texture(size: tuple[int, int], texel: str, values: np.ndarray | None = None) -> gpu.types.GPUTexture:
    """A texture of `size` (width, height).

    Args:
        texel: a format of TEXEL_BYTES.
        values: what it holds, (height, width, channels) or (height, width), float32 and contiguous; None for anything.
    """
    with _refusals(size[0] * size[1] * TEXEL_BYTES[texel]):
        if values is None:
            return gpu.types.GPUTexture(size, format=texel)
        return gpu.types.GPUTexture(size, format=texel, data=gpu.types.Buffer("FLOAT", values.shape, values))


def offscreen(size: tuple[int, int], texel: str) -> gpu.types.GPUOffScreen:
    """An offscreen of `size` (width, height), with a depth buffer that Blender adds."""
    with _refusals(size[0] * size[1] * TEXEL_BYTES[texel]):
        return gpu.types.GPUOffScreen(*size, format=texel)


def corners(name: str, values: np.ndarray) -> gpu.types.GPUVertBuf:
    """A buffer of the attribute `name` with `values` (C, n) float32 for each corner."""
    layout = gpu.types.GPUVertFormat()
    layout.attr_add(id=name, comp_type="F32", len=values.shape[1], fetch_mode="FLOAT")
    with _refusals(values.nbytes):
        buffer = gpu.types.GPUVertBuf(layout, len(values))
        buffer.attr_fill(name, values)
    return buffer


def triangles(values: np.ndarray) -> gpu.types.GPUIndexBuf:
    """A buffer of triangles (T, 3) int32: indices into corners."""
    with _refusals(values.nbytes):
        return gpu.types.GPUIndexBuf(type="TRIS", seq=values)


def check_arrived(uploaded: gpu.types.GPUTexture, place: tuple[int, int], expected: np.ndarray) -> None:
    """Raise NoGpuMemory if the texel (RGBA32F) at this column and row is not what was uploaded, (4,) float32."""
    read = gpu.types.Buffer("FLOAT", 4)
    framebuffer = gpu.types.GPUFrameBuffer(color_slots=[uploaded])
    with framebuffer.bind():
        framebuffer.read_color(*place, 1, 1, 4, 0, "FLOAT", data=read)
    if np.asarray(read).tobytes() != expected.tobytes():
        raise _refused(uploaded.width * uploaded.height * TEXEL_BYTES["RGBA32F"])


def _refused(size: int) -> NoGpuMemory:
    return NoGpuMemory(sum(count() for count in held) + size)


@contextmanager
def _refusals(size: int) -> Iterator[None]:
    """Raise NoGpuMemory if something of `size` bytes is refused in this block."""
    try:
        yield
    except (RuntimeError, MemoryError) as error:
        raise _refused(size) from error
