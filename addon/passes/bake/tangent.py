# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the low mesh in UV space and transforms object-space normals into its tangent space."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.udim import UvToClip
from .. import drawn_part, shader, target
from ..program import Program

if TYPE_CHECKING:
    import gpu

VARYINGS = (("VEC3", "v_normal"), ("VEC4", "v_tangent"), ("VEC3", "v_bitangent"))
"""Of tangent_vert.glsl."""
PROGRAM = Program(
    vertex="bake/tangent_vert.glsl",
    fragment="bake/tangent_frag.glsl",
    inputs=(("VEC2", "uv"), ("VEC3", "normal"), ("VEC4", "tangent")),
    varyings=VARYINGS,
    texels=(("RGBA32F", "FLOAT_2D", "normals"),),
    constants=(("MAT4", "to_basis"), ("VEC4", "uv_to_clip"), ("INT", "basis_flags")),
    outputs=(("VEC4", "normal_out"),),
)
TURNED = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/turned_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "normals"), ("RGBA32F", "FLOAT_2D", "turned")),
    outputs=(("FLOAT", "stopped_out"),),
)


def draw(
    into: target.Target,
    low: gpu.types.GPUBatch,
    normals: gpu.types.GPUTexture,
    uv_to_clip: UvToClip,
    *,
    basis_flags: int,
    stretch: np.ndarray | None = None,
    clear: bool = True,
    stopped: gpu.types.GPUTexture | None = None,
) -> None:
    """Clear `into` (RGBA32F) and write tangent-space unit normals, alpha 1, on texels that `low` and `normals` cover.

    low: batch with attributes uv, normal and tangent (w = the bitangent's sign). normals: object-space unit normals of
    the same size. basis_flags: core.declarations.bases.Basis.flags. stretch: as Mesh.stretch has it, of `low`.
    clear: False to keep other texels of `into`. stopped: as in target.drawing.
    """
    compiled = shader.load(PROGRAM)
    with target.drawing(into, clear=clear, stopped=stopped):
        compiled.bind()
        to_basis = shader.mat4(np.eye(3) if stretch is None else np.linalg.inv(stretch).T)
        constants = {"to_basis": to_basis, "uv_to_clip": uv_to_clip, "basis_flags": basis_flags}
        target.bind(compiled, PROGRAM, normals=normals, **constants)
        low.draw(compiled)


def left(normals: gpu.types.GPUTexture, turned: target.Target) -> tuple[gpu.types.GPUTexture, np.ndarray]:
    """The texels of `normals` that `turned` lacks: a depth texture that limits `draw` to them, valid until the next call, and
    their rows and columns (N, 2) int, in the part of the map that is drawn."""
    depth = target.get("turned texels", turned.width, turned.height, "R8", "DEPTH_COMPONENT32F")
    target.fill(depth, TURNED, clear=True, writes_depth=True, normals=normals, turned=turned.texture)
    columns, rows = drawn_part.of(turned.width, turned.height)
    stopped = np.empty((len(rows), len(columns), 1), np.uint8)
    depth.read(stopped, start=(columns.start, rows.start))
    return depth.textures[1], np.argwhere(stopped[..., 0] == 0) + (rows.start, columns.start)
