# SPDX-License-Identifier: GPL-3.0-or-later
"""Leaves out triangles of the high meshes that are there twice, and patches that lie behind the surface: they see nothing of
the outside from either side, and the low mesh does not need them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.progress import Timings
from ..mesh import corner_normals, orientation
from ..mesh.triangle_mesh import Mesh
from ..mesh.triangles import transformed
from . import tree_cache
from .face_openness import openness
from .high_patches import SURE, HighPatches, corners_in
from .mend_trials import FEWEST_PLACES, Trials

FIRST_RAYS, ALL_RAYS = 8, 64
"""From each side of a triangle, to see the outside: first for all, then for those that seem to be hidden."""
HIDDEN = 0.02
"""A side that sees less of the outside, as a share of a hemisphere, is hidden."""
PEEPING = 0.2
"""The share of a hidden patch that may see the outside, as through a hole."""
NEEDED, FEWEST = 0.5, 4
"""A hidden patch stays if this share of the places that show it, and so many, have no hit of their own without it."""
SHOWN = 0.5
"""What shows this share of itself is no hidden patch."""
HARM, SPARE = 1e-3, 0.1
"""In a mesh without conflicts, patches that are against the low mesh are left out only if they take at least the first share of
its hits, and at most the second share of these places needs them."""


@dataclass(frozen=True)
class LeftOut:
    """What is left out of high meshes so that their outer surface stays alone.

    Attributes:
        masks: Triangles (T,) bool of each mesh.
        twice, hidden: How many of them are there twice, and lie behind the surface.
    """

    masks: list[np.ndarray]
    twice: int
    hidden: int


def hidden_and_twice(
    patches: HighPatches, turned: Sequence[np.ndarray], trials: Trials | None, *, may_be_twice: bool = False
) -> LeftOut:
    """What is left out of the high meshes of `patches`.

    Args:
        turned: the triangles (T,) bool of each mesh that are turned over.
        may_be_twice: whether triangles may be there twice.
    """
    highs = [
        corner_normals.wound_over(high, mask) if mask.any() else high
        for high, mask in zip(patches.meshes.highs, turned, strict=True)
    ]
    left_out, hidden = [np.zeros(len(high.triangles), bool) for high in highs], 0
    if may_be_twice:
        left_out = _twice(highs, turned, patches, trials)
    twice = sum(int(np.count_nonzero(mask)) for mask in left_out)
    patches_hidden = [] if trials is None else _hidden(highs, turned, patches, trials)
    for mask, one, each in zip(left_out, patches.of, patches_hidden, strict=False):
        more = ~mask & each[one.labels]
        if np.array_equal(more, ~mask):  # a whole object was meant
            continue
        mask[more] = True
        hidden += int(np.count_nonzero(more))
    return LeftOut(left_out, twice, hidden)


def _twice(
    highs: Sequence[Mesh], turned: Sequence[np.ndarray], patches: HighPatches, trials: Trials | None
) -> list[np.ndarray]:
    """Which triangles (T,) bool of each mesh are in the place of an earlier one that points to the same side, or of one that
    points to the other side and that the low mesh needs more: rays that start between the two go nowhere."""
    corners = [high.vertices[high.triangles] for high in highs]
    copies = [orientation.copies(high.positions, each)[0] for high, each in zip(highs, corners, strict=True)]
    if trials is None:
        return copies
    pairs = [orientation.opposites(high.positions, each) for high, each in zip(highs, corners, strict=True)]
    pairs = [each[~same[each].any(axis=1)] for each, same in zip(pairs, copies, strict=True)]
    if not any(len(each) for each in pairs):
        return copies
    worth = []
    before = trials.shown(turned)
    shows = trials.split(before.counts(np.ones(len(before.patches), bool), trials.count))
    for side in range(2):
        left_out = [np.zeros(len(same), bool) for same in copies]
        for mask, each in zip(left_out, pairs, strict=True):
            mask[each[:, side]] = True
        after = trials.shown(turned, left_out)
        worth.append(trials.split(before.counts(after.patches < 0, trials.count)))
    for number, (one, same, each) in enumerate(zip(patches.of, copies, pairs, strict=True)):
        patch = one.labels[each]
        needs = np.stack([worth[side][number][patch[:, side]] for side in range(2)], axis=1)
        takes = shows[number][patch]
        is_spare = (needs <= SPARE * takes) | (needs <= SPARE * needs[:, ::-1])
        # Of two that nothing needs, a solid that points outward stays, else that which agrees with the low mesh near it.
        right = patches.agreements[number] + 2.0 * patches.is_outward(number, one.is_closed)
        goes = np.where(is_spare.all(axis=1), right[patch[:, 1]] <= right[patch[:, 0]], is_spare[:, 1]).astype(int)
        some = is_spare.any(axis=1)
        same[each[some, goes[some]]] = True
    return copies


def _hidden(
    highs: Sequence[Mesh], turned: Sequence[np.ndarray], patches: HighPatches, trials: Trials
) -> list[np.ndarray]:
    """Which patches (count,) bool of each mesh are left out. highs: with their triangles turned over."""
    asked_of = []
    for number, one in enumerate(patches.of):
        asked = _may_be_hidden(patches, number)
        if one.pairs is None:  # what was turned over is right now
            asked[one.labels[turned[number]]] = False
        if asked.any() and one.pairs is not None:
            asked &= ~sees_outside_of(patches, number, highs[number], asked, trials.scene)
        asked_of.append(np.zeros(one.count, bool) if asked.all() else asked)
    if not any(each.any() for each in asked_of):
        return asked_of
    before, after = (trials.shown(turned, out) for out in (None, _triangles(patches, asked_of)))
    shows = trials.split(before.counts(np.ones(len(before.patches), bool), trials.count))
    even = trials.split(before.counts(np.arange(len(before.patches)) < before.spread, trials.count))
    needs = trials.split(before.counts(after.patches < 0, trials.count))
    harms = [np.zeros(0, bool)] * len(asked_of)
    for number, one in enumerate(patches.of):
        if one.pairs is None:
            asked_of[number] &= (even[number] >= FEWEST_PLACES) & (needs[number] <= SPARE * shows[number])
            harms[number] = even[number][asked_of[number]]
        else:
            is_doubtful = (patches.is_dirty(number) | one.is_closed) & (even[number] < SHOWN * trials.expected(number))
            is_spare = is_doubtful & (needs[number] < np.maximum(NEEDED * shows[number], FEWEST))
            asked_of[number] &= is_spare | (shows[number] < FEWEST_PLACES)
    if np.concatenate(harms).sum() < HARM * before.spread:
        asked_of = [each & (one.pairs is not None) for each, one in zip(asked_of, patches.of, strict=True)]
    return asked_of


def _may_be_hidden(patches: HighPatches, number: int) -> np.ndarray:
    """Which patches (count,) bool of a mesh may be left out.

    All but those that are closed and point outward without a conflict; of a mesh without conflicts, only those that are against
    the low mesh, or closed and point inward.
    """
    one = patches.of[number]
    if one.pairs is not None:
        return patches.is_dirty(number) | ~patches.is_outward(number, one.is_closed)
    volumes = patches.volumes(number, one.is_closed)
    return (volumes < 0.0) | (~one.is_closed & (patches.agreements[number] < -SURE))


def _triangles(patches: HighPatches, chosen: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The triangles (T,) bool of some patches (count,) bool of each mesh."""
    return [some[one.labels] for one, some in zip(patches.of, chosen, strict=True)]


