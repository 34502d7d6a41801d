# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws high meshes in UV space: the point of the surface on each texel, and its object and material."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from ...core.udim import UvToClip
from .. import shader, target
from ..program import Program

if TYPE_CHECKING:
    import gpu

PROGRAM = Program(
    vertex="bake/points_vert.glsl",
    fragment="bake/points_frag.glsl",
    inputs=(("VEC2", "uv"), ("VEC3", "position"), ("VEC2", "labels")),
    varyings=(("VEC3", "v_position"),),
    flat=(("VEC2", "v_labels"),),
    constants=(("VEC4", "uv_to_clip"),),
    outputs=(("VEC4", "point_out"), ("VEC4", "labels_out")),
)


def draw(into: target.Target, meshes: Iterable[gpu.types.GPUBatch], uv_to_clip: UvToClip) -> None:
    """Clear `into` (two RGBA32F) and write points, and in x and y the numbers of object and material.

    meshes: batches with the attributes uv, position and labels. Where meshes overlap, the later one stays.
    """
    compiled = shader.load(PROGRAM)
    with target.drawing(into):
        for batch in meshes:
            compiled.bind()
            target.bind(compiled, PROGRAM, uv_to_clip=uv_to_clip)
            batch.draw(compiled)
