# SPDX-License-Identifier: GPL-3.0-or-later
"""Counts the texels whose rays missed, or whose hits are doubtful, by triangles of the low mesh."""

from collections.abc import Sequence

import numpy as np

from ...core.udim import UvToClip
from ...passes import target
from ...passes.bake import cast
from .ray_casting import RayCast

ON_SURFACE = 1e-3
"""In local space. A hit this close to the low surface is the texel's own, whatever rounding makes of its owner."""


def count(ray_cast: RayCast, size: tuple[int, int], views: Sequence[UvToClip]) -> tuple[np.ndarray, int]:
    """How many doubtful texels each triangle of the low mesh has, (T,) int, and how many texels there are in all.

    The rays are cast for `views`, each of width and height `size`. Doubtful are misses, hits of backs alone, and hits that the
    texel does not own.
    """
    numbers = ray_cast.low.numbers
    found, of = np.zeros(len(numbers) + 1, np.int64), 0
    drawn = target.get("audit rays", *size, "RGBA32F", "RGBA32F")
    hits = target.get("audit hits", *size, "RGBA32UI")
    heights = target.get("audit far", *size, "RGBA32F")
    places, texels = (np.empty((size[1], size[0], 4), np.float32) for _ in range(2))
    for view in views:
        ray_cast.draw(drawn, view)
        ray_cast.trace(hits, drawn)
        cast.heights(heights, hits, drawn)
        drawn.read(places)
        heights.read(texels)
        height, not_owned, is_back, alpha = np.moveaxis(texels, -1, 0)
        is_foreign = (not_owned > 0.0) & (np.abs(height) > ON_SURFACE)
        is_doubtful = (alpha < 0.0) | is_foreign | (is_back > 0.0)
        found += np.bincount(places[..., 3][is_doubtful].astype(np.int64), minlength=len(found))
        of += int(np.count_nonzero(alpha))
    return found[numbers], of
