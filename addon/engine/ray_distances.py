# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures what the settings of rays leave open: their distances, and how wide their directions blend."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import gpu
import numpy as np

from ..core import udim
from ..core.declarations.choices import Directions, Hit
from ..core.progress import Pace, Progress, Task, Timings
from ..core.settings import Settings
from ..mesh.inputs import Meshes
from ..mesh.local_space import FARTHEST, local_space_of
from ..mesh.triangles import unit
from ..passes import cast, rays, target
from ..passes.cast import Owners
from . import low_offset, ray_casting, tree_cache
from .tree_cache import LowSurface, RayScene, SharpPoints

PROBE_SIZE = 256
"""The most rays a side that are cast."""
PART_PROBE_SIZE = 128
"""The most rays a side that look for parts that stand off: they go farther, and ask for owners."""
QUANTILE = 0.999
"""Distances beyond this quantile are outliers: rays that pass an edge and hit a surface behind it."""
RESERVE = 1.5
"""Factor on the measured distances: the surface between two measured texels may lie farther away."""
SMALLEST = 1e-4
"""Rays must start a little away from surfaces that coincide."""
WHOLE_WORLD = 8.0
"""Longer than any distance in the local space of the high meshes, if the low mesh touches them."""
FARTHEST_PART = 4.0
"""In tree_cache.ROOM. Parts that stand off farther need an extrusion that is set."""
MOST_PARTS = 0.9
"""The largest share of the low surface that parts may cover. What covers more is another layer, which the low mesh lacks."""
MOST_INSIDE = 0.5
"""The share of rays that may start inside of solid parts."""
PART_RESERVE = 1.1
"""Factor on the measured height of parts that stand off."""
MOST_STRAYS = 0.05
"""The largest share of hits that belong to no texel. With more, layers may lie closer together than the two meshes do: they are
told apart by their order if that leaves less than half of these hits. Of hair cards over a scalp, it leaves 0.4 of 16 to 26 %.
Nine real pairs have at most 2.3 %."""
DIGITS = 3
"""The significant digits of measured distances on which all rays depend. GPUs round measurements differently."""


def measured_rays(
    meshes: Meshes, tiles: Sequence[int], settings: Settings, timings: Timings, *, has_clearances: bool = True
) -> Task[ray_casting.RayCast]:
    """The rays of a bake on these UDIM tiles. Distances that the settings do not set are measured.

    has_clearances: As in planning.Plan.
    """
    has_cage, tracing = meshes.cage is not None, settings.tracing
    yield Progress("Building the tree", 0.0)
    ray_scene = tree_cache.trees.ray_scene_of(meshes.highs, timings, repeat=meshes.repeat)
    starts = _Starts(ray_scene, settings, tiles, timings)
    start = starts.of(meshes, has_clearances=has_clearances and tracing.hit == Hit.OWN)
    yield Progress("Measuring distances", 0.5)
    # With a cage, rays start exactly on it.
    extrusion, max_distance = 0.0 if has_cage else tracing.extrusion, tracing.max_distance
    off, by_order, unit = 0.0, False, ray_scene.local_space.size
    is_measured = extrusion is None or max_distance is None
    if extrusion is None or max_distance is None:
        with timings.timed("distances"):
            heights = measured_heights(start.probe, has_cage=has_cage, facing_only=tracing.facing_only)
            if tracing.hit == Hit.OWN and not has_cage:
                off, start, heights = starts.moved(meshes, start, heights)
            outside, inside = distances(heights, has_cage=has_cage)
            if tracing.hit in _WITH_PARTS and not has_cage:
                length = None if max_distance is None else max_distance / unit
                widened = _WITH_PARTS[Hit(tracing.hit)]
                outside, inside, by_order = widened((outside, inside), length, start.probe, start.low_surface.owners)
            room = start.low_surface.owners.room
            if not has_cage and len(heights) and np.mean(heights > room) > MOST_INSIDE:
                outside = out_of_solids(start.probe, outside)
            outside, inside = max(outside + off, SMALLEST), max(inside - off, SMALLEST)
        extrusion = outside * unit if extrusion is None else extrusion
        # Measured from the low surface; rays start `extrusion` outside it.
        max_distance = extrusion + inside * unit if max_distance is None else max_distance
    return ray_casting.RayCast(
        ray_scene,
        start.low_surface,
        start.ray_mesh,
        start.probe.directions,
        Hit(tracing.hit),
        extrusion,
        max_distance,
        tracing.facing_only,
        has_cage,
        is_measured,
        off,
        by_order=by_order,
    )


@dataclass(frozen=True)
class _Start:
    """Where rays start: the low mesh as it is, or moved.

    Attributes:
        probe: Without what is painted, which scales the distances that are measured and does not change them.
    """

    low_surface: LowSurface
    ray_mesh: gpu.types.GPUBatch
    probe: "Probe"


