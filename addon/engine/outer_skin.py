# SPDX-License-Identifier: GPL-3.0-or-later
"""Leaves out triangles of the high meshes that are there twice, and patches that lie behind the surface: they see nothing of
the outside from either side, and no place of the low mesh shows them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core.declarations.choices import Hit
from ..core.progress import Timings
from ..mesh import orientation
from ..mesh.inputs import Mended, Meshes
from ..mesh.local_space import FARTHEST
from ..mesh.triangle_mesh import Mesh
from ..passes import cast, rays, target
from . import tree_cache
from .face_openness import openness
from .high_patches import SURE, HighPatches, Samples, corners_in

FIRST_RAYS, ALL_RAYS = 8, 64
"""From each side of a triangle, to see the outside: first for all, then for those that seem to be hidden."""
HIDDEN = 0.02
"""A side that sees less of the outside, as a share of a hemisphere, is hidden."""
PEEPING = 0.2
"""The share of a hidden patch that may see the outside, as through a hole."""
SHOWN = 0.1
"""The share of a hidden patch that places of the low mesh show, if it is meant."""
CLOSE = 1e-3
"""In local space. Closer hits are the same."""


BESIDE = 1e-3
"""Share of the size of all meshes by which a hidden patch lies inside their box at least."""


def may_be_hidden(patches: HighPatches) -> list[np.ndarray]:
    """Which patches (count,) bool of each mesh may lie behind the surface, or be there twice. For clean meshes; takes little
    time."""
    boxes = [_boxes(patches, number) for number in range(len(patches.of))]
    lows, highs = (np.concatenate([each[side] for each in boxes]) for side in range(2))
    low, high = lows.min(axis=0), highs.max(axis=0)
    room = BESIDE * float(np.linalg.norm(high - low))
    is_inside = ((lows > low + room) & (highs < high - room)).all(axis=1)
    _, which, counts = np.unique(np.concatenate([lows, highs], axis=1), axis=0, return_inverse=True, return_counts=True)
    found = is_inside | (counts > 1)[which.reshape(-1)]
    return np.split(found, np.cumsum([one.count for one in patches.of])[:-1])


def _boxes(patches: HighPatches, number: int) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and the highest corners (count, 3) of the boxes around the patches of a mesh."""
    high, one = patches.meshes.highs[number], patches.of[number]
    of_vertex = np.full(len(high.positions), one.count, np.min_scalar_type(one.count))  # small numbers sort fast
    for column in high.triangles.T:  # patches of clean meshes share no vertex
        of_vertex[np.take(high.vertices, column, mode="clip")] = one.labels
    order = np.argsort(of_vertex, kind="stable")
    starts = np.searchsorted(of_vertex, np.arange(one.count + 1), sorter=order)
    points = patches.space.points(high)[order[: starts[-1]]].T
    lows, highs = (
        np.stack([pick.reduceat(axis, starts[:-1]) for axis in points], 1) for pick in (np.minimum, np.maximum)
    )
    return lows, highs


def one_skin(
    meshes: Meshes,
    patches: HighPatches,
    timings: Timings,
    asked: Sequence[np.ndarray] | None = None,
    in_order: Sequence[Mesh] | None = None,
    *,
    may_be_twice: bool = True,
) -> Meshes:
    """`meshes`, whose high meshes have the triangles of those in `patches`, turned over or not, with the outer skin alone.

    asked: patches (count,) bool of each mesh that may be hidden, if all are clean; None for all. in_order: the clean meshes
    with their triangles in the order in which the bake casts rays at them. may_be_twice: whether triangles may be there twice.
    """
    kept = [np.ones(len(high.triangles), bool) for high in meshes.highs]
    twice = hidden = 0
    for high, mask in zip(meshes.highs, kept, strict=True) if may_be_twice else ():
        same, _ = orientation.copies(high.positions, high.vertices[high.triangles])
        mask[same] = False
        twice += int(np.count_nonzero(same))
    if patches.count > 1 and tree_cache.fits(meshes.highs):
        search = _Search(meshes.highs, patches, timings, in_order)
        for number, mask in enumerate(kept):
            one = patches.of[number]
            found = search.hidden(number, np.ones(one.count, bool) if asked is None else asked[number])
            left_out = mask & found[one.labels]
            if np.array_equal(left_out, mask):  # a whole object was meant
                continue
            mask[left_out] = False
            hidden += int(np.count_nonzero(left_out))
    if not (twice or hidden):
        return meshes
    highs = [high if mask.all() else high.with_triangles(mask) for high, mask in zip(meshes.highs, kept, strict=True)]
    masks = tuple(None if mask.all() else mask for mask in kept)
    mended = replace(meshes.mended or Mended.nothing(patches.meshes.highs), kept=masks, hidden=hidden, twice=twice)
    return replace(meshes, highs=highs, mended=mended)


