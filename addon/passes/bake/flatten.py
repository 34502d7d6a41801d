# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws high meshes in UV space: the result is their normal map (Gumbau, González and Chover, Algorithms 1 and 2)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from ...core.udim import UvToClip
from .. import shader, target
from ..program import Program

if TYPE_CHECKING:
    import gpu

PROGRAM = Program(
    vertex="bake/flatten_vert.glsl",
    fragment="bake/flatten_frag.glsl",
    inputs=(("VEC2", "uv"), ("VEC3", "normal")),
    varyings=(("VEC3", "v_normal"),),
    constants=(("MAT4", "normal_matrix"), ("VEC4", "uv_to_clip")),
    outputs=(("VEC4", "normal_out"),),
)

STEP = 2**14
"""The triangles that draw_in_steps draws at a time."""


def draw(
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
    compiled = shader.load(PROGRAM)
    with target.drawing(into, clear=clear):
        for batch, normal_matrix in meshes:
            compiled.bind()
            target.bind(compiled, PROGRAM, normal_matrix=shader.mat4(normal_matrix), uv_to_clip=uv_to_clip)
            batch.draw(compiled)


def draw_in_steps(
    into: target.Target,
    mesh: tuple[gpu.types.GPUBatch, np.ndarray],
    count: int,
    uv_to_clip: UvToClip,
) -> None:
    """Draw a mesh of `count` triangles over what is in `into`, as `draw` does, for drivers that draw in software.

    They sort all triangles into tiles before they fill texels. After a few triangles they still find them in the processor's
    caches, and sort the next ones meanwhile.
    """
    compiled = shader.load(PROGRAM)
    batch, normal_matrix = mesh
    constants = {"normal_matrix": shader.mat4(normal_matrix), "uv_to_clip": uv_to_clip}
    for first in range(0, count, STEP):
        with target.drawing(into, clear=False):
            compiled.bind()
            target.bind(compiled, PROGRAM, **constants)
            batch.draw_range(compiled, elem_start=3 * first, elem_count=3 * min(STEP, count - first))
        target.clear(target.get("step", 1, 1, "RGBA8"))  # another target makes the driver fill texels
