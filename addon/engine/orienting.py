# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds what a bake changes of its high meshes: it turns over what points to the wrong side, as seen from the low mesh, leaves
out what lies behind the surface, and joins normals across vertices that are not joined."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.progress import Timings
from ..core.recent import Recent
from ..core.sentences import WRONG, Sentence
from ..mesh import corner_normals
from ..mesh import orientation as surfaces
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..mesh.triangles import enclosed_volumes, face_areas
from . import sides, tree_cache
from .hidden_faces import hidden_and_twice
from .high_masks import HighMasks, Mended, without_copies
from .high_patches import HighPatches, patches_of
from .mend_trials import Trials
from .sides import Sides
from .tree_cache import RayScene

DIRTY_LOW = 0.02
"""Share of the area of a low mesh. If more of it is against the rest, it cannot tell the sides."""
INWARD = -0.3
"""How far normals of a closed mesh point away from its center, as a mean, if it is inside out: from -1, all inward, to 1."""
FEW_PLACES, SERVED = 1024, 0.98
"""How many places of the low mesh are asked first, and the share that own hits from which no part points to the wrong side."""
UNWELDED = 0.02
"""The share of the triangles of a clean mesh that are joined to others at no corner from which its normals are joined."""
MUCH = 1e-3
"""Share of the area of the high meshes. Not to know the sides of smaller parts is not worth a warning."""


@dataclass(frozen=True)
class Orientation:
    """How the high meshes are meant.

    Attributes:
        masks: What is changed of each.
        told: What the report has of it; None if nothing is to be told.
        scene: The tree over the high meshes in the order in which the bake casts rays at them, whichever of their triangles are
            turned over; None if it has other triangles, or if nothing is turned.
    """

    masks: tuple[HighMasks, ...]
    told: Mended | None = None
    scene: RayScene | None = None


known: Recent[Orientation] = Recent(8)
"""By the checksums of the meshes. Each takes a byte or two for a triangle if there is something to mend, and nothing if not."""


def orientation_of(
    meshes: Meshes, timings: Timings, *, casts_rays: bool = True, is_reversed: bool = False
) -> Orientation:
    """How the faces of the high meshes point to the sides that the low mesh has there, without what lies behind the surface.

    It is remembered by the content of the meshes: bakes of the same ones, and of the sets of their materials, look once.

    Args:
        casts_rays: whether the bake finds the high meshes by rays.
        is_reversed: whether its tree has the high triangles in the reverse order.
    """
    if not len(meshes.low.triangles):
        return Orientation(_no_masks(meshes))
    smooth = zlib.crc32(np.ascontiguousarray(meshes.smooth_normals))
    key = (*map(tree_cache.checksums, [meshes.whole_low, *meshes.highs]), smooth, casts_rays, is_reversed)
    orientation = known.get(key)
    if orientation is None:
        orientation = _look(meshes, timings, casts_rays=casts_rays, is_reversed=is_reversed)
        known[key] = replace(orientation, scene=None)
    return orientation


def _look(meshes: Meshes, timings: Timings, *, casts_rays: bool, is_reversed: bool) -> Orientation:
    """As `orientation_of`, of meshes that it has not seen before."""
    patches = HighPatches(meshes)
    if not patches.count:
        return Orientation(_no_masks(meshes))
    patches.compare()
    # Of two triangles in one place, each goes on as well at its edges: that must not decide where the other one points.
    copies = [surfaces.copies(high.positions, high.vertices[high.triangles]) for high in _of_several(patches)]
    twice, may_be_twice = [same for same, _ in copies], any(other.any() for _, other in copies)
    if any(each.any() for each in twice):
        once = [without_copies(high, same) for high, same in zip(meshes.highs, twice, strict=True)]
        orientation = _look(replace(meshes, highs=once), timings, casts_rays=casts_rays, is_reversed=is_reversed)
        return _of_all(orientation, meshes, twice)
    if patches.is_clean:
        return _left_alone(patches, timings, may_be_twice=may_be_twice, casts_rays=casts_rays, is_reversed=is_reversed)
    if _low_is_wrong(patches):
        return _low_named(patches)
    if not _can_try(meshes):
        return _without_hidden(_with_turned(patches, sides.by_shape(patches)), patches, None, may_be_twice=may_be_twice)
    suspects = sides.suspects_of(patches)
    trials = Trials(patches, meshes.highs, timings, near=suspects, is_reversed=is_reversed)
    orientation = _with_turned(patches, sides.decided(patches, trials, suspects), trials)
    return _without_hidden(orientation, patches, trials, may_be_twice=may_be_twice)