@dataclass(frozen=True)
class _Starts:
    """Finds where the rays of a bake start."""

    ray_scene: RayScene
    settings: Settings
    tiles: Sequence[int]
    timings: Timings

    def of(self, meshes: Meshes, *, has_clearances: bool = True) -> _Start:
        """The start from a low mesh. has_clearances: as TreeCache.low_surface_of has it."""
        space, tracing = self.ray_scene.local_space, self.settings.tracing
        low_surface = tree_cache.trees.low_surface_of(
            meshes.whole_low, space, self.timings, has_clearances=has_clearances
        )
        with self.timings.timed("upload"):
            ray_mesh = probed = ray_casting.upload_ray_mesh(meshes, low_surface, space)
            if meshes.offset is not None:
                probed = ray_casting.upload_ray_mesh(replace(meshes, offset=None), low_surface, space)
        with self.timings.timed("distances"):
            directions = choose_directions(tracing.directions, meshes, low_surface, self.ray_scene.tables)
        size = self.settings.sampling.size
        return _Start(low_surface, ray_mesh, Probe(self.ray_scene.tables, probed, directions, size, self.tiles))

    def moved(self, meshes: Meshes, start: _Start, heights: np.ndarray) -> tuple[float, _Start, np.ndarray]:
        """The distance, in local space, by which the low mesh is moved to the high ones if it lies off them everywhere, else 0;
        the start then, and the heights from there. heights: those measured from `start`."""
        unit = self.ray_scene.local_space.size
        off = rounded(low_offset.offset(heights, 2.0 * local_space_of([meshes.low]).size / unit))
        if not off:
            return 0.0, start, heights
        there = self.of(low_offset.moved(meshes, off * unit))
        after = measured_heights(there.probe, has_cage=False, facing_only=self.settings.tracing.facing_only)
        if low_offset.is_around(meshes, off * unit) or low_offset.fits_better(heights, after, off):
            return off, there, after
        return 0.0, start, heights


@dataclass(frozen=True)
class Probe:
    """Some of the rays of a bake.

    Attributes:
        size: Width and height of the map.
        tiles: Its UDIM tiles. The others are as rays.draw and cast.trace take them.
        ray_mesh: The low mesh, or the cage, as rays start on it.
    """

    tables: cast.Tables
    ray_mesh: gpu.types.GPUBatch
    directions: rays.Directions
    size: tuple[int, int]
    tiles: Sequence[int]

    def drawn(
        self, *, start_offset: float, start_on_cage: bool = False, most: int = PROBE_SIZE
    ) -> Iterator[target.Target]:
        """The rays of each tile, at most `most` along u and v. The next tile overwrites them."""
        width, height = (min(side, most) for side in self.size)
        into = target.get("rays", width, height, "RGBA32F", "RGBA32F")
        for tile in self.tiles:
            rays.draw(
                into,
                self.ray_mesh,
                udim.uv_to_clip(tile),
                self.directions,
                start_offset=start_offset,
                start_on_cage=start_on_cage,
            )
            yield into


def measured_heights(probe: Probe, *, has_cage: bool, facing_only: bool) -> np.ndarray:
    """How far the high surface lies outside the low one, (N,) float32 in units of the rays' local space.

    With a cage, rays start on it.
    """
    rule = Hit.OUTERMOST if has_cage else Hit.NEAREST
    return np.concatenate(
        [
            _heights(probe.tables, drawn, rule, facing_only)
            for drawn in probe.drawn(start_offset=WHOLE_WORLD, start_on_cage=has_cage)
        ]
    )


def distances(heights: np.ndarray, *, has_cage: bool) -> tuple[float, float]:
    """How far the high surface lies outside and inside the low one, with some reserve. heights (N,): measured ones.

    With a cage, only the distance inside counts.
    """
    if has_cage:
        return 0.0, _with_reserve(-heights) if heights.size else WHOLE_WORLD
    return _with_reserve(heights[heights > 0.0]), _with_reserve(-heights[heights <= 0.0])


def with_room(
    measured: tuple[float, float], max_distance: float | None, probe: Probe, owners: Owners
) -> tuple[float, float, bool]:
    """The two distances that were measured, with room for all parts of the high meshes that belong to the low mesh, and whether
    their layers are told apart by their order.

    max_distance: the length of the rays in units of their local space, if the settings have one.
    """
    outside, inside = measured
    farthest = max(outside, FARTHEST_PART * owners.room)
    inside = max(inside, owners.room)
    heights, texels, strays = _own_heights(probe, owners, farthest=farthest, inside=inside)
    by_order = strays > MOST_STRAYS
    if by_order:
        *_, left = _own_heights(probe, owners, farthest=farthest, inside=inside, by_order=True)
        by_order = left < 0.5 * strays
    parts = heights[heights > owners.room]
    height = float(parts.max(initial=0.0)) if len(parts) <= MOST_PARTS * texels else 0.0
    extrusion = max(owners.room, min(rounded(PART_RESERVE * height), farthest))
    return max(outside, _within(extrusion, measured[1], max_distance)), inside, by_order


