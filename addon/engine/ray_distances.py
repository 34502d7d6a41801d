# SPDX-License-Identifier: GPL-3.0-or-later
"""How far the high surface really lies from the low one: distances for rays when nobody has set them."""

from collections.abc import Sequence

import gpu
import numpy as np

from ..core import udim
from ..core.progress import Pace
from ..passes import target
from ..passes.bake import cast, gbuffer

PROBE_SIZE = 256
"""Rays a side, at most, that are sent both ways to find out."""
QUANTILE = 0.999
"""Of the probes, those that lie farther are outliers: rays that slip past a rim and hit something behind."""
SPARE = 1.5
"""How much farther than the probes' farthest rays may start and go: between two probes there is more to find."""
WHOLE_WORLD = 8.0
"""As far as anything can be in a frame around the high meshes that the low one touches."""


def measure(
    tables: cast.Tables,
    rays: gpu.types.GPUBatch,
    size: tuple[int, int],
    tiles: Sequence[int],
    *,
    has_cage: bool,
    facing_only: bool,
) -> tuple[float, float]:
    """How far the high surface lies outside and inside the low one, in the frame's units, with something to spare.

    size: the map's width and height; tiles: its UDIM tiles. With a cage rays start where it says, and only how far they go
    is measured.
    """
    width, height = (min(side, PROBE_SIZE) for side in size)
    places = target.get("rays", width, height, "RGBA32F", "RGBA32F")
    inwards, outwards = [], []
    for tile in tiles:
        gbuffer.draw(places, rays, udim.uv_to_clip(tile))
        inwards.append(_probe(tables, places, -1.0, facing_only))
        if not has_cage:
            # Seen from the low surface, a high triangle that lies outside turns its front away from the ray.
            outwards.append(_probe(tables, places, 1.0, facing_only=False))
    inwards = np.concatenate(inwards)
    if has_cage:
        found = inwards[inwards >= 0.0]
        return 0.0, _spare(found) if found.size else WHOLE_WORLD
    outwards = np.concatenate(outwards)
    inwards = np.where(inwards < 0.0, np.inf, inwards)
    outwards = np.where(outwards < 0.0, np.inf, outwards)
    is_outside = outwards < inwards
    outside, inside = outwards[is_outside], inwards[~is_outside & np.isfinite(inwards)]
    return _spare(outside), _spare(inside)


def _probe(tables: cast.Tables, places: target.Target, direction_sign: float, facing_only: bool) -> np.ndarray:
    """How far each ray goes, (N,) float32 for the texels that the low mesh covers; -1 where it hits nothing."""
    hits = target.get("hits", places.width, places.height, "RGBA32UI")
    found = target.get("high", places.width, places.height, "RGBA32F")
    for rows in Pace().slices(places.height):
        cast.trace(
            hits,
            places,
            tables,
            direction_sign=direction_sign,
            start_offset=1e-5,
            max_t=WHOLE_WORLD,
            facing_only=facing_only,
            rows=rows,
        )
        hits.finish()
    cast.distances(found, hits)
    far = np.empty((places.height, places.width, 4), np.float32)
    covered = np.empty_like(far)
    found.read(far)
    places.read(covered)
    return far[..., 0][covered[..., 3] > 0.0]


def _spare(distances: np.ndarray) -> float:
    """A distance that leaves room for all but the outliers of `distances`."""
    smallest = 1e-4  # of the frame: surfaces that coincide are found from a hair's breadth away
    return max(smallest, SPARE * float(np.quantile(distances, QUANTILE))) if distances.size else smallest
