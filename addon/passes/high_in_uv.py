# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws high meshes in UV space: normals, hits and points. Joins these hits with those of rays."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ..core import progress
from ..core.udim import UvToClip
from . import blender_gpu as gpu
from . import cast, cutouts, data_texture, mesh_upload, samples, shader, target
from .cast import Owners
from .samples import Active
from .shader import Program

NORMALS = Program(
    vertex="bake/flatten_vert.glsl",
    fragment="bake/flatten_frag.glsl",
    inputs=(("VEC2", "uv"), ("VEC3", "normal")),
    varyings=(("VEC3", "v_normal"),),
    constants=(("MAT4", "normal_matrix"), ("VEC4", "uv_to_clip")),
    outputs=(("VEC4", "normal_out"),),
)

TRIANGLE = 0.25
"""The cost of a triangle of a high mesh, in rays."""
TRIANGLES_AT_ONCE = 2**14
"""The triangles that software draws at a time. It sorts all of them into tiles before it fills texels: after a few it still
finds them in the processor's caches, and sorts the next ones meanwhile."""


def draw_normals(
    into: target.Target,
    meshes: Iterable[tuple[gpu.types.GPUBatch, np.ndarray]],
    uv_to_clip: UvToClip,
    *,
    clear: bool = True,
) -> None:
    """Clear `into` (RGBA32F) and draw each mesh: xyz its unit normal, alpha 1 where it was written.

    meshes: batches with attributes uv and normal, each with the (3, 3) matrix that takes its normals to the wanted
    space. uv_to_clip: as udim.uv_to_clip. Where meshes overlap, the later one stays. clear: False to draw over what is there.
    """
    with target.drawing(into, clear=clear):
        for batch, normal_matrix in meshes:
            matrix = shader.mat4(normal_matrix)
            target.draw_bound(NORMALS, batch, normal_matrix=matrix, uv_to_clip=uv_to_clip)


def draw_normals_in_steps(
    into: target.Target,
    mesh: tuple[gpu.types.GPUBatch, np.ndarray],
    count: int,
    uv_to_clip: UvToClip,
) -> None:
    """Draw a mesh of `count` triangles over what is in `into`, as `draw_normals` does, some triangles at a time."""
    batch, normal_matrix = mesh
    constants = {"normal_matrix": shader.mat4(normal_matrix), "uv_to_clip": uv_to_clip}
    for some in steps_of(count):
        target.draw(into, NORMALS, batch, clear=False, parts=[(some.start, len(some))], **constants)
        if shader.in_software():
            target.clear(target.get("step", 1, 1, "RGBA8"))  # another target makes the driver fill texels
        else:
            into.finish()


def steps_of(count: int) -> list[range]:
    """The triangles of a mesh that are drawn at a time."""
    if shader.in_software():
        return [range(first, min(first + TRIANGLES_AT_ONCE, count)) for first in range(0, count, TRIANGLES_AT_ONCE)]
    return progress.pieces(count, TRIANGLE)


HITS = Program(
    vertex="bake/flat_hits_vert.glsl",
    fragment="bake/flat_hits_frag.glsl",
    inputs=(("VEC2", "uv"),),
    varyings=(("VEC2", "v_weights"),),
    flat=(("INT", "v_triangle"),),
    constants=(("VEC4", "uv_to_clip"),),
    outputs=(("UVEC4", "hit_out"),),
)
HITS_CUT = cutouts.cutting(replace(HITS, samplers=(("FLOAT_2D", "triangles"),)))
"""Only where triangles are not clear."""
NO_HITS = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/no_hits_frag.glsl",
    inputs=(("VEC2", "position"),),
    outputs=(("UVEC4", "hit_out"),),
)

CLIP = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/clip_hits_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "normals"),),
    outputs=(("UVEC4", "hit_out"),),
)


def upload_for_hits(uv: np.ndarray, numbers: np.ndarray) -> gpu.types.GPUBatch:
    """Meshes for `draw`. uv (3 T, 2) float32: of the corners of the triangles in the order of their numbers. numbers (T,) int:
    from 0, in the order of drawing."""
    corners = (3 * numbers[:, None] + np.arange(3)).astype(np.int32)
    return mesh_upload.upload(corners, uv=uv)


def draw_hits(
    into: target.Target,
    meshes: gpu.types.GPUBatch,
    count: int,
    uv_to_clip: UvToClip,
    clear: cutouts.Cutouts | None = None,
    *,
    has_clear: bool = True,
) -> None:
    """Write the hits into `into` (RGBA32UI), as shaders/lib/hit_lib.glsl reads them, with a height of 0.

    meshes: of `count` triangles, from upload_for_hits. Where triangles overlap, the later one stays, but what is clear by
    `clear` lies below all else. has_clear: whether it is drawn at all.
    """
    target.fill(into, NO_HITS)  # clearing writes floats
    pieces = progress.pieces(count, TRIANGLE)
    steps = [(HITS, {})] if clear is None or has_clear else []
    steps += [(HITS_CUT, clear.bindings)] if clear is not None else []
    for (program, tables), piece in itertools.product(steps, pieces):
        parts = [(piece.start, len(piece))]
        target.draw(into, program, meshes, clear=False, parts=parts, uv_to_clip=uv_to_clip, **tables)
        if len(pieces) > 1:
            into.finish()


def clip_hits(hits: target.Target, normals: gpu.types.GPUTexture) -> None:
    """Remove hits (RGBA32UI) where `normals` (RGBA32F) has an alpha of 0: where the low mesh does not cover the sample."""
    # Drawn, as the hits of the next sample are: OpenGL may put stores of a compute shader behind later drawing.
    target.fill(hits, CLIP, normals=normals)


POINTS = Program(
    vertex="bake/points_vert.glsl",
    fragment="bake/points_frag.glsl",
    inputs=(("VEC2", "uv"), ("VEC3", "position"), ("VEC2", "labels")),
    varyings=(("VEC3", "v_position"),),
    flat=(("VEC2", "v_labels"),),
    constants=(("VEC4", "uv_to_clip"),),
    outputs=(("VEC4", "point_out"), ("VEC4", "labels_out")),
)


def draw_points(into: target.Target, meshes: Iterable[gpu.types.GPUBatch], uv_to_clip: UvToClip) -> None:
    """Clear `into` (two RGBA32F) and write points, and in x and y the numbers of object and material.

    meshes: batches with the attributes uv, position and labels. Where meshes overlap, the later one stays.
    """
    with target.drawing(into):
        for batch in meshes:
            target.draw_bound(POINTS, batch, uv_to_clip=uv_to_clip)


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
    constants=(*data_texture.tree_constants("low"), ("FLOAT", "near")),
    outputs=(("VEC4", "left_out"),),
    cost=1.5,
)
JOIN = Program(
    compute="bake/join_hits_comp.glsl",
    texels=((*_FLOATS, "positions"), (*_FLOATS, "left"), _FLAT_HITS),
    samplers=samples.ACTIVE_SAMPLERS,
    images=(("RGBA32UI", "UINT_2D", "hits", "READ WRITE"),),
    constants=(("INT", "first_row"), *samples.ACTIVE_CONSTANTS),
)


def draw_left(
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
    draw_hits writes them. flat_normals: at all of them, as cast.look_up writes them, in world space. tables: of the
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
        **owners.bindings,
        near=owners.room,
    )


def join_hits(
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
        **samples.active_bindings(some, rays.textures[0]),
    )