def with_outermost(
    measured: tuple[float, float], max_distance: float | None, probe: Probe, owners: Owners
) -> tuple[float, float, bool]:
    """The two distances that were measured to the nearest surface, with room for the outermost one that belongs to the low
    mesh, however much of it that covers. max_distance, and the last value: as `with_room` has them."""
    outside, inside = measured
    farthest = max(outside, FARTHEST_PART * owners.room)
    heights, *_ = _own_heights(probe, owners, farthest=farthest, inside=inside)
    extrusion = min(rounded(PART_RESERVE * _highest(heights)), farthest)
    return max(outside, _within(extrusion, inside, max_distance)), inside, False


_WITH_PARTS = {Hit.OWN: with_room, Hit.OUTERMOST: with_outermost}
"""What widens distances to the nearest surface, for the rules that search for what lies farther out."""


def _within(extrusion: float, inside: float, max_distance: float | None) -> float:
    """`extrusion`, but such that rays of this length still reach as far inside as was measured."""
    return extrusion if max_distance is None else min(extrusion, max_distance - inside)


def _highest(heights: np.ndarray) -> float:
    """The largest height outside the low surface but the outliers, or 0."""
    outside = heights[heights > 0.0]
    return float(np.quantile(outside, QUANTILE)) if outside.size else 0.0


LEAST_HITS = 0.5
"""The share of rays that hit something if the meshes are far apart, but belong together, as a card before a wall."""


def share_of_hits(ray_cast: ray_casting.RayCast, tiles: Sequence[int], settings: Settings) -> float:
    """The share of some of the rays of a bake that hit anything."""
    hit, cast_in_all = 0, 0
    width, height = (min(side, PART_PROBE_SIZE) for side in settings.sampling.size)
    for tile in tiles:
        drawn = target.get("rays", width, height, "RGBA32F", "RGBA32F")
        ray_cast.draw(drawn, udim.uv_to_clip(tile))
        hits, into = target.get("hits", width, height, "RGBA32UI"), target.get("high", width, height, "RGBA32F")
        ray_cast.trace(hits, drawn)
        cast.heights(into, hits, drawn)
        alpha = into.texels()[..., 3]
        hit, cast_in_all = hit + np.count_nonzero(alpha > 0.0), cast_in_all + np.count_nonzero(alpha)
    return hit / max(1, cast_in_all)


def out_of_solids(probe: Probe, outside: float) -> float:
    """`outside`, or as far outside as the front of solid parts lies that stand off the low surface, if most rays would start in
    them and see their backs from inside."""
    inside, seen = 0, 0
    for drawn in probe.drawn(start_offset=outside, most=PART_PROBE_SIZE):
        first, faced = (
            hit_heights(probe.tables, None, drawn, cast.Search(Hit.OUTERMOST, outside, FARTHEST, facing_only=facing))
            .reshape(-1, 4)
            .copy()
            for facing in (False, True)
        )
        is_hit = first[:, 3] > 0.0
        is_back = is_hit & ((faced[:, 3] <= 0.0) | (faced[:, 0] < first[:, 0] - SMALLEST))
        inside, seen = inside + np.count_nonzero(is_back), seen + np.count_nonzero(is_hit)
    if inside <= MOST_INSIDE * seen:
        return outside
    fronts = measured_heights(probe, has_cage=False, facing_only=True)
    return max(outside, _with_reserve(fronts[fronts > 0.0]))


def rounded(distance: float) -> float:
    """`distance` with DIGITS significant digits."""
    return float(f"{distance:.{DIGITS}g}")


def _own_heights(
    probe: Probe, owners: Owners, *, farthest: float, inside: float, by_order: bool = False
) -> tuple[np.ndarray, int, float]:
    """How high above the low surface the outermost hits are that belong to it, (N,) float32, the number of texels, and the
    share of hits that belong to none.

    Rays run from `farthest` outside it to `inside` it.
    """
    own_heights, texels_of_low, hit = [], 0, 0
    for drawn in probe.drawn(start_offset=farthest, most=PART_PROBE_SIZE):
        search = cast.Search(Hit.OWN, inside, FARTHEST, facing_only=True, by_order=by_order)
        texels = hit_heights(probe.tables, owners, drawn, search)
        heights, is_not_owned, _, alpha = np.moveaxis(texels, -1, 0)
        own_heights.append(heights[(alpha > 0.0) & (is_not_owned == 0.0)])
        texels_of_low, hit = texels_of_low + int(np.count_nonzero(alpha)), hit + int(np.count_nonzero(alpha > 0.0))
    own = np.concatenate(own_heights)
    return own, texels_of_low, 1.0 - len(own) / max(1, hit)


