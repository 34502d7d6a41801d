# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws lit meshes, with a normal map and without (Gumbau, González and Chover, Algorithms 3 and 4)."""

from __future__ import annotations

import numpy as np

from . import blender_gpu as gpu
from . import shader, target
from .shader import Program

WORLD, OBJECT, TANGENT = range(3)
"""The spaces of a map's normals, as in decode_lib.glsl. TANGENT is the first of a number of kinds, one for each basis."""
REBUILT_Z = 216
"""As in decode_lib.glsl."""

_VARYINGS = (
    ("VEC3", "v_position"),
    ("VEC3", "v_normal"),
    ("VEC2", "v_uv"),
    ("VEC4", "v_tangent"),
    ("VEC3", "v_bitangent"),
)
# Vulkan grants 128 bytes of constants, which these are.
_CONSTANTS = (("MAT4", "view_projection"), ("MAT4", "shading"))

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
    vertex="view/lit_without_map_vert.glsl",
    fragment="view/lit_without_map_frag.glsl",
    inputs=(("VEC3", "position"), ("VEC3", "normal")),
    varyings=_VARYINGS[:2],
    constants=_CONSTANTS,
    outputs=(("VEC4", "color_out"),),
)


def reading(
    kind: int, channels: np.ndarray | None = None, *, steps: int = 0, rebuilds_z: bool = False
) -> tuple[int, int, int]:
    """How a map is read, as decode_lib.glsl takes it.

    kind: WORLD, OBJECT, or TANGENT plus the flags of a basis. channels (3, 3): from a normal to red, green and blue, one axis
    each. steps: 2^bits - 1 if the map is rounded to integers before it is read, else 0. rebuilds_z: whether z is made of x and
    y.
    """
    channels = np.eye(3) if channels is None else channels
    digits = 2 * np.abs(channels).argmax(axis=1) + (channels.sum(axis=1) < 0.0)
    return steps, kind, int(digits @ (1, 6, 36)) + REBUILT_Z * rebuilds_z


def shading(
    normal_matrix: np.ndarray, light: np.ndarray | None = None, *, read: tuple[int, int, int] | None = None
) -> np.ndarray:
    """Pack the parameters that shade a mesh with its map into (4, 4) float64, as map_lib.glsl reads them.

    normal_matrix (3, 3): from the mesh's normals to world space. light (4,): see `draw`. read: from `reading`, or None
    for an object-space map.
    """
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = normal_matrix
    matrix[3, :3] = read or reading(OBJECT)
    if light is not None:
        matrix[:, 3] = light
    return matrix


def draw(
    batch: gpu.types.GPUBatch, normal_map: gpu.types.GPUTexture, view_projection: np.ndarray, shading: np.ndarray
) -> None:
    """Draw `batch` lit with its normal map into the bound framebuffer, with its depth test.

    batch: attributes position, in a space with the world's axes, normal and tangent, in object space, and uv.
    view_projection (4, 4): from that space to clip space. shading: from the function `shading`. Its light is a direction
    towards the light and 0, or a position and 1, in that space.
    """
    _draw(MAP, batch, view_projection, shading, normal_map=normal_map)


def draw_bare(batch: gpu.types.GPUBatch, view_projection: np.ndarray, shading: np.ndarray) -> None:
    """Draw `batch` as `draw` does, but lit by its own normals."""
    _draw(BARE, batch, view_projection, shading)


def _draw(
    program: Program, batch: gpu.types.GPUBatch, view_projection: np.ndarray, shading: np.ndarray, **samplers
) -> None:
    matrices = {"view_projection": shader.mat4(view_projection), "shading": shader.mat4(shading)}
    target.draw_bound(program, batch, **matrices, **samplers)
