# SPDX-License-Identifier: GPL-3.0-or-later
"""How open the sides of triangles are: the share of the directions in which nothing is."""

import math

import numpy as np

from ..core import udim
from ..core.progress import SLICE_ROWS, Pace
from ..mesh import bvh
from ..mesh.triangles import face_normals
from ..passes import cast, hemisphere, high_in_uv, target
from .ray_casting import TEXEL


def openness(tables: cast.Tables, corners: np.ndarray, rays: int) -> np.ndarray:
    """How open the front of each triangle is, (N,) float32 from 0 to 1, for both sides of all triangles that rays may meet.

    Args:
        tables: what rays meet.
        corners: (N, 3, 3) float32, in the space of the tables, counter-clockwise from the front.
        rays: of each triangle, from its middle.
    """
    count = len(corners)
    nowhere = bvh.Tree(np.arange(count), np.zeros((1, 3, 4), np.float32), 0, np.zeros(3), np.ones(3))
    vertices = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    own = 1 + 2 * np.arange(count, dtype=np.int32)  # one normal for all three corners
    surface = cast.upload(nowhere, corners.reshape(-1, 3), vertices, face_normals(corners).astype(np.float32), own)
    side = max(8, 1 << math.isqrt(max(0, count - 1)).bit_length())
    centers = np.stack(np.divmod(np.arange(count), side)[::-1], axis=1) + 0.5
    uv = ((centers[:, None] + TEXEL) / side).reshape(-1, 2).astype(np.float32)
    hits = target.Target(side, side, ("RGBA32UI",))
    high_in_uv.draw_hits(hits, high_in_uv.upload_for_hits(uv, np.arange(count)), count, udim.uv_to_clip())
    sums = target.Target(side, side, ("RGBA32F",))
    target.clear(sums)
    lattice, occluders = hemisphere.lattice_of(rays), hemisphere.Occluders(tables, two_sided=True)
    height = min(side, SLICE_ROWS * -(-count // (SLICE_ROWS * side)))

    def draw(rows: range, numbers: range, is_first: bool) -> None:
        cast_now = hemisphere.Rays(hits.texture, surface, lattice, numbers, rows, is_first)
        hemisphere.add_openness(sums, cast_now, occluders)

    covered = np.full(height // SLICE_ROWS, float(SLICE_ROWS * side))
    for _ in hemisphere.slices(Pace(), hemisphere.ADD_OPENNESS, (side, height), covered, range(rays), draw=draw):
        pass
    texels = np.empty((side, side, 4), np.float32)
    target.read(sums.texture, texels)
    return texels.reshape(-1, 4)[:count, 3] / rays
