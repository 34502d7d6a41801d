# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the low mesh in UV space: points, normals in its tangent space, normals of a stored map; and maps of points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.map_types import MapType
from ..core.udim import UvToClip
from . import blender_gpu as gpu
from . import shader, target
from .shader import Program

POINTS = Program(
    vertex="bake/gbuffer_vert.glsl",
    fragment="bake/gbuffer_frag.glsl",
    inputs=(("VEC2", "uv"), ("VEC3", "position"), ("VEC3", "direction")),
    varyings=(("VEC3", "v_position"), ("VEC3", "v_direction")),
    constants=(("VEC4", "uv_to_clip"),),
    outputs=(("VEC4", "position_out"), ("VEC4", "direction_out")),
)


def draw_points(into: target.Target, low: gpu.types.GPUBatch, uv_to_clip: UvToClip) -> None:
    """Clear `into` (two RGBA32F) and write positions and unit directions, with alpha 1, on the texels that `low` covers.

    low: batch with attributes uv, position and direction. Directions point away from the surface, with any length.
    """
    target.draw(into, POINTS, low, uv_to_clip=uv_to_clip)


TANGENT_VARYINGS = (("VEC3", "v_normal"), ("VEC4", "v_tangent"), ("VEC3", "v_bitangent"))
"""Of tangent_vert.glsl."""
TANGENT = Program(
    vertex="bake/tangent_vert.glsl",
    fragment="bake/tangent_frag.glsl",
    inputs=(("VEC2", "uv"), ("VEC3", "normal"), ("VEC4", "tangent")),
    varyings=TANGENT_VARYINGS,
    texels=(("RGBA32F", "FLOAT_2D", "normals"),),
    constants=(("VEC4", "uv_to_clip"), ("INT", "basis_flags")),
    outputs=(("VEC4", "normal_out"),),
)
TANGENT_VECTOR = replace(TANGENT, fragment="bake/tangent_vector_frag.glsl")
_OF_STRETCH = {"library": "lib/stretch_lib.glsl", "constants": (("MAT4", "to_basis"), *TANGENT.constants)}
STRETCHED, STRETCHED_VECTOR = (replace(each, **_OF_STRETCH) for each in (TANGENT, TANGENT_VECTOR))
"""For meshes with other scales along their axes: the others do without a product of matrices for each texel."""
TURNED = Program(
    vertex="lib/nearer_vert.glsl",
    fragment="bake/turned_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "normals"), ("RGBA32F", "FLOAT_2D", "turned")),
    outputs=(("FLOAT", "stopped_out"),),
)


def draw_in_tangent_space(
    into: target.Target,
    low: gpu.types.GPUBatch,
    normals: gpu.types.GPUTexture,
    uv_to_clip: UvToClip,
    *,
    basis_flags: int,
    stretch: np.ndarray | None = None,
    clear: bool = True,
    stopped: gpu.types.GPUTexture | None = None,
    program: Program = TANGENT,
) -> None:
    """Clear `into` (RGBA32F) and write tangent-space unit normals, alpha 1, on texels that `low` and `normals` cover.

    low: batch with attributes uv, normal and tangent (w = the bitangent's sign). normals: object-space unit normals of
    the same size. basis_flags: core.declarations.bases.Basis.flags. stretch: as Mesh.stretch has it, of `low`.
    clear: False to keep other texels of `into`. stopped: as in target.drawing. program: TANGENT_VECTOR for vectors of any
    length, as tangent, normal and bitangent.
    """
    bindings = {"normals": normals, "uv_to_clip": uv_to_clip, "basis_flags": basis_flags}
    if stretch is not None:
        program = STRETCHED if program is TANGENT else STRETCHED_VECTOR
        bindings["to_basis"] = shader.mat4(np.linalg.inv(stretch).T)
    target.draw(into, program, low, clear=clear, stopped=stopped, **bindings)


