# SPDX-License-Identifier: GPL-3.0-or-later
"""Counts the texels whose rays missed, or whose hits are doubtful, by triangles of the low mesh."""

from collections.abc import Sequence

import numpy as np

from ...core.udim import UvToClip
from ...mesh.triangle_mesh import Mesh
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
        doubts = explorer.doubts(size, view)
        is_doubtful = doubts.missed | doubts.not_owned | doubts.unsure
        found += np.bincount(doubts.triangles[is_doubtful], minlength=len(found))
        of += int(np.count_nonzero(doubts.on_low))
    return found[numbers], of
