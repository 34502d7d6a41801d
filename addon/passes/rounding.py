# SPDX-License-Identifier: GPL-3.0-or-later
"""Rounds normals at hits near hard edges, as the Bevel node of Cycles does."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ..core.progress import Pace, costs_of_rows
from . import blender_gpu as gpu
from . import cast, data_texture, shader, target, unfinished
from .shader import Program

ROUND = Program(
    compute="surface/rounded_comp.glsl",
    samplers=(("UINT_2D", "hits"), ("FLOAT_2D", "corner_normals"), ("FLOAT_2D", "part_numbers")),
    texels=(
        ("RGBA32F", "FLOAT_2D", "nodes"),
        ("RGBA32F", "FLOAT_2D", "triangles"),
        ("RGBA32F", "FLOAT_2D", "points"),
        ("RGBA32F", "FLOAT_2D", "edge_nodes"),
        ("RGBA32F", "FLOAT_2D", "edge_ends"),
    ),
    images=(("RGBA32F", "FLOAT_2D", "normals", "READ WRITE"), *unfinished.CARRIED),
    constants=(
        ("MAT4", "to_space"),
        ("VEC4", "grid_origin"),
        ("VEC4", "grid_scale"),
        ("VEC4", "edge_scale"),
        ("INT", "first_leaf"),
        ("INT", "first_row"),
    ),
    cost=4.0,
)
"""Fourth numbers hold others, since there are only 128 bytes: shaders/surface/rounded_comp.glsl says which."""
PARTS = 6
"""Texels of an unfinished texel: ROUNDED_CARRIED in that shader."""


@dataclass(frozen=True)
class HardEdges:
    """The hard edges of a surface and its smooth parts, on the GPU.

    Attributes:
        tree: Over the edges.
        ends: Two texels of each edge: its ends, each with the part on one of its sides.
        part_numbers: The part of each triangle, four in a texel.
    """

    tree: data_texture.Tree
    ends: gpu.types.GPUTexture
    part_numbers: gpu.types.GPUTexture


def upload_hard_edges(
    tree: data_texture.BuiltTree, ends: np.ndarray, beside: np.ndarray, numbers: np.ndarray
) -> HardEdges:
    """Upload hard edges.

    Args:
        tree: over them (bvh.Tree).
        ends: (E, 2, 3) float32, in the tree's order.
        beside: (E, 2) int, the parts on both sides of each, in the tree's order.
        numbers: (T,) int, the part of each triangle, in the order of the hits.
    """
    texels = np.empty((len(ends), 2, 4), np.float32)
    texels[..., :3] = ends
    texels.view(np.int32)[..., 3] = beside + data_texture.FIRST_NUMBER
    padded = np.pad(numbers, (0, -len(numbers) % 4))
    return HardEdges(
        data_texture.upload_tree(tree),
        data_texture.upload(texels.reshape(-1, 4)),
        data_texture.upload_numbers(padded.reshape(-1, 4)),
    )


def round_in_slices(
    normals: target.Target,
    hits: target.Target,
    surface: cast.Tables,
    edges: HardEdges,
    radius: float,
    *,
    to_space: np.ndarray,
    pace: Pace,
    covered: np.ndarray,
) -> Generator[range, None, None]:
    """Round `normals` (RGBA32F) in place, in slices. Yields the rows that are done.

    Those at hits that are farther from all hard edges stay as they are, to the bit.

    Args:
        normals: alpha is 1 at hits.
        hits: RGBA32UI, as shaders/lib/hit_lib.glsl reads it, with triangles of `surface`, which has a tree.
        edges: of the same triangles.
        radius: in local space.
        to_space: as cast.look_up got it.
        covered: (N,), how many texels of each SLICE_ROWS rows have hits, about.
    """
    tree, matrix = surface.tree, np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = to_space, edges.tree.origin

    def draw(rows: range) -> None:
        unfinished.dispatch(
            ROUND,
            ROUND,
            normals.width,
            rows,
            parts=PARTS,
            normals=normals.texture,
            hits=hits.texture,
            nodes=tree.nodes,
            triangles=surface.triangles,
            points=surface.points,
            corner_normals=surface.normals,
            part_numbers=edges.part_numbers,
            edge_nodes=edges.tree.nodes,
            edge_ends=edges.ends,
            to_space=shader.mat4(matrix),
            grid_origin=(*tree.origin, radius),
            grid_scale=(*tree.scale, 0.0),
            edge_scale=(*edges.tree.scale, float(edges.tree.first_leaf)),
            first_leaf=tree.first_leaf,
        )

    yield from pace.slices(ROUND.compute, costs_of_rows(covered, normals.width, ROUND.cost), normals.height, draw)
