# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws a mesh in UV space, layer by layer: the number of the top triangle on each texel, then of the one below it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ...core.udim import UvToClip
from .. import mesh_upload, shader, target
from ..program import Program

if TYPE_CHECKING:
    import gpu

PROGRAM = Program(
    vertex="audit/triangle_ids_vert.glsl",
    fragment="audit/triangle_ids_frag.glsl",
    inputs=(("VEC2", "uv"), ("FLOAT", "number")),
    flat=(("FLOAT", "v_number"),),
    samplers=(("FLOAT_2D", "above"),),
    constants=(("VEC4", "uv_to_clip"),),
    outputs=(("FLOAT", "number_out"),),
)


def upload(triangles: np.ndarray, uv: np.ndarray, numbers: np.ndarray | None = None) -> gpu.types.GPUBatch:
    """A mesh for `layers`: triangles (T, 3) int32, indices into uv (C, 2) float32. They have these `numbers` (T,) above 0,
    at most 2^24, which a float holds exactly, or are numbered from 1."""
    count = len(triangles)
    numbers = np.arange(1, count + 1) if numbers is None else numbers
    numbers = np.repeat(numbers, 3).astype(np.float32)[:, None]
    corners = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return mesh_upload.upload(corners, uv=uv[triangles.reshape(-1)], number=numbers)


def layers(
    mesh: gpu.types.GPUBatch, size: tuple[int, int], uv_to_clip: UvToClip, count: int = 1
) -> Iterator[np.ndarray]:
    """The numbers (height, width) of the triangles on each texel, 0 for none, layer by layer from the top down.

    The last triangle is on top, as in a map. After the lowest triangle of a texel comes a 0, then its top triangle again.
    The array is reused for the next layer.
    """
    compiled = shader.load(PROGRAM)
    above, into = (target.get(f"faces {name}", *size, "R32F") for name in ("above", "into"))
    target.clear(above)
    numbers = np.empty(size[::-1], np.float32)
    for _ in range(count):
        with target.drawing(into):
            compiled.bind()
            target.bind(compiled, PROGRAM, above=above.texture, uv_to_clip=uv_to_clip)
            mesh.draw(compiled)
        into.read(numbers)
        yield numbers
        above, into = into, above
