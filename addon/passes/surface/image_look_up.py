# SPDX-License-Identifier: GPL-3.0-or-later
"""Adds what images show at the hits to the sums of a map."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ...core.material_feeds import AttributeFeed, Extension, ImageFeed
from .. import target
from ..program import Program
from . import served_blocks
from .image_page import Page
from .material_table import MaterialTable
from .served_blocks import Blocks

if TYPE_CHECKING:
    from ..bake import cast
    from .corner_tables import CornerValues

TEXELS = (
    ("RGBA32UI", "UINT_2D", "hits"),
    ("RGBA32F", "FLOAT_2D", "uv_triangles"),
    ("RGBA32F", "FLOAT_2D", "uvs"),
    ("RGBA32F", "FLOAT_2D", "triangles"),
    ("RGBA32F", "FLOAT_2D", "points"),
    ("RGBA32F", "FLOAT_2D", "levels"),
)
"""What all programs that look up images read, beside `PAGE`."""
PAGE = ("FLOAT_2D", "page"), ("FLOAT_2D", "materials"), ("FLOAT_2D", "blocks")
LEVELS = (("VEC4", "scale"), ("VEC4", "offset"), ("VEC4", "low"), ("VEC4", "high"), ("INT", "channel"))
"""What shaders/lib/fed_value_lib.glsl takes, from `levels`."""
ADD_IMAGE = Program(
    compute="surface/add_image_comp.glsl",
    texels=TEXELS,
    samplers=PAGE,
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(
        ("VEC4", "row_u"),
        ("VEC4", "row_v"),
        *LEVELS,
        ("INT", "feed"),
        ("INT", "tile"),
        ("INT", "page_flags"),
        ("INT", "top_level"),
    ),
)
COLOR = 4
"""The channel of a whole color in shaders/lib/channel_lib.glsl."""
LARGEST = 3e38
"""About the largest number of single precision."""
CLOSEST, EXTENSION_SHIFT = 4, 4
"""As in shaders/lib/page_lib.glsl."""
_EXTENSIONS = (Extension.REPEAT, Extension.EXTEND, Extension.CLIP, Extension.MIRROR)


def add_image(
    sums: target.Target,
    hits: target.Target,
    page: Page,
    feed: ImageFeed,
    number: int,
    *,
    tables: cast.Tables,
    uvs: CornerValues,
    materials: MaterialTable,
    tile: int | None = None,
    samples: int = 1,
    blocks: Blocks | None = None,
) -> None:
    """Add what `page` shows to `sums` (RGBA32F), and 1 to its alpha, where the hit's material has this feed's `number`.

    hits: RGBA32UI, as shaders/lib/hit_lib.glsl reads it. tables: of the high triangles. uvs: from corner_tables.upload_uvs, of
    the feed's layer. materials: from material_table.upload. tile: the UDIM tile that the page is; only hits in it count. Pixels
    are averaged over the footprint of a texel, from the hits beside it, divided by the square root of `samples`.
    blocks: from served_blocks.find, for the same hits: without, the pass runs on the whole map.
    """
    served_blocks.dispatch(
        ADD_IMAGE,
        (sums.width, sums.height),
        blocks,
        materials,
        number,
        sums=sums.texture,
        hits=hits.texture,
        **surface_bindings(tables, uvs),
        **levels(feed),
        **bindings(page, feed, tile, 1.0 / math.sqrt(samples)),
    )


def surface_bindings(tables: cast.Tables, uvs: CornerValues) -> dict:
    """The high triangles and their UVs, as all programs that look up pages take them."""
    return {
        "triangles": tables.triangles,
        "points": tables.points,
        "uv_triangles": uvs.triangles,
        "uvs": uvs.values,
    }


def bindings(page: Page, feed: ImageFeed, tile: int | None, width: float, other: float = 0.0) -> dict:
    """What all programs that look up pages take. width: of a sample, in texels. other: a number that a program wants."""
    # The tiles of an image have nothing outside.
    extension = feed.extension if tile is None else Extension.EXTEND
    flags = page.flags | (not feed.is_smooth) * CLOSEST | _EXTENSIONS.index(extension) << EXTENSION_SHIFT
    return {
        "page": page.pixels,
        "levels": page.levels,
        "row_u": (*feed.mapping[0], width),
        "row_v": (*feed.mapping[1], other),
        "tile": tile or 0,
        "page_flags": flags,
        "top_level": page.top,
    }


def levels(feed: ImageFeed | AttributeFeed) -> dict:
    """The constants LEVELS of a feed."""
    limits = feed.limits
    return {
        "scale": (*feed.scale, 0.0),
        "offset": (*feed.offset, 0.0),
        "low": (*map(shader_number, limits.low), shader_number(limits.least)),
        "high": (*map(shader_number, limits.high), shader_number(limits.most)),
        "channel": channel_number(feed.channel),
    }


def shader_number(value: float) -> float:
    """`value` with a large number in place of infinity, which some drivers take for anything."""
    return min(max(value, -LARGEST), LARGEST)


def channel_number(channel: int | None) -> int:
    """The number of a feed's channel in shaders/lib/channel_lib.glsl."""
    return COLOR if channel is None else channel
