# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the low mesh in UV space and transforms object-space normals into its tangent space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...core.udim import UvToClip
from .. import mesh_upload, shader, target
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
    constants=(("VEC4", "uv_to_clip"), ("INT", "basis_flags")),
    outputs=(("VEC4", "normal_out"),),
)


def draw(
    into: target.Target,
    low: gpu.types.GPUBatch,
    normals: gpu.types.GPUTexture,
    uv_to_clip: UvToClip,
    *,
    basis_flags: int,
    rows: range | None = None,
    clear: bool = True,
    stopped: gpu.types.GPUTexture | None = None,
    parts: Sequence[tuple[int, int]] | None = None,
) -> None:
    """Clear `into` (RGBA32F) and write tangent-space unit normals, alpha 1, on texels that `low` and `normals` cover.

    low: batch with attributes uv, normal and tangent (w = the bitangent's sign). normals: object-space unit normals of
    the same size. basis_flags: core.declarations.bases.Basis.flags.
    rows: in these rows alone; it is cleared with the first of them. clear: False to keep other texels of `into`.
    stopped: as in target.drawing. parts: of `low`, as in mesh_upload.draw.
    """
    compiled = shader.load(PROGRAM)
    with target.drawing(into, rows, clear=clear and (not rows or rows.start == 0), stopped=stopped):
        compiled.bind()
        target.bind(compiled, PROGRAM, normals=normals, uv_to_clip=uv_to_clip, basis_flags=basis_flags)
        mesh_upload.draw(low, compiled, parts)