def notes(meshes: Meshes, told: Mended | None) -> list[str]:
    """What could not be mended of these meshes, in sentences."""
    if told is None:
        return []
    notes = []
    if told.low_differs:
        notes.append(
            f"The faces of {meshes.low.name!r} point to different sides, so that those of the high mesh, which do so, too, "
            "were not turned over: recalculate the normals of both."
        )
    names = [repr(high.name) for high in meshes.highs]
    if told.low_is_inside_out:
        text = (
            f"{meshes.low.name!r} is inside out, and the high mesh is not: the map will be wrong. Recalculate its normals, or "
            "enlarge it if it was shrunk through itself."
        )
        notes.append(Sentence(text, WRONG, share=1.0))
    if told.undecided_share > MUCH:
        parts = [f"{count:,} of {name}" for count, name in zip(told.undecided, names, strict=True) if count]
        notes.append(
            f"No side of some parts is the outer one ({', '.join(parts)}, {told.undecided_share:.1%} of the surface): they "
            "are baked as they are. Recalculate their normals if their detail is wrong."
        )
    parts = [f"{count:,} of {name}" for count, name in zip(told.contradicting, names, strict=False) if count]
    if parts:
        notes.append(
            f"The faces of some parts cannot point to one side, as those of a Möbius strip ({', '.join(parts)}): the map has "
            "an edge there."
        )
    return notes


