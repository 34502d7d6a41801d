# SPDX-License-Identifier: GPL-3.0-or-later
"""Encodes texels of any program in blocks that GPUs read, with mip levels."""

from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

from ..blocks.formats import BlockFormat, Purpose
from ..core import foreach
from ..core.errors import BakeError
from ..engine.mip_levels import halved
from ..output import atomic_file, containers, image_file, value_encoding
from ..output.containers import Container
from ..scene import textures
from .job import check_gpu

SHORTEST = 1e-6
"""Normals of which the mean is shorter point nowhere, and become that of a flat surface."""


def encode(
    texels: np.ndarray, block_format: BlockFormat, purpose: Purpose, *, has_alpha: bool, mips: bool
) -> Container:
    """The blocks of texels, and of the mip levels below them.

    Args:
        texels: (H, W, 4) float32, row 0 at v = 0, as `purpose` says; linear if the format stores floats. What has no alpha has
            1 there.
        mips: whether there are levels down to one texel: means of unit normals, of linear colors, or of the values.

    Raises NoGpu.
    """
    check_gpu()
    is_srgb = purpose is Purpose.COLOR and not block_format.is_float
    levels = list(_levels(texels, purpose, is_srgb=is_srgb)) if mips else []
    has_map = purpose is Purpose.DATA or not has_alpha  # alpha of data is one more value, such as smoothness
    blocks = image_file.Blocks(block_format, purpose, levels, has_map_in_alpha=has_map)
    return blocks.container(texels, has_alpha=has_alpha, is_color=is_srgb, note="")


def shown(content: Container) -> np.ndarray:
    """The texels (H, W, 4) float32 that a GPU reads of the largest level, row 0 at v = 0."""
    return image_file.decoded(content)


def stored(image: bpy.types.Image) -> np.ndarray:
    """The texels (H, W, 4) float32 of an image as its file has them: of files of 16 bits, Blender makes colors linear."""
    texels = foreach.pixels(image)
    if image.source == "FILE" and image.is_float and image.colorspace_settings.name == value_encoding.SRGB:
        texels[..., :3] = value_encoding.rounded(value_encoding.to_srgb(texels[..., :3]), 16)
    return texels


def absolute(output: str) -> str:
    """A path whose two slashes in front, if any, are the folder of the open file. Raises BakeError if that was never saved."""
    if output.startswith("//") and not bpy.data.filepath:
        raise BakeError(f"{output!r} is relative to a .blend file that was never saved: save it first.")
    return bpy.path.abspath(output)


def size_of(path: str) -> tuple[int, int]:
    """The width and height of an image. Raises BakeError."""
    return image_file.format_of(path).size


def read(path: str) -> tuple[np.ndarray, bool]:
    """The texels of an image as `encode` takes them, and whether the file has alpha. Raises BakeError."""
    return image_file.read(path), image_file.format_of(path).has_alpha


def write(path: Path, content: Container) -> None:
    """Write a .dds or .ktx2 file. Raises BakeError, and then an earlier file stays."""
    with atomic_file.replacing(path) as partial:
        containers.write(partial, content)


def _levels(texels: np.ndarray, purpose: Purpose, *, is_srgb: bool) -> Iterator[np.ndarray]:
    """The levels from 1 on, each the mean of the texels below it. Of all but data, texels whose alpha is 0 do not count, if
    others do."""
    alpha = texels[..., 3:]
    weights = np.ones_like(alpha) if purpose is Purpose.DATA else np.maximum(alpha, np.float32(1e-6))
    sums = np.concatenate(
        [_linear(texels[..., :3], purpose, is_srgb=is_srgb) * weights, weights, alpha, np.ones_like(weights)], axis=2
    )
    for _ in range(int(max(texels.shape[:2])).bit_length() - 1):
        sums = halved(sums)
        colors = _stored(sums[..., :3] / sums[..., 3:4], purpose, is_srgb=is_srgb)
        yield np.concatenate([colors, sums[..., 4:5] / sums[..., 5:]], axis=2).astype(np.float32)


def _linear(colors: np.ndarray, purpose: Purpose, *, is_srgb: bool) -> np.ndarray:
    """Colors as values that have a mean."""
    if purpose is Purpose.NORMAL:
        return 2.0 * colors - 1.0
    return textures.srgb_to_linear(colors) if is_srgb else colors


def _stored(values: np.ndarray, purpose: Purpose, *, is_srgb: bool) -> np.ndarray:
    """What `_linear` was made of."""
    if purpose is not Purpose.NORMAL:
        return value_encoding.to_srgb(values) if is_srgb else values
    lengths = np.linalg.norm(values, axis=2, keepdims=True)
    units = np.where(lengths > SHORTEST, values / np.maximum(lengths, SHORTEST), np.float32([0.0, 0.0, 1.0]))
    return 0.5 + 0.5 * units
