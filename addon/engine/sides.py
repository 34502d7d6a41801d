# SPDX-License-Identifier: GPL-3.0-or-later
"""Decides which patches of the high meshes are turned over: those of which places of the low mesh show more then."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.parts_turned import PartTurned
from .face_openness import openness
from .hidden_faces import sees_outside_of
from .high_patches import SURE, HighPatches, corners_in
from .mend_trials import FEWEST_PLACES, GAIN_OVER_LOSS, Shown, Trials, gains
from .tree_cache import RayScene

CLEAR = 0.5
"""A patch that is against the low mesh by less than this, from 0 to 1, lies perhaps between two of its surfaces, as inside a
shell that stands off: its open side decides."""
OPENER = 0.1
"""By how much more open one side of a patch is than the other, as a share of a hemisphere, if it is the outer one."""
RAYS = 32
"""From each side of a triangle, to see which one is open."""
FRESH, ALL_FRESH = 0.15, 0.5
"""A patch is what the low mesh lacks if at least this share of the places that gain it had no hit of their own, or one on its
other side; the second one if the patch agrees with the low mesh near it."""
PART, SOLID_PART = 0.1, 0.6
"""The least share of a patch without a conflict that must be shown once it is turned over; of one that is closed and lies in
others, as a copy inside or the inner side of a hollow body, the second one."""
OPEN_BACK = 0.4
"""By how much more open the back of a sheet is that stands off what it covers, as a share of a hemisphere."""
OUTSIDE = 0.45
"""What stands off others sees the outside on this share of it."""
MIXED = 0.35
"""The share of the triangles of a patch that point against the others from which most of them say nothing."""
MOST_APART = 4
"""The most open patches, the largest ones, that are turned over one at a time to see which one is better."""
LOST = 0.01
"""The share of the low mesh that may lose its hits by all changes together, unless the others come nearer."""
MUCH = 0.25
"""The share of the places that showed a patch as it was read. If more of them show nothing then, it stays as it was."""
ROUNDS = 4
"""How often patches are turned back at most before the rest stays."""
NAMED = 5
"""The most parts whose gain is told."""


@dataclass(frozen=True)
class Sides:
    """What is turned over.

    Attributes:
        masks: The triangles (T,) bool of each mesh.
        undecided: The patches (count,) bool of each mesh that have no outer side.
        before, after: What places showed, and show now; None where no rays can be cast.
    """

    masks: list[np.ndarray]
    undecided: list[np.ndarray]
    before: Shown | None = None
    after: Shown | None = None


def suspects_of(patches: HighPatches) -> list[np.ndarray]:
    """Which patches (count,) bool of each mesh may be turned over: those that are against the low mesh, those that are closed
    and point inward, and those whose triangles are against each other. Closed ones that point outward are right."""
    suspects = []
    for number, (one, ratio) in enumerate(zip(patches.of, patches.agreements, strict=True)):
        is_sampled = np.bincount(patches.samples[number].patches, minlength=one.count) > 0
        asked, dirty = (ratio <= SURE) & is_sampled, patches.is_dirty(number)
        closed = one.is_closed & ~dirty & (asked if patches.count == 1 else True)
        volumes = patches.volumes(number, closed)
        suspects.append(dirty | (volumes < 0.0) | (asked & ~(volumes > 0.0)))
    return suspects


def decided(patches: HighPatches, trials: Trials, suspects: Sequence[np.ndarray]) -> Sides:
    """Which of the suspects (count,) bool of each mesh are turned over.

    A patch is turned over if places show more of it then, of which some had nothing before; one that nothing shows either way
    is turned only if its triangles are against each other. What shows less than before stays as it was read.
    """
    dirty = [patches.is_dirty(number) for number in range(len(patches.of))]
    solid = [each & one.is_closed for each, one in zip(suspects, patches.of, strict=True)]
    straight = _State(patches, trials, dirty, [np.zeros(one.count, bool) for one in patches.of])
    state, unclear = _turn(straight, [one | other for one, other in zip(dirty, solid, strict=True)])
    sheets = [each & ~one & ~other for each, one, other in zip(suspects, dirty, solid, strict=True)]
    state = _turn_sheets(state, sheets)
    flips = [each.copy() for each in state.flips]
    left = [each & bad & ~flip for each, bad, flip in zip(dirty, unclear, flips, strict=True)]
    undecided = _by_shape(patches, flips, left, trials.scene)
    return _without_worse(_State(patches, trials, dirty, flips), undecided)


class _State:
    """High meshes with some patches turned over, and what places show of them.

    dirty: patches (count,) bool of each mesh whose triangles are turned to the side of most of them. flips: those that are
    turned to the other side.
    """

    def __init__(self, patches: HighPatches, trials: Trials, dirty: Sequence[np.ndarray], flips: Sequence[np.ndarray]):
        self.patches, self.trials, self.dirty, self.flips = patches, trials, dirty, list(flips)
        self.masks = []
        for one, some, flip in zip(patches.of, dirty, flips, strict=True):
            self.masks.append((one.is_against & some[one.labels]) ^ flip[one.labels])
        self.shown = trials.shown(self.masks) if any(each.any() for each in self.masks) else trials.as_read()

    def with_flips(self, more: Sequence[np.ndarray]) -> "_State":
        """The same with more patches (count,) bool turned to the other side."""
        flips = [one | other for one, other in zip(self.flips, more, strict=True)]
        return _State(self.patches, self.trials, self.dirty, flips)


def _turn(before: _State, asked: Sequence[np.ndarray]) -> tuple[_State, list[np.ndarray]]:
    """`before` with those of the patches asked for (count,) bool turned over that are better so; and which ones show about the
    same either way."""
    after, unclear = before.with_flips(asked), None
    # What covers a patch may be turned over with it, and what it gained is gone once that is undone.
    for _ in range(ROUNDS):
        better, equal = _compared(before, after, asked)
        unclear = unclear or equal
        if all(np.array_equal(one, other) for one, other in zip(asked, better, strict=True)):
            break
        asked = better
        after = before.with_flips(asked) if any(each.any() for each in asked) else before
    return after, unclear or []


def _turn_sheets(state: _State, sheets: list[np.ndarray]) -> _State:
    """`state` with those of some open patches (count,) bool turned over that are better so.

    Two of them may gain the same places, as a body and the lining over it: the one whose hits are nearer is turned first.
    """
    for _ in range(MOST_APART):
        if not any(each.any() for each in sheets):
            return state
        after, _ = _turn(state, sheets)
        if after is state or sum(np.count_nonzero(each) for each in sheets) < 2:
            return after
        candidates = [state.with_flips(each) for each in _largest_of(state.patches, sheets)]
        candidates = [one for one in candidates if any(each.any() for each in _compared(state, one, sheets)[0])]
        best = max(candidates, key=lambda one: one.shown.value, default=state)
        if best.shown.value <= max(state.shown.value, after.shown.value):
            return after
        sheets = [each & ~flip for each, flip in zip(sheets, best.flips, strict=True)]
        state = best
    return state


def _largest_of(patches: HighPatches, chosen: Sequence[np.ndarray]) -> list[list[np.ndarray]]:
    """The largest of the chosen patches (count,) bool of each mesh, one at a time."""
    sizes = [one.sizes * some for one, some in zip(patches.of, chosen, strict=True)]
    places = [(size, number, patch) for number, each in enumerate(sizes) for patch, size in enumerate(each) if size]
    largest_alone = []
    for _, number, patch in sorted(places, reverse=True)[:MOST_APART]:
        one = [np.zeros(each.count, bool) for each in patches.of]
        one[number][patch] = True
        largest_alone.append(one)
    return largest_alone


def _compared(before: _State, after: _State, asked: Sequence[np.ndarray]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Which of the patches asked for (count,) bool of each mesh are better turned over, and which show about the same."""
    patches, trials = after.patches, after.trials
    each = gains(before.shown, after.shown, trials.count)
    better, equal = [], []
    for number, (one, flip) in enumerate(zip(patches.of, asked, strict=True)):
        gained, lost, relieved, places, gone, fresh = (trials.split(values)[number] for values in each)
        ratio, dirty, high = patches.agreements[number], patches.is_dirty(number), patches.meshes.highs[number]
        inward = patches.volumes(number, flip & one.is_closed) < 0.0
        hidden = inward & ~dirty
        if hidden.any():
            hidden &= ~sees_outside_of(patches, number, high, hidden, trials.scene)
        parts = np.where(dirty, 0.0, np.where(hidden, SOLID_PART, PART)) * trials.expected(number)
        enough = places >= np.maximum(np.where(dirty, FEWEST_PLACES, FEWEST_PLACES + 1), parts)
        is_better = enough & (gained > GAIN_OVER_LOSS * lost)
        is_lacking = fresh >= np.where(ratio <= SURE, FRESH, ALL_FRESH) * places
        is_lacking |= inward  # what shows more of a solid, and nearer to the low mesh, needs no other reason
        # What stands off, as a rivet or a leaf does, is farther from the low mesh than what it covers. Rays through a solid
        # that points inward hit its far side, which may be the nearer one.
        in_doubt = enough & ~(is_better & is_lacking) & (GAIN_OVER_LOSS * places > gone)
        stands = flip & in_doubt & (inward | _is_mixed(patches, number))
        if stands.any():
            stands &= sees_outside_of(patches, number, high, stands, trials.scene, least=OUTSIDE)
        sheets = flip & in_doubt & ~stands & ~one.is_closed & (ratio < -SURE)
        if sheets.any():
            front, back = _open_sides(patches, number, sheets, trials.scene)
            stands |= sheets & (back - front > OPEN_BACK)
        is_relieved = (
            inward & (relieved > GAIN_OVER_LOSS * (lost + gained)) & (gone - places >= np.maximum(FEWEST_PLACES, parts))
        )
        better.append(flip & ((is_better & is_lacking) | stands | is_relieved))
        equal.append(flip & dirty & ~is_better & (lost <= GAIN_OVER_LOSS * gained) & (places < FEWEST_PLACES))
    return better, equal


