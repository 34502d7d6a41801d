# SPDX-License-Identifier: GPL-3.0-or-later
"""Casts a ray from each texel of the low mesh to the high meshes, and reads the surface at the hit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .. import data_texture, shader, target
from ..program import Program

if TYPE_CHECKING:
    import gpu

TRACE = Program(
    compute="bake/cast_comp.glsl",
    texels=(
        ("RGBA32F", "FLOAT_2D", "positions"),
        ("RGBA32F", "FLOAT_2D", "directions"),
        ("RGBA32F", "FLOAT_2D", "nodes"),
        ("RGBA32F", "FLOAT_2D", "corners"),
    ),
    images=(("RGBA32UI", "UINT_2D", "hits", "WRITE"),),
    constants=(
        ("VEC4", "grid_origin"),
        ("VEC4", "grid_scale"),
        ("INT", "first_row"),
        ("FLOAT", "direction_sign"),
        ("FLOAT", "start_offset"),
        ("FLOAT", "max_t"),
        ("INT", "first_leaf"),
        ("INT", "facing_only"),
    ),
)
LOOKUP = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/cast_lookup_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32UI", "UINT_2D", "hits"), ("RGBA32F", "FLOAT_2D", "positions"), ("RGBA32F", "FLOAT_2D", "normals")),
    constants=(("MAT4", "normal_matrix"),),
    outputs=(("VEC4", "normal_out"),),
)
DISTANCE = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/cast_distance_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("UINT_2D", "hits"),),
    outputs=(("VEC4", "distance_out"),),
)
POINTS = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/cast_points_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("UINT_2D", "hits"), ("FLOAT_2D", "corners"), ("FLOAT_2D", "labels")),
    outputs=(("VEC4", "point_out"), ("VEC4", "labels_out")),
)


@dataclass(frozen=True)
class Tables:
    """The triangles of the high meshes and their tree on the GPU. Triangle i has three texels in `corners` and `normals`."""

    nodes: gpu.types.GPUTexture
    corners: gpu.types.GPUTexture
    normals: gpu.types.GPUTexture
    first_leaf: int
    origin: np.ndarray
    scale: np.ndarray
    bytes: int


def upload(
    nodes: np.ndarray,
    points: np.ndarray,
    vertices: np.ndarray,
    normals: np.ndarray,
    corners: np.ndarray,
    *,
    first_leaf: int,
    origin: np.ndarray,
    scale: np.ndarray,
) -> Tables:
    """Upload a tree (bvh.Tree: nodes (N, 3, 4), first_leaf, origin, scale) and its triangles.

    vertices (T, 3), indices into points (P, 3) float32, and corners (T, 3), indices into normals (C, 3) float32, are in
    the tree's order. Normals can have any length.
    """
    gathered = data_texture.empty(
        vertices.size
    )  # both uploads use it: allocating memory takes the time of large meshes
    textures = [
        data_texture.upload(nodes.reshape(-1, 4)),
        data_texture.upload_gathered(points, vertices.reshape(-1), gathered),
        data_texture.upload_gathered(normals, corners.reshape(-1), gathered),
    ]
    size = sum(texture.width * texture.height * 16 for texture in textures)
    return Tables(*textures, first_leaf, origin, scale, size)


def trace(
    into: target.Target,
    rays: target.Target,
    tables: Tables,
    *,
    direction_sign: float,
    start_offset: float,
    max_t: float,
    facing_only: bool,
    rows: range | None = None,
) -> None:
    """Trace one ray per texel and write its hit into `into` (RGBA32UI).

    A hit is the triangle's index + 1, or 0 for a miss, then the bits of three floats: two barycentric coordinates and the
    distance. rays: what gbuffer.draw wrote, positions and unit directions d. A ray starts at
    position - direction_sign * start_offset * d and runs along direction_sign * d, at most as far as `max_t`.
    facing_only: ignore triangles whose back faces the ray. rows: the rows to trace; the first is a multiple of 8.
    """
    target.dispatch(
        TRACE,
        rays.width,
        rows or range(rays.height),
        positions=rays.textures[0],
        directions=rays.textures[1],
        nodes=tables.nodes,
        corners=tables.corners,
        hits=into.texture,
        grid_origin=(*tables.origin, 0.0),
        grid_scale=(*tables.scale, 0.0),
        direction_sign=direction_sign,
        start_offset=start_offset,
        max_t=max_t,
        first_leaf=tables.first_leaf,
        facing_only=int(facing_only),
    )


def look_up(
    into: target.Target,
    hits: target.Target,
    rays: target.Target,
    tables: Tables,
    normal_matrix: np.ndarray,
    *,
    rows: range | None = None,
) -> None:
    """Write the unit normals at the hits into `into` (RGBA32F). Alpha is 1 for a hit, -1 for a miss, 0 without a low mesh.

    normal_matrix: (3, 3), applied to the interpolated normal. rows: the rows to write.
    """
    target.fill(
        into,
        LOOKUP,
        rows=rows,
        hits=hits.texture,
        positions=rays.textures[0],
        normals=tables.normals,
        normal_matrix=shader.mat4(normal_matrix),
    )


def distances(into: target.Target, hits: target.Target) -> None:
    """Write the distance that each ray traveled into `into` (RGBA32F), -1 for a miss."""
    target.fill(into, DISTANCE, hits=hits.texture)


def points(into: target.Target, hits: target.Target, tables: Tables, labels: gpu.types.GPUTexture) -> None:
    """Write the hit points and their labels into `into` (two RGBA32F). Alpha is 1 for a hit, 0 for a miss.

    labels: a data texture with the object and material number of each triangle, in the tree's order.
    """
    target.fill(into, POINTS, hits=hits.texture, corners=tables.corners, labels=labels)
