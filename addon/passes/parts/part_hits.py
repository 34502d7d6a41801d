# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays at high meshes in parts: one part after another is cast at, and the best of their hits stay."""

from __future__ import annotations

import numpy as np

from ...core.declarations.choices import Hit
from .. import shader, target
from ..adaptive import active
from ..adaptive.active import Active
from ..bake import cast
from ..program import Program

MERGE = Program(
    compute="parts/merge_hits_comp.glsl",
    texels=(
        ("RGBA32UI", "UINT_2D", "part_hits"),
        ("RGBA32F", "FLOAT_2D", "corners"),
        ("RGBA32F", "FLOAT_2D", "normals"),
    ),
    samplers=active.SAMPLERS,
    images=(("RGBA32UI", "UINT_2D", "hits", "READ WRITE"), ("RGBA32F", "FLOAT_2D", "found", "WRITE")),
    constants=(
        ("INT", "first_row"),
        ("INT", "first_triangle"),
        ("INT", "is_first"),
        ("INT", "is_nearest"),
        *active.CONSTANTS,
    ),
)
OF_PART = Program(
    compute="parts/hits_of_part_comp.glsl",
    texels=(("RGBA32UI", "UINT_2D", "hits"),),
    images=(("RGBA32UI", "UINT_2D", "of_part", "WRITE"),),
    constants=(("INT", "first_row"), ("INT", "first_triangle"), ("INT", "count")),
)
LOOKUP = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="parts/found_normals_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32UI", "UINT_2D", "hits"), ("RGBA32F", "FLOAT_2D", "positions"), ("RGBA32F", "FLOAT_2D", "found")),
    constants=(("MAT4", "normal_matrix"),),
    outputs=(("VEC4", "normal_out"),),
)


def merge(
    hits: target.Target,
    found: target.Target,
    part_hits: target.Target,
    tables: cast.Tables,
    *,
    first_triangle: int,
    is_first: bool,
    rule: Hit,
    rows: range,
    some: Active | None = None,
) -> None:
    """Put the hits of a part into `hits` (RGBA32UI) where they are better than those of other parts, by `rule`.

    part_hits: what cast.trace wrote for `tables`, whose first triangle has the number `first_triangle` of all parts together.
    found (RGBA32F): gets the interpolated normals of the best hits. is_first: replace what was in both. rows, some: as
    cast.trace has them. The result does not depend on the order of the parts.

    It is that of one tree, but for rays that ask for owners and meet more than cast_comp.glsl's most candidates, or two hits at
    one place in different parts of which only the inner one is owned: one tree takes these for a single hit.
    """
    target.dispatch(
        MERGE,
        hits.width,
        rows,
        part_hits=part_hits.texture,
        corners=tables.corners,
        normals=tables.normals,
        hits=hits.texture,
        found=found.texture,
        first_triangle=first_triangle,
        is_first=int(is_first),
        is_nearest=int(rule == Hit.NEAREST),
        **active.bindings(some, tables.nodes),
    )


def look_up(
    into: target.Target,
    hits: target.Target,
    rays: target.Target,
    found: target.Target,
    normal_matrix: np.ndarray,
    *,
    rows: range | None = None,
    some: Active | None = None,
) -> None:
    """As cast.look_up, with the normals that `merge` has found."""
    target.fill(
        into,
        LOOKUP,
        rows=rows,
        stopped=some and some.stopped,
        hits=hits.texture,
        positions=rays.textures[0],
        found=found.texture,
        normal_matrix=shader.mat4(normal_matrix),
    )


def of_part(into: target.Target, hits: target.Target, first_triangle: int, count: int) -> None:
    """Write the hits on a part into `into` (RGBA32UI), with numbers from 0. The part has `count` triangles."""
    target.dispatch(
        OF_PART,
        hits.width,
        range(hits.height),
        hits=hits.texture,
        of_part=into.texture,
        first_triangle=first_triangle,
        count=count,
    )
