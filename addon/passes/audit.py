# SPDX-License-Identifier: GPL-3.0-or-later
"""Passes of the audit: shared texels, hidden triangles, and what another program shows of the map."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..core.udim import UvToClip
from . import blender_gpu as gpu
from . import low_in_uv, mesh_upload, target
from .shader import Program

OVERLAP = Program(
    vertex="audit/overlap_vert.glsl",
    fragment="audit/overlap_frag.glsl",
    inputs=(("VEC2", "uv"),),
    constants=(("VEC4", "uv_to_clip"),),
    outputs=(("VEC4", "count_out"),),
)


def counts(mesh: gpu.types.GPUBatch, size: tuple[int, int], uv_to_clip: UvToClip) -> np.ndarray:
    """The number (height, width) uint8 of triangles of `mesh` that cover each texel's center; 255 for more.

    mesh: batch with the attribute uv. Triangles that share an edge do not share texels along it.
    """
    drawn = target.get("overlap", *size, "R8")
    with target.drawing(drawn):
        gpu.state.blend_set("ADDITIVE")
        target.draw_bound(OVERLAP, mesh, uv_to_clip=uv_to_clip)
        gpu.state.blend_set("NONE")
    return drawn.texels()


TRIANGLE_IDS = Program(
    vertex="audit/triangle_ids_vert.glsl",
    fragment="audit/triangle_ids_frag.glsl",
    inputs=(("VEC2", "uv"), ("FLOAT", "number")),
    flat=(("FLOAT", "v_number"),),
    samplers=(("FLOAT_2D", "above"),),
    constants=(("VEC4", "uv_to_clip"),),
    outputs=(("FLOAT", "number_out"),),
)


def upload_with_ids(triangles: np.ndarray, uv: np.ndarray, numbers: np.ndarray | None = None) -> gpu.types.GPUBatch:
    """A mesh for `layers`: triangles (T, 3) int32, indices into uv (C, 2) float32. They have these `numbers` (T,) above 0,
    at most 2^24, which a float holds exactly, or are numbered from 1."""
    count = len(triangles)
    numbers = np.arange(1, count + 1) if numbers is None else numbers
    numbers = np.repeat(numbers, 3).astype(np.float32)[:, None]
    corners = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return mesh_upload.upload(corners, uv=uv[triangles.reshape(-1)], number=numbers)


def layers_of_triangles(
    mesh: gpu.types.GPUBatch, size: tuple[int, int], uv_to_clip: UvToClip, count: int = 1
) -> Iterator[np.ndarray]:
    """The numbers (height, width) of the triangles on each texel, 0 for none, layer by layer from the top down.

    The last triangle is on top, as in a map. After the lowest triangle of a texel comes a 0, then its top triangle again.
    The array is reused for the next layer.
    """
    above, into = (target.get(f"faces {name}", *size, "R32F") for name in ("above", "into"))
    target.clear(above)
    numbers = np.empty(size[::-1], np.float32)
    for _ in range(count):
        target.draw(into, TRIANGLE_IDS, mesh, above=above.texture, uv_to_clip=uv_to_clip)
        into.read(numbers)
        yield numbers
        above, into = into, above


ENGINE_ANGLES = Program(
    vertex="bake/tangent_vert.glsl",
    fragment="audit/engine_angles_frag.glsl",
    inputs=low_in_uv.TANGENT.inputs,
    varyings=low_in_uv.TANGENT_VARYINGS,
    texels=(("RGBA32F", "FLOAT_2D", "normal_map"), ("RGBA32F", "FLOAT_2D", "kept_map")),
    constants=(("VEC4", "uv_to_clip"), ("VEC4", "own"), ("VEC4", "other")),
    outputs=(("FLOAT", "angle_out"),),
)


def measure_engine_angles(
    low: gpu.types.GPUBatch,
    normal_map: gpu.types.GPUTexture,
    kept_map: gpu.types.GPUTexture,
    uv_to_clip: UvToClip,
    *,
    own: tuple[int, int, int],
    other: tuple[int, int, int],
) -> np.ndarray:
    """The angles (height, width) float32 in degrees, or -1 where the low mesh does not cover the texel's center.

    low: as low_in_uv.draw_in_tangent_space takes it. normal_map: RGBA32F, colors before they are
    rounded. kept_map: of the same size, what the program reads. own: how the map is meant; other: how the program reads it;
    both from lit.reading.
    """
    into = target.get("engine angles", normal_map.width, normal_map.height, "R32F")
    target.draw(
        into,
        ENGINE_ANGLES,
        low,
        normal_map=normal_map,
        kept_map=kept_map,
        uv_to_clip=uv_to_clip,
        own=(*own, 0.0),
        other=(*other, 0.0),
    )
    return into.texels() - 1.0
