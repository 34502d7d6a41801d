# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads at the hits what the materials of the high meshes show: constants, attributes, images, normal and bump maps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.material_feeds import LUMINANCE, AttributeFeed, BumpFeed, Extension, ImageFeed, NormalMapFeed
from . import blender_gpu as gpu
from . import cast, shader, surface_tables, target
from .shader import Program
from .surface_tables import Blocks, CornerValues, ImageLevels, MaterialTable

TEXELS = (
    ("RGBA32UI", "UINT_2D", "hits"),
    ("RGBA32F", "FLOAT_2D", "uv_triangles"),
    ("RGBA32F", "FLOAT_2D", "uvs"),
    ("RGBA32F", "FLOAT_2D", "triangles"),
    ("RGBA32F", "FLOAT_2D", "points"),
    ("RGBA32F", "FLOAT_2D", "levels"),
)
"""What all programs that look up images read, beside `IMAGE`."""
IMAGE = ("FLOAT_2D", "image_pixels"), ("FLOAT_2D", "materials"), ("FLOAT_2D", "blocks")
LEVELS = (("VEC4", "scale"), ("VEC4", "offset"), ("VEC4", "low"), ("VEC4", "high"), ("INT", "channel"))
"""What shaders/lib/fed_value_lib.glsl takes, from `_levels`."""
_ROWS = ("VEC4", "row_u"), ("VEC4", "row_v")
_IMAGE_NUMBERS = ("INT", "feed"), ("INT", "tile"), ("INT", "image_flags"), ("INT", "top_level")
"""The constants of all programs that look up images."""
_OF_NORMALS = ("MAT4", "to_space"), *_ROWS, ("INT", "channel"), *_IMAGE_NUMBERS, ("VEC2", "limits")
"""The constants of programs that turn normals, in an order by which Blender counts 128 bytes: it prints a line for more."""
_NORMALS = (("RGBA32F", "FLOAT_2D", "normals", "READ WRITE"),)
ADD_IMAGE = Program(
    compute="surface/add_image_comp.glsl",
    texels=TEXELS,
    samplers=IMAGE,
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(*_ROWS, *LEVELS, *_IMAGE_NUMBERS),
    cost=0.5,
)
ADD_CONSTANTS = Program(
    compute="surface/add_constants_comp.glsl",
    texels=(
        ("RGBA32UI", "UINT_2D", "hits"),
        ("RGBA32F", "FLOAT_2D", "normals"),
        ("RGBA32F", "FLOAT_2D", "labels"),
        ("RGBA32F", "FLOAT_2D", "materials"),
    ),
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(("INT", "first_row"), ("INT", "is_first")),
)
ADD_ATTRIBUTE = Program(
    compute="surface/add_attribute_comp.glsl",
    texels=(
        ("RGBA32UI", "UINT_2D", "hits"),
        ("RGBA32F", "FLOAT_2D", "labels"),
        ("RGBA32F", "FLOAT_2D", "materials"),
        ("RGBA32F", "FLOAT_2D", "value_triangles"),
        ("RGBA32F", "FLOAT_2D", "values"),
    ),
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(*LEVELS, ("INT", "first_row"), ("INT", "feed")),
)
NORMAL_MAP = Program(
    compute="surface/normal_map_comp.glsl",
    texels=TEXELS,
    samplers=(*IMAGE, ("FLOAT_2D", "tangent_triangles"), ("FLOAT_2D", "tangents")),
    images=_NORMALS,
    constants=_OF_NORMALS,
    cost=0.5,
)
BUMP = Program(
    compute="surface/bump_comp.glsl",
    texels=TEXELS,
    samplers=IMAGE,
    images=_NORMALS,
    constants=_OF_NORMALS,
    cost=2.0,
)
COLOR = 4
"""The channel of a whole color in shaders/lib/channel_lib.glsl."""
LARGEST = 3e38
"""About the largest number of single precision."""
CLOSEST, EXTENSION_SHIFT = 4, 4
"""As in shaders/lib/image_lib.glsl."""
_EXTENSIONS = (Extension.REPEAT, Extension.EXTEND, Extension.CLIP, Extension.MIRROR)
GREEN_DOWN = 8
"""As in shaders/surface/normal_map_comp.glsl."""


@dataclass(frozen=True)
class ImageAtHits:
    """An image at the hits of a sample, on the materials that have `number` in `materials`.

    Attributes:
        hits: RGBA32UI, as shaders/lib/hit_lib.glsl reads it.
        tables: Of the high triangles.
        uvs: From surface_tables.upload_uvs, of the feed's layer.
        tile: The UDIM tile that the image is; only hits in it count. Pixels are averaged over the footprint of a texel, from
            the hits beside it, divided by the square root of `samples`.
        blocks: From surface_tables.find_blocks, for the same hits: without, a pass runs on the whole map.
    """

    hits: target.Target
    image: ImageLevels
    feed: ImageFeed
    number: int
    tables: cast.Tables
    uvs: CornerValues
    materials: MaterialTable
    tile: int | None = None
    samples: int = 1
    blocks: Blocks | None = None

    def dispatch(self, program: Program, *, flags: int = 0, other: float = 0.0, **bindings) -> None:
        """Run a program that reads the image. flags: further ones of the image. other: a number that the program wants."""
        # The tiles of an image have nothing outside.
        extension = self.feed.extension if self.tile is None else Extension.EXTEND
        flags |= self.image.flags | (not self.feed.is_smooth) * CLOSEST
        surface_tables.dispatch_in_blocks(
            program,
            self.hits,
            self.blocks,
            self.materials,
            self.number,
            triangles=self.tables.triangles,
            points=self.tables.points,
            uv_triangles=self.uvs.triangles,
            uvs=self.uvs.values,
            image_pixels=self.image.pixels,
            levels=self.image.levels,
            row_u=(*self.feed.mapping[0], 1.0 / math.sqrt(self.samples)),
            row_v=(*self.feed.mapping[1], other),
            tile=self.tile or 0,
            image_flags=flags | _EXTENSIONS.index(extension) << EXTENSION_SHIFT,
            top_level=self.image.top,
            **bindings,
        )


