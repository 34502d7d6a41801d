# SPDX-License-Identifier: GPL-3.0-or-later
"""The triangles of the low mesh on the GPU, which decide what texel a hit of a ray belongs to."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .. import blender_gpu as gpu
from .. import data_texture, target
from ..program import Program

CLEARANCE = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/clearance_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "low_nodes"), ("RGBA32F", "FLOAT_2D", "low_corners")),
    constants=(
        ("VEC4", "low_origin"),
        ("VEC4", "low_scale"),
        ("INT", "low_first_leaf"),
        ("INT", "count"),
        ("INT", "per_row"),
    ),
    outputs=(("VEC4", "clearance_out"),),
)
"""A fragment shader: of what a compute shader writes, Blender makes only textures and images wait, and this is read back."""
TEXELS = 4
"""Texels of a triangle in Owners.corners."""
MOST_CLEARED = 2**16
"""The most triangles whose clearance is measured: with more, it takes longer than it saves."""
CLEARED_WIDTH, CLEARED_AT_ONCE = 256, 4
"""Texels a side of the target that they are written to, and of its blocks, as in shaders/bake/clearance_frag.glsl."""


@dataclass(frozen=True)
class Owners:
    """The triangles of a low mesh and a tree over them (bvh.Tree).

    Triangle i has four texels in `corners`. The first three have its corners, and the number of the triangle across the edge to
    the next corner, or -1. The fourth has its face normal, of any length, and its clearance: no triangle is closer to it than
    that, unless a short walk over the mesh leads to it. room: hits farther outside than this belong only to texels that are
    about at their closest point.
    """

    nodes: gpu.types.GPUTexture
    corners: gpu.types.GPUTexture
    first_leaf: int
    origin: np.ndarray
    scale: np.ndarray
    room: float


def upload(
    nodes: np.ndarray,
    corners: np.ndarray,
    neighbors: np.ndarray,
    *,
    first_leaf: int,
    origin: np.ndarray,
    scale: np.ndarray,
    room: float,
    has_clearances: bool = True,
) -> Owners:
    """Upload the nodes of a tree (bvh.Tree), with corners (T, 3, 3) float32 and neighbors (T, 3) int in its order.

    has_clearances: whether the clearances are measured, which makes many searches for owners quicker; otherwise they are 0.
    """
    texels = np.zeros((len(corners), TEXELS, 4), np.float32)
    texels[:, :3, :3], texels[:, :3, 3] = corners, neighbors
    texels[:, 3, :3] = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    uploaded = Owners(
        data_texture.upload(nodes.reshape(-1, 4)),
        data_texture.upload(texels.reshape(-1, 4)),
        first_leaf,
        origin,
        scale,
        room,
    )
    if not has_clearances or len(corners) > MOST_CLEARED:
        return uploaded
    texels[:, 3, 3] = _clearances(uploaded, len(corners))
    return replace(uploaded, corners=data_texture.upload(texels.reshape(-1, 4)))


def _clearances(owners: Owners, count: int) -> np.ndarray:
    """The clearances (T,) float32 of the triangles."""
    rows = -(-count // (CLEARED_AT_ONCE * CLEARED_WIDTH))
    into = target.Target(CLEARED_WIDTH, rows * CLEARED_AT_ONCE, ("R32F",))
    target.fill(
        into,
        CLEARANCE,
        low_nodes=owners.nodes,
        low_corners=owners.corners,
        low_origin=(*owners.origin, 0.0),
        low_scale=(*owners.scale, 0.0),
        low_first_leaf=owners.first_leaf,
        count=count,
        per_row=CLEARED_WIDTH // CLEARED_AT_ONCE,
    )
    found = np.empty((into.height, into.width), np.float32)
    into.read(found)
    blocks = found.reshape(rows, CLEARED_AT_ONCE, -1, CLEARED_AT_ONCE)
    return blocks.transpose(0, 2, 1, 3).reshape(-1)[:count]
