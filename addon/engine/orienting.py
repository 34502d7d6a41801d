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
from ..mesh.triangles import face_areas
from . import sides, stacked_uvs, tree_cache, uv_agreement
from .high_patches import HighPatches, patches_of, places_of
from .mend_trials import Trials
from .method_choice import tiles_to_bake
from .outer_skin import one_skin
from .sides import Sides

DIRTY_LOW = 0.02
"""Share of the area of a low mesh. If more of it is against the rest, it cannot tell the sides."""
INWARD = -0.3
"""How far normals of a closed mesh point away from its center, as a mean, if it is inside out: from -1, all inward, to 1."""
FEW_PLACES, SERVED = 1024, 0.98
"""How many places of the low mesh are asked first, and the share that own hits from which no part points to the wrong side."""
UNWELDED = 0.02
"""The share of the triangles of a clean mesh that are joined to others at no corner from which its normals are joined."""
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
    # Of two triangles in one place, each goes on as well at its edges: that must not decide where the other one points.
    copies = [orientation.copies(high.positions, high.vertices[high.triangles]) for high in _of_several(patches)]
    twice, may_be_twice = [same for same, _ in copies], any(other.any() for _, other in copies)
    if not any(each.any() for each in twice):
        if patches.is_clean:
            return _left_alone(patches, settings, timings, may_be_twice=may_be_twice)
        if _low_is_wrong(patches):
            return _low_named(patches)
    else:
        once = [high.with_triangles(~same) for high, same in zip(meshes.highs, twice, strict=True)]
        return _without(_oriented(replace(meshes, highs=once), settings, timings), meshes.highs, twice)
    if not _can_try(meshes):
        return one_skin(_with_turned(patches, sides.by_shape(patches)), patches, None, may_be_twice=may_be_twice)
    suspects = sides.suspects_of(patches)
    trials = Trials(patches, meshes.highs, timings, near=suspects)
    mended = _with_turned(patches, sides.decided(patches, trials, suspects), trials)
    return one_skin(mended, patches, trials, may_be_twice=may_be_twice)


def _of_several(patches: HighPatches) -> list[Mesh]:
    """The high meshes; none if all is one patch without a conflict, in which no triangle is in the place of another."""
    return [] if patches.is_clean and patches.count == 1 else patches.meshes.highs


def _left_alone(patches: HighPatches, settings: Settings, timings: Timings, *, may_be_twice: bool = False) -> Meshes:
    """Meshes without a conflict. They stay as they are, but for patches that are turned over as a whole, and for triangles that
    are in the place of others."""
    meshes = _joined(patches)
    # Objects beside the low mesh may be rotated, too.
    if patches.is_aside or not _can_try(meshes):
        return meshes
    if _agreement(patches) < -0.5 and _low_is_wrong(patches):
        return _low_named(patches)
    suspects, is_reversed = sides.suspects_of(patches), False
    if not may_be_twice and not any(each.any() for each in suspects):
        # The low mesh near a part may be another layer. Then places of it lack what they should show.
        may_differ = patches.count > 1 and any((~one.is_closed).any() for one in patches.of)
        in_order = _in_order(meshes, settings) if may_differ and settings.tracing.method != Method.FLATTEN else None
        if in_order is None:
            return meshes
        is_reversed = in_order.is_reversed
        first = Trials(patches, meshes.highs, timings, is_reversed=is_reversed, places=FEW_PLACES)
        if first.as_read().share >= SERVED:
            return meshes
        suspects = [~patches.is_outward(number, np.ones(one.count, bool)) for number, one in enumerate(patches.of)]
    elif _low_is_wrong(patches):
        return _low_named(patches)
    else:
        in_order = _in_order(meshes, settings)
        is_reversed = in_order is not None and in_order.is_reversed
    trials = Trials(patches, meshes.highs, timings, near=suspects, is_reversed=is_reversed)
    found = sides.decided(patches, trials, suspects)
    turned = _with_turned(patches, found, trials) if any(each.any() for each in found.masks) else meshes
    return one_skin(turned, patches, trials, may_be_twice=may_be_twice)


def _can_try(meshes: Meshes) -> bool:
    """Whether rays can be cast from the low mesh to the high ones."""
    return tree_cache.fits(meshes.highs) and tree_cache.low_fits(meshes.whole_low)


def _low_is_wrong(patches: HighPatches) -> bool:
    """Whether the low mesh cannot tell the sides of the high ones."""
    return _low_is_inside_out(patches) or _low_points_inward(patches) or _low_differs(patches)


def _low_named(patches: HighPatches) -> Meshes:
    """The meshes as they are, with what is wrong with the low one."""
    meshes = patches.meshes
    if _low_is_inside_out(patches):
        return meshes
    nothing = Mended.nothing(meshes.highs)
    if _low_points_inward(patches):
        return replace(meshes, mended=replace(nothing, low_is_inside_out=True))
    has_conflict = any(each.conflicts for each in patches.of)
    return replace(meshes, mended=replace(nothing, low_differs=True)) if has_conflict else meshes


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
    highs = [
        # Seams of a clean mesh shade as they are seen: only scans of single triangles are joined.
        high
        if one.pairs is None and corner_normals.share_alone(high, one.places) < UNWELDED
        else corner_normals.joined(high, one.places)
        for high, one in zip(meshes.highs, patches.of, strict=True)
    ]
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
        one.is_closed.all() and patches.is_outward(n, one.is_closed).all()
        for n, one in zip(numbers, patches.of, strict=True)
    )


def _agreement(patches: HighPatches) -> float:
    """How much the high meshes agree with the low one, from -1 to 1."""
    most = sum(float((each.weights * np.abs(each.cosines)).sum()) for each in patches.samples)
    return sum(float((each.weights * each.cosines).sum()) for each in patches.samples) / max(most, 1e-300)


def _low_differs(patches: HighPatches) -> bool:
    """Whether faces of the low mesh point against those beside them, on much of it. Faces that are there twice do not count."""
    low = patches.low
    again, _ = orientation.copies(low.positions, low.vertices[low.triangles])
    is_against = patches_of(low.with_triangles(~again) if again.any() else low).is_against
    areas = patches.low_areas[~again]
    return float(areas[is_against].sum()) > DIRTY_LOW * float(areas.sum())


def _with_turned(patches: HighPatches, found: Sides, trials: Trials | None = None) -> Meshes:
    """The meshes with some triangles turned over, and smooth normals across vertices that were not joined."""
    meshes, masks, undecided = patches.meshes, found.masks, found.undecided
    contradicting = tuple(one.contradicting for one in patches.of)
    if not any(each.any() for each in (*masks, *undecided)) and not any(contradicting):
        return _joined(patches)
    highs, parts, unknown, area = [], 0, 0.0, 0.0
    for high, one, mask, unclear in zip(meshes.highs, patches.of, masks, undecided, strict=True):
        areas = face_areas(high.positions, high.vertices[high.triangles], np.float64)
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
        largest=() if trials is None else sides.largest(patches, trials, found),
    )
    if trials is not None:
        trials.keep_tree(highs)
    return replace(meshes, highs=highs, mended=mended)
