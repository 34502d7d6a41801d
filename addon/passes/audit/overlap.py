# SPDX-License-Identifier: GPL-3.0-or-later
"""Counts the triangles of a mesh on each texel. More than one means overlapping UVs."""

from __future__ import annotations

from ...core.udim import UvToClip
from .. import blender_gpu as gpu
from .. import shader, target
from ..program import Program

PROGRAM = Program(
    vertex="audit/overlap_vert.glsl",
    fragment="audit/overlap_frag.glsl",
    inputs=(("VEC2", "uv"),),
    constants=(("VEC4", "uv_to_clip"),),
    outputs=(("VEC4", "count_out"),),
)


def draw(into: target.Target, mesh: gpu.types.GPUBatch, uv_to_clip: UvToClip) -> None:
    """Clear `into` (R16F, exact up to 2048) and write the number of triangles of `mesh` that cover each texel's center.

    mesh: batch with the attribute uv. Triangles that share an edge do not share texels along it.
    """
    compiled = shader.load(PROGRAM)
    with target.drawing(into):
        gpu.state.blend_set("ADDITIVE")
        compiled.bind()
        target.bind(compiled, PROGRAM, uv_to_clip=uv_to_clip)
        mesh.draw(compiled)
        gpu.state.blend_set("NONE")
