# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds texels that are too close to another UV island, or to the border of the map, for the smaller mip levels."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.settings import SamplingSettings
from ..engine.coverage import Sparse, at_most
from ..mesh import topology, uv_islands
from ..mesh.triangle_mesh import Mesh
from ..passes import audit

QUICK = 256
"""Texels a side, at most, of a quick check, unless gaps are too narrow for it."""
FULL_SIDE = 4096
"""Texels a side, at most, of a full check; a larger map is checked in steps."""


@dataclass(frozen=True)
class Found:
    """The texels of one tile that are too close to another island, of those that `grid` selects, (height, width) bool each.

    Attributes:
        covered: By the mesh.
        close, border: Of the covered ones, those too close to another island, or to the border.
    """

    covered: np.ndarray
    close: np.ndarray
    border: np.ndarray


def needed(sampling: SamplingSettings) -> int:
    """The texels that are needed between islands: the width of one texel of the last mip level in the settings.

    Half as many are needed to the border: a map that repeats has the other half on its opposite side.
    """
    return 2**sampling.mips


def grid(sampling: SamplingSettings, most: int = QUICK) -> Sparse:
    """The texels to check: at most `most` a side, but at least two on the gap that is needed between islands."""
    sparse = at_most(sampling.size, most)
    finest = max(1, needed(sampling) // 2)
    if most == QUICK:
        sparse = replace(sparse, steps=(min(sparse.steps[0], finest), min(sparse.steps[1], finest)))
    return sparse if max(sparse.small) <= FULL_SIDE else at_most(sparse.size, FULL_SIDE)


def find(
    low: Mesh, tiles: Sequence[int], sampling: SamplingSettings, sparse: Sparse, *, overlaps: bool
) -> Iterator[Found]:
    """The texels that are too close, on each of the tiles. overlaps: whether triangles share texels."""
    if overlaps:
        unique = uv_islands.without_copies(low)
        low = replace(low, triangles=low.triangles[unique], faces=low.faces[unique])
    islands = uv_islands.islands(uv_islands.welded(low))
    drawn = [audit.upload_with_ids(low.triangles, low.uv, islands + 1)]
    if overlaps:  # overlapping islands count as one: in reverse order, the hidden ones are drawn last and show
        drawn.append(audit.upload_with_ids(low.triangles[::-1], low.uv, islands[::-1] + 1))
    reach = [max(1, needed(sampling) // step) for step in sparse.steps]
    for tile in tiles:
        layers = [
            next(audit.layers_of_triangles(batch, sparse.small, sparse.uv_to_clip(tile))).astype(np.int32)
            for batch in drawn
        ]
        ids = _stacked(layers[0], layers[1], len(islands)) if overlaps else layers[0]
        covered = ids > 0
        border = np.zeros(ids.shape, bool)
        if not sampling.udim:  # UDIM tiles do not repeat
            border = _near_border(ids, reach[0] // 2) | _near_border(ids.T, reach[1] // 2).T
        yield Found(covered, _near_others(ids, reach), border & covered)


def _stacked(above: np.ndarray, below: np.ndarray, count: int) -> np.ndarray:
    """The numbers of islands (height, width); overlapping islands share one."""
    differ = above != below
    pairs = np.unique(np.stack([above[differ], below[differ]], axis=1), axis=0)
    return topology.connected(count + 1, *pairs.T)[above]


def _near_others(ids: np.ndarray, reach: Sequence[int]) -> np.ndarray:
    """Which texels are at most `reach` along u and v from a texel of another island. ids: 0 is background."""
    if ids.max() == ids[ids > 0].min(initial=ids.max()):  # only one island
        return np.zeros(ids.shape, bool)
    unknown = np.int32(2**31 - 1)
    most = _slide(_slide(ids, reach[0], np.maximum).T, reach[1], np.maximum).T
    least = np.where(ids > 0, ids, unknown)
    least = _slide(_slide(least, reach[0], np.minimum).T, reach[1], np.minimum).T
    # If a window has two numbers, all its texels are close. The result of a window is at its first texel.
    mixed = np.pad(most > least, [(reach[1], 0), (reach[0], 0)])
    covered = _slide(_slide(mixed, reach[0], np.logical_or).T, reach[1], np.logical_or).T
    return covered[: ids.shape[0], : ids.shape[1]] & (ids > 0)


def _slide(values: np.ndarray, reach: int, take: np.ufunc) -> np.ndarray:
    """`take` over each value of (rows, N) and the `reach` values after it in its row, fewer at the end."""
    result, done = values.copy(), 1
    reach = min(reach, values.shape[1] - 1)
    while done <= reach:
        step = min(done, reach + 1 - done)
        # numpy handles overlapping arrays: values ahead are read before they are written.
        take(result[:, :-step], result[:, step:], out=result[:, :-step])
        done += step
    return result


def _near_border(ids: np.ndarray, reach: int) -> np.ndarray:
    """Which texels (rows, N) are less than `reach` from an end of their row, unless the same island continues at the other end.

    ids: 0 is background.
    """
    reach = max(1, min(reach, ids.shape[1] // 2))
    first, last = ids[:, :reach].max(axis=1), ids[:, -reach:].max(axis=1)
    result = np.zeros(ids.shape, bool)
    result[:, :reach] = result[:, -reach:] = (first != last)[:, None]
    return result
