# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures how far the high surface lies from the low one, for ray distances that the settings do not set."""

from collections.abc import Sequence

import gpu
import numpy as np

from ...core import udim
from ...core.progress import Pace
from ...passes import target
from ...passes.bake import cast, gbuffer

PROBE_SIZE = 256
"""The most rays a side that are cast inwards and outwards."""
QUANTILE = 0.999
"""Distances beyond this quantile are outliers: rays that pass an edge and hit a surface behind it."""
RESERVE = 1.5
"""Factor on the measured distances: the surface between two measured texels may lie farther away."""
WHOLE_WORLD = 8.0
"""Longer than any distance in the local space of the high meshes, if the low mesh touches them."""


def measure(
    tables: cast.Tables,
    ray_mesh: gpu.types.GPUBatch,
    size: tuple[int, int],
    tiles: Sequence[int],
    *,
    has_cage: bool,
    facing_only: bool,
) -> tuple[float, float]:
    """How far the high surface lies outside and inside the low one, with some reserve, in units of the rays' local space.

    size: width and height of the map. tiles: its UDIM tiles. With a cage, rays start on it, and only the distance inside is
    measured.
    """
    width, height = (min(side, PROBE_SIZE) for side in size)
    rays = target.get("rays", width, height, "RGBA32F", "RGBA32F")
    inwards, outwards = [], []
    for tile in tiles:
        gbuffer.draw(rays, ray_mesh, udim.uv_to_clip(tile))
        inwards.append(_probe(tables, rays, -1.0, facing_only))
        if not has_cage:
            # These rays reach high triangles outside the low surface from behind.
            outwards.append(_probe(tables, rays, 1.0, facing_only=False))
    inwards = np.concatenate(inwards)
    if has_cage:
        found = inwards[inwards >= 0.0]
        return 0.0, _with_reserve(found) if found.size else WHOLE_WORLD
    outwards = np.concatenate(outwards)
    inwards = np.where(inwards < 0.0, np.inf, inwards)
    outwards = np.where(outwards < 0.0, np.inf, outwards)
    is_outside = outwards < inwards
    outside, inside = outwards[is_outside], inwards[~is_outside & np.isfinite(inwards)]
    return _with_reserve(outside), _with_reserve(inside)


def _probe(tables: cast.Tables, rays: target.Target, direction_sign: float, facing_only: bool) -> np.ndarray:
    """The length of each ray, (N,) float32 for the texels that the low mesh covers; -1 for a miss."""
    hits = target.get("hits", rays.width, rays.height, "RGBA32UI")
    found = target.get("high", rays.width, rays.height, "RGBA32F")
    for rows in Pace().slices(rays.height):
        cast.trace(
            hits,
            rays,
            tables,
            direction_sign=direction_sign,
            start_offset=1e-5,
            max_t=WHOLE_WORLD,
            facing_only=facing_only,
            rows=rows,
        )
        hits.finish()
    cast.distances(found, hits)
    far = np.empty((rays.height, rays.width, 4), np.float32)
    covered = np.empty_like(far)
    found.read(far)
    rays.read(covered)
    return far[..., 0][covered[..., 3] > 0.0]


def _with_reserve(distances: np.ndarray) -> float:
    """A distance that includes all of `distances` but the outliers, with some reserve."""
    smallest = 1e-4  # rays must start a little away from surfaces that coincide
    return max(smallest, RESERVE * float(np.quantile(distances, QUANTILE))) if distances.size else smallest
