# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures how far the high surface lies from the low one, for ray distances that the settings do not set."""

from collections.abc import Sequence

import gpu
import numpy as np

from ...core import udim
from ...core.declarations.choices import Hit
from ...core.progress import Pace
from ...passes import target
from ...passes.bake import cast, rays

PROBE_SIZE = 256
"""The most rays a side that are cast."""
QUANTILE = 0.999
"""Distances beyond this quantile are outliers: rays that pass an edge and hit a surface behind it."""
RESERVE = 1.5
"""Factor on the measured distances: the surface between two measured texels may lie farther away."""
WHOLE_WORLD = 8.0
"""Longer than any distance in the local space of the high meshes, if the low mesh touches them."""
ROOM = 0.03
"""Share of the low mesh's diagonal that rays search on both sides at least, if hits have owners: parts that stand off the
surface are few, so that the quantile does not see them."""


def measure(
    tables: cast.Tables,
    ray_mesh: gpu.types.GPUBatch,
    directions: rays.Directions,
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
    drawn = target.get("rays", width, height, "RGBA32F", "RGBA32F")
    found = []
    for tile in tiles:
        rays.draw(drawn, ray_mesh, udim.uv_to_clip(tile), directions, start_offset=WHOLE_WORLD, start_on_cage=has_cage)
        found.append(_probe(tables, drawn, Hit.OUTERMOST if has_cage else Hit.NEAREST, facing_only))
    heights = np.concatenate(found)
    if has_cage:
        return 0.0, _with_reserve(-heights) if heights.size else WHOLE_WORLD
    return _with_reserve(heights[heights > 0.0]), _with_reserve(-heights[heights <= 0.0])


def _probe(tables: cast.Tables, drawn: target.Target, rule: Hit, facing_only: bool) -> np.ndarray:
    """The heights (N,) float32 of the hits above the low surface, or above the cage for OUTERMOST."""
    hits = target.get("hits", drawn.width, drawn.height, "RGBA32UI")
    found = target.get("high", drawn.width, drawn.height, "RGBA32F")
    for rows in Pace().slices(drawn.height):
        cast.trace(
            hits,
            drawn,
            tables,
            None,
            rule=rule,
            inside=WHOLE_WORLD,
            max_t=2.0 * WHOLE_WORLD,
            facing_only=facing_only,
            rows=rows,
        )
        hits.finish()
    cast.heights(found, hits, drawn)
    heights, away = (np.empty((drawn.height, drawn.width, 4), np.float32) for _ in range(2))
    found.read(heights)
    if rule == Hit.OUTERMOST:
        drawn.read(away, slot=1)
        heights[..., 0] -= away[..., 3]
    return heights[..., 0][heights[..., 3] > 0.0]


def _with_reserve(distances: np.ndarray) -> float:
    """A distance that includes all of `distances` but the outliers, with some reserve."""
    smallest = 1e-4  # rays must start a little away from surfaces that coincide
    return max(smallest, RESERVE * float(np.quantile(distances, QUANTILE))) if distances.size else smallest
