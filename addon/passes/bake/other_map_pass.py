# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps that follow from the point on the low surface and the one on the high surface: a number or a vector for each texel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.map_types import MapType
from .. import shader, target
from ..program import Program

if TYPE_CHECKING:
    import gpu

PROGRAM = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/height_position_ids_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(
        ("FLOAT_2D", "normals"),
        ("FLOAT_2D", "points"),
        ("FLOAT_2D", "labels"),
        ("FLOAT_2D", "low_points"),
        ("FLOAT_2D", "directions"),
    ),
    constants=(("INT", "map_index"), ("MAT4", "to_space"), ("VEC4", "origin"), ("FLOAT", "scale")),
    outputs=(("VEC4", "value_out"),),
)


def draw(
    into: target.Target,
    map_type: MapType,
    normals: gpu.types.GPUTexture,
    points: target.Target,
    low_points: target.Target,
    *,
    to_space: np.ndarray,
    origin: np.ndarray,
    scale: float,
) -> None:
    """Write the map into `into` (RGBA32F): xyz is the value, alpha is as in `normals`: 1 known, 0 empty, -1 missed.

    points: what points.draw or cast.points wrote. low_points: what gbuffer.draw wrote. Vectors and positions are transformed
    with to_space (3, 3) and origin (3,); distances are multiplied by `scale`.
    """
    target.fill(
        into,
        PROGRAM,
        normals=normals,
        points=points.textures[0],
        labels=points.textures[1],
        low_points=low_points.textures[0],
        directions=low_points.textures[1],
        map_index=map_type.index,
        to_space=shader.mat4(to_space),
        origin=(*origin, 0.0),
        scale=scale,
    )
