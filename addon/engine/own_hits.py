# SPDX-License-Identifier: GPL-3.0-or-later
"""What places spread over a low mesh show of the high meshes: the hits that they own, found by the rays of a bake."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.declarations.choices import Hit
from ..core.progress import Pace, Timings
from ..mesh import uv_layout
from ..mesh.inputs import Meshes
from ..mesh.local_space import FARTHEST, LocalSpace, gap, local_space_of
from ..mesh.triangle_mesh import Mesh
from ..mesh.triangles import face_areas, unit
from ..passes import cast, rays, target
from . import ray_distances, tree_cache
from .method_choice import FAR_APART
from .tree_cache import RayScene

PLACES = 4096
"""Places on the low mesh from which rays are cast."""
STEPS = 0.7548776662466927, 0.5698402909980532
"""The steps of a sequence that covers a square evenly: 1 over the plastic number, and 1 over its square."""


@dataclass(frozen=True)
class LowPlaces:
    """Places on a low mesh, N of them.

    Attributes:
        mesh: The low mesh, with all its triangles.
        triangles (N,) int: Those that the places are on.
        weights (N, 3): Of their corners.
        normals (C, 3) float32: The smooth normals of the mesh's corners, in its own space.
    """

    mesh: Mesh
    triangles: np.ndarray
    weights: np.ndarray
    normals: np.ndarray

    @classmethod
    def of(cls, meshes: Meshes, count: int = PLACES) -> "LowPlaces":
        """About `count` places; none if the low mesh has no area. Half of them are spread evenly over its surface, and half of
        them over its UV map."""
        mesh = meshes.whole_low
        corners = mesh.vertices[mesh.front_triangles]
        areas = _finite(2.0 * face_areas(local_space_of([mesh]).points(mesh), corners, np.float64))
        if mesh.uv is not None:
            of_uv = _finite(np.abs(uv_layout.areas(mesh)))
            areas = areas / max(areas.sum(), 1e-300) + of_uv / max(of_uv.sum(), 1e-300)
        sums = np.cumsum(areas)
        if not len(sums) or not sums[-1] > 0.0:
            return cls(mesh, np.zeros(0, np.int64), np.zeros((0, 3)), meshes.smooth_normals)
        numbers = np.arange(count)
        chosen = np.searchsorted(sums, (numbers + 0.5) * (sums[-1] / count))
        u, v = ((0.5 + numbers * step) % 1.0 for step in STEPS)
        u, v = np.where(u + v > 1.0, (1.0 - u, 1.0 - v), (u, v))
        weights = np.stack([1.0 - u - v, u, v], axis=1)
        return cls(mesh, np.minimum(chosen, len(areas) - 1), weights, meshes.smooth_normals)

    def turned_over(self) -> "LowPlaces":
        """The same places on the mesh with all its faces turned over."""
        mesh = replace(self.mesh, triangles=self.mesh.triangles[:, ::-1], normals=-self.mesh.normals, face_corners=None)
        return replace(self, mesh=mesh, weights=self.weights[:, ::-1], normals=-self.normals)

    def points(self, space: LocalSpace) -> np.ndarray:
        """The places (N, 3) float32 in a local space."""
        corners = self.mesh.vertices[self.mesh.triangles[self.triangles]]
        return (space.points(self.mesh)[corners] * self.weights[:, :, None]).sum(axis=1).astype(np.float32)

    def directions(self) -> np.ndarray:
        """The unit directions (N, 3) of their rays, away from the surface: smooth normals."""
        normals = self.mesh.to_world_normals(self.normals)[self.mesh.triangles[self.triangles]]
        return unit((normals.astype(np.float64) * self.weights[:, :, None]).sum(axis=1))


@dataclass(frozen=True)
class OwnHits:
    """What N places show.

    Attributes:
        is_own (N,) bool: Whether they own a hit that faces their ray.
        triangles (N,) int: Of the hit, numbered mesh after mesh; -1 for a miss.
        heights (N,) float32: Of the hit above the low mesh, in local space.
    """

    is_own: np.ndarray
    triangles: np.ndarray
    heights: np.ndarray

    @property
    def share(self) -> float:
        """The share of the places that own a hit."""
        return float(np.mean(self.is_own)) if len(self.is_own) else 0.0


def own_hits(places: LowPlaces, scene: RayScene, offset: np.ndarray, timings: Timings) -> OwnHits:
    """What places show of a scene, from as far outside as a bake looks for parts that stand off.

    offset (3,): from the low mesh to the high ones, in world units, if they lie beside it.
    """
    count, space = len(places.triangles), scene.local_space
    if not count:
        return OwnHits(np.zeros(0, bool), np.zeros(0, np.int64), np.zeros(0, np.float32))
    moved = LocalSpace(space.origin - offset, space.size)  # where the low mesh lies in the place of the high ones
    low = tree_cache.trees.low_surface_of(places.mesh, moved, timings)
    outside = ray_distances.FARTHEST_PART * low.owners.room
    below, away = np.empty((2, count, 4), np.float32)
    below[:, :3], away[:, :3] = places.points(moved), places.directions()
    below[:, 3], away[:, 3] = low.starts[places.triangles], outside
    below[~away[:, :3].any(axis=1), 3] = 0.0  # no normal, no ray
    drawn = rays.upload_texels(below, away)
    search = cast.Search(Hit.OWN, inside=outside, max_t=FARTHEST, facing_only=True)
    hits = target.Target(drawn.width, drawn.height, ("RGBA32UI",))
    for _ in cast.trace_in_slices(hits, drawn, scene.tables, low.owners, search, pace=Pace()):
        pass
    into = target.Target(drawn.width, drawn.height, ("RGBA32F",))
    cast.heights(into, hits, drawn)
    heights, is_not_owned, _, alpha = into.texels().reshape(-1, 4)[:count].T
    numbers = cast.read_hits(hits)[0].reshape(-1)[:count]
    triangles = np.where(numbers >= 0, scene.order[np.maximum(numbers, 0)], -1)
    return OwnHits((alpha > 0.0) & (is_not_owned == 0.0), triangles, heights)


def shares_of_sides(
    meshes: Meshes, timings: Timings, *, like: Sequence[Mesh] | None = None
) -> tuple[float, float] | None:
    """The share of places on the low mesh that own a hit which faces their ray, with the low mesh as it is, and with all its
    faces turned over. None if rays cannot be cast, since a mesh is empty or too large for the GPU.

    What the bake's rays find from outside decides, not which face is the nearest. Takes the tree of the bake from the cache.
    like: the high meshes of the bake, if only some triangles of theirs are turned over in `meshes`.
    """
    highs = [high for high in meshes.highs if len(high.triangles)]
    if not highs or not tree_cache.fits(highs) or not tree_cache.low_fits(meshes.whole_low):
        return None
    places = LowPlaces.of(meshes)
    if not len(places.triangles):
        return None
    scene, offset = tree_cache.trees.ray_scene_of(like or meshes.highs, timings), offset_beside(meshes.whole_low, highs)
    if like is not None:
        scene = tree_cache.variant(meshes.highs, scene, timings)
    as_is, turned = (own_hits(each, scene, offset, timings).share for each in (places, places.turned_over()))
    return as_is, turned


def share_facing(meshes: Meshes, places: LowPlaces, outside: np.ndarray, timings: Timings) -> float:
    """The share of places whose ray meets a face that points to it, from `outside` (N,) world units above the surface down to
    the surface: whatever it belongs to. The high meshes must fit the tree, as in `shares_of_sides`."""
    scene, count = tree_cache.trees.ray_scene_of(meshes.highs, timings), len(places.triangles)
    space = scene.local_space
    moved = LocalSpace(space.origin - offset_beside(meshes.whole_low, meshes.highs), space.size)
    below, away = np.ones((count, 4), np.float32), np.empty((count, 4), np.float32)
    below[:, :3], away[:, :3], away[:, 3] = places.points(moved), places.directions(), outside / space.size
    drawn = rays.upload_texels(below, away)
    hits = target.Target(drawn.width, drawn.height, ("RGBA32UI",))
    search = cast.Search(Hit.OUTERMOST, inside=0.0, max_t=FARTHEST, facing_only=True)
    for _ in cast.trace_in_slices(hits, drawn, scene.tables, None, search, pace=Pace()):
        pass
    return float((cast.read_hits(hits)[0].reshape(-1)[:count] >= 0).mean()) if count else 0.0


def offset_beside(low: Mesh, highs: Sequence[Mesh]) -> np.ndarray:
    """The way (3,) from a low mesh to high meshes that lie beside it, in world units; 0 if they do not."""
    space = local_space_of([low])
    if gap(low, highs) <= FAR_APART * space.size:
        return np.zeros(3)
    return local_space_of(highs).origin - space.origin


def _finite(areas: np.ndarray) -> np.ndarray:
    """Areas (N,) float64, 0 where coordinates are not finite, or too large."""
    return np.nan_to_num(areas.astype(np.float64), nan=0.0, posinf=0.0)
