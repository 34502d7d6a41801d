# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws high meshes in UV space: the triangle on each texel, and where in it the texel lies. These are Flatten's hits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.udim import UvToClip
from .. import mesh_upload, shader, target
from ..program import Program

if TYPE_CHECKING:
    import gpu

PROGRAM = Program(
    vertex="bake/flat_hits_vert.glsl",
    fragment="bake/flat_hits_frag.glsl",
    inputs=(("VEC2", "uv"),),
    varyings=(("VEC2", "v_weights"),),
    flat=(("INT", "v_triangle"),),
    constants=(("VEC4", "uv_to_clip"),),
    outputs=(("UVEC4", "hit_out"),),
)
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


def upload(uv: np.ndarray, numbers: np.ndarray) -> gpu.types.GPUBatch:
    """Meshes for `draw`. uv (3 T, 2) float32: of the corners of the triangles in the order of their numbers. numbers (T,) int:
    from 0, in the order of drawing."""
    corners = (3 * numbers[:, None] + np.arange(3)).astype(np.int32)
    return mesh_upload.upload(corners, uv=uv)


def draw(into: target.Target, meshes: gpu.types.GPUBatch, uv_to_clip: UvToClip) -> None:
    """Write the hits into `into` (RGBA32UI), as shaders/lib/hit_lib.glsl reads them, with a height of 0.

    Where triangles overlap, the later one stays.
    """
    target.fill(into, NO_HITS)  # clearing writes floats
    compiled = shader.load(PROGRAM)
    with target.drawing(into, clear=False):
        compiled.bind()
        target.bind(compiled, PROGRAM, uv_to_clip=uv_to_clip)
        meshes.draw(compiled)


def clip(hits: target.Target, normals: gpu.types.GPUTexture) -> None:
    """Remove hits (RGBA32UI) where `normals` (RGBA32F) has an alpha of 0: where the low mesh does not cover the sample."""
    # Drawn, as the hits of the next sample are: OpenGL may put stores of a compute shader behind later drawing.
    target.fill(hits, CLIP, normals=normals)