def _heights(tables: cast.Tables, drawn: target.Target, rule: Hit, facing_only: bool) -> np.ndarray:
    """The heights (N,) float32 of the hits above the low surface, or above the cage for OUTERMOST."""
    texels = hit_heights(tables, None, drawn, cast.Search(rule, WHOLE_WORLD, 2.0 * WHOLE_WORLD, facing_only))
    heights = texels[..., 0]
    if rule == Hit.OUTERMOST:
        heights -= drawn.texels(1)[..., 3]
    return heights[texels[..., 3] > 0.0]


def hit_heights(tables: cast.Tables, owners: Owners | None, drawn: target.Target, search: cast.Search) -> np.ndarray:
    """What cast.heights writes, (height, width, 4) float32."""
    hits = target.get("hits", drawn.width, drawn.height, "RGBA32UI")
    into = target.get("high", drawn.width, drawn.height, "RGBA32F")
    for _ in cast.trace_in_slices(hits, drawn, tables, owners, search, pace=Pace()):
        pass
    cast.heights(into, hits, drawn)
    return into.texels()


def _with_reserve(distances: np.ndarray) -> float:
    """A distance that includes all of `distances` but the outliers, with some reserve."""
    return max(SMALLEST, RESERVE * float(np.quantile(distances, QUANTILE))) if distances.size else SMALLEST


BEVELS = 2.0
"""The width over which directions of rays blend, in widths of the high mesh's bevels."""
CROSSING = 1.5
"""The least width of the blend, in distances between the two surfaces at hard edges: rays on a narrower one would cross."""
CROSSING_QUANTILE = 0.9
"""Distances beyond this quantile are outliers, as where another part hides an edge."""
LEAST_WIDTH = 1e-4
"""In local space. A blend of no width would be smooth directions everywhere, as if there were no hard edges."""
MOST_POINTS = 2**14
"""The most points on hard edges that are measured."""


def choose_directions(which: str, meshes: Meshes, low_surface: LowSurface, tables: cast.Tables) -> rays.Directions:
    """The directions for the setting `which`. BLENDED is SMOOTH for a low mesh without hard edges, and with a cage."""
    width, sharp = 0.0, low_surface.sharp
    if sharp is not None and may_blend(which, has_cage=meshes.cage is not None):
        width = _blend_width(meshes, sharp, tables)
    return of_width(which, low_surface.edges, width)


def may_blend(which: str, *, has_cage: bool) -> bool:
    """Whether directions blend at hard edges. A cage decides the directions alone."""
    return which == Directions.BLENDED and not has_cage


def of_width(which: str, edges: rays.Edges, blend_width: float) -> rays.Directions:
    """The directions for the setting `which`. blend_width: in local space; 0 if they do not blend."""
    return rays.Directions(edges, straight_share=float(which == Directions.SPLIT), blend_width=blend_width)


def _blend_width(meshes: Meshes, sharp: SharpPoints, tables: cast.Tables) -> float:
    """How wide the blend along hard edges is, in local space.

    The high mesh's bevels show in how far its surface is from the low mesh's sharp edges, along their smooth normals.
    """
    low = meshes.low
    by_vertex = np.zeros((len(low.positions), 3), np.float32)
    by_vertex[low.vertices] = low.to_world_normals(meshes.smooth_normals)
    chosen = slice(None, None, -(-len(sharp.places) // MOST_POINTS))
    ends = unit(by_vertex[sharp.vertices[chosen]])
    heights, has_hit = _heights_along(sharp.places[chosen], ends.sum(axis=1), tables)
    if not has_hit.any():
        return 0.0
    distances = np.abs(heights[has_hit])
    bevels = distances / np.maximum(sharp.cosines[chosen][has_hit], 0.1)
    width = max(LEAST_WIDTH, BEVELS * np.median(bevels), CROSSING * np.quantile(distances, CROSSING_QUANTILE))
    return rounded(float(width))


def _heights_along(places: np.ndarray, normals: np.ndarray, tables: cast.Tables) -> tuple[np.ndarray, np.ndarray]:
    """How far the nearest high surface lies along normals (N, 3) from places (N, 3).

    Returns heights (N,), and which rays hit, (N,) bool.
    """
    drawn = rays.upload_points(places, normals, WHOLE_WORLD)
    search = cast.Search(Hit.NEAREST, WHOLE_WORLD, 2.0 * WHOLE_WORLD, facing_only=False)
    texels = hit_heights(tables, None, drawn, search)
    texels = texels.reshape(-1, 4)[: len(places)]
    return texels[:, 0], texels[:, 3] > 0.0
