# SPDX-License-Identifier: GPL-3.0-or-later
"""Which texels lie too close to another UV island, or to the border of the map, for the smaller mip levels."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.settings import Settings
from ..mesh import uv_islands
from ..mesh.triangle_mesh import Mesh
from ..passes.audit import triangle_ids
from .sparse_maps import Sparse, at_most

PROBE = 256
"""Texels a side, at most, that are looked at when nobody asks for all, unless gaps are too narrow for that."""
MOST = 4096
"""The same when somebody does: a larger map is looked at in steps."""


@dataclass(frozen=True)
class Found:
    """Of the texels of one tile that `grid` names, (height, width) each: which are covered, and which of these lie too close
    to another island, or to the border."""

    covered: np.ndarray
    close: np.ndarray
    border: np.ndarray


def needed(settings: Settings) -> int:
    """How many texels there must be between islands: as many as one of the last mip level that counts is wide. Half as
    many are needed to the border, past which readers that repeat the map find what lies on its other side."""
    return 2**settings.mips


def grid(settings: Settings, most: int = PROBE) -> Sparse:
    """The texels that are looked at: at most so many a side, and yet two on what has to be between islands."""
    sparse = at_most((settings.width, settings.height), most)
    finest = max(1, needed(settings) // 2)
    if most == PROBE:
        sparse = replace(sparse, steps=tuple(min(step, finest) for step in sparse.steps))
    return sparse if max(sparse.small) <= MOST else at_most(sparse.size, MOST)


def find(low: Mesh, tiles: Sequence[int], settings: Settings, sparse: Sparse, *, overlaps: bool) -> Iterator[Found]:
    """What lies too close on each of the tiles. overlaps: whether triangles share texels."""
    if overlaps:
        alone = uv_islands.without_copies(low)
        low = replace(low, triangles=low.triangles[alone], faces=low.faces[alone])
    islands = uv_islands.islands(uv_islands.welded(low))
    drawn = [triangle_ids.upload(low.triangles, low.uv, islands + 1)]
    if overlaps:  # what lies on top of each other is not close but in one place: seen from below as well
        drawn.append(triangle_ids.upload(low.triangles[::-1], low.uv, islands[::-1] + 1))
    reach = [max(1, needed(settings) // step) for step in sparse.steps]
    for tile in tiles:
        seen = [
            next(triangle_ids.layers(batch, sparse.small, sparse.uv_to_clip(tile))).astype(np.int32) for batch in drawn
        ]
        ids = _stacked(*seen, len(islands)) if overlaps else seen[0]
        covered = ids > 0
        border = np.zeros(ids.shape, bool)
        if not settings.udim:  # tiles are not repeated
            border = _near_border(ids, reach[0] // 2) | _near_border(ids.T, reach[1] // 2).T
        yield Found(covered, _near_others(ids, reach), border & covered)


def _stacked(above: np.ndarray, below: np.ndarray, count: int) -> np.ndarray:
    """The numbers of islands (height, width), those that lie on each other as one."""
    differ = above != below
    pairs = np.unique(np.stack([above[differ], below[differ]], axis=1), axis=0)
    return uv_islands.connected_components(pairs, count + 1)[above] if len(pairs) else above


def _near_others(ids: np.ndarray, reach: Sequence[int]) -> np.ndarray:
    """Which texels of islands, 0 for none, lie at most `reach` along u and v from one of another island."""
    if ids.max() == ids[ids > 0].min(initial=ids.max()):  # one island alone
        return np.zeros(ids.shape, bool)
    unknown = np.int32(2**31 - 1)
    most = _slide(_slide(ids, reach[0], np.maximum).T, reach[1], np.maximum).T
    least = np.where(ids > 0, ids, unknown)
    least = _slide(_slide(least, reach[0], np.minimum).T, reach[1], np.minimum).T
    # A window that holds two numbers: all that it covers is close, seen from the texel that it begins on.
    mixed = np.pad(most > least, [(reach[1], 0), (reach[0], 0)])
    covered = _slide(_slide(mixed, reach[0], np.logical_or).T, reach[1], np.logical_or).T
    return covered[: ids.shape[0], : ids.shape[1]] & (ids > 0)


def _slide(values: np.ndarray, reach: int, take: np.ufunc) -> np.ndarray:
    """What `take` makes of each value of (rows, N) and the `reach` behind it in its row, of fewer at its end."""
    result, done = values.copy(), 1
    reach = min(reach, values.shape[1] - 1)
    while done <= reach:
        step = min(done, reach + 1 - done)
        # What lies ahead is read before it is written: numpy takes care of arrays that overlap.
        take(result[:, :-step], result[:, step:], out=result[:, :-step])
        done += step
    return result


def _near_border(ids: np.ndarray, reach: int) -> np.ndarray:
    """Which texels (rows, N) lie less than `reach` from either end of their row, unless the same island, 0 for none, goes
    on at the other end."""
    reach = max(1, min(reach, ids.shape[1] // 2))
    first, last = ids[:, :reach].max(axis=1), ids[:, -reach:].max(axis=1)
    result = np.zeros(ids.shape, bool)
    result[:, :reach] = result[:, -reach:] = (first != last)[:, None]
    return result