def _is_mixed(patches: HighPatches, number: int) -> np.ndarray:
    """Which patches (count,) bool of a mesh have almost as many triangles that point to one side as to the other."""
    one = patches.of[number]
    return one.against > MIXED * one.sizes


def _without_worse(state: _State, undecided: list[np.ndarray]) -> Sides:
    """`state` without the changes by which more places lost all hits of their own than got one."""
    patches, trials, as_read = state.patches, state.trials, state.trials.as_read()
    every = np.ones(len(as_read.patches), bool)
    gone = as_read.counts(state.shown.patches < 0, trials.count)
    came = state.shown.counts(as_read.patches < 0, trials.count)
    worse = trials.split((gone > came) & (gone > MUCH * as_read.counts(every, trials.count)))
    if state.shown.share < as_read.share - LOST and state.shown.value < as_read.value:
        worse = [one | (flip & ~each) for one, flip, each in zip(worse, state.flips, state.dirty, strict=True)]
    if any((one & (other | flip)).any() for one, other, flip in zip(worse, state.dirty, state.flips, strict=True)):
        dirty = [each & ~bad for each, bad in zip(state.dirty, worse, strict=True)]
        state = _State(patches, trials, dirty, [each & ~bad for each, bad in zip(state.flips, worse, strict=True)])
    return Sides(state.masks, undecided, as_read, state.shown)


