# SPDX-License-Identifier: GPL-3.0-or-later
"""Fills the margin around UV islands: finds the nearest written texels, repeats them, and continues the map across seams.

The nearest texels are exact: rows are searched first, then the results along columns, as in A. Meijster, J. Roerdink and W.
Hesselink, "A general algorithm for computing distance transforms in linear time" (2000). Theirs takes a column in one go,
but a GPU has room for many more invocations than a map has columns. So columns are searched by halving: a few rows first,
then those halfway between two, whose nearest lie between the nearest of both. Each pass searches all gaps between rows at
once.

Across a seam, the margin of a texel starts at its nearest written texel. Just before that one, on the way there, is a texel
beside the border of the island. The similarity transform of this border moves the whole way to the island across, and the map
is read at its end. Without a seam on the way, or if the way leaves the island across, the margin repeats the nearest texel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.udim import UvToClip
from . import blender_gpu as gpu
from . import data_texture, mesh_upload, shader, target
from .shader import Program

WORD = 32
"""The texels whose bits are together, as in shaders/lib/margin_lib.glsl."""
WRITTEN = Program(
    compute="margin/margin_written_comp.glsl",
    texels=(("RGBA32F", "FLOAT_2D", "values"),),
    images=(("R32I", "INT_2D", "written", "WRITE"),),
)
SEARCH_ROWS = Program(
    compute="margin/margin_rows_comp.glsl",
    texels=(("R32I", "INT_2D", "written"),),
    constants=(("INT", "farthest"),),
    images=(("R16I", "INT_2D", "offsets", "WRITE"),),
)
SEARCH_COLUMNS = Program(
    compute="margin/margin_columns_comp.glsl",
    texels=(("R16I", "INT_2D", "offsets"),),
    constants=tuple(("INT", name) for name in ("reach", "farthest", "step", "is_first", "part")),
    images=(("R32I", "INT_2D", "source_rows", "READ WRITE"),),
    group=(64, 1),
)


@dataclass(frozen=True)
class Nearest:
    """The nearest written texel of each texel: `rows` (R32I) holds its row, and `offsets` (R16I), in that row, the number of
    columns to it. 32767 and numbers below 0 mean none in reach."""

    offsets: gpu.types.GPUTexture
    rows: gpu.types.GPUTexture


MOST_TURNS = 2**15
"""The most turns of the loops of a dispatch: see shaders/lib/turns_lib.glsl."""
PARTS = 1, 2, 3
"""The searches of a gap, as in shaders/margin/margin_columns_comp.glsl. Each takes the rows of the map and those in reach."""


def find_nearest(values: gpu.types.GPUTexture, reach: int | None) -> Nearest:
    """Find the nearest texel of `values` (RGBA32F) whose alpha is above 0, for each texel with one in reach.

    reach: in texels, along rows and along columns, so that a margin of 2^n - 1 fills every block of 2^n x 2^n texels that
    contains a written one; None for no limit.
    """
    width, height = values.width, values.height
    most = max(width, height)
    limit = most if reach is None else min(reach, most)
    farthest = min(farthest_texel(limit), most)
    words = -(-width // WORD)
    written = target.get("margin's bits", words, height, "R32I").texture
    offsets = target.get("margin's offsets", width, height, "R16I").texture
    rows = target.get("margin's rows", width, height, "R32I").texture
    _dispatch(WRITTEN, words, height, values=values, written=written)
    _dispatch(SEARCH_ROWS, words, height, written=written, farthest=farthest, offsets=offsets)
    is_long = 2 * height + 3 * min(2 * limit + 1, height) > MOST_TURNS
    for number, step in enumerate(_steps(height, farthest)):
        for part in PARTS if number and is_long else (0,):
            _dispatch(
                SEARCH_COLUMNS,
                width,
                -(-height // (4 * step if number else step)),
                offsets=offsets,
                source_rows=rows,
                reach=limit,
                farthest=farthest,
                step=step,
                is_first=int(number == 0),
                part=part,
            )
    return Nearest(offsets, rows)


def farthest_texel(reach: int) -> int:
    """The largest distance, in whole texels, of the nearest written texel along a row or column: the radius of the circle
    through the corners of the square of `reach`."""
    return math.isqrt(2 * reach * reach)


def _steps(height: int, farthest: int) -> list[int]:
    """How far the rows are from each other that a pass along columns adds to those before, pass by pass down to 1."""
    steps = [1]
    while 2 * steps[0] < min(farthest, height - 1):
        steps.insert(0, 4 * steps[0])
    return steps


def _dispatch(program: Program, width: int, height: int, **bindings) -> None:
    groups = -(-width // program.group[0]), -(-height // program.group[1])
    target.dispatch_groups(program, groups, **bindings)


FILL = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="margin/margin_fill_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "values"), ("R16I", "INT_2D", "offsets"), ("R32I", "INT_2D", "source_rows")),
    constants=(("INT", "halo"), ("INT", "fills_misses"), ("MAT4", "encode"), ("VEC4", "missed")),
    outputs=(("VEC4", "map_out"), ("FLOAT", "state_out")),
)


def fill_from_nearest(
    into: target.Target,
    values: gpu.types.GPUTexture,
    nearest: Nearest,
    *,
    halo: int,
    encode: np.ndarray,
    missed: tuple[float, float, float],
    fills_misses: bool = False,
) -> None:
    """Write the map (RGBA32F) and the state of its texels (R8) into `into`, whose row 0 is row `halo` of `values`.

    values: alpha above 0 where a texel was written, below 0 where its ray missed. nearest: what `find_nearest`
    returned for `values`. encode: (4, 4), from a value and 1 to red, green and blue. missed: the color of misses.
    fills_misses: whether misses with a written texel in reach have its color.
    """
    target.fill(
        into,
        FILL,
        values=values,
        offsets=nearest.offsets,
        source_rows=nearest.rows,
        halo=halo,
        fills_misses=int(fills_misses),
        encode=shader.mat4(encode),
        missed=(*missed, 0.0),
    )


SEAM_BORDERS = Program(
    vertex="margin/seam_borders_vert.glsl",
    fragment="margin/seam_borders_frag.glsl",
    inputs=(("VEC4", "corner"),),
    flat=(("FLOAT", "v_number"),),
    constants=(("VEC4", "uv_to_clip"),),
    outputs=(("FLOAT", "number_out"),),
)
ACROSS_SEAMS = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="margin/seam_across_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("FLOAT_2D", "values"), ("FLOAT_2D", "borders"), ("FLOAT_2D", "similarities")),
    texels=(("R16I", "INT_2D", "offsets"), ("R32I", "INT_2D", "source_rows")),
    constants=(
        *(("INT", name) for name in ("halo", "reach", "kind", "first_row", "is_deferred")),
        ("MAT4", "encode"),
    ),
    outputs=(("VEC4", "map_out"), ("FLOAT", "state_out")),
    cost=1.0,
)
ACROSS_SEAMS_LISTED = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="margin/seam_listed_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("FLOAT_2D", "values"), ("FLOAT_2D", "similarities")),
    texels=(("RGBA32F", "FLOAT_2D", "places"), ("RGBA32F", "FLOAT_2D", "borders")),
    constants=(("INT", "kind"), ("INT", "first_row"), ("MAT4", "encode")),
    outputs=(("VEC4", "map_out"),),
    cost=1.0,
)
VALUE, LABEL, NORMAL, TANGENT, TANGENT_VECTOR = range(5)
"""Kinds of values: numbers, numbers that must not be averaged, unit normals, those in tangent space, and vectors along tangent,
normal and bitangent."""
FARTHEST_ACROSS = 256
"""The longest way, in texels, on the other side of a seam, as in shaders/lib/seam_lib.glsl."""


@dataclass(frozen=True)
class Seams:
    """The borders of the UV islands of one map on the GPU: mesh.uv_seams.Seams, uploaded.

    Attributes:
        strips: Strips of triangles along the borders.
        similarities: The transform of each border to the island across it.
    """

    strips: gpu.types.GPUBatch
    similarities: gpu.types.GPUTexture


def upload_seams(triangles: np.ndarray, corners: np.ndarray, similarities: np.ndarray) -> Seams:
    """Upload the results of mesh.uv_seams.Seams.strips and similarities."""
    return Seams(mesh_upload.upload(triangles, corner=corners), data_texture.upload(similarities))


def fill_across_seams(
    into: target.Target,
    values: gpu.types.GPUTexture,
    nearest: Nearest,
    seams: Seams,
    uv_to_clip: UvToClip,
    *,
    halo: int,
    reach: int,
    kind: int,
    encode: np.ndarray,
    first_row: int = 0,
    is_deferred: bool = False,
) -> None:
    """Draw over the result of `fill_from_nearest` where a seam lies on the way to the nearest written texel.

    Args:
        uv_to_clip: to the clip space of `values`.
        reach: how far, in texels, the way to the nearest may be.
        kind: VALUE, LABEL, NORMAL, TANGENT or TANGENT_VECTOR; the last two are turned with the similarity, which is exact on a
            flat surface whose islands are similar to it.
        first_row: the row of the map that is row 0 of `values`.
        is_deferred: store what `colors_across_seams` takes instead of the value, with the state DEFERRED, because `values` are
            only a part of the map: the border's number from 0, the way (x, y) to the nearest written texel, and the row
            of the map on which the walk across the seam starts.
    """
    borders = target.get("borders", values.width, values.height, "R32F", "DEPTH_COMPONENT32F")
    target.draw(borders, SEAM_BORDERS, seams.strips, writes_depth=True, uv_to_clip=uv_to_clip)
    target.fill(
        into,
        ACROSS_SEAMS,
        values=values,
        offsets=nearest.offsets,
        source_rows=nearest.rows,
        borders=borders.texture,
        similarities=seams.similarities,
        halo=halo,
        reach=reach,
        kind=kind,
        first_row=first_row,
        is_deferred=int(is_deferred),
        encode=shader.mat4(encode),
    )


def colors_across_seams(
    values: gpu.types.GPUTexture,
    seams: Seams,
    places: np.ndarray,
    borders: np.ndarray,
    *,
    first_row: int,
    kind: int,
    encode: np.ndarray,
) -> np.ndarray:
    """The colors (N, 4) float32 across the seam of some texels of a map. Alpha is 0 where the nearest texel is to stay.

    Args:
        values: as `draw` takes them, of all rows that are at most FARTHEST + 2 from where the walks across the seam start.
        places: (N, 4) float32, column, row, and the way (x, y) to the nearest written texel.
        borders: (N, 1), the numbers of their borders, from 0.
    """
    listed = data_texture.upload(places)
    into = target.Target(listed.width, listed.height, ("RGBA32F",))
    target.fill(
        into,
        ACROSS_SEAMS_LISTED,
        values=values,
        similarities=seams.similarities,
        places=listed,
        borders=data_texture.upload(borders),
        kind=kind,
        first_row=first_row,
        encode=shader.mat4(encode),
    )
    return into.texels().reshape(-1, 4)[: len(places)]
