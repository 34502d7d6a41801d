# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws meshes as they are seen from one side, in parallel projection, and compares what a viewer sees of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from . import blender_gpu as gpu
from . import lit, shader, target

NOTHING, LOW_ALONE, HIGH_ALONE, OTHERS = 0, -1, -2, -3
"""What is known of a pixel instead of its angle, as in seen_lib.glsl."""
BACK = 2.0
"""What is added to the depths of back faces."""
NOT_JUDGED, OWN_NORMALS, MAP_NORMALS = range(3)
"""Which normals of the low mesh are compared, as in seen_low_frag.glsl."""

HIGH = replace(lit.BARE, fragment="audit/seen_high_frag.glsl", outputs=(("VEC4", "seen_out"),))
LOW = replace(
    lit.MAP,
    fragment="audit/seen_low_frag.glsl",
    texels=(("RGBA32F", "FLOAT_2D", "seen_high"),),
    outputs=(("VEC4", "compared_out"),),
)
HIGH_ALONE_PASS = shader.Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="audit/seen_high_alone_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "seen_high"),),
    outputs=(("VEC4", "compared_out"),),
)

HALF_PASS = replace(HIGH_ALONE_PASS, fragment="audit/seen_half_frag.glsl", outputs=(("VEC4", "half_out"),))

FORMATS = "RGBA32F", "DEPTH_COMPONENT32F"
"""Of pictures."""


def draw_high(
    into: target.Target, meshes: Iterable[tuple[gpu.types.GPUBatch, np.ndarray]], view: np.ndarray, *, clear: bool
) -> None:
    """Draw the unit normals of meshes into `into` (FORMATS), and 1 + the depth in alpha, and BACK more for back
    faces; 0 where there is no mesh.

    Args:
        meshes: batches with position, in a space with the world's axes, and normal; and the normal matrix (3, 3) of each.
        view: (4, 4), from the space of positions to clip space, in parallel projection.
        clear: False to draw among the meshes that are in `into`.
    """
    with target.drawing(into, clear=clear, writes_depth=True):
        _see_both_sides()
        for batch, normal_matrix in meshes:
            target.draw_bound(HIGH, batch, view_projection=shader.mat4(view), shading=shader.mat4(normal_matrix))


def half(high: gpu.types.GPUTexture, side: int) -> gpu.types.GPUTexture:
    """Every second pixel of a picture from `draw_high`, `side` in both directions: no normals or depths are mixed. It is what a
    view shows that is moved by half of its pixels."""
    into = target.Target(side, side, FORMATS[:1])
    target.fill(into, HALF_PASS, seen_high=high)
    return into.texture


def compare(
    into: target.Target,
    high: gpu.types.GPUTexture,
    parts: Iterable[tuple[gpu.types.GPUBatch, gpu.types.GPUTexture, np.ndarray]],
    view: np.ndarray,
) -> None:
    """Fill `into` (FORMATS) with 1 + the degrees between the normals that a viewer sees of the high mesh and the low one, or
    with what is known instead; the distance between both along the view, as a share of its depth; the number of the square of
    the map, from 1; and how much the low mesh faces the viewer, from 0 to 1, or -1 less that where it shows a back face and
    the high mesh does not, neither there nor on a pixel beside it.

    Args:
        high: from `draw_high`.
        parts: batches of the low mesh as lit.draw takes them, the map of each, and its shading, from `low_shading`.
        view: as in `draw_high`.
    """
    target.fill(into, HIGH_ALONE_PASS, seen_high=high)
    with target.drawing(into, clear=False, writes_depth=True):
        gpu.state.active_framebuffer_get().clear(depth=1.0)
        _see_both_sides()
        for batch, normal_map, shading in parts:
            textures = {"normal_map": normal_map, "seen_high": high}
            target.draw_bound(LOW, batch, view_projection=shader.mat4(view), shading=shader.mat4(shading), **textures)


def low_shading(
    normal_matrix: np.ndarray, read: tuple[int, int, int], kind: int, squares: tuple[int, int] = (1, 1), first: int = 0
) -> np.ndarray:
    """How a part of the low mesh is compared, (4, 4).

    Args:
        normal_matrix, read: as lit.shading takes them.
        kind: NOT_JUDGED, OWN_NORMALS or MAP_NORMALS.
        squares: columns and rows of squares on the map.
        first: the number of squares before those of this map.
    """
    return lit.shading(normal_matrix, np.array((*squares, first, kind), np.float64), read=read)


def _see_both_sides() -> None:
    """Set what the gpu module cannot read back to its default: a script may have left another state."""
    gpu.state.face_culling_set("NONE")
    gpu.state.front_facing_set(False)
