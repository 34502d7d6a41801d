# SPDX-License-Identifier: GPL-3.0-or-later
"""Mends the high meshes for a bake: turns over what points to the wrong side, as seen from the low mesh, leaves out what lies
behind the surface, joins normals across vertices that are not, and smooths them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core.declarations.choices import Method
from ..core.progress import Timings
from ..core.settings import Settings
from ..mesh import corner_normals, orientation
from ..mesh.inputs import Mended, Meshes
from ..mesh.triangle_mesh import Mesh
from . import stacked_uvs, tree_cache, uv_agreement
from .face_openness import openness
from .high_patches import SURE, HighPatches, corners_in, patches_of, places_of
from .method_choice import tiles_to_bake
from .outer_skin import may_be_hidden, one_skin

CLEAR = 0.5
"""A patch that is against the low mesh by less than this, from 0 to 1, lies perhaps between two of its surfaces, as inside a
shell that stands off: its open side decides."""
OPENER = 0.1
"""By how much more open one side of a patch is than the other, as a share of a hemisphere, if it is the outer one."""
DIRTY_LOW = 0.02
"""Share of the area of a low mesh. If more of it is against the rest, it cannot tell the sides."""
INWARD = -0.3
"""As audit.before_bake has it: how much of a closed mesh's surface points inward."""
RAYS = 32
"""From each side of a triangle, to see which one is open."""
ALONE = 0.25
"""The least share of a patch that is the nearest to its places on the low mesh, if it belongs there."""
MUCH = 1e-3
"""Share of the area of the high meshes. Parts with less are crumbs: not to know their sides is not worth a warning."""


def mended(meshes: Meshes, settings: Settings, timings: Timings, before: tuple[Meshes, Meshes] | None = None) -> Meshes:
    """`meshes` with high meshes whose faces point to the sides that the low mesh has there. Clean ones stay the same objects.

    before: earlier meshes, as they were read and the result. What has the same triangles is turned over as it was then.
    """
    tracing = settings.tracing
    with timings.timed("orient"):
        if not (tracing.keep_faces or meshes.is_own_base or not len(meshes.low.triangles)):
            known = None if before is None else _as_before(meshes, *before)
            meshes = _oriented(meshes, settings, timings) if known is None else known
        return _smoothed(meshes, tracing.smooth_high) if tracing.smooth_high else meshes


def notes(meshes: Meshes) -> list[str]:
    """What could not be mended, in sentences."""
    mended = meshes.mended
    if mended is None:
        return []
    found = []
    if mended.low_differs:
        found.append(
            f"The faces of {meshes.low.name!r} point to different sides, so that those of the high mesh, which do so, too, "
            "were not turned over: recalculate the normals of both."
        )
    names = [repr(high.name) for high in meshes.highs]
    if mended.low_is_inside_out:
        found.append(
            f"{meshes.low.name!r} is inside out, and the high mesh is not: the map will be wrong. Recalculate its normals, or "
            "enlarge it if it was shrunk through itself."
        )
    if mended.undecided_share > MUCH:
        parts = [f"{count:,} of {name}" for count, name in zip(mended.undecided, names, strict=True) if count]
        found.append(
            f"No side of some parts is the outer one ({', '.join(parts)}, {mended.undecided_share:.1%} of the surface): they "
            "are baked as they are. Recalculate their normals if their detail is wrong."
        )
    parts = [f"{count:,} of {name}" for count, name in zip(mended.contradicting, names, strict=False) if count]
    if parts:
        found.append(
            f"The faces of some parts cannot point to one side, as those of a Möbius strip ({', '.join(parts)}): the map has "
            "an edge there."
        )
    return found


def _smoothed(meshes: Meshes, rounds: int) -> Meshes:
    found = [corner_normals.smoothed(high, rounds) for high in meshes.highs]
    turned = np.concatenate([degrees for _, degrees in found])
    degrees = tuple(float(np.percentile(turned, share)) for share in (50.0, 95.0)) if len(turned) else (0.0, 0.0)
    mended = replace(meshes.mended or Mended.nothing(meshes.highs), degrees=degrees)
    return replace(meshes, highs=[high for high, _ in found], mended=mended)


