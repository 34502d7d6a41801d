# SPDX-License-Identifier: GPL-3.0-or-later
"""Counts the texels whose rays missed, or whose hits are doubtful, by triangles of the low mesh."""

from collections.abc import Sequence

import numpy as np

from ...core.udim import UvToClip
from ...mesh.triangle_mesh import Mesh
from ...passes import target
from ...passes.bake import cast
from .ray_casting import RayCast
from .unsure_texels import Explorer


def count(ray_cast: RayCast, low: Mesh, size: tuple[int, int], views: Sequence[UvToClip]) -> tuple[np.ndarray, int]:
    """How many doubtful texels each triangle of `low` has, (T,) int, and how many texels there are in all.

    The rays are cast for `views`, each of width and height `size`. Doubtful are misses, hits that their texel does not own, and
    what Explorer is unsure about.
    """
    numbers = ray_cast.low.numbers
    found, of = np.zeros(len(numbers) + 1, np.int64), 0
    explorer = Explorer(ray_cast, low)
    for view in views:
        places, is_missed = _misses(ray_cast, size, view)
        doubts = explorer.doubts(size, view)
        is_doubtful = is_missed | doubts.not_owned | doubts.unsure
        found += np.bincount(places[is_doubtful], minlength=len(found))
        of += int(np.count_nonzero(places))
    return found[numbers], of


def _misses(ray_cast: RayCast, size: tuple[int, int], view: UvToClip) -> tuple[np.ndarray, np.ndarray]:
    """The number of the triangle that each texel lies on, (height, width) int64, 0 for none; and which rays missed, bool."""
    drawn = target.get("audit rays", *size, "RGBA32F", "RGBA32F")
    hits = target.get("audit hits", *size, "RGBA32UI")
    found = target.get("audit far", *size, "RGBA32F")
    ray_cast.draw(drawn, view)
    ray_cast.trace(hits, drawn)
    cast.heights(found, hits, drawn)
    places, heights = (np.empty((size[1], size[0], 4), np.float32) for _ in range(2))
    drawn.read(places)
    found.read(heights)
    return places[..., 3].astype(np.int64), heights[..., 3] < 0.0