def by_shape(patches: HighPatches) -> Sides:
    """As `decided`, without the rays of a bake, for more triangles than the GPU takes: patches whose triangles are against
    each other are turned to one side alone."""
    flips = [np.zeros(one.count, bool) for one in patches.of]
    dirty = [patches.is_dirty(number) for number in range(len(patches.of))]
    undecided = _by_shape(patches, flips, dirty, None)
    masks = [
        (one.is_against ^ flip[one.labels]) & some[one.labels]
        for one, flip, some in zip(patches.of, flips, dirty, strict=True)
    ]
    return Sides(masks, undecided)


def largest(patches: HighPatches, trials: Trials, sides: Sides) -> tuple[PartTurned, ...]:
    """The patches with most triangles of those that were turned over, and what they gained."""
    before, after = sides.before, sides.after
    if before is None or after is None:
        return ()
    lost = before.counts(after.patches < 0, trials.count)
    stayed = before.counts(before.patches == after.patches, trials.count)
    shows = after.counts(np.ones(len(after.patches), bool), trials.count)
    every = np.maximum(shows + lost, 1)
    shares = (stayed + lost) / every, shows / every
    named = []
    for number, (high, one, mask) in enumerate(zip(patches.meshes.highs, patches.of, sides.masks, strict=True)):
        sizes = one.sizes
        for patch in np.unique(one.labels[mask]):
            was, now = (float(share[trials.starts[number] + patch]) for share in shares)
            named.append(PartTurned(high.name, int(sizes[patch]), len(one.labels), was, now))
    return tuple(sorted(named, key=lambda part: -part.triangles)[:NAMED])


def _by_shape(
    patches: HighPatches, flips: list[np.ndarray], unclear: Sequence[np.ndarray], scene: RayScene | None
) -> list[np.ndarray]:
    """Decide unclear patches (count,) bool of each mesh without what the low mesh shows, and add those to turn to `flips`:
    closed ones point outward, others as the low mesh near them, or to their open side. Returns the undecided ones."""
    near, undecided = [], [np.zeros(one.count, bool) for one in patches.of]
    for number, (one, ratio) in enumerate(zip(patches.of, patches.agreements, strict=True)):
        closed, is_open = unclear[number] & one.is_closed, unclear[number] & ~one.is_closed
        flips[number] |= closed & (patches.volumes(number, closed) < 0.0)
        flips[number] |= is_open & (ratio < -CLEAR)
        near.append(is_open & (np.abs(ratio) <= CLEAR))
    if scene is None:
        return near
    for number, asked in enumerate(near):
        if asked.any():
            front, back = _open_sides(patches, number, asked, scene)
            flips[number] |= asked & (back - front > OPENER)
            undecided[number] = asked & (np.abs(back - front) <= OPENER) & (front + back > OPENER)
    return undecided


def _open_sides(patches: HighPatches, number: int, asked: np.ndarray, scene: RayScene) -> tuple[np.ndarray, np.ndarray]:
    """How open the fronts and the backs of some patches (count,) bool of a mesh are, (count,) each, from 0 to 1."""
    some = patches.samples[number]
    chosen = asked[some.patches]
    numbers = some.triangles[chosen]
    corners = corners_in(patches.meshes.highs[number], numbers, scene.local_space)
    is_against = patches.of[number].is_against[numbers]
    corners[is_against] = corners[is_against][:, ::-1]
    values = np.zeros((2, len(chosen)))
    values[:, chosen] = np.split(openness(scene.tables, np.concatenate([corners, corners[:, ::-1]]), RAYS), 2)
    front, back = (some.means(side, chosen) for side in values)
    return front, back
