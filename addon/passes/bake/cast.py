# SPDX-License-Identifier: GPL-3.0-or-later
"""Casts a ray from each texel of the low mesh to the high ones, and looks up what was hit."""

from dataclasses import dataclass

import gpu
import numpy as np

from .. import data_texture, shader, target

TRACE = shader.Program(
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
        ("FLOAT", "heading"),
        ("FLOAT", "back"),
        ("FLOAT", "reach"),
        ("INT", "first_leaf"),
        ("INT", "facing_only"),
    ),
)
LOOKUP = shader.Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/lookup_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32UI", "UINT_2D", "hits"), ("RGBA32F", "FLOAT_2D", "positions"), ("RGBA32F", "FLOAT_2D", "normals")),
    constants=(("MAT4", "normal_matrix"),),
    outputs=(("VEC4", "normal_out"),),
)
DISTANCE = shader.Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/distance_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("UINT_2D", "hits"),),
    outputs=(("VEC4", "distance_out"),),
)
POINTS = shader.Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/hit_points_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("UINT_2D", "hits"), ("FLOAT_2D", "corners"), ("FLOAT_2D", "labels")),
    outputs=(("VEC4", "point_out"), ("VEC4", "labels_out")),
)


@dataclass(frozen=True)
class Tables:
    """High triangles and their tree on the GPU. Triangle i has three texels in `corners` and three in `normals`."""

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
    the tree's order. The normals need not be of length one.
    """
    room = data_texture.room(vertices.size)  # for one after the other: of large meshes, memory is what takes the time
    textures = [
        data_texture.upload(nodes.reshape(-1, 4)),
        data_texture.gathered(points, vertices.reshape(-1), room),
        data_texture.gathered(normals, corners.reshape(-1), room),
    ]
    size = sum(texture.width * texture.height * 16 for texture in textures)
    return Tables(*textures, first_leaf, origin, scale, size)


def trace(
    into: target.Target,
    rays: target.Target,
    tables: Tables,
    *,
    heading: float,
    back: float,
    reach: float,
    facing_only: bool,
    rows: range | None = None,
) -> None:
    """Write into `into` (RGBA32UI) for each texel the hit triangle's number + 1 or 0, and as float bits its barycentric
    coordinates and the distance.

    rays: what gbuffer.draw wrote, direction d. A ray starts at position - heading * back * d and runs along heading * d
    for `reach` at the most. facing_only: pass through triangles that turn their back on the ray.
    rows: in these rows alone, the first a multiple of 8.
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
        heading=heading,
        back=back,
        reach=reach,
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
    """Write into `into` (RGBA32F) the unit normal where `hits` has one: alpha 1 hit, -1 missed, 0 no low mesh here.

    normal_matrix: (3, 3), applied to the interpolated normal. rows: in these rows alone.
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
    """Write into `into` (RGBA32F) how far each ray went, -1 where it hit nothing."""
    target.fill(into, DISTANCE, hits=hits.texture)


def points(into: target.Target, hits: target.Target, tables: Tables, labels: gpu.types.GPUTexture) -> None:
    """Write into `into` (two RGBA32F) the points that were hit and their labels, alpha 1, or 0 where there are none.

    labels: a table with the numbers of object and material for each triangle, in the tree's order.
    """
    target.fill(into, POINTS, hits=hits.texture, corners=tables.corners, labels=labels)
