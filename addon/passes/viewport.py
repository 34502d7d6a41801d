# SPDX-License-Identifier: GPL-3.0-or-later
"""Passes for the screen: maps as they are stored, masks, the deviation of a map with its legend, the shell of the cage, and
pictures of unfinished maps."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core import udim
from . import blender_gpu as gpu
from . import data_texture, lit, low_in_uv, mesh_upload, shader, target
from .shader import Program

MEASURE_DEVIATION = Program(
    vertex="bake/tangent_vert.glsl",
    fragment="view/deviation_frag.glsl",
    inputs=(("VEC2", "uv"), ("VEC3", "normal"), ("VEC4", "tangent")),
    varyings=low_in_uv.TANGENT_VARYINGS,
    samplers=(("FLOAT_2D", "normal_map"), ("FLOAT_2D", "truth"), ("FLOAT_2D", "elsewhere")),
    # Vulkan grants 128 bytes of constants, which these are.
    constants=(
        *(("MAT4", "shading"), ("VEC4", "uv_to_clip")),
        *(("VEC4", "truth_x"), ("VEC4", "truth_y"), ("VEC4", "truth_z")),
    ),
    outputs=(("VEC4", "deviation_out"),),
)
DRAW_DEVIATION = Program(
    vertex="view/deviation_colors_vert.glsl",
    fragment="view/deviation_colors_frag.glsl",
    inputs=(("VEC3", "position"), ("VEC2", "uv")),
    varyings=(("VEC2", "v_uv"),),
    samplers=(("FLOAT_2D", "deviation"),),
    constants=(("MAT4", "view_projection"), ("FLOAT", "limit"), ("INT", "without_map")),
    outputs=(("VEC4", "color_out"),),
)
DRAW_LEGEND = Program(
    vertex="view/legend_vert.glsl",
    fragment="view/legend_frag.glsl",
    inputs=(("VEC2", "position"),),
    varyings=(("FLOAT", "v_share"),),
    constants=(("VEC4", "rect"),),
    outputs=(("VEC4", "color_out"),),
)


def measure_deviation(
    into: target.Target,
    low: gpu.types.GPUBatch,
    normal_map: gpu.types.GPUTexture,
    truth: gpu.types.GPUTexture,
    shading: np.ndarray,
    *,
    elsewhere: np.ndarray,
    stretch: np.ndarray | None = None,
    uv_to_clip: udim.UvToClip | None = None,
) -> None:
    """Clear `into` (RGBA32F) and write angles in degrees on the texels that `low` covers.

    Red is the angle between the truth and the normal that `low` shows with its map, green the angle without it. Alpha is 1,
    or -1 without a truth, or -2 where the truth belongs to another place of the surface. low: batch with attributes uv,
    normal and tangent. truth: unit normals, as sources.Source writes them. All textures have the same size. shading: from
    lit.shading. elsewhere (rows, columns) bool, at any resolution: where the truth belongs to another place.
    stretch: as Mesh.stretch has it, of `low`. uv_to_clip: as udim.uv_to_clip returns it for the textures; None for the whole of
    the first tile.
    """
    of_truth = np.eye(3) if shading[3, 1] == lit.WORLD else shading[:3, :3]
    if stretch is not None:  # then it is a tangent-space map, and `shading` is for normals that have the stretch
        of_truth = of_truth @ np.linalg.inv(stretch).T
    target.draw(
        into,
        MEASURE_DEVIATION,
        low,
        normal_map=normal_map,
        truth=truth,
        elsewhere=data_texture.image(elsewhere, "R32F"),
        shading=shader.mat4(shading),
        uv_to_clip=udim.uv_to_clip() if uv_to_clip is None else uv_to_clip,
        truth_x=(*of_truth[:, 0], 0.0),
        truth_y=(*of_truth[:, 1], 0.0),
        truth_z=(*of_truth[:, 2], 0.0),
    )


def draw_deviation(
    batch: gpu.types.GPUBatch,
    measured: gpu.types.GPUTexture,
    view_projection: np.ndarray,
    *,
    limit: float,
    without_map: bool,
) -> None:
    """Draw the result of `measure` into the bound framebuffer, in colors from 0 to `limit` degrees and more.

    batch: attributes position and uv. without_map: show the angles without the map.
    """
    matrix, is_bare = shader.mat4(view_projection), int(without_map)
    target.draw_bound(
        DRAW_DEVIATION, batch, deviation=measured, view_projection=matrix, limit=limit, without_map=is_bare
    )


def draw_legend(rect: tuple[float, float, float, float]) -> None:
    """Draw the color scale left to right. rect: scale and offset in clip space of a square from 0 to 1."""
    corners = np.array([(0, 0), (1, 0), (0, 1), (1, 1)], np.float32)
    square = mesh_upload.upload(np.array([(0, 1, 2), (2, 1, 3)], np.int32), position=corners)
    target.draw_bound(DRAW_LEGEND, square, rect=rect)


DRAW_TEXTURE = Program(
    vertex="view/deviation_colors_vert.glsl",
    fragment="view/texture_frag.glsl",
    inputs=(("VEC3", "position"), ("VEC2", "uv")),
    varyings=(("VEC2", "v_uv"),),
    samplers=(("FLOAT_2D", "stored_map"),),
    constants=(
        ("MAT4", "view_projection"),
        ("VEC4", "levels"),
        ("INT", "takes_nearest"),
        ("INT", "is_stored_color"),
    ),
    outputs=(("VEC4", "color_out"),),
)
DRAW_MASK = Program(
    vertex="view/deviation_colors_vert.glsl",
    fragment="view/mask_frag.glsl",
    inputs=(("VEC3", "position"), ("VEC2", "uv")),
    varyings=(("VEC2", "v_uv"),),
    samplers=(("FLOAT_2D", "mask"),),
    constants=(("MAT4", "view_projection"), ("VEC4", "color")),
    outputs=(("VEC4", "color_out"),),
)


def texture_of(image: Any) -> gpu.types.GPUTexture:
    """The texture that Blender keeps of an image datablock, with the pixels that it has now.

    After it has made mip levels, Blender binds the shader again that was bound before, even one that was freed.
    """
    shader.load(DRAW_TEXTURE).bind()
    return gpu.texture.from_image(image)


def draw_texture(
    batch: gpu.types.GPUBatch,
    stored: gpu.types.GPUTexture,
    view_projection: np.ndarray,
    *,
    is_stored_color: bool,
    takes_nearest: bool = False,
    bounds: tuple[float, float] = (0.0, 1.0),
) -> None:
    """Draw `batch` into the bound framebuffer with a map on it, unlit.

    batch: attributes position and uv. is_stored_color: whether the framebuffer, which encodes colors as sRGB, is to show the
    values as they are stored; else they are linear colors. takes_nearest: each texel with its true borders, as numbers of
    objects need it. bounds: the values that are black and white.
    """
    low, high = bounds
    target.draw_bound(
        DRAW_TEXTURE,
        batch,
        stored_map=stored,
        view_projection=shader.mat4(view_projection),
        levels=(low, 1.0 / (high - low), 0.0, 0.0),
        takes_nearest=int(takes_nearest),
        is_stored_color=int(is_stored_color),
    )


def draw_mask(
    batch: gpu.types.GPUBatch,
    mask: gpu.types.GPUTexture,
    view_projection: np.ndarray,
    color: tuple[float, float, float, float],
) -> None:
    """Draw the texels of `batch` where `mask` is 1 into the bound framebuffer. batch: attributes position and uv."""
    target.draw_bound(DRAW_MASK, batch, mask=mask, view_projection=shader.mat4(view_projection), color=color)


CAGE_SHELL = Program(
    vertex="view/cage_shell_vert.glsl",
    fragment="view/cage_shell_frag.glsl",
    inputs=(("VEC3", "position"), ("VEC3", "direction"), ("FLOAT", "start")),
    constants=(("MAT4", "view_projection"), ("VEC4", "color"), ("FLOAT", "scale"), ("FLOAT", "offset")),
    outputs=(("VEC4", "color_out"),),
)


def draw_cage_shell(
    batch: gpu.types.GPUBatch,
    view_projection,
    color: tuple[float, float, float, float],
    *,
    scale: float,
    offset: float,
) -> None:
    """Draw into the bound framebuffer each point at the distance start * scale + offset outside the surface.

    batch: attributes position and unit direction, in world space, and start.
    """
    constants = {"view_projection": view_projection, "color": color, "scale": scale, "offset": offset}
    target.draw_bound(CAGE_SHELL, batch, **constants)


PREVIEW = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/preview_picture_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("FLOAT_2D", "normals"),),
    constants=(("VEC4", "scale"), ("MAT4", "channels")),
    outputs=(("VEC4", "picture_out"),),
)
PREVIEW_SIDE = 512
"""The largest length of the longer side, in texels."""


def draw_preview(
    normals: gpu.types.GPUTexture, size: tuple[int, int], channels: np.ndarray, *, clear: bool, is_value: bool = False
) -> gpu.types.GPUTexture:
    """Draw the picture of `normals` (RGBA32F, or sums of samples), a part of a map of `size`. channels: (3, 3), as in
    lit.shading.

    is_value: `normals` has values instead, which are shown as they are. Texels without normals keep the previous
    picture, unless `clear` is True.
    """
    shrink = max(1.0, max(size) / PREVIEW_SIDE)
    into = target.get("picture", max(1, int(size[0] / shrink)), max(1, int(size[1] / shrink)), "RGBA16F")
    scale = normals.width / into.width, normals.height / into.height, float(is_value), 0.0
    if clear:
        target.clear(into)
    target.fill(into, PREVIEW, normals=normals, scale=scale, channels=shader.mat4(channels))
    into.finish()  # so that the caller's clock includes the drawing
    return into.texture
