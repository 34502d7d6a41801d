# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluates the rays of a bake at points of the low mesh, by the pass that draws the rays of texels."""

from dataclasses import dataclass

import numpy as np

from ...core import udim
from ...mesh.inputs import Meshes
from ...mesh.local_space import LocalSpace
from ...mesh.subdividing import Pieces
from ...passes import target
from ...passes.bake import rays
from . import ray_casting

TEXEL = np.array([(-0.4, -0.3), (0.4, -0.3), (0.0, 0.5)], np.float32)
"""The corners of a triangle that covers the center of one texel alone, in texels from that center."""


@dataclass(frozen=True)
class RayPoints:
    """Rays at points: places (P, 3), unit directions away from the surface (P, 3), 0 where there is none, and the distances
    (P,) outside the surface at which rays start. All float32, in local space."""

    places: np.ndarray
    directions: np.ndarray
    starts: np.ndarray


def evaluate(
    meshes: Meshes, pieces: Pieces, local_space: LocalSpace, directions: rays.Directions, *, extrusion: float
) -> RayPoints:
    """The rays at the points of `pieces`, parts of the low mesh's triangles. extrusion: in units of the local space.

    Needs no UVs: each point gets a texel of its own.
    """
    corners, count = meshes.low.triangles, len(pieces.parents)
    arrays = ray_casting.ray_arrays(meshes, local_space)
    by_point = {
        name: None if values is None else pieces.interpolate(values, corners) for name, values in arrays.items()
    }
    side = max(1, int(np.ceil(np.sqrt(count))))
    centers = np.stack(np.divmod(np.arange(count), side)[::-1], axis=1) + 0.5
    batch = rays.upload(
        np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        np.ones(count, np.int64),
        uv=((centers[:, None] + TEXEL) / side).reshape(-1, 2).astype(np.float32),
        **{name: None if values is None else np.repeat(values, 3, axis=0) for name, values in by_point.items()},
    )
    drawn = target.Target(side, side, ("RGBA32F", "RGBA32F"))
    rays.draw(
        drawn,
        batch,
        udim.uv_to_clip(),
        directions,
        start_offset=extrusion,
        start_on_cage=meshes.cage is not None,
    )
    away = np.empty((side, side, 4), np.float32)
    drawn.read(away, slot=1)
    away = away.reshape(-1, 4)[:count]
    return RayPoints(by_point["position"], away[:, :3], away[:, 3])
