# SPDX-License-Identifier: GPL-3.0-or-later
"""Lights meshes, with a normal map and without (Gumbau, González and Chover, Algorithms 3 and 4)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .. import shader, target
from ..program import Program

if TYPE_CHECKING:
    import gpu

WORLD, OBJECT, MIKKTSPACE, BLENDER = range(4)
"""What the normals of a map are relative to: the world, the object, or its tangent space in one of two bases, of which
Blender's has the interpolated normal at length one. As in map_lib.glsl."""

_VARYINGS = (("VEC3", "v_position"), ("VEC3", "v_normal"), ("VEC2", "v_uv"), ("VEC4", "v_tangent"))
# Vulkan grants 128 bytes of constants, which these are.
_CONSTANTS = (("MAT4", "view_projection"), ("MAT4", "placed"))

MAP = Program(
    vertex="view/lit_vert.glsl",
    fragment="view/lit_frag.glsl",
    inputs=(("VEC3", "position"), ("VEC3", "normal"), ("VEC2", "uv"), ("VEC4", "tangent")),
    varyings=_VARYINGS,
    samplers=(("FLOAT_2D", "normal_map"),),
    constants=_CONSTANTS,
    outputs=(("VEC4", "color_out"),),
)
BARE = Program(
    vertex="view/bare_vert.glsl",
    fragment="view/bare_frag.glsl",
    inputs=(("VEC3", "position"), ("VEC3", "normal")),
    varyings=_VARYINGS[:2],
    constants=_CONSTANTS,
    outputs=(("VEC4", "color_out"),),
)


def placed(
    normal_matrix: np.ndarray,
    light: np.ndarray | None = None,
    *,
    kind: int = OBJECT,
    channels: np.ndarray | None = None,
    steps: int = 0,
) -> np.ndarray:
    """What the shaders of this kind know of a mesh and its map, packed: (4, 4) float64, as map_lib.glsl has it.

    normal_matrix (3, 3): from the mesh's normals to the world's. light (4,): see `draw`. kind: one of WORLD, OBJECT,
    MIKKTSPACE and BLENDER. channels (3, 3): from a normal to what red, green and blue hold of it, one axis each.
    steps: 2^bits - 1 where the map is rounded to them before it is read, else 0.
    """
    channels = np.eye(3) if channels is None else channels
    digits = 2 * np.abs(channels).argmax(axis=1) + (channels.sum(axis=1) < 0.0)
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = normal_matrix
    matrix[3, :3] = steps, kind, digits @ (1, 6, 36)
    if light is not None:
        matrix[:, 3] = light
    return matrix


def draw(
    batch: gpu.types.GPUBatch, normal_map: gpu.types.GPUTexture, view_projection: np.ndarray, placed: np.ndarray
) -> None:
    """Draw into the framebuffer that is bound, with its tests of depth, what `batch` looks like with its map.

    batch: attributes position, in a space with the world's axes, normal and tangent in the object's, and uv.
    view_projection (4, 4): from that space to clip space. placed: from the function of this name; its light is where the
    light comes from in that space and 0, or where it is and 1.
    """
    _draw(MAP, batch, view_projection, placed, normal_map=normal_map)


def draw_bare(batch: gpu.types.GPUBatch, view_projection: np.ndarray, placed: np.ndarray) -> None:
    """As `draw`, by the normals of `batch` alone."""
    _draw(BARE, batch, view_projection, placed)


def _draw(
    program: Program, batch: gpu.types.GPUBatch, view_projection: np.ndarray, placed: np.ndarray, **samplers
) -> None:
    compiled = shader.load(program)
    compiled.bind()
    matrices = {"view_projection": shader.mat4(view_projection), "placed": shader.mat4(placed)}
    target.bind(compiled, program, **matrices, **samplers)
    batch.draw(compiled)