def add_constants(
    sums: target.Target,
    hits: target.Target,
    normals: gpu.types.GPUTexture,
    *,
    labels: gpu.types.GPUTexture,
    materials: MaterialTable,
    is_first: bool,
    rows: range | None = None,
) -> None:
    """Add the constants of `materials` to `sums` (RGBA32F), and count misses: once for each sample of a map.

    is_first: replace what the sums held. normals: alpha is -1 for a miss. labels: a data texture with the object and
    material number of each triangle, in the order of the hits' numbers. materials: from surface_tables.upload_materials.
    """
    target.dispatch(
        ADD_CONSTANTS,
        sums.width,
        rows or range(sums.height),
        sums=sums.texture,
        hits=hits.texture,
        normals=normals,
        labels=labels,
        materials=materials.texture,
        is_first=int(is_first),
    )


def add_attribute(
    sums: target.Target,
    hits: target.Target,
    values: CornerValues,
    feed: AttributeFeed,
    number: int,
    *,
    labels: gpu.types.GPUTexture,
    materials: MaterialTable,
    rows: range | None = None,
) -> None:
    """Add `values`, from surface_tables.upload_values, to `sums` where the hit's material has this feed's `number`.

    Other arguments as in `add_constants`.
    """
    target.dispatch(
        ADD_ATTRIBUTE,
        sums.width,
        rows or range(sums.height),
        sums=sums.texture,
        hits=hits.texture,
        labels=labels,
        value_triangles=values.triangles,
        values=values.values,
        materials=materials.texture,
        feed=number,
        **_levels(feed),
    )


def add_image(sums: target.Target, at_hits: ImageAtHits) -> None:
    """Add what an image shows to `sums` (RGBA32F), and 1 to their alpha, where the hit's material has it."""
    at_hits.dispatch(ADD_IMAGE, sums=sums.texture, **_levels(at_hits.feed))


def apply_normal_map(
    normals: target.Target, at_hits: ImageAtHits, feed: NormalMapFeed, tangents: CornerValues, to_space: np.ndarray
) -> None:
    """Turn `normals` (RGBA32F), as cast.look_up wrote them, in place where the hit's material has the image of `feed`.

    tangents: from surface_tables.upload_tangents, of the feed's layer. to_space: the matrix (3, 3) that cast.look_up got.
    """
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3], matrix[3, :3] = to_space, feed.image.offset, feed.image.scale
    at_hits.dispatch(
        NORMAL_MAP,
        flags=feed.is_green_down * GREEN_DOWN,
        other=feed.strength,
        normals=normals.texture,
        tangent_triangles=tangents.triangles,
        tangents=tangents.values,
        to_space=shader.mat4(matrix),
        channel=_channel_number(feed.image.channel),
        limits=_limits(feed.image),
    )


def apply_bump(normals: target.Target, at_hits: ImageAtHits, feed: BumpFeed, to_space: np.ndarray, unit: float) -> None:
    """Turn `normals` in place by heights, after the normal map `below`. Otherwise as `apply_normal_map`.

    unit: how many scene units one unit of the points is: the size of their local space.
    """
    matrix = np.eye(4)
    matrix[:3, :3], matrix[0, 3] = to_space, feed.distance * feed.image.scale[0] / unit
    at_hits.dispatch(
        BUMP,
        other=max(feed.strength, 0.0),
        normals=normals.texture,
        to_space=shader.mat4(matrix),
        channel=_channel_number(LUMINANCE if feed.image.channel is None else feed.image.channel),
        limits=_limits(feed.image),
    )


def _levels(feed: ImageFeed | AttributeFeed) -> dict:
    """The constants LEVELS of a feed."""
    limits = feed.limits
    return {
        "scale": (*feed.scale, 0.0),
        "offset": (*feed.offset, 0.0),
        "low": (*map(_shader_number, limits.low), _shader_number(limits.least)),
        "high": (*map(_shader_number, limits.high), _shader_number(limits.most)),
        "channel": _channel_number(feed.channel),
    }


def _limits(image: ImageFeed) -> tuple[float, float]:
    """The limits that all channels have."""
    return _shader_number(image.limits.low[0]), _shader_number(image.limits.high[0])


def _shader_number(value: float) -> float:
    """`value` with a large number in place of infinity, which some drivers take for anything."""
    return min(max(value, -LARGEST), LARGEST)


def _channel_number(channel: int | None) -> int:
    """The number of a feed's channel in shaders/lib/channel_lib.glsl."""
    return COLOR if channel is None else channel
