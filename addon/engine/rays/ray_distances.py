# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures how far the high surface lies from the low one, for ray distances that the settings do not set."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import gpu
import numpy as np

from ...core import udim
from ...core.declarations.choices import Hit
from ...core.progress import Pace
from ...mesh.local_space import FARTHEST
from ...passes import target
from ...passes.bake import cast, rays
from ...passes.bake.owners import Owners
from . import tracing

PROBE_SIZE = 256
"""The most rays a side that are cast."""
PART_PROBE_SIZE = 128
"""The most rays a side that look for parts that stand off: they go farther, and ask for owners."""
QUANTILE = 0.999
"""Distances beyond this quantile are outliers: rays that pass an edge and hit a surface behind it."""
RESERVE = 1.5
"""Factor on the measured distances: the surface between two measured texels may lie farther away."""
WHOLE_WORLD = 8.0
"""Longer than any distance in the local space of the high meshes, if the low mesh touches them."""
FARTHEST_PART = 4.0
"""In low_surface.ROOM. Parts that stand off farther need an extrusion that is set."""
MOST_PARTS = 0.25
"""The largest share of the low surface that parts may cover. What covers more is another layer, which the low mesh lacks."""
PART_RESERVE = 1.1
"""Factor on the measured height of parts that stand off."""
DIGITS = 3
"""The significant digits of measured figures on which all rays depend. GPUs round measurements differently."""


@dataclass(frozen=True)
class Probe:
    """Some of the rays of a bake.

    size: width and height of the map. tiles: its UDIM tiles. The others are as rays.draw and cast.trace take them.
    """

    tables: cast.Tables
    ray_mesh: gpu.types.GPUBatch
    directions: rays.Directions
    size: tuple[int, int]
    tiles: Sequence[int]

    def drawn(
        self, *, start_offset: float, start_on_cage: bool = False, most: int = PROBE_SIZE
    ) -> Iterator[target.Target]:
        """The rays of each tile, at most `most` along u and v. The next tile overwrites them."""
        width, height = (min(side, most) for side in self.size)
        into = target.get("rays", width, height, "RGBA32F", "RGBA32F")
        for tile in self.tiles:
            rays.draw(
                into,
                self.ray_mesh,
                udim.uv_to_clip(tile),
                self.directions,
                start_offset=start_offset,
                start_on_cage=start_on_cage,
            )
            yield into


def measure(probe: Probe, *, has_cage: bool, facing_only: bool) -> tuple[float, float]:
    """How far the high surface lies outside and inside the low one, with some reserve, in units of the rays' local space.

    With a cage, rays start on it, and only the distance inside is measured.
    """
    rule = Hit.OUTERMOST if has_cage else Hit.NEAREST
    heights = np.concatenate(
        [
            _heights(probe.tables, drawn, rule, facing_only)
            for drawn in probe.drawn(start_offset=WHOLE_WORLD, start_on_cage=has_cage)
        ]
    )
    if has_cage:
        return 0.0, _with_reserve(-heights) if heights.size else WHOLE_WORLD
    return _with_reserve(heights[heights > 0.0]), _with_reserve(-heights[heights <= 0.0])


def with_room(
    measured: tuple[float, float], max_distance: float | None, probe: Probe, owners: Owners
) -> tuple[float, float]:
    """The two distances that `measure` found, with room for all parts of the high meshes that belong to the low mesh.

    max_distance: the length of the rays in units of their local space, if the settings have one.
    """
    outside, inside = measured
    farthest = max(outside, FARTHEST_PART * owners.room)
    height = _standing_off(probe, owners, farthest=farthest, inside=max(inside, owners.room))
    wanted = max(owners.room, min(rounded(PART_RESERVE * height), farthest))
    if max_distance is not None:  # the rays must still reach as far inside as was measured
        wanted = min(wanted, max_distance - inside)
    return max(outside, wanted), max(inside, owners.room)


def rounded(figure: float) -> float:
    """`figure` with DIGITS significant digits."""
    return float(f"{figure:.{DIGITS}g}")


def _standing_off(probe: Probe, owners: Owners, *, farthest: float, inside: float) -> float:
    """How high above the low surface parts stand off that belong to it, if that is farther than its room; else 0.

    Rays run from `farthest` outside it to `inside` it.
    """
    highest, covered, texels_of_low = 0.0, 0, 0
    for drawn in probe.drawn(start_offset=farthest, most=PART_PROBE_SIZE):
        texels = traced(probe.tables, owners, drawn, rule=Hit.OWN, inside=inside, max_t=FARTHEST, facing_only=True)
        heights, is_not_owned, _, alpha = np.moveaxis(texels, -1, 0)
        is_part = (alpha > 0.0) & (is_not_owned == 0.0) & (heights > owners.room)
        highest = max(highest, float(heights[is_part].max(initial=0.0)))
        covered, texels_of_low = covered + np.count_nonzero(is_part), texels_of_low + np.count_nonzero(alpha)
    return highest if covered <= MOST_PARTS * texels_of_low else 0.0


def _heights(tables: cast.Tables, drawn: target.Target, rule: Hit, facing_only: bool) -> np.ndarray:
    """The heights (N,) float32 of the hits above the low surface, or above the cage for OUTERMOST."""
    texels = traced(
        tables, None, drawn, rule=rule, inside=WHOLE_WORLD, max_t=2.0 * WHOLE_WORLD, facing_only=facing_only
    )
    heights = texels[..., 0]
    if rule == Hit.OUTERMOST:
        away = np.empty_like(texels)
        drawn.read(away, slot=1)
        heights -= away[..., 3]
    return heights[texels[..., 3] > 0.0]


def traced(tables: cast.Tables, owners: Owners | None, drawn: target.Target, **options) -> np.ndarray:
    """What cast.heights writes, (height, width, 4) float32. options: of cast.trace."""
    hits = target.get("hits", drawn.width, drawn.height, "RGBA32UI")
    found = target.get("high", drawn.width, drawn.height, "RGBA32F")
    for _ in tracing.traced(hits, drawn, tables, owners, pace=Pace(), **options):
        pass
    cast.heights(found, hits, drawn)
    texels = np.empty((drawn.height, drawn.width, 4), np.float32)
    found.read(texels)
    return texels


def _with_reserve(distances: np.ndarray) -> float:
    """A distance that includes all of `distances` but the outliers, with some reserve."""
    smallest = 1e-4  # rays must start a little away from surfaces that coincide
    return max(smallest, RESERVE * float(np.quantile(distances, QUANTILE))) if distances.size else smallest