def sees_outside(mesh: Mesh, places: np.ndarray, triangles: np.ndarray, timings: Timings) -> np.ndarray:
    """Which places (N,) bool on a mesh see something of the outside from one of their sides.

    If the mesh has too many triangles for rays, all do.

    Args:
        places: (N, 3) float, in the mesh's own space.
        triangles: (N,) int, those that the places lie on.
    """
    found = np.ones(len(places), bool)
    if tree_cache.fits([mesh]):
        scene = tree_cache.trees.ray_scene_of([mesh], timings)
        space = scene.local_space
        corners = corners_in(mesh, triangles, space)
        corners -= corners.mean(axis=1, keepdims=True)  # rays start in the middle
        world = places @ mesh.to_world[:3, :3].T + mesh.to_world[:3, 3]
        corners += ((world - space.origin) / space.size)[:, None].astype(np.float32)
        found[:] = False
        for count in (FIRST_RAYS, ALL_RAYS):
            found[~found] = _is_open(scene, corners[~found], count, ~found[~found])
    return found


def _is_open(scene: tree_cache.RayScene, corners: np.ndarray, rays_of_each: int, has_back: np.ndarray) -> np.ndarray:
    """Which triangles (N,) bool see the outside from their front, or from their back where has_back (N,) says so. corners:
    (N, 3, 3) in the scene's local space."""
    if not len(corners):
        return np.zeros(0, bool)
    sides = np.concatenate([corners, corners[has_back][:, ::-1]])
    found, back = np.split(openness(scene.tables, sides, rays_of_each), [len(corners)])
    found[has_back] = np.maximum(found[has_back], back)
    return found > HIDDEN


class _Search:
    """Finds hidden patches with rays."""

    def __init__(self, highs: Sequence[Mesh], patches: HighPatches, timings: Timings, in_order: Sequence[Mesh] | None):
        self._highs, self._patches, self._timings, self._is_clean = highs, patches, timings, in_order is not None
        if in_order is not None:
            self._scene = tree_cache.trees.ray_scene_of(in_order, timings)
        else:
            self._scene = tree_cache.trees.ray_scene_of(highs, timings, like=patches.scene(timings))

    def hidden(self, number: int, asked: np.ndarray) -> np.ndarray:
        """Which of the patches asked for (count,) bool of a mesh lie behind the surface, (count,) bool."""
        some = self._patches.samples[number]
        found = asked & ~self._sees_outside(number, some, ~asked)
        return found & ~self._shown(some, found) if found.any() else found

    def _sees_outside(self, number: int, some: Samples, seen: np.ndarray) -> np.ndarray:
        """Which patches (count,) bool see something of the outside. seen: those that are known to."""
        is_open = np.zeros(len(some.triangles), bool)
        # What covers the front is hit by the rays that come from the back, too: without the patch, they see about the same. So
        # the back counts only where the front is not known, and for meshes that nobody spoiled.
        has_back = self._is_clean | (np.abs(some.means(some.cosines)) <= SURE)[some.patches]
        for count in (FIRST_RAYS, ALL_RAYS):  # most see much of it
            left = ~seen[some.patches]
            if left.any():
                corners = corners_in(self._highs[number], some.triangles[left], self._scene.local_space)
                is_open[left] = _is_open(self._scene, corners, count, has_back[left])
                seen = seen | (some.shares(is_open) > PEEPING)
        return seen

    def _shown(self, some: Samples, asked: np.ndarray) -> np.ndarray:
        """Which of the patches asked for (count,) bool are what places of the low mesh show, (count,) bool."""
        chosen = np.flatnonzero(asked[some.patches])
        space = self._scene.local_space
        low = tree_cache.trees.low_surface_of(self._patches.low, space, self._timings)
        own, below = (self._patches.in_scene(places[chosen], space) for places in (some.places, some.on_low))
        normals = self._patches.low_normals[some.closest[chosen]]
        along = own - below
        far = np.linalg.norm(along, axis=1)
        away = np.where((far > CLOSE)[:, None], along / np.maximum(far, 1e-30)[:, None], normals)
        away *= np.where((away * normals).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
        height = (along * away).sum(axis=1)
        reach = np.maximum(low.owners.room, np.abs(height).max(initial=0.0) + CLOSE)
        texels = np.empty((2, len(chosen), 4), np.float32)
        texels[0, :, :3], texels[1, :, :3] = below, away
        texels[0, :, 3], texels[1, :, 3] = low.starts[some.closest[chosen]], low.owners.room
        drawn = rays.upload_texels(*texels)
        hits = target.Target(drawn.width, drawn.height, ("RGBA32UI",))
        search = cast.Search(Hit.OWN, inside=float(reach), max_t=FARTHEST, facing_only=True)
        cast.trace(hits, drawn, self._scene.tables, low.owners, search)
        heights = target.Target(drawn.width, drawn.height, ("RGBA32F",))
        cast.heights(heights, hits, drawn)
        values = heights.texels().reshape(-1, 4)[: len(chosen)]
        is_own = (values[:, 3] > 0.0) & (np.abs(values[:, 0] - height) <= CLOSE + 0.02 * np.abs(height))
        return some.shares(chosen[is_own]) > SHOWN
