# SPDX-License-Identifier: GPL-3.0-or-later
"""Turns the normals at the hits as the normal maps and bump maps of the high meshes' own materials say."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ...core.material_feeds import LUMINANCE, BumpFeed, ImageFeed, NormalMapFeed
from .. import shader, target
from ..program import Program
from . import served_blocks
from .image_look_up import PAGE, TEXELS, bindings, channel_number, shader_number, surface_bindings
from .image_page import Page
from .material_table import MaterialTable
from .served_blocks import Blocks

if TYPE_CHECKING:
    from ..bake import cast
    from .corner_tables import CornerValues

NORMAL_MAP = Program(
    compute="surface/normal_map_comp.glsl",
    texels=TEXELS,
    samplers=(*PAGE, ("FLOAT_2D", "tangent_triangles"), ("FLOAT_2D", "tangents")),
    images=(("RGBA32F", "FLOAT_2D", "normals", "READ WRITE"),),
    constants=(
        ("MAT4", "to_space"),
        ("VEC4", "row_u"),
        ("VEC4", "row_v"),
        ("FLOAT", "lowest"),
        ("FLOAT", "highest"),
        ("INT", "feed"),
        ("INT", "tile"),
        ("INT", "channel"),
        ("INT", "page_flags"),
        ("INT", "top_level"),
    ),
)
BUMP = Program(
    compute="surface/bump_comp.glsl",
    texels=TEXELS,
    samplers=PAGE,
    images=(("RGBA32F", "FLOAT_2D", "normals", "READ WRITE"),),
    constants=(
        ("MAT4", "to_space"),
        ("VEC4", "row_u"),
        ("VEC4", "row_v"),
        ("FLOAT", "rise"),
        ("FLOAT", "lowest"),
        ("FLOAT", "highest"),
        ("INT", "feed"),
        ("INT", "tile"),
        ("INT", "channel"),
        ("INT", "page_flags"),
        ("INT", "top_level"),
    ),
)
GREEN_DOWN = 8
"""As in shaders/surface/normal_map_comp.glsl."""


def apply_normal_map(
    normals: target.Target,
    hits: target.Target,
    page: Page,
    feed: NormalMapFeed,
    number: int,
    *,
    tables: cast.Tables,
    uvs: CornerValues,
    tangents: CornerValues,
    materials: MaterialTable,
    to_space: np.ndarray,
    tile: int | None = None,
    samples: int = 1,
    blocks: Blocks | None = None,
) -> None:
    """Turn `normals` (RGBA32F), as cast.look_up wrote them, in place where the hit's material has this feed's `number`.

    tangents: from corner_tables.upload_tangents, of the feed's layer. uvs: of the layer of its image. to_space: the matrix
    (3, 3) that cast.look_up got. Other arguments as in image_look_up.add_image.
    """
    bound = bindings(page, feed.image, tile, 1.0 / math.sqrt(samples), feed.strength)
    bound["page_flags"] |= feed.is_green_down * GREEN_DOWN
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3], matrix[3, :3] = to_space, feed.image.offset, feed.image.scale
    served_blocks.dispatch(
        NORMAL_MAP,
        (normals.width, normals.height),
        blocks,
        materials,
        number,
        normals=normals.texture,
        hits=hits.texture,
        tangent_triangles=tangents.triangles,
        tangents=tangents.values,
        to_space=shader.mat4(matrix),
        channel=channel_number(feed.image.channel),
        **surface_bindings(tables, uvs),
        **_limits(feed.image),
        **bound,
    )


def apply_bump(
    normals: target.Target,
    hits: target.Target,
    page: Page,
    feed: BumpFeed,
    number: int,
    *,
    tables: cast.Tables,
    uvs: CornerValues,
    materials: MaterialTable,
    to_space: np.ndarray,
    unit: float,
    tile: int | None = None,
    samples: int = 1,
    blocks: Blocks | None = None,
) -> None:
    """Turn `normals` in place by heights, after the normal map `below`.

    unit: how many scene units one unit of the points is: the size of their local space. Other arguments as in
    `apply_normal_map`.
    """
    channel = LUMINANCE if feed.image.channel is None else feed.image.channel
    served_blocks.dispatch(
        BUMP,
        (normals.width, normals.height),
        blocks,
        materials,
        number,
        normals=normals.texture,
        hits=hits.texture,
        to_space=shader.mat4(to_space),
        rise=feed.distance * feed.image.scale[0] / unit,
        **surface_bindings(tables, uvs),
        **_limits(feed.image),
        channel=channel_number(channel),
        **bindings(page, feed.image, tile, 1.0 / math.sqrt(samples), max(feed.strength, 0.0)),
    )


def _limits(image: ImageFeed) -> dict:
    """The limits that all channels have."""
    return {
        "lowest": shader_number(image.limits.low[0]),
        "highest": shader_number(image.limits.high[0]),
    }
