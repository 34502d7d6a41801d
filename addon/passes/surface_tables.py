# SPDX-License-Identifier: GPL-3.0-or-later
"""What the materials of the high meshes show, on the GPU: tables of materials, values at corners, and images with levels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core import progress
from ..core.material_feeds import ImagePixels
from . import allocation, data_texture, target
from . import blender_gpu as gpu
from .allocation import TEXEL_BYTES
from .shader import Program

LARGEST_FINITE = 65504.0
"""What infinite values become: the largest number of half precision, as rendered images store it."""


def finite(values: np.ndarray) -> np.ndarray:
    """`values` (float32, any shape) with 0 in place of NaN, and LARGEST in place of infinity."""
    return (
        values if _are_finite(values) else np.nan_to_num(values, nan=0.0, posinf=LARGEST_FINITE, neginf=-LARGEST_FINITE)
    )


def count_others(values: np.ndarray) -> int:
    """How many rows of `values` (N, channels) float32 have one that `finite` replaces."""
    return 0 if _are_finite(values) else int(np.count_nonzero(~np.isfinite(values).all(axis=1)))


def _are_finite(values: np.ndarray) -> bool:
    """False if a value is not finite, or if their sum is not."""
    # A sum is finite unless a term is not, or it overflows: the common case takes one pass and no memory.
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(values.sum()))


CONSTANT = 0
"""The number of all constants; images and attributes count from 1. As in shaders/surface/add_constants_comp.glsl."""
UNKNOWN = -1
"""The number of a material that the map cannot show."""


@dataclass(frozen=True)
class MaterialTable:
    """Which feed each material has.

    Attributes:
        feeds (M,) int: The number of each material's feed.
        texture: The same with constants, for shaders.
    """

    feeds: np.ndarray
    texture: gpu.types.GPUTexture


def upload_materials(feeds: np.ndarray, colors: np.ndarray | None = None) -> MaterialTable:
    """Upload one texel for each material number, from 0.

    feeds (M,) int: CONSTANT, UNKNOWN, or the number of a feed, at most 2^24. colors (M, 3) float32: the constants.
    """
    texels = np.zeros((max(1, len(feeds)), 4), np.float32)
    texels[:, 3] = UNKNOWN
    texels[: len(feeds), 3] = feeds
    if colors is not None:
        texels[: len(feeds), :3] = colors
    return MaterialTable(np.asarray(feeds), data_texture.upload(texels))


@dataclass(frozen=True)
class CornerValues:
    """A layer on the GPU. A texel of `triangles` has the numbers of a triangle's three values in `values`, and one number more,
    as shaders/lib/triangle_lib.glsl reads them."""

    triangles: gpu.types.GPUTexture
    values: gpu.types.GPUTexture


def upload_uvs(uv: np.ndarray, corners: np.ndarray, materials: np.ndarray) -> CornerValues:
    """Upload UVs with material numbers, as shaders/lib/footprint_lib.glsl reads them.

    uv (C, 2) float32; corners (T, 3) int, indices into it; materials (T,), the number of each triangle's material.
    """
    return CornerValues(data_texture.upload_numbers(corners, materials.astype(np.int32)), data_texture.upload(uv))


def upload_values(values: np.ndarray, corners: np.ndarray) -> CornerValues:
    """Upload the values of an attribute.

    values (C, 1 to 4) float32; corners (T, 3) int, indices into it. A single number fills red, green and blue; alpha is 1
    unless there are four channels. Values that are not finite are replaced.
    """
    wide = np.ones((len(values), 4), np.float32)
    channels = values.shape[1]
    wide[:, : 3 if channels == 1 else channels] = finite(values)
    if channels == 2:
        wide[:, 2] = 0.0
    return CornerValues(data_texture.upload_numbers(corners), data_texture.upload(wide))


def upload_tangents(tangents: np.ndarray, corners: np.ndarray) -> CornerValues:
    """Upload tangents.

    tangents (C, 4) float32: world directions of any length, which are normalized, and the sign of the bitangent, for
    bitangent = sign * cross(normal, tangent) in world space: a mirrored object has the other sign than its mesh. A
    tangent of zeros has no normal map. corners (T, 3) int, indices into it.
    """
    unit = np.array(tangents, np.float32)
    length = np.linalg.norm(unit[:, :3], axis=1, keepdims=True)
    unit[:, :3] /= np.where(length > 0.0, length, 1.0)
    return CornerValues(data_texture.upload_numbers(corners), data_texture.upload(unit))


FIRST_LEVEL = Program(
    compute="surface/first_level_comp.glsl",
    samplers=(("FLOAT_2D", "image_pixels"),),
    images=(("RGBA32F", "FLOAT_2D", "levels", "WRITE"),),
    constants=(("INT", "first_row"), ("INT", "image_flags")),
    cost=0.05,
)
NEXT_LEVEL = Program(
    compute="surface/next_level_comp.glsl",
    images=(("RGBA32F", "FLOAT_2D", "levels", "READ WRITE"),),
    constants=(("VEC4", "source"), ("VEC4", "result"), ("INT", "first_row")),
)
SRGB, WEIGHS_ALPHA = 1, 2
"""Flags of an image in shaders/lib/image_color_lib.glsl."""


@dataclass(frozen=True)
class ImageLevels:
    """An image on the GPU.

    Attributes:
        pixels: As stored, 8 bits a channel where they suffice.
        levels: The others from half the size down to one pixel, scene-linear and multiplied by alpha where it weighs, as
            shaders/lib/image_lib.glsl finds them.
        top: The number of levels.
        flags: Of the values above.
        reduced: By how much the image was too large for the GPU; 1 if it was not.
        bytes: What it takes on the GPU.
    """

    pixels: gpu.types.GPUTexture
    levels: gpu.types.GPUTexture
    top: int
    flags: int
    reduced: int
    bytes: int


def upload_image(image: ImagePixels) -> ImageLevels:
    """Upload an image and build its levels. One that is larger than a texture can be is reduced first.

    The caller can free the pixels afterwards. Raises ValueError for an image without pixels.
    """
    if not image.values.size:
        raise ValueError("the image has no pixels")
    values, reduced = fitting(image.values, gpu.capabilities.max_texture_size_get())
    if not image.is_byte:
        values = finite(values)
    height, width = values.shape[:2]
    texel = "RGBA8" if image.is_byte else "RGBA32F"
    pixels = data_texture.image(values, texel)
    sizes = level_sizes(width, height)
    flags = image.is_srgb * SRGB | image.weighs_alpha * WEIGHS_ALPHA
    extent = _extent(sizes)
    # Half precision would lose a little at each level: some drivers cut numbers off instead of rounding them.
    levels = allocation.texture(extent, "RGBA32F")
    if len(sizes) > 1:
        width_of_first, rows = sizes[1]
        for piece in progress.pieces(rows, FIRST_LEVEL.cost * width_of_first, progress.SLICE_ROWS):
            target.dispatch(FIRST_LEVEL, width_of_first, piece, image_pixels=pixels, levels=levels, image_flags=flags)
            if len(piece) < rows:
                target.Target.of(*extent, "RGBA32F", levels).finish()
    for level in range(2, len(sizes)):
        target.dispatch(
            NEXT_LEVEL,
            sizes[level][0],
            range(sizes[level][1]),
            levels=levels,
            source=(*level_origin(sizes, level - 1), *sizes[level - 1]),
            result=(*level_origin(sizes, level), *sizes[level]),
        )
    held = width * height * TEXEL_BYTES[texel] + extent[0] * extent[1] * TEXEL_BYTES["RGBA32F"]
    return ImageLevels(pixels, levels, len(sizes) - 1, flags, reduced, held)


def level_sizes(width: int, height: int) -> list[tuple[int, int]]:
    """The sizes of all levels, from the image itself to one pixel. Odd sizes are rounded up: each level covers the image."""
    sizes = [(width, height)]
    while max(sizes[-1]) > 1:
        sizes.append(((sizes[-1][0] + 1) // 2, (sizes[-1][1] + 1) // 2))
    return sizes


def level_origin(sizes: list[tuple[int, int]], level: int) -> tuple[int, int]:
    """Where a level from 1 on lies: the first at the bottom, the others above it, side by side."""
    return (0, 0) if level == 1 else (sum(width for width, _ in sizes[2:level]), sizes[1][1])


def _extent(sizes: list[tuple[int, int]]) -> tuple[int, int]:
    """The size of the texture that has all levels but the image itself."""
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


FIND_BLOCKS = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="surface/served_blocks_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32UI", "UINT_2D", "hits"), ("RGBA32F", "FLOAT_2D", "labels")),
    outputs=(("VEC4", "materials_out"),),
    cost=30.0,
)
BLOCK_SIDE = 32
"""Texels. As in shaders/lib/served_lib.glsl; workgroups are 8 x 8."""
BITS = 24
"""The whole numbers that a float holds exactly have so many bits."""


@dataclass(frozen=True)
class Blocks:
    """Which materials show in each block of texels.

    Attributes:
        masks (rows, columns, 4) int: Material m in bit m % 96, by 24 bits.
    """

    masks: np.ndarray

    def serving(self, materials: MaterialTable, number: int) -> np.ndarray:
        """The columns and rows (N, 2) of the blocks that may show a material with the feed of this number."""
        wanted = np.zeros(4, np.int64)
        bits = np.flatnonzero(materials.feeds == number) % (BITS * 4)
        np.bitwise_or.at(wanted, bits // BITS, 1 << bits % BITS)
        return np.argwhere((self.masks & wanted).any(axis=-1))[:, ::-1]


def find_blocks(hits: target.Target, labels: gpu.types.GPUTexture) -> Blocks:
    """The blocks of a map, from its `hits` (RGBA32UI). labels: as in surface_values.add_constants. Waits for the GPU."""
    rows, columns = -(-hits.height // BLOCK_SIDE), -(-hits.width // BLOCK_SIDE)
    shown = target.Target(columns, rows, ("RGBA32F",))
    target.fill(
        shown, FIND_BLOCKS, hits=hits.texture, labels=labels
    )  # drawn: Target.read does not wait for compute shaders
    return Blocks(shown.texels().astype(np.int64))


def every_block(width: int, height: int) -> Blocks:
    """All blocks of a map, whatever they show."""
    return Blocks(np.full((-(-height // BLOCK_SIDE), -(-width // BLOCK_SIDE), 4), 2**BITS - 1))


def dispatch_in_blocks(
    program: Program, hits: target.Target, blocks: Blocks | None, materials: MaterialTable, number: int, **bindings
) -> None:
    """Run `program` on the blocks of the map of `hits` that may show a material with the feed of this number, in pieces."""
    served = (blocks or every_block(hits.width, hits.height)).serving(materials, number)
    pieces = progress.pieces(len(served), BLOCK_SIDE**2 * program.cost)
    for piece in pieces:
        listed = data_texture.upload(np.pad(served[piece.start : piece.stop], ((0, 0), (0, 1))).astype(np.float32))
        target.dispatch_groups(
            program,
            ((BLOCK_SIDE // program.group[0]) ** 2, len(piece)),
            hits=hits.texture,
            blocks=listed,
            materials=materials.texture,
            feed=number,
            **bindings,
        )
        if len(pieces) > 1:
            hits.finish()