def sees_outside_of(
    patches: HighPatches,
    number: int,
    high: Mesh,
    asked: np.ndarray,
    scene: tree_cache.RayScene,
    *,
    least: float = PEEPING,
) -> np.ndarray:
    """Which patches (count,) bool of a mesh see something of the outside; of those not asked for (count,) bool, all do.

    high: the mesh with its triangles turned as they are meant. least: the share of a patch that must see it.
    """
    some = patches.samples[number]
    is_open, seen = np.zeros(len(some.triangles), bool), ~asked
    # What covers the front is hit by the rays that come from the back, too: without the patch, they see about the same. So the
    # back counts only where the front is not known, and for meshes that nobody spoiled.
    has_back = np.abs(patches.agreements[number]) <= SURE
    if patches.of[number].pairs is None:
        has_back[:] = True
    for count in (FIRST_RAYS, ALL_RAYS):  # most see much of it
        left = ~seen[some.patches]
        if left.any():
            corners = corners_in(high, some.triangles[left], scene.local_space)
            is_open[left] = _is_open(scene, corners, count, has_back[some.patches][left])
            seen = seen | (some.shares(is_open) > least)
    return seen


def sees_outside(mesh: Mesh, places: np.ndarray, triangles: np.ndarray, timings: Timings) -> np.ndarray:
    """Which places (N,) bool on a mesh see something of the outside from one of their sides.

    If the mesh has too many triangles for rays, all do.

    Args:
        places: (N, 3) float, in the mesh's own space.
        triangles: (N,) int, those that the places lie on.
    """
    is_open = np.ones(len(places), bool)
    if tree_cache.fits([mesh]):
        scene = tree_cache.trees.ray_scene_of([mesh], timings)
        space = scene.local_space
        corners = corners_in(mesh, triangles, space)
        corners -= corners.mean(axis=1, keepdims=True)  # rays start in the middle
        corners += ((transformed(places, mesh.to_world) - space.origin) / space.size)[:, None].astype(np.float32)
        is_open[:] = False
        for count in (FIRST_RAYS, ALL_RAYS):
            is_open[~is_open] = _is_open(scene, corners[~is_open], count, ~is_open[~is_open])
    return is_open


def _is_open(scene: tree_cache.RayScene, corners: np.ndarray, rays_of_each: int, has_back: np.ndarray) -> np.ndarray:
    """Which triangles (N,) bool see the outside from their front, or from their back where has_back (N,) says so. corners:
    (N, 3, 3) in the scene's local space."""
    if not len(corners):
        return np.zeros(0, bool)
    sides = np.concatenate([corners, corners[has_back][:, ::-1]])
    front, back = np.split(openness(scene.tables, sides, rays_of_each), [len(corners)])
    front[has_back] = np.maximum(front[has_back], back)
    return front > HIDDEN
