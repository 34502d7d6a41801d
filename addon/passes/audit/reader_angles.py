# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures by how many degrees a program is off that reads a tangent-space map by other rules than it is made for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.udim import UvToClip
from .. import shader, target
from ..bake import tangent
from ..program import Program

if TYPE_CHECKING:
    import gpu

PROGRAM = Program(
    vertex="bake/tangent_vert.glsl",
    fragment="audit/reader_angles_frag.glsl",
    inputs=tangent.PROGRAM.inputs,
    varyings=tangent.VARYINGS,
    texels=(("RGBA32F", "FLOAT_2D", "normal_map"),),
    constants=(("VEC4", "uv_to_clip"), ("VEC4", "own"), ("VEC4", "other")),
    outputs=(("FLOAT", "angle_out"),),
)


def measure(
    low: gpu.types.GPUBatch,
    normal_map: gpu.types.GPUTexture,
    uv_to_clip: UvToClip,
    own: tuple[int, int, int],
    other: tuple[int, int, int],
) -> np.ndarray:
    """The angles (height, width) float32 in degrees, or -1 where the low mesh does not cover the texel's center.

    low: as tangent.draw takes it. normal_map: RGBA32F, colors before they are rounded. own: how the map is meant; other: how
    the program reads it; both from lit.reading.
    """
    into = target.get("reader angles", normal_map.width, normal_map.height, "R32F")
    compiled = shader.load(PROGRAM)
    with target.drawing(into):
        compiled.bind()
        bound = {"own": (*own, 0.0), "other": (*other, 0.0)}
        target.bind(compiled, PROGRAM, normal_map=normal_map, uv_to_clip=uv_to_clip, **bound)
        low.draw(compiled)
    angles = np.empty((normal_map.height, normal_map.width), np.float32)
    into.read(angles)
    angles -= 1.0
    return angles
