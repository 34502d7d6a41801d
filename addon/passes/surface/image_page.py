# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages on the GPU: an image with its levels, each of half the width and height of the one before."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.material_feeds import ImagePixels
from .. import blender_gpu as gpu
from .. import target
from ..program import Program
from .finite_values import finite

if TYPE_CHECKING:
    from gpu.types import GPUTexture

FIRST_LEVEL = Program(
    compute="surface/first_level_comp.glsl",
    samplers=(("FLOAT_2D", "page"),),
    images=(("RGBA32F", "FLOAT_2D", "levels", "WRITE"),),
    constants=(("INT", "first_row"), ("INT", "page_flags")),
)
NEXT_LEVEL = Program(
    compute="surface/next_level_comp.glsl",
    images=(("RGBA32F", "FLOAT_2D", "levels", "READ WRITE"),),
    constants=(("VEC4", "source"), ("VEC4", "result"), ("INT", "first_row")),
)
SRGB, WEIGHS_ALPHA = 1, 2
"""The flags of a page in shaders/lib/page_lib.glsl."""


@dataclass(frozen=True)
class Page:
    """An image on the GPU.

    pixels: as stored, 8 bits a channel where they suffice. levels: the others from half the size down to one pixel,
    scene-linear and multiplied by alpha where it weighs, as shaders/lib/page_lib.glsl finds them. top: the number of
    levels. flags: of the values above. reduced: by how much the image was too large for the GPU; 1 if it was not.
    """

    pixels: GPUTexture
    levels: GPUTexture
    top: int
    flags: int
    reduced: int
    bytes: int


def upload(image: ImagePixels) -> Page:
    """Upload a page and build its levels. An image that is larger than a texture can be is reduced first.

    The caller can free the pixels afterwards. Raises ValueError for an image without pixels.
    """
    if not image.values.size:
        raise ValueError("an image without pixels has no page")
    values, reduced = fitting(image.values, gpu.capabilities.max_texture_size_get())
    if not image.is_byte:
        values = finite(values)
    height, width = values.shape[:2]
    texel = "RGBA8" if image.is_byte else "RGBA32F"
    data = gpu.types.Buffer("FLOAT", values.shape, np.ascontiguousarray(values, np.float32))
    pixels = gpu.types.GPUTexture((width, height), format=texel, data=data)
    sizes = level_sizes(width, height)
    flags = image.is_srgb * SRGB | image.weighs_alpha * WEIGHS_ALPHA
    extent = _extent(sizes)
    # Half precision would lose a little at each level: some drivers cut numbers off instead of rounding them.
    levels = gpu.types.GPUTexture(extent, format="RGBA32F")
    if len(sizes) > 1:
        target.dispatch(FIRST_LEVEL, sizes[1][0], range(sizes[1][1]), page=pixels, levels=levels, page_flags=flags)
    for level in range(2, len(sizes)):
        target.dispatch(
            NEXT_LEVEL,
            sizes[level][0],
            range(sizes[level][1]),
            levels=levels,
            source=(*level_origin(sizes, level - 1), *sizes[level - 1]),
            result=(*level_origin(sizes, level), *sizes[level]),
        )
    held = width * height * target.TEXEL_BYTES[texel] + extent[0] * extent[1] * target.TEXEL_BYTES["RGBA32F"]
    return Page(pixels, levels, len(sizes) - 1, flags, reduced, held)


def level_sizes(width: int, height: int) -> list[tuple[int, int]]:
    """The sizes of all levels, from the page itself to one pixel. Odd sizes are rounded up: each level covers the page."""
    sizes = [(width, height)]
    while max(sizes[-1]) > 1:
        sizes.append(((sizes[-1][0] + 1) // 2, (sizes[-1][1] + 1) // 2))
    return sizes


def level_origin(sizes: list[tuple[int, int]], level: int) -> tuple[int, int]:
    """Where a level from 1 on lies: the first at the bottom, the others above it, side by side."""
    return (0, 0) if level == 1 else (sum(width for width, _ in sizes[2:level]), sizes[1][1])


def _extent(sizes: list[tuple[int, int]]) -> tuple[int, int]:
    """The size of the texture that has all levels but the page itself."""
    if len(sizes) < 3:
        return sizes[-1]
    return max(sizes[1][0], sum(width for width, _ in sizes[2:])), sizes[1][1] + sizes[2][1]


def fitting(values: np.ndarray, most: int) -> tuple[np.ndarray, int]:
    """`values` (h, w, 4) with at most `most` pixels a side, and by how much each side was divided: by a whole number."""
    parts = -(-max(values.shape[:2]) // most)
    if parts == 1:
        return values, 1
    for axis in (0, 1):
        size = values.shape[axis]
        starts = np.arange(-(-size // parts)) * parts
        counts = np.diff(np.append(starts, size)).astype(np.float32)
        values = np.add.reduceat(values, starts, axis=axis) / np.expand_dims(counts, (1 - axis, 2))
    return values, parts
