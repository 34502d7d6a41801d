# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the low mesh, lit with its normal map, seen from the front, the right and above."""

from collections.abc import Iterator, Mapping

import gpu
import numpy as np

from ...core import udim
from ...core.settings import Settings
from ...engine import normal_channels
from ...mesh.local_space import local_space_of
from ...mesh.triangle_mesh import Mesh
from ...passes import lit, mesh_upload, target

TOWARDS_VIEWER = np.array((0.5, -0.75, 0.45))
"""From the middle of a closed mesh, in the axes of the world."""
FILLED = 0.94
"""Share of the picture's side that the mesh takes."""
FINER = 2
"""Pixels drawn along a side for each pixel of the picture."""


def draw(low: Mesh, tiles: Mapping[int, np.ndarray], settings: Settings, side: int) -> np.ndarray:
    """The picture (side, side, 4) float32, linear, row 0 at the bottom; alpha is the share of a pixel that the mesh covers.

    low: with its tangents, if the map has them. tiles: by UDIM tile, a normal map as it is stored (rows, columns, 4) float32,
    perhaps smaller.
    """
    corners = low.triangles.ravel()
    points = local_space_of([low]).points(low)[low.vertices[corners]]
    away = _towards_viewer(points)
    matrix, up, right = _view(points, away)
    light = np.append(away + 0.7 * up - 0.5 * right, 0.0)
    shading = lit.shading(low.normal_matrix, light, read=normal_channels.reading(settings.map))
    tangents = np.zeros((len(low.normals), 4), np.float32) if low.tangents is None else low.tangents
    attributes = {"position": points, "normal": low.normals[corners], "tangent": tangents[corners]}
    into = target.get("picture of low", FINER * side, FINER * side, "RGBA32F", "DEPTH_COMPONENT32F")
    with target.drawing(into, writes_depth=True):
        for tile, chosen, uv in _by_tile(low.uv[corners], tiles, is_udim=settings.sampling.udim):
            batch = mesh_upload.upload_corners(
                uv=uv, **{name: np.ascontiguousarray(values[chosen]) for name, values in attributes.items()}
            )
            texels = np.ascontiguousarray(tiles[tile], np.float32)
            data = gpu.types.Buffer("FLOAT", texels.shape, texels)
            texture = gpu.types.GPUTexture(texels.shape[1::-1], format="RGBA32F", data=data)
            lit.draw(batch, texture, matrix, shading)
    pixels = np.empty((FINER * side, FINER * side, 4), np.float32)
    into.read(pixels)
    return pixels.reshape(side, FINER, side, FINER, 4).mean(axis=(1, 3))


def _by_tile(
    uv: np.ndarray, tiles: Mapping[int, np.ndarray], *, is_udim: bool
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """For each tile: the corners (n,) of its triangles, and their UVs (n, 2) float32 within it. uv: (3 T, 2).

    Without UDIM there is one tile, which repeats.
    """
    places = np.floor(uv.reshape(-1, 3, 2).mean(axis=1))
    for tile in tiles:
        chosen = (places == udim.place(tile)).all(axis=1) if is_udim else np.ones(len(places), bool)
        if chosen.any():
            corners = np.repeat(chosen, 3)
            yield tile, corners, uv[corners] - np.repeat(places[chosen], 3, axis=0).astype(np.float32)


def _towards_viewer(points: np.ndarray) -> np.ndarray:
    """The direction from the mesh to the viewer. An open mesh turns its front to him: its normals do not add up to zero.

    points: (3 T, 3), the corners of the triangles.
    """
    first, second, third = np.moveaxis(points.reshape(-1, 3, 3).astype(np.float64), 1, 0)
    areas = np.cross(second - first, third - first)
    lean = areas.sum(axis=0) / max(np.linalg.norm(areas, axis=1).sum(), 1e-30)
    towards = TOWARDS_VIEWER / np.linalg.norm(TOWARDS_VIEWER) + 2.0 * lean
    return towards / max(np.linalg.norm(towards), 1e-30)


def _view(points: np.ndarray, away: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The matrix (4, 4) from the points' space to clip space, which fills the picture, and the directions up and right."""
    right = np.cross((0.0, 0.0, 1.0), away)
    right = np.array((1.0, 0.0, 0.0)) if np.linalg.norm(right) < 1e-3 else right / np.linalg.norm(right)
    up = np.cross(away, right)
    axes = np.array((right, up, -away))  # clip space is nearer where z is less
    seen = points @ axes.T
    least, most = seen.min(axis=0), seen.max(axis=0)
    scales = np.array((*2 * [2.0 * FILLED / max((most - least)[:2].max(), 1e-30)], 1.0 / max((most - least)[2], 1e-30)))
    matrix = np.eye(4)
    matrix[:3, :3] = axes * scales[:, None]
    matrix[:3, 3] = -scales * (least + most) / 2.0
    return matrix, up, right
