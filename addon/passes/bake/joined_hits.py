# SPDX-License-Identifier: GPL-3.0-or-later
"""Hits by Flatten where they belong to their texels, and by rays for the rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .. import adaptive, target
from ..adaptive import Active
from ..program import Program
from .owners import Owners

if TYPE_CHECKING:
    from . import cast

_FLOATS = "RGBA32F", "FLOAT_2D"
_FLAT_HITS = ("RGBA32UI", "UINT_2D", "flat_hits")
LEFT = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/left_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(
        (*_FLOATS, "positions"),
        (*_FLOATS, "directions"),
        _FLAT_HITS,
        (*_FLOATS, "flat_normals"),
        (*_FLOATS, "triangles"),
        (*_FLOATS, "points"),
        (*_FLOATS, "low_nodes"),
        (*_FLOATS, "low_corners"),
    ),
    constants=(
        ("VEC4", "low_origin"),
        ("VEC4", "low_scale"),
        ("INT", "low_first_leaf"),
        ("FLOAT", "near"),
    ),
    outputs=(("VEC4", "left_out"),),
)
JOIN = Program(
    compute="bake/join_hits_comp.glsl",
    texels=((*_FLOATS, "positions"), (*_FLOATS, "left"), _FLAT_HITS),
    samplers=adaptive.ACTIVE_SAMPLERS,
    images=(("RGBA32UI", "UINT_2D", "hits", "READ WRITE"),),
    constants=(("INT", "first_row"), *adaptive.ACTIVE_CONSTANTS),
)


def left(
    into: target.Target,
    rays: target.Target,
    flat_hits: target.Target,
    flat_normals: target.Target,
    *,
    tables: cast.Tables,
    owners: Owners,
    rows: range | None = None,
    some: Active | None = None,
) -> None:
    """Write the points of `rays` that cast.trace has to take into `into` (RGBA32F), with alpha 0 for the other ones.

    These are the texels whose hit by Flatten is at their own place: it faces their ray, belongs to them by the rule of owners,
    and what the ray would hit is on a texel close by, with about the same normals on all texels between. flat_hits: as
    flat_hits.draw writes them. flat_normals: at all of them, as cast.look_up writes them, in world space. tables: of the
    high triangles. rows, some: as in cast.look_up.
    """
    target.fill(
        into,
        LEFT,
        rows=rows,
        stopped=some and some.stopped,
        positions=rays.textures[0],
        directions=rays.textures[1],
        flat_hits=flat_hits.texture,
        flat_normals=flat_normals.texture,
        triangles=tables.triangles,
        points=tables.points,
        low_nodes=owners.nodes,
        low_corners=owners.corners,
        low_origin=(*owners.origin, 0.0),
        low_scale=(*owners.scale, 0.0),
        low_first_leaf=owners.first_leaf,
        near=owners.room,
    )


def join(
    hits: target.Target,
    rays: target.Target,
    left_points: target.Target,
    flat_hits: target.Target,
    *,
    rows: range | None = None,
    some: Active | None = None,
) -> None:
    """Add the hits of Flatten to `hits` (RGBA32UI), where cast.trace has written those of the rays that were left. Where such a
    ray missed, that of Flatten counts as well. rows, some: as cast.trace has them."""
    target.dispatch(
        JOIN,
        hits.width,
        rows or range(some.rows if some else hits.height),
        positions=rays.textures[0],
        left=left_points.texture,
        flat_hits=flat_hits.texture,
        hits=hits.texture,
        **adaptive.active_bindings(some, rays.textures[0]),
    )