def not_turned(normals: gpu.types.GPUTexture, turned: target.Target) -> tuple[gpu.types.GPUTexture, np.ndarray]:
    """The texels of `normals` that `turned` lacks: a depth texture that limits `draw` to them, valid until the next call, and
    their rows and columns (N, 2) int, in the part of the map that is drawn."""
    depth = target.get("turned texels", turned.width, turned.height, "R8", "DEPTH_COMPONENT32F")
    target.fill(depth, TURNED, clear=True, writes_depth=True, normals=normals, turned=turned.texture)
    columns, rows = target.drawn_part(turned.width, turned.height)
    stopped = np.empty((len(rows), len(columns), 1), np.uint8)
    depth.read(stopped, start=(columns.start, rows.start))
    return depth.textures[1], np.argwhere(stopped[..., 0] == 0) + (rows.start, columns.start)


MAP_NORMALS = Program(
    vertex="bake/tangent_vert.glsl",
    fragment="bake/map_normals_frag.glsl",
    inputs=(("VEC2", "uv"), ("VEC3", "normal"), ("VEC4", "tangent")),
    varyings=TANGENT_VARYINGS,
    samplers=(("FLOAT_2D", "normal_map"),),
    constants=(("VEC4", "uv_to_clip"), ("MAT4", "shading")),
    outputs=(("VEC4", "normal_out"), ("VEC4", "fit_out")),
)

NO_DIRECTION, MISSED = 2.0, 3.0
"""Instead of a length, as in map_normals_frag.glsl."""


def draw_map_normals(
    into: target.Target,
    low: gpu.types.GPUBatch,
    normal_map: gpu.types.GPUTexture,
    uv_to_clip: UvToClip,
    shading: np.ndarray,
) -> None:
    """Clear `into` (RGBA32F, R16F) and decode a map on the texels that `low` covers.

    The first texture gets unit normals: alpha 1, or -1 where the map's alpha is 0, or 0 where the color is no direction. The
    second gets the length of the stored vector, below 0 if it points away from the surface, or MISSED or NO_DIRECTION.
    low: batch with attributes uv, normal and tangent. normal_map: of the same size, as it is stored. shading: (4, 4) float64
    as lit.shading packs it; its light's first number is above 0 if the matrix applies to the low mesh's normals, too.
    """
    matrix = shader.mat4(shading)
    target.draw(into, MAP_NORMALS, low, normal_map=normal_map, uv_to_clip=uv_to_clip, shading=matrix)


POINT_MAP = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/height_position_ids_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(
        ("FLOAT_2D", "normals"),
        ("FLOAT_2D", "points"),
        ("FLOAT_2D", "labels"),
        ("FLOAT_2D", "low_points"),
        ("FLOAT_2D", "directions"),
    ),
    constants=(("INT", "map_index"), ("MAT4", "to_space"), ("VEC4", "origin"), ("FLOAT", "scale")),
    outputs=(("VEC4", "value_out"),),
)


def draw_point_map(
    into: target.Target,
    map_type: MapType,
    normals: gpu.types.GPUTexture,
    points: target.Target,
    low_points: target.Target,
    *,
    to_space: np.ndarray,
    origin: np.ndarray,
    scale: float,
) -> None:
    """Write the map into `into` (RGBA32F): xyz is the value, alpha is as in `normals`: 1 known, 0 empty, -1 missed.

    points: what high_in_uv.draw_points or cast.points wrote. low_points: what `draw_points` wrote. Vectors and positions are
    transformed with to_space (3, 3) and origin (3,); distances are multiplied by `scale`.
    """
    target.fill(
        into,
        POINT_MAP,
        normals=normals,
        points=points.textures[0],
        labels=points.textures[1],
        low_points=low_points.textures[0],
        directions=low_points.textures[1],
        map_index=map_type.index,
        to_space=shader.mat4(to_space),
        origin=(*origin, 0.0),
        scale=scale,
    )