def same_triangles(one: Mesh, other: Mesh) -> bool:
    """Whether both have the same faces. As a face is bent, Blender cuts it along other diagonals."""
    if one.triangles.shape != other.triangles.shape or not _is_equal(one.vertices, other.vertices):
        return False
    if one.triangles is other.triangles:
        return True
    differing = np.unique(np.flatnonzero(one.triangles != other.triangles) // 3)
    return np.array_equal(np.unique(one.triangles[differing]), np.unique(other.triangles[differing]))


def _is_equal(one: np.ndarray, other: np.ndarray) -> bool:
    return one is other or np.array_equal(one, other)


def _no_masks(meshes: Meshes) -> tuple[HighMasks, ...]:
    return (HighMasks(),) * len(meshes.highs)


def _of_several(patches: HighPatches) -> list[Mesh]:
    """The high meshes; none if all is one patch without a conflict, in which no triangle is in the place of another."""
    return [] if patches.is_clean and patches.count == 1 else patches.meshes.highs


def _left_alone(
    patches: HighPatches, timings: Timings, *, may_be_twice: bool, casts_rays: bool, is_reversed: bool
) -> Orientation:
    """Of meshes without a conflict. They stay as they are, but for patches that are turned over as a whole, and for triangles
    that are in the place of others."""
    as_is = Orientation(_joined(patches))
    # Objects beside the low mesh may be rotated, too.
    if patches.is_aside or not _can_try(patches.meshes):
        return as_is
    if _agreement(patches) < -0.5 and _low_is_wrong(patches):
        return _low_named(patches)
    suspects = sides.suspects_of(patches)
    highs = [masks.of(high) for masks, high in zip(as_is.masks, patches.meshes.highs, strict=True)]
    if not may_be_twice and not any(each.any() for each in suspects):
        # The low mesh near a part may be another layer. Then places of it lack what they should show.
        may_differ = patches.count > 1 and any((~one.is_closed).any() for one in patches.of)
        if not (may_differ and casts_rays):
            return as_is
        first = Trials(patches, highs, timings, is_reversed=is_reversed, places=FEW_PLACES)
        if first.as_read().share >= SERVED:
            return as_is
        suspects = [~patches.is_outward(number, np.ones(one.count, bool)) for number, one in enumerate(patches.of)]
    elif _low_is_wrong(patches):
        return _low_named(patches)
    trials = Trials(patches, highs, timings, near=suspects, is_reversed=is_reversed)
    sides_of = sides.decided(patches, trials, suspects)
    turned = _with_turned(patches, sides_of, trials) if any(each.any() for each in sides_of.masks) else as_is
    return _without_hidden(turned, patches, trials, may_be_twice=may_be_twice)


def _can_try(meshes: Meshes) -> bool:
    """Whether rays can be cast from the low mesh to the high ones."""
    return tree_cache.fits(meshes.highs) and tree_cache.low_fits(meshes.whole_low)


def _low_is_wrong(patches: HighPatches) -> bool:
    """Whether the low mesh cannot tell the sides of the high ones."""
    return _low_is_inside_out(patches) or _low_points_inward(patches) or _low_differs(patches)


def _low_named(patches: HighPatches) -> Orientation:
    """The meshes as they are, with what is wrong with the low one."""
    masks, nothing = _no_masks(patches.meshes), Mended.nothing(patches.meshes.highs)
    if _low_is_inside_out(patches):
        return Orientation(masks)
    if _low_points_inward(patches):
        return Orientation(masks, replace(nothing, low_is_inside_out=True))
    has_conflict = any(each.conflicts for each in patches.of)
    return Orientation(masks, replace(nothing, low_differs=True) if has_conflict else None)


def _of_all(orientation: Orientation, meshes: Meshes, twice: Sequence[np.ndarray]) -> Orientation:
    """What was found of meshes without the triangles that are there twice (T,) bool, for the meshes with them."""
    told = orientation.told or Mended.nothing(meshes.highs)
    told = replace(
        told,
        of_triangles=sum(len(high.triangles) for high in meshes.highs),
        twice=told.twice + sum(int(np.count_nonzero(same)) for same in twice),
    )
    return replace(
        orientation,
        masks=tuple(masks.of_all(same) for masks, same in zip(orientation.masks, twice, strict=True)),
        told=told,
    )


def _without_hidden(
    orientation: Orientation, patches: HighPatches, trials: Trials | None, *, may_be_twice: bool
) -> Orientation:
    """`found` without what is there twice, or lies behind the surface."""
    turned = [
        np.zeros(len(one.labels), bool) if masks.turned is None else masks.turned
        for masks, one in zip(orientation.masks, patches.of, strict=True)
    ]
    left_out = hidden_and_twice(patches, turned, trials, may_be_twice=may_be_twice)
    if not (left_out.twice or left_out.hidden):
        return orientation
    masks = tuple(
        replace(one, left_out=mask if mask.any() else None)
        for one, mask in zip(orientation.masks, left_out.masks, strict=True)
    )
    told = replace(
        orientation.told or Mended.nothing(patches.meshes.highs), hidden=left_out.hidden, twice=left_out.twice
    )
    return Orientation(masks, told)


def _joined(patches: HighPatches) -> tuple[HighMasks, ...]:
    """Meshes with smooth normals across vertices that were not joined."""
    # Seams of a clean mesh shade as they are seen: only scans of single triangles are joined.
    return tuple(
        HighMasks(is_joined=one.pairs is not None or corner_normals.share_alone(high, one.places) >= UNWELDED)
        for high, one in zip(patches.meshes.highs, patches.of, strict=True)
    )


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
    if enclosed_volumes(patches.low_points[patches.low_triangles].astype(np.float64)).sum() >= 0.0:
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
    again, _ = surfaces.copies(low.positions, low.vertices[low.triangles])
    is_against = patches_of(low.with_triangles(~again) if again.any() else low).is_against
    areas = patches.low_areas[~again]
    return float(areas[is_against].sum()) > DIRTY_LOW * float(areas.sum())


def _with_turned(patches: HighPatches, decided: Sides, trials: Trials | None = None) -> Orientation:
    """The meshes with some triangles turned over, and smooth normals across vertices that were not joined."""
    masks, undecided = decided.masks, decided.undecided
    contradicting = tuple(one.contradicting for one in patches.of)
    if not any(each.any() for each in (*masks, *undecided)) and not any(contradicting):
        return Orientation(_joined(patches))
    parts, unknown, area = 0, 0.0, 0.0
    for high, one, mask, unclear in zip(patches.meshes.highs, patches.of, masks, undecided, strict=True):
        areas = face_areas(high.positions, high.vertices[high.triangles], np.float64)
        area += float(areas.sum())
        unknown += float(areas[unclear[one.labels]].sum())
        parts += len(np.unique(one.labels[mask]))
    told = replace(
        Mended.nothing(patches.meshes.highs),
        turned=sum(int(np.count_nonzero(mask)) for mask in masks),
        parts=parts,
        of_parts=patches.count,
        undecided=tuple(int(np.count_nonzero(each)) for each in undecided),
        undecided_share=unknown / max(area, 1e-300),
        contradicting=contradicting,
        largest=() if trials is None else sides.largest(patches, trials, decided),
    )
    changed = tuple(HighMasks(turned=mask if mask.any() else None, is_joined=True) for mask in masks)
    return Orientation(changed, told, None if trials is None else trials.scene)