def _as_before(meshes: Meshes, read: Meshes, result: Meshes) -> Meshes | None:
    """`meshes`, mended as `read` was; None if their triangles, or the low mesh, have changed."""
    if len(meshes.highs) != len(read.highs) or meshes.low is not read.low:
        return None
    earlier = result.mended or Mended()
    highs = []
    for number, (mesh, before, after) in enumerate(zip(meshes.highs, read.highs, result.highs, strict=True)):
        if mesh is before and not earlier.degrees:
            highs.append(after)
        elif not _same_triangles(mesh, before):
            return None
        elif after is before:
            highs.append(mesh)
        else:
            turned, kept = (of[number] if of else None for of in (earlier.turned, earlier.kept))
            highs.append(_mended_as(mesh, turned, kept))
    return replace(meshes, highs=highs, mended=result.mended and replace(result.mended, degrees=()))


def _mended_as(mesh: Mesh, turned: np.ndarray | None, kept: np.ndarray | None) -> Mesh:
    places = places_of(mesh)
    mesh = corner_normals.joined(mesh, places) if turned is None else corner_normals.turned_over(mesh, turned, places)
    return mesh if kept is None else mesh.with_triangles(kept)


def _same_triangles(one: Mesh, other: Mesh) -> bool:
    """Whether both have the same faces. As a face is bent, Blender cuts it along other diagonals."""
    if one.triangles.shape != other.triangles.shape or not _is_equal(one.vertices, other.vertices):
        return False
    if one.triangles is other.triangles:
        return True
    differing = np.unique(np.flatnonzero(one.triangles != other.triangles) // 3)
    return np.array_equal(np.unique(one.triangles[differing]), np.unique(other.triangles[differing]))


def _is_equal(one: np.ndarray, other: np.ndarray) -> bool:
    return one is other or np.array_equal(one, other)


def _oriented(meshes: Meshes, settings: Settings, timings: Timings) -> Meshes:
    patches = HighPatches(meshes)
    if not patches.count:
        return meshes
    patches.compare()
    # Beside the low mesh, objects may be rotated, too: then only conflicts tell that something is wrong.
    if patches.is_clean and (patches.is_aside or all((each > SURE).all() for each in patches.agreements)):
        may_cast = patches.count > 1 and settings.tracing.method != Method.FLATTEN
        asked = may_be_hidden(patches) if may_cast else []
        joined = _joined(patches)
        in_order = _in_order(joined, settings) if any(each.any() for each in asked) else None
        return joined if in_order is None else one_skin(joined, patches, timings, asked, in_order.highs)
    if _low_is_inside_out(patches):
        return meshes
    if _low_points_inward(patches):
        return replace(meshes, mended=replace(Mended.nothing(meshes.highs), low_is_inside_out=True))
    if _low_differs(patches):
        has_conflict = any(each.conflicts for each in patches.of)
        return (
            replace(meshes, mended=replace(Mended.nothing(meshes.highs), low_differs=True)) if has_conflict else meshes
        )
    # Of two triangles in one place, each goes on as well at its edges: that must not decide where the other one points.
    copies = [orientation.copies(high.positions, high.vertices[high.triangles]) for high in meshes.highs]
    twice = [same for same, _ in copies]
    if any(each.any() for each in twice):
        once = [high.with_triangles(~same) for high, same in zip(meshes.highs, twice, strict=True)]
        return _without(_oriented(replace(meshes, highs=once), settings, timings), meshes.highs, twice)
    may_be_twice = any(other.any() for _, other in copies)
    return one_skin(_turned(patches, timings), patches, timings, may_be_twice=may_be_twice)


def _without(meshes: Meshes, highs: Sequence[Mesh], twice: Sequence[np.ndarray]) -> Meshes:
    """`meshes`, mended without triangles of `highs` that are there twice (T,) bool, with what that says of all triangles."""
    mended = meshes.mended or Mended.nothing(meshes.highs)

    turned, kept = [], []
    for same, flips, left in zip(twice, mended.turned, mended.kept or (None,) * len(highs), strict=True):
        of_all = np.zeros((2, len(same)), bool)
        of_all[0, ~same], of_all[1, ~same] = flips is not None and flips, left is None or left
        turned.append(None if flips is None else of_all[0])
        kept.append(of_all[1])
    mended = replace(
        mended,
        turned=tuple(turned),
        kept=tuple(kept),
        of_triangles=sum(len(high.triangles) for high in highs),
        twice=mended.twice + sum(int(np.count_nonzero(same)) for same in twice),
    )
    return replace(meshes, mended=mended)


def _in_order(meshes: Meshes, settings: Settings) -> Meshes | None:
    """`meshes` in the order in which the bake casts rays at them, so that it finds their tree in the cache; None if it casts
    none."""
    tiles = tiles_to_bake(meshes, settings.sampling)
    in_order = stacked_uvs.ordered(meshes, tiles, settings.sampling)
    if settings.tracing.method != Method.AUTO or any(high.uv is None for high in meshes.highs):
        return None if settings.tracing.method == Method.FLATTEN else in_order
    return None if uv_agreement.measure(in_order.low, in_order.drawn_highs, tiles).is_shared else in_order


def _joined(patches: HighPatches) -> Meshes:
    """The meshes with smooth normals across vertices that were not joined."""
    meshes = patches.meshes
    highs = [corner_normals.joined(high, one.places) for high, one in zip(meshes.highs, patches.of, strict=True)]
    if all(one is other for one, other in zip(highs, meshes.highs, strict=True)):
        return meshes
    return replace(meshes, highs=highs)


def _low_is_inside_out(patches: HighPatches) -> bool:
    """Whether the low mesh is the one that points inward, while the high ones do not."""
    if _agreement(patches) > -0.5:
        return False
    centers = patches.low_points[patches.low_triangles].astype(np.float64).mean(axis=1)
    away, normals = centers - centers.mean(axis=0), patches.low_normals * patches.low_areas[:, None]
    most = (np.linalg.norm(away, axis=1) * patches.low_areas).sum()
    return float((away * normals).sum()) < INWARD * float(most)


def _low_points_inward(patches: HighPatches) -> bool:
    """Whether the low mesh is closed and points inward, while the high ones are closed, clean and point outward: also parts of
    any shape, as rings, whose faces point away from the middle as often as towards it."""
    if not patches.is_clean or _agreement(patches) > -0.5 or not patches_of(patches.low).is_closed.all():
        return False
    a, b, c = patches.low_points[patches.low_triangles].astype(np.float64).transpose(1, 0, 2)
    if float((a * np.cross(b, c)).sum()) >= 0.0:
        return False
    numbers = range(len(patches.of))
    return all(
        one.is_closed.all() and (_volumes(patches, n) > 0.0).all() for n, one in zip(numbers, patches.of, strict=True)
    )


def _agreement(patches: HighPatches) -> float:
    """How much the high meshes agree with the low one, from -1 to 1."""
    most = sum(float((each.weights * np.abs(each.cosines)).sum()) for each in patches.samples)
    return sum(float((each.weights * each.cosines).sum()) for each in patches.samples) / max(most, 1e-300)


def _low_differs(patches: HighPatches) -> bool:
    """Whether faces of the low mesh point against those beside them, on much of it."""
    is_against = patches_of(patches.low).is_against
    return float(patches.low_areas[is_against].sum()) > DIRTY_LOW * float(patches.low_areas.sum())


def _turned(patches: HighPatches, timings: Timings) -> Meshes:
    """The meshes, turned over."""
    samples, ratios = patches.samples, patches.agreements
    flips, unclear = ([np.zeros(one.count, bool) for one in patches.of] for _ in range(2))
    against = [ratio < -SURE for ratio in ratios]
    if any(each.any() for each in against):
        for number, is_own in enumerate(patches.is_owned(against, timings)):
            some, ratio = samples[number], samples[number].means(samples[number].cosines, is_own)
            belongs = against[number] & (some.means(is_own) >= ALONE)
            flips[number] |= belongs & (ratio < -CLEAR)
            unclear[number] |= against[number] & ~(belongs & (np.abs(ratio) > CLEAR))
    is_dirty = any(one.conflicts for one in patches.of)
    for number, (one, some, ratio) in enumerate(zip(patches.of, samples, ratios, strict=True)):
        near = (np.abs(ratio) <= SURE) & (np.bincount(some.patches, some.weights, one.count) > 0.0)
        if near.any():
            closed = near & one.is_closed
            unclear[number] |= (near & ~one.is_closed) if is_dirty else False
            unclear[number] |= closed & (_volumes(patches, number, closed) < 0.0)
    undecided = [np.zeros(one.count, bool) for one in patches.of]
    # Where nothing else is wrong, it may be the low mesh that is: the sheets of a thin part that shrank have changed places.
    asked = [each | flip for each, flip in zip(unclear, flips, strict=True)] if patches.is_clean else unclear
    if any(each.any() for each in asked) and tree_cache.fits(patches.meshes.highs):
        undecided = _by_openness(patches, flips, unclear, asked, timings)
    masks = [one.is_against ^ flip[one.labels] for one, flip in zip(patches.of, flips, strict=True)]
    return _with_turned(patches, masks, undecided)


def _volumes(patches: HighPatches, number: int, asked: np.ndarray | None = None) -> np.ndarray:
    """The volumes (count,) that the patches of a mesh enclose; negative if they point inward. asked (count,) bool: 0 for the
    others."""
    one = patches.of[number]
    if asked is not None and not asked.any():
        return np.zeros(one.count)
    some = slice(None) if asked is None or asked.all() else np.flatnonzero(asked[one.labels])
    a, b, c = patches.corners(number, some).transpose(1, 2, 0)
    volumes = (
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    return np.bincount(one.labels[some], volumes * np.where(one.is_against[some], -1.0, 1.0), one.count)


def _by_openness(
    patches: HighPatches,
    flips: list[np.ndarray],
    unclear: Sequence[np.ndarray],
    asked: Sequence[np.ndarray],
    timings: Timings,
) -> list[np.ndarray]:
    """Turn over the unclear patches whose backs are more open than their fronts, and turn none of those asked for whose fronts
    are more open. Returns the unclear ones (count,) bool of each mesh whose sides are about as open."""
    scene = patches.scene(timings)
    undecided = []
    for number, some in enumerate(patches.samples):
        chosen = asked[number][some.patches]
        front, back = np.zeros((2, some.count))
        if chosen.any():
            numbers = some.triangles[chosen]
            corners = corners_in(patches.meshes.highs[number], numbers, scene.local_space)
            is_against = patches.of[number].is_against[numbers]
            corners[is_against] = corners[is_against][:, ::-1]
            values = np.zeros((2, len(chosen)))
            values[:, chosen] = np.split(openness(scene.tables, np.concatenate([corners, corners[:, ::-1]]), RAYS), 2)
            front, back = (some.means(side, chosen) for side in values)
        flips[number] |= unclear[number] & (back - front > OPENER)
        flips[number] &= ~(asked[number] & (front - back > OPENER))
        undecided.append(unclear[number] & (np.abs(back - front) <= OPENER) & (front + back > OPENER))
    return undecided


def _with_turned(patches: HighPatches, masks: Sequence[np.ndarray], undecided: Sequence[np.ndarray]) -> Meshes:
    """The meshes with some triangles (T,) bool turned over, and smooth normals across vertices that were not joined.

    undecided: patches (count,) bool whose sides are not known.
    """
    meshes = patches.meshes
    contradicting = tuple(one.contradicting for one in patches.of)
    if not any(each.any() for each in (*masks, *undecided)) and not any(contradicting):
        return _joined(patches)
    highs, parts, unknown, area = [], 0, 0.0, 0.0
    for high, one, mask, unclear in zip(meshes.highs, patches.of, masks, undecided, strict=True):
        areas = np.linalg.norm(orientation.face_normals(high.positions, high.vertices[high.triangles]), axis=1)
        area += float(areas.sum())
        unknown += float(areas[unclear[one.labels]].sum())
        parts += len(np.unique(one.labels[mask]))
        turned = corner_normals.turned_over(high, mask, one.places) if mask.any() else None
        highs.append(turned or corner_normals.joined(high, one.places))
    mended = replace(
        Mended.nothing(meshes.highs),
        turned=tuple(mask if mask.any() else None for mask in masks),
        parts=parts,
        of_parts=patches.count,
        undecided=tuple(int(np.count_nonzero(each)) for each in undecided),
        undecided_share=unknown / max(area, 1e-300),
        contradicting=contradicting,
    )
    return replace(meshes, highs=highs, mended=mended)
