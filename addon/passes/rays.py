# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the rays of a bake: where each texel lies on the low mesh, which way its ray goes, and where it starts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.udim import UvToClip
from . import blender_gpu as gpu
from . import data_texture, mesh_upload, target
from .shader import Program

RAYS = Program(
    vertex="bake/rays_vert.glsl",
    fragment="bake/rays_frag.glsl",
    inputs=(
        ("VEC2", "uv"),
        ("VEC3", "position"),
        ("VEC3", "smooth_normal"),
        ("VEC3", "straight_normal"),
        ("FLOAT", "number"),
        ("VEC2", "paint"),
    ),
    varyings=(
        ("VEC3", "v_position"),
        ("VEC3", "v_smooth_normal"),
        ("VEC3", "v_straight_normal"),
        ("VEC2", "v_paint"),
    ),
    flat=(("FLOAT", "v_number"),),
    texels=(("RGBA32F", "FLOAT_2D", "edge_nodes"), ("RGBA32F", "FLOAT_2D", "edge_ends")),
    constants=(
        ("VEC4", "uv_to_clip"),
        *data_texture.tree_constants("edge"),
        ("FLOAT", "blend_width"),
        ("FLOAT", "straight_share"),
        ("FLOAT", "start_offset"),
        ("INT", "start_on_cage"),
    ),
    outputs=(("VEC4", "position_out"), ("VEC4", "direction_out")),
    cost=0.3,
)
MOST_TRIANGLES = 2**24 - 1
"""The most triangles of a low mesh whose numbers rays can carry: floats hold larger ones not exactly."""


@dataclass(frozen=True)
class Edges:
    """The hard edges of a low mesh and a tree over them (bvh.Tree) on the GPU. Edge i has two texels in `ends`."""

    tree: data_texture.Tree
    ends: gpu.types.GPUTexture


@dataclass(frozen=True)
class Directions:
    """How the directions of rays blend between smooth and straight normals of the low mesh.

    Attributes:
        edges: Of the low mesh.
        straight_share: The share of the straight normals, from 0 to 1, where blend_width is 0.
        blend_width: In the units of the positions. The share of the straight normals rises from 0 on a hard edge to 1 at this
            distance from it.
    """

    edges: Edges
    straight_share: float = 0.0
    blend_width: float = 0.0


def upload_edges(tree: data_texture.BuiltTree, ends: np.ndarray) -> Edges:
    """Upload a tree over edges (bvh.Tree) and their ends (E, 2, 3) float32, in the tree's order."""
    return Edges(data_texture.upload_tree(tree), data_texture.upload(ends.reshape(-1, 3)))


def no_edges() -> Edges:
    """The edges of a low mesh that has no hard ones; a shader needs textures."""
    nothing = data_texture.upload(np.zeros((1, 4), np.float32))
    return Edges(data_texture.Tree(nothing, 0, np.zeros(3), np.ones(3)), nothing)


def upload(triangles: np.ndarray, numbers: np.ndarray, **arrays: Any) -> gpu.types.GPUBatch:
    """A low mesh for `draw`, from the same as `vertices`."""
    corners = np.arange(triangles.size, dtype=np.int32).reshape(-1, 3)
    return mesh_upload.upload(corners, **vertices(triangles, numbers, **arrays))


def vertices(
    triangles: np.ndarray,
    numbers: np.ndarray,
    *,
    uv: np.ndarray,
    position: np.ndarray,
    smooth_normal: np.ndarray,
    straight_normal: np.ndarray,
    paint: np.ndarray | None,
) -> dict[str, np.ndarray]:
    """The inputs of PROGRAM (3 T, 2 or 3) float32 from triangles (T, 3) int32, indices into the other arrays, which have a row
    per corner.

    numbers (T,): of the triangles, from 1 to MOST_TRIANGLES. Normals have any length. paint (C, 2) float32: a factor on the
    distance at which rays start, and what is added to the share of the straight normals; None for 1 and 0.
    """
    corners = triangles.reshape(-1)
    painted = np.tile(np.array([1.0, 0.0], np.float32), (len(corners), 1)) if paint is None else paint[corners]
    return {
        "uv": uv[corners],
        "position": position[corners],
        "smooth_normal": smooth_normal[corners],
        "straight_normal": straight_normal[corners],
        "number": np.repeat(numbers, 3).astype(np.float32)[:, None],
        "paint": painted,
    }


def draw(
    into: target.Target,
    low: gpu.types.GPUBatch,
    uv_to_clip: UvToClip,
    directions: Directions,
    *,
    start_offset: float,
    start_on_cage: bool = False,
    clear: bool = True,
    stopped: gpu.types.GPUTexture | None = None,
    parts: Sequence[tuple[int, int]] | None = None,
) -> None:
    """Clear `into` (two RGBA32F) and write the rays of the texels that `low` covers.

    The first texture gets the point on the low mesh and the number of its triangle, the second the unit direction away from
    the surface and how far outside it the ray starts. start_offset: that distance where nothing is painted; with
    start_on_cage it is the length of the smooth normals instead, which then point at the cage.

    clear, stopped: as in target.drawing. parts: of `low`, as in target.draw_bound.
    """
    edges = directions.edges
    target.draw(
        into,
        RAYS,
        low,
        clear=clear,
        stopped=stopped,
        parts=parts,
        uv_to_clip=uv_to_clip,
        edge_ends=edges.ends,
        **edges.tree.bindings("edge"),
        blend_width=directions.blend_width,
        straight_share=directions.straight_share,
        start_offset=start_offset,
        start_on_cage=int(start_on_cage),
    )


def upload_points(places: np.ndarray, directions: np.ndarray, start: float) -> target.Target:
    """Rays as `draw` writes them, at places (N, 3) with any directions (N, 3): as `upload_texels` arranges them."""
    texels = np.empty((2, len(places), 4), np.float32)
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    texels[0, :, :3], texels[1, :, :3] = places, directions / np.maximum(lengths, 1e-30)
    texels[0, :, 3], texels[1, :, 3] = lengths[:, 0] > 0.0, start
    return upload_texels(*texels)


def upload_texels(places: np.ndarray, away: np.ndarray) -> target.Target:
    """Rays from the values (N, 4) float32 of both textures of `draw`: the first texels, row by row, of a square.

    Its side is a power of two: software drivers compile a shader again for textures of other sizes.
    """
    side = max(8, 1 << math.isqrt(max(0, len(places) - 1)).bit_length())
    drawn = target.Target(side, side, ("RGBA32F", "RGBA32F"))
    for slot, values in enumerate((places, away)):
        texels = np.zeros((side, side, 4), np.float32)
        texels.reshape(-1, 4)[: len(values)] = values
        drawn.textures[slot] = data_texture.image(texels)
    return drawn
