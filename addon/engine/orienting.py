# SPDX-License-Identifier: GPL-3.0-or-later
"""Turns over what points to the wrong side of the high meshes, as seen from the low mesh, and leaves out what lies behind the
surface that it shows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.declarations.choices import Hit
from ..core.progress import Timings
from ..core.settings import TracingSettings
from ..mesh import corner_normals, orientation
from ..mesh.closest import Surface
from ..mesh.inputs import Mended, Meshes
from ..mesh.local_space import FARTHEST, LocalSpace, gap, local_space_of
from ..mesh.orientation import Patches
from ..mesh.triangle_mesh import Mesh
from ..passes import cast, rays, target
from . import tree_cache
from .face_openness import openness
from .tree_cache import RayScene

FEW, MANY = 64, 4096
"""How many triangles of all high meshes are compared with the low mesh, if they agree with each other, and if not."""
OF_PATCH = 8
"""The least of them in a patch, if it has so many."""
SURE = 0.1
"""A patch that agrees with the low mesh by less than this, from -1 to 1, points to no side."""
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
FIRST_RAYS, HIDDEN_RAYS = 8, 64
"""From each side of a triangle, to see the outside: first for all, then for those that seem to be hidden."""
HIDDEN = 0.02
"""A side that sees less of the outside, as a share of a hemisphere, is hidden."""
PEEPING = 0.2
"""The share of a hidden patch that may see the outside, as through a hole."""
SHOWN = 0.1
"""The share of a hidden patch that places of the low mesh show, if it is meant."""
CLOSE = 1e-3
"""In local space. Closer hits are the same."""
NEAREST, NEAR = 1.5, 5e-4
"""A point of a patch belongs to its place on the low mesh if no other is nearer by this factor and this share of the radius."""


def mended(
    meshes: Meshes, tracing: TracingSettings, timings: Timings, before: tuple[Meshes, Meshes] | None = None
) -> Meshes:
    """`meshes` with high meshes whose faces point to the sides that the low mesh has there. Clean ones stay the same objects.

    before: earlier meshes, as they were read and the result. What has the same triangles is turned over as it was then.
    """
    with timings.timed("orient"):
        if not (tracing.keep_faces or meshes.is_own_base or not len(meshes.low.triangles)):
            known = None if before is None else _as_before(meshes, *before)
            meshes = _Turning(meshes, timings).result() if known is None else known
        return _smoothed(meshes, tracing.smooth_high) if tracing.smooth_high else meshes


def _smoothed(meshes: Meshes, rounds: int) -> Meshes:
    found = [corner_normals.smoothed(high, rounds) for high in meshes.highs]
    turned = np.concatenate([degrees for _, degrees in found])
    degrees = tuple(float(np.percentile(turned, share)) for share in (50.0, 95.0)) if len(turned) else (0.0, 0.0)
    return replace(
        meshes, highs=[high for high, _ in found], mended=replace(meshes.mended or Mended(), degrees=degrees)
    )


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
            triangles = mesh.vertices[mesh.triangles]
            places = orientation.welded(mesh.positions, orientation.open_vertices(triangles.T, len(mesh.positions)))
            turned, kept = (of[number] if of else None for of in (earlier.turned, earlier.kept))
            mended = corner_normals.joined(mesh, places)
            if turned is not None:
                mended = corner_normals.turned_over(mesh, turned, places)
            highs.append(mended if kept is None else mended.with_triangles(kept))
    return replace(meshes, highs=highs, mended=result.mended and replace(result.mended, degrees=()))


def _same_triangles(one: Mesh, other: Mesh) -> bool:
    if one.triangles is other.triangles and one.vertices is other.vertices:
        return True
    return one.triangles.shape == other.triangles.shape and np.array_equal(
        one.vertices[one.triangles], other.vertices[other.triangles]
    )


@dataclass(frozen=True)
class _Samples:
    """Triangles of a high mesh that are compared with the low mesh.

    triangles, patches (N,) int. weights (N,): areas. cosines (N,): between the triangle's normal, turned as its patch says, and
    that of the low mesh at the closest point. places (N, 3), on_low (N, 3): the triangle's middle and that point, in local space.
    closest (N,) int: the triangle of the low mesh.
    """

    triangles: np.ndarray
    patches: np.ndarray
    weights: np.ndarray
    cosines: np.ndarray
    places: np.ndarray
    on_low: np.ndarray
    closest: np.ndarray

    def ratios(self, count: int, chosen: np.ndarray | slice = slice(None)) -> np.ndarray:
        """From -1 for a patch that points against the low mesh to 1, (count,)."""
        weights = np.bincount(self.patches[chosen], self.weights[chosen], count)
        sums = np.bincount(self.patches[chosen], (self.weights * self.cosines)[chosen], count)
        return sums / np.maximum(weights, 1e-300)


class _Turning:
    """Finds what to turn over of the high meshes of a bake."""

    def __init__(self, meshes: Meshes, timings: Timings):
        self.meshes, self.timings = meshes, timings
        self.low = meshes.whole_low
        self.space = local_space_of([self.low])

    def result(self) -> Meshes:
        highs = self.meshes.highs
        found = self._found = [self._patches(high) for high in highs]
        if not any(patches.count for patches in found):
            return self.meshes
        self._low_points = self.space.points(self.low)
        self._low_triangles = self.low.vertices[self.low.front_triangles]
        normals = orientation.face_normals(self._low_points, self._low_triangles)
        self._low_normals = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
        self._surface = Surface(self._low_points, self._low_triangles)
        self._is_two_sided = orientation.copies(self._low_points, self._low_triangles)[1]
        self._aside = self._offset()
        is_clean = all(patches.pairs is None for patches in found)
        samples = [
            self._samples(high, patches, FEW if is_clean else MANY) for high, patches in zip(highs, found, strict=True)
        ]
        ratios = [each.ratios(patches.count) for each, patches in zip(samples, found, strict=True)]
        if is_clean and all((ratio > SURE).all() for ratio in ratios):
            return self._joined(found)
        return self._turned(found, samples, ratios)

    def _joined(self, found: Sequence[Patches]) -> Meshes:
        """The meshes with smooth normals across vertices that were not joined."""
        highs = [
            corner_normals.joined(high, patches.places) for high, patches in zip(self.meshes.highs, found, strict=True)
        ]
        if all(one is other for one, other in zip(highs, self.meshes.highs, strict=True)):
            return self.meshes
        return replace(self.meshes, highs=highs)

    def _patches(self, high: Mesh) -> Patches:
        return orientation.patches(high.positions, np.take(high.vertices, high.triangles, mode="clip"))

    def _offset(self) -> np.ndarray:
        """What to add to points of high meshes that lie beside the low mesh, to have them in its place."""
        if gap(self.low, self.meshes.highs) == 0.0:
            return np.zeros(3)
        return (self.space.origin - local_space_of(self.meshes.highs).origin) / self.space.size

    def _points(self, high: Mesh) -> np.ndarray:
        """The points of a high mesh in the place of the low one, in its local space."""
        return self.space.points(high) + self._aside.astype(np.float32)

    def _corners(self, high: Mesh, chosen: np.ndarray) -> np.ndarray:
        """The corners (N, 3, 3) of some triangles, in the same space as `_points`, counter-clockwise from the front."""
        points = high.positions[high.vertices[high.front_triangles[chosen]]].astype(np.float64)
        moved = (points @ high.to_world[:3, :3].T + (high.to_world[:3, 3] - self.space.origin)) / self.space.size
        return moved + self._aside

    def _samples(self, high: Mesh, patches: Patches, count: int) -> _Samples:
        chosen = _spread(patches.labels, patches.count, count)
        corners = self._corners(high, chosen)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(normals, axis=1)
        places = corners.mean(axis=1).astype(np.float32)
        closest, on_low, _ = self._surface.closest(places)
        cosines = (normals * self._low_normals[closest]).sum(axis=1) / np.maximum(areas, 1e-300)
        cosines *= np.where(patches.is_against[chosen], -1.0, 1.0)
        two_sided = self._is_two_sided[closest]
        cosines[two_sided] = np.abs(cosines[two_sided])
        return _Samples(chosen, patches.labels[chosen], areas, cosines, places, on_low, closest)

    def _turned(self, found: Sequence[Patches], samples: Sequence[_Samples], ratios: Sequence[np.ndarray]) -> Meshes:
        meshes = self.meshes
        if self._low_is_inside_out(samples):
            return meshes
        if self._low_differs():
            return replace(meshes, mended=Mended(low_differs=True)) if any(each.conflicts for each in found) else meshes
        is_dirty = any(patches.conflicts for patches in found)
        flips = [np.zeros(patches.count, bool) for patches in found]
        unclear = [np.zeros(patches.count, bool) for patches in found]
        against = [ratio < -SURE for ratio in ratios]
        if any(each.any() for each in against):
            owned = self._owned(samples, against)
            for number, (patches, some) in enumerate(zip(found, samples, strict=True)):
                share = np.bincount(some.patches, some.weights * owned[number], patches.count)
                share /= np.maximum(np.bincount(some.patches, some.weights, patches.count), 1e-300)
                ratio = some.ratios(patches.count, owned[number])
                is_own = against[number] & (share >= ALONE)
                flips[number] |= is_own & (ratio < -SURE)
                unclear[number] |= against[number] & ~(is_own & (np.abs(ratio) > SURE))
        for number, (high, patches, some, ratio) in enumerate(zip(meshes.highs, found, samples, ratios, strict=True)):
            near = (np.abs(ratio) <= SURE) & (np.bincount(some.patches, some.weights, patches.count) > 0.0)
            if near.any():
                volumes = self._volumes(high, patches)
                unclear[number] |= near & np.where(patches.is_closed, volumes < 0.0, is_dirty)
        undecided = 0
        if any(each.any() for each in unclear) and tree_cache.fits(meshes.highs):
            undecided = self._by_openness(samples, flips, unclear)
        turned = [patches.is_against ^ flip[patches.labels] for patches, flip in zip(found, flips, strict=True)]
        return self._one_skin(self._mended(found, turned, undecided), found, samples)

    def _low_is_inside_out(self, samples: Sequence[_Samples]) -> bool:
        """Whether the low mesh is the one that points inward, while the high ones do not."""
        agreeing = sum(float((each.weights * each.cosines).sum()) for each in samples)
        if agreeing > -0.5 * sum(float((each.weights * np.abs(each.cosines)).sum()) for each in samples):
            return False
        corners = self._low_points[self._low_triangles].astype(np.float64)
        centers, normals = corners.mean(axis=1), orientation.face_normals(self._low_points, self._low_triangles)
        away = centers - centers.mean(axis=0)
        most = (np.linalg.norm(away, axis=1) * np.linalg.norm(normals, axis=1)).sum()
        return float((away * normals).sum()) < INWARD * float(most)

    def _low_differs(self) -> bool:
        """Whether faces of the low mesh point against those beside them, on much of it."""
        low = self._patches(self.low)
        if not low.is_against.any():
            return False
        areas = np.linalg.norm(orientation.face_normals(self._low_points, self._low_triangles), axis=1)
        return float(areas[low.is_against].sum()) > DIRTY_LOW * float(areas.sum())

    def _owned(self, samples: Sequence[_Samples], patches: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Which samples (N,) bool of these patches (count,) bool are about the nearest to their places on the low mesh."""
        points, triangles, before = [], [], 0
        for high in self.meshes.highs:
            points.append(self._points(high))
            triangles.append(high.vertices[high.triangles] + before)
            before += len(high.positions)
        surface, owned = Surface(np.concatenate(points), np.concatenate(triangles)), []
        for some, chosen in zip(samples, patches, strict=True):
            asked = chosen[some.patches]
            _, _, squares = surface.closest(some.on_low[asked])
            own = np.linalg.norm(some.places[asked] - some.on_low[asked], axis=1)
            is_own = np.zeros(len(asked), bool)
            is_own[asked] = own <= NEAREST * np.sqrt(squares) + NEAR
            owned.append(is_own)
        return owned

    def _volumes(self, high: Mesh, patches: Patches) -> np.ndarray:
        """The volumes (count,) that patches enclose; negative if they point inward."""
        corners = self._corners(high, np.arange(len(high.triangles)))
        volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
        signs = np.where(patches.is_against, -1.0, 1.0)
        return np.bincount(patches.labels, volumes * signs, patches.count)

    def _by_openness(
        self, samples: Sequence[_Samples], flips: Sequence[np.ndarray], unclear: Sequence[np.ndarray]
    ) -> int:
        """Turn over the unclear patches whose backs are more open than their fronts. Returns how many are not known."""
        scene = tree_cache.trees.ray_scene_of(self.meshes.highs, self.timings)
        undecided = 0
        for high, some, flip, asked, patches in zip(
            self.meshes.highs, samples, flips, unclear, self._found, strict=True
        ):
            if not asked.any():
                continue
            chosen = np.flatnonzero(asked[some.patches])
            numbers = some.triangles[chosen]
            corners = _in_space(high, numbers, scene.local_space)
            is_against = patches.is_against[numbers]
            corners[is_against] = corners[is_against][:, ::-1]
            both = openness(scene.tables, np.concatenate([corners, corners[:, ::-1]]), RAYS)
            weights = some.weights[chosen]
            total = np.maximum(np.bincount(some.patches[chosen], weights, len(flip)), 1e-300)
            front, back = (
                np.bincount(some.patches[chosen], weights * side, len(flip)) / total for side in np.split(both, 2)
            )
            flip |= asked & (back - front > OPENER)
            undecided += int(np.count_nonzero(asked & (np.abs(back - front) <= OPENER) & (front + back > OPENER)))
        return undecided

    def _mended(self, found: Sequence[Patches], turned: Sequence[np.ndarray], undecided: int) -> Meshes:
        highs, masks, parts, area, of_area = [], [], 0, 0.0, 0.0
        for high, patches, mask in zip(self.meshes.highs, found, turned, strict=True):
            areas = np.linalg.norm(orientation.face_normals(high.positions, high.vertices[high.triangles]), axis=1)
            of_area += float(areas.sum())
            if mask.any():
                area += float(areas[mask].sum())
                parts += len(np.unique(patches.labels[mask]))
                highs.append(corner_normals.turned_over(high, mask, patches.places))
            else:
                highs.append(corner_normals.joined(high, patches.places))
            masks.append(mask if mask.any() else None)
        if not parts and not undecided:
            return self._joined(found)
        mended = Mended(
            tuple(masks),
            parts=parts,
            of_parts=sum(patches.count for patches in found),
            share=area / max(of_area, 1e-300),
            undecided=undecided,
        )
        return replace(self.meshes, highs=highs, mended=mended)

    def _one_skin(self, meshes: Meshes, found: Sequence[Patches], samples: Sequence[_Samples]) -> Meshes:
        """`meshes` without triangles that are there twice, and without patches that lie behind the surface: they see nothing of
        the outside from either side, and no place of the low mesh shows them."""
        kept = [np.ones(len(high.triangles), bool) for high in meshes.highs]
        twice = 0
        for high, mask in zip(meshes.highs, kept, strict=True):
            same, _ = orientation.copies(high.positions, high.vertices[high.triangles])
            mask &= ~same
            twice += int(np.count_nonzero(same))
        hidden = 0
        if sum(patches.count for patches in found) > 1 and tree_cache.fits(meshes.highs):
            scene = tree_cache.trees.ray_scene_of(meshes.highs, self.timings)
            for high, mask, patches, some in zip(meshes.highs, kept, found, samples, strict=True):
                is_hidden = self._hidden(high, patches, some, scene)
                if is_hidden.any():
                    is_hidden &= ~self._shown(high, patches, some, is_hidden, scene)
                left_out = mask & is_hidden[patches.labels]
                mask &= ~left_out
                hidden += int(np.count_nonzero(left_out))
        if not (twice or hidden):
            return meshes
        highs = [
            high if mask.all() else high.with_triangles(mask) for high, mask in zip(meshes.highs, kept, strict=True)
        ]
        masks = tuple(None if mask.all() else mask for mask in kept)
        return replace(
            meshes, highs=highs, mended=replace(meshes.mended or Mended(), kept=masks, hidden=hidden, twice=twice)
        )

    def _hidden(self, high: Mesh, patches: Patches, some: _Samples, scene: RayScene) -> np.ndarray:
        """Which patches (count,) bool see nothing of the outside."""
        open_ones = np.zeros(len(some.triangles), bool)
        for rays in (FIRST_RAYS, HIDDEN_RAYS):  # most see much of it
            left = ~self._any_of(patches, some, open_ones)[some.patches] if rays > FIRST_RAYS else ~open_ones
            if not left.any():
                break
            corners = _in_space(high, some.triangles[left], scene.local_space)
            both = openness(scene.tables, np.concatenate([corners, corners[:, ::-1]]), rays)
            open_ones[left] = np.maximum(*np.split(both, 2)) > HIDDEN
        return ~self._any_of(patches, some, open_ones)

    @staticmethod
    def _any_of(patches: Patches, some: _Samples, chosen: np.ndarray) -> np.ndarray:
        """Which patches (count,) bool have enough of the chosen samples (N,) bool: more than PEEPING."""
        of_all = np.bincount(some.patches, minlength=patches.count)
        return np.bincount(some.patches[chosen], minlength=patches.count) > PEEPING * of_all

    def _shown(self, high: Mesh, patches: Patches, some: _Samples, asked: np.ndarray, scene: RayScene) -> np.ndarray:
        """Which of the patches asked for (count,) bool are what some place of the low mesh shows, (count,) bool."""
        chosen = np.flatnonzero(asked[some.patches])
        space = scene.local_space
        low = tree_cache.trees.low_surface_of(self.low, space, self.timings)
        own, below = (self._moved(places[chosen], space) for places in (some.places, some.on_low))
        normals = self._low_normals[some.closest[chosen]]
        along = own - below
        far = np.linalg.norm(along, axis=1)
        is_aside = far > CLOSE
        away = np.where(is_aside[:, None], along / np.maximum(far, 1e-30)[:, None], normals)
        away *= np.where((away * normals).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
        height = (along * away).sum(axis=1)
        reach = np.maximum(low.owners.room, np.abs(height).max(initial=0.0) + CLOSE)
        texels = np.empty((2, len(chosen), 4), np.float32)
        texels[0, :, :3], texels[1, :, :3] = below, away
        texels[0, :, 3], texels[1, :, 3] = low.starts[some.closest[chosen]], low.owners.room
        drawn = rays.upload_texels(*texels)
        hits = target.Target(drawn.width, drawn.height, ("RGBA32UI",))
        search = cast.Search(Hit.OWN, inside=float(reach), max_t=FARTHEST, facing_only=True)
        cast.trace(hits, drawn, scene.tables, low.owners, search)
        heights = target.Target(drawn.width, drawn.height, ("RGBA32F",))
        cast.heights(heights, hits, drawn)
        values = heights.texels().reshape(-1, 4)[: len(chosen)]
        is_own = (values[:, 3] > 0.0) & (np.abs(values[:, 0] - height) <= CLOSE + 0.02 * np.abs(height))
        of_all = np.bincount(some.patches[chosen], minlength=patches.count)
        return np.bincount(some.patches[chosen[is_own]], minlength=patches.count) > SHOWN * of_all

    def _moved(self, places: np.ndarray, space: LocalSpace) -> np.ndarray:
        """Places (N, 3) of this space in that of rays, without the offset of high meshes beside the low one."""
        return ((places - self._aside) * self.space.size + self.space.origin - space.origin) / space.size


def _in_space(high: Mesh, chosen: np.ndarray, space: LocalSpace) -> np.ndarray:
    """The corners (N, 3, 3) float32 of some triangles in a local space, counter-clockwise from the front."""
    points = high.positions[high.vertices[high.front_triangles[chosen]]].astype(np.float64)
    return ((points @ high.to_world[:3, :3].T + (high.to_world[:3, 3] - space.origin)) / space.size).astype(np.float32)


def _spread(labels: np.ndarray, count: int, most: int) -> np.ndarray:
    """Some triangles (N,) int, about `most`: spread over each patch, and at least OF_PATCH of it."""
    if count == 1:
        return np.unique(np.linspace(0, len(labels) - 1, most).astype(np.int64))
    order = np.argsort(labels, kind="stable")
    sizes = np.bincount(labels, minlength=count)
    wanted = np.minimum(sizes, np.maximum(OF_PATCH, -(-sizes * most // max(1, len(labels)))))
    starts = np.cumsum(sizes) - sizes
    patch = np.repeat(np.arange(count), wanted)
    number = np.arange(len(patch)) - np.repeat(np.cumsum(wanted) - wanted, wanted)
    return order[starts[patch] + ((number + 0.5) * (sizes / np.maximum(wanted, 1))[patch]).astype(np.int64)]
