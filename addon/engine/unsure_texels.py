# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds texels whose hit may be on the wrong layer of the high mesh, and the triangles of the low mesh that have them."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import gpu
import numpy as np

from ..core.declarations.choices import Hit
from ..core.udim import UvToClip
from ..mesh.local_space import local_space_of
from ..mesh.triangle_mesh import Mesh
from ..passes import cast, data_texture, rays, target
from . import low_offset
from .ray_casting import RayCast

GAP = 2e-4
"""Share of the low mesh's radius. Closer hits of a ray are the same, as on an edge that two triangles share."""
AS_NEAR = 2.0
"""A hit that is farther from the low surface than the nearest one, by this factor, is no choice in its place."""
ON_LAYER = 0.125
"""A hit is on another layer of the low mesh if that is closer to it than this share of its distance from the texel."""
NEARER = 4.0
"""A hit may belong to another layer of the low mesh if that is closer to it than this factor times its distance from the texel.
If both hits that a texel owns are farther from all others, they are sides of one surface: an inner wall, or a second scan."""
FARTHER = 20.0
"""A second hit that a texel owns is no choice if it is farther from the low surface than the first one by this factor."""
SHIFTED = 0.5
"""Where hits are told apart by their order, it is not sure if another layer of the low mesh is closer to the texel than this
share of its hit's height, or another hit is so close to its hit: of cards over a scalp, that is 8 in 10 wrong texels."""
MUCH_COVERED = 0.25
"""The share of the low surface from which parts that stand off may also be another layer, which the low mesh lacks."""
BEYOND = 8.0
"""How far outside the low mesh surfaces are looked for that rays do not reach, in times of the room that they have at least."""
STEEP = 2.0
"""The least slope of a jump: the difference of two heights, in distances between the texels."""


@dataclass(frozen=True)
class Doubts:
    """What speaks against the hits of texels, (height, width) bool each.

    The others are reasons to be unsure.

    Attributes:
        triangles (height, width) int64: The number of the low triangle on each texel, as in LowSurface.starts; 0 for none.
        heights (height, width) float32: Of the hits above the low surface along the rays, in local space.
        missed: Those whose rays hit nothing.
        not_owned: Those that own none of the hits that face their rays, and show the nearest.
        undecided: not_owned, and another hit is about as near, or the hit is on another layer of the low mesh.
        backs: The ray hits only backs of triangles.
        contested: The texel owns several hits, and one of them may belong to another layer of the low mesh, which is on the ray
            as well.
        jumps: A texel next to it on the surface has a hit at another height, and there are several hits and layers.
        other_layer: The settings choose hits by another rule than OWN, and the hit is not the texel's own.
        covered: The texel owns a hit that stands off and one below it, and such parts cover much of the low mesh.
        beyond: The texel owns a surface farther outside than its ray starts. The last two are reasons only where distances were
            measured.
    """

    triangles: np.ndarray
    heights: np.ndarray
    missed: np.ndarray
    not_owned: np.ndarray
    undecided: np.ndarray
    backs: np.ndarray
    contested: np.ndarray
    jumps: np.ndarray
    other_layer: np.ndarray
    covered: np.ndarray
    beyond: np.ndarray

    @property
    def on_low(self) -> np.ndarray:
        """The texels of the low mesh."""
        return self.triangles > 0

    @property
    def unsure(self) -> np.ndarray:
        """The texels with at least one reason."""
        return np.logical_or.reduce([getattr(self, reason) for reason in REASONS])


REASONS = tuple(field.name for field in fields(Doubts))[4:]
"""The names of the reasons to be unsure."""


@dataclass(frozen=True)
class _Hits:
    """What rays hit.

    Attributes:
        heights (...) float32: Above the low surface along the rays, in local space. The others: (...) bool.
    """

    heights: np.ndarray
    is_hit: np.ndarray
    is_not_owned: np.ndarray
    is_back: np.ndarray

    def at(self, place: slice | tuple[slice, ...] | np.ndarray) -> "_Hits":
        return _Hits(**{field.name: getattr(self, field.name)[place] for field in fields(self)})


class Explorer:
    """Looks along the rays of `ray_cast`, which start at the mesh `low`."""

    def __init__(self, ray_cast: RayCast, low: Mesh):
        self._ray_cast = ray_cast
        self._unit = ray_cast.ray_scene.local_space.size
        self._gap = GAP * local_space_of([low]).size / self._unit
        owners = ray_cast.low.owners
        from_low = low_offset.moved_low(low, ray_cast.offset * self._unit)
        points = data_texture.upload(ray_cast.ray_scene.local_space.points(from_low))
        tables = cast.Tables(owners.tree, _triangles(ray_cast, low), points, points)
        self._facing = replace(ray_cast, facing_only=True, by_order=False)
        self._at_low = replace(
            self._facing,
            ray_scene=replace(ray_cast.ray_scene, tables=tables),
            hit=Hit.OUTERMOST,
            has_cage=False,
        )

    def doubts(self, size: tuple[int, int], uv_to_clip: UvToClip) -> Doubts:
        """The doubts about a map, with jumps between all neighbors. size: width and height."""
        drawn, first = self._bake(size, uv_to_clip)
        doubts, may_jump = self._look_farther(drawn, first)
        if may_jump.any():
            points = drawn.texels()[..., :3]
            for before, after in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
                steps = np.linalg.norm(points[before] - points[after], axis=-1)
                jumps = _jumps(first.at(before), first.at(after), steps, self._gap)
                doubts.jumps[before] |= jumps & may_jump[before]
                doubts.jumps[after] |= jumps & may_jump[after]
        return doubts

    def sample(self, size: tuple[int, int], uv_to_clip: UvToClip, to_neighbors: UvToClip) -> tuple[Doubts, np.ndarray]:
        """The doubts about separate texels, and the distances (N,) float32 of the hits from the low surface, in scene units.

        Each texel has jumps to one neighbor, which `to_neighbors` draws in its place.
        """
        drawn, first = self._bake(size, uv_to_clip)
        doubts, may_jump = self._look_farther(drawn, first)
        if may_jump.any():
            points = drawn.texels()[may_jump]
            neighbors = [self._draw(size, to_neighbors).texels(slot)[may_jump] for slot in range(2)]
            steps = np.linalg.norm(points[:, :3] - neighbors[0][:, :3], axis=-1)
            beside = _cast(self._ray_cast, *neighbors)
            doubts.jumps[may_jump] = _jumps(first.at(may_jump), beside, steps, self._gap)
        heights = first.heights[first.is_hit] + np.float32(self._ray_cast.offset)
        return doubts, np.abs(heights) * np.float32(self._unit)

    def _bake(self, size: tuple[int, int], uv_to_clip: UvToClip) -> tuple[target.Target, _Hits]:
        """The rays of a bake, and what they hit."""
        drawn, hits = self._draw(size, uv_to_clip), target.get("audit hits", *size, "RGBA32UI")
        self._ray_cast.trace(hits, drawn)
        return drawn, _hits(hits, drawn)

    def _look_farther(self, drawn: target.Target, first: _Hits) -> tuple[Doubts, np.ndarray]:
        """The doubts about hits, without jumps, and the texels (height, width) bool where jumps would count."""
        places, away = drawn.texels(), drawn.texels(1)
        nothing = np.zeros((len(REASONS) + 2, *first.is_hit.shape), bool)
        doubts = Doubts(places[..., 3].astype(np.int64), first.heights, *nothing)
        on_low = doubts.on_low
        doubts.missed[:] = on_low & ~first.is_hit
        if self._ray_cast.hit != Hit.OWN:
            here, starts = first.at(on_low), away[on_low][:, 3]
            starts = np.where(here.is_hit, np.minimum(here.heights + self._gap, starts), starts)
            own = self._cast_later(replace(self._ray_cast, hit=Hit.OWN), places[on_low], away[on_low], starts)
            doubts.other_layer[on_low] = self._differ(here, own)
            return doubts, np.zeros_like(on_low)
        layers = self._other_layers(places, away)
        is_layered, is_on_layer = np.isfinite(layers).any(axis=0), _is_close(layers, first.heights, ON_LAYER)
        # Elsewhere, more hits are no reason for doubt: parts stand off the surface on purpose.
        matter = first.is_hit & (is_layered | first.is_not_owned)
        doubts.not_owned[:], doubts.backs[:] = first.is_not_owned, first.is_back
        if self._ray_cast.is_measured and not self._ray_cast.has_cage:
            self._look_for_covers(places, away, first, doubts)
        if not matter.any():
            return doubts, matter
        places, away, here = places[matter], away[matter], first.at(matter)
        outermost = _cast(replace(self._facing, hit=Hit.OUTERMOST), places, away)
        following = self._cast_later(self._facing, places, away, here.heights - self._gap)
        is_outermost_other = outermost.is_hit & self._differ(here, outermost)
        is_several = following.is_hit | is_outermost_other
        is_near = (following.is_hit & _is_as_near(following, here)) | (
            is_outermost_other & _is_as_near(outermost, here)
        )
        doubts.undecided[matter] = here.is_not_owned & (is_near | is_on_layer[matter])
        contested = _may_have_another_order if self._ray_cast.by_order else _may_be_of_another_layer
        doubts.contested[matter] = contested(layers[:, matter], here, following)
        may_jump = np.zeros_like(matter)
        may_jump[matter] = is_several
        return doubts, may_jump

    def _look_for_covers(self, places: np.ndarray, away: np.ndarray, first: _Hits, doubts: Doubts) -> None:
        """Find the texels with a surface below what they show, or above it, that they could show as well."""
        on_low, own = doubts.on_low, self._facing
        room = own.low.owners.room
        stands = first.is_hit & ~first.is_not_owned & (first.heights > room)
        if np.count_nonzero(stands) > MUCH_COVERED * np.count_nonzero(on_low):
            following = self._cast_later(own, places[stands], away[stands], first.heights[stands] - self._gap)
            covered = np.zeros_like(stands)
            covered[stands] = following.is_hit & ~following.is_not_owned
            if np.count_nonzero(covered) > MUCH_COVERED * np.count_nonzero(on_low):
                doubts.covered[:] = covered
        # These rays end where those of the bake start.
        outside = replace(own, max_distance=0.0)
        above = self._cast_later(outside, places[on_low], away[on_low], np.float32(BEYOND * room))
        doubts.beyond[on_low] = above.is_hit & ~above.is_not_owned

    def _other_layers(self, places: np.ndarray, away: np.ndarray) -> np.ndarray:
        """The heights (2, height, width) of the next layers of the low mesh above and below that face the ray, too; infinite
        where there is none."""
        heights = np.full((2, *places.shape[:2]), np.inf, np.float32)
        on_low = places[..., 3] > 0.0
        places, away = places[on_low], away[on_low]
        until_low = replace(self._at_low, extrusion=self._gap * self._unit, max_distance=0.0)
        above = _cast(until_low, places, away)
        below = self._cast_later(self._at_low, places, away, np.float32(-self._gap))
        for side, layer in enumerate((above, below)):
            heights[side, on_low] = np.where(layer.is_hit, layer.heights, np.inf)
        return heights

    def _cast_later(
        self, ray_cast: RayCast, places: np.ndarray, away: np.ndarray, starts: np.ndarray | np.float32
    ) -> _Hits:
        """As `_cast`, with rays that have these starts (N,) and end where they did before."""
        later = away.copy()
        later[:, 3] = starts
        others = _cast(ray_cast, places, later)
        if not self._ray_cast.has_cage:
            return others
        # From a cage, rays have a length.
        ends = away[:, 3] - self._ray_cast.max_distance / self._unit
        return replace(others, is_hit=others.is_hit & (others.heights >= ends))

    def _differ(self, one: _Hits, other: _Hits) -> np.ndarray:
        """Where two rules choose different hits, or only one of them finds a hit."""
        return (one.is_hit != other.is_hit) | (one.is_hit & (np.abs(one.heights - other.heights) > self._gap))

    def _draw(self, size: tuple[int, int], uv_to_clip: UvToClip) -> target.Target:
        """The rays of a bake. The next call overwrites them."""
        drawn = target.get("audit rays", *size, "RGBA32F", "RGBA32F")
        self._ray_cast.draw(drawn, uv_to_clip)
        return drawn


def _cast(ray_cast: RayCast, places: np.ndarray, away: np.ndarray) -> _Hits:
    """What rays (N, 4) hit, as rays.upload_texels takes them."""
    drawn = rays.upload_texels(places, away)
    hits = target.Target(drawn.width, drawn.height, ("RGBA32UI",))
    ray_cast.trace(hits, drawn)
    return _hits(hits, drawn, len(places))


def _is_as_near(one: _Hits, other: _Hits) -> np.ndarray:
    """Where the first hit is hardly farther from the low surface than the other one."""
    return np.abs(one.heights) < AS_NEAR * np.abs(other.heights)


def _is_close(layers: np.ndarray, heights: np.ndarray, share: float) -> np.ndarray:
    """Where a hit is closer to a layer of the low mesh than this share of its distance from the texel. layers (2, ...): their
    heights, as those of the hits (...)."""
    return (np.abs(layers - heights) <= share * np.abs(heights)).any(axis=0)


def _may_be_of_another_layer(layers: np.ndarray, here: _Hits, following: _Hits) -> np.ndarray:
    """Where a texel owns two hits, and one of them may belong to one of `layers`, as `_is_close` has them."""
    is_other = [_is_close(layers, hits.heights, NEARER) for hits in (here, following)]
    is_choice = (
        following.is_hit & ~following.is_not_owned & (np.abs(following.heights) < FARTHER * np.abs(here.heights))
    )
    return is_choice & np.logical_or(*is_other)


def _may_have_another_order(layers: np.ndarray, here: _Hits, following: _Hits) -> np.ndarray:
    """Where layers or hits are so close to each other that their order may not be the same."""
    near = SHIFTED * np.abs(here.heights)
    is_close = following.is_hit & (np.abs(following.heights - here.heights) < near)
    return is_close | (np.abs(layers) < near).any(axis=0)


def _jumps(one: _Hits, other: _Hits, steps: np.ndarray, gap: float) -> np.ndarray:
    """Where the heights of texels that are `steps` apart on the surface differ by more than a surface does."""
    difference = np.abs(one.heights - other.heights)
    return one.is_hit & other.is_hit & (difference > STEEP * steps) & (difference > gap)


def _hits(hits: target.Target, drawn: target.Target, count: int | None = None) -> _Hits:
    """What cast.trace wrote into `hits`, (height, width), or of the first `count` texels, (count,)."""
    into = target.get("audit far", hits.width, hits.height, "RGBA32F")
    cast.heights(into, hits, drawn)
    texels = into.texels()
    if count is not None:
        texels = texels.reshape(-1, 4)[:count]
    return _Hits(texels[..., 0], texels[..., 3] > 0.0, texels[..., 1] > 0.0, texels[..., 2] > 0.0)


def _triangles(ray_cast: RayCast, low: Mesh) -> gpu.types.GPUTexture:
    """The vertices of the low mesh's triangles, as cast.Tables has them, in the order of its tree."""
    ordered = np.empty_like(low.triangles)
    # The winding decides whether a ray hits the front or the back.
    ordered[ray_cast.low.numbers - 1] = low.front_triangles
    return data_texture.upload_numbers(low.vertices[ordered])


STEEP_TURN = 3.0
"""A ray that turns moves its hit along the surface. The most that it moves on one surface, in times of the turn's own arc."""


@dataclass(frozen=True)
class Traced:
    """The texels of a map that lie on the low mesh, and their rays, in local space.

    Attributes:
        triangles (N,) int: Of the low mesh.
        directions, hits (N, 3) float32: Of the rays, and the points that they hit.
        heights (N,) float32: Of these points above the low surface.
        is_missed, is_unsure, is_doubtful (N,) bool: Doubtful are misses, hits that their texel does not own, and what Explorer
            is unsure about.
        gap: Closer hits are the same.
        count: Of the low mesh's triangles.
    """

    triangles: np.ndarray
    directions: np.ndarray
    hits: np.ndarray
    heights: np.ndarray
    is_missed: np.ndarray
    is_unsure: np.ndarray
    is_doubtful: np.ndarray
    gap: float
    count: int

    def doubtful(self) -> np.ndarray:
        """How many doubtful texels each triangle has, (T,) int."""
        return self._by_triangle(self.is_doubtful)

    def lost(self, other: "Traced") -> np.ndarray:
        """How many texels get worse in `other`, by triangles (T,) int: rays miss that hit here, or hit another surface.

        The surface may change where texels are unsure here, or doubtful here and not in `other`.
        """
        arc = np.linalg.norm(self.directions - other.directions, axis=1) * np.maximum(
            np.abs(self.heights), np.abs(other.heights)
        )
        has_moved = np.linalg.norm(self.hits - other.hits, axis=1) > STEEP_TURN * arc + self.gap
        is_better = self.is_unsure | (self.is_doubtful & ~other.is_doubtful)
        return self._by_triangle(~self.is_missed & (other.is_missed | (has_moved & ~is_better)))

    def _by_triangle(self, is_counted: np.ndarray) -> np.ndarray:
        return np.bincount(self.triangles[is_counted], minlength=self.count)


def trace_doubts(ray_cast: RayCast, low: Mesh, size: tuple[int, int], views: Sequence[UvToClip]) -> Traced:
    """Cast the rays of `views`, each of width and height `size`."""
    explorer, numbers = Explorer(ray_cast, low), np.argsort(ray_cast.low.numbers)
    parts = []
    for view in views:
        doubts = explorer.doubts(size, view)
        drawn = target.get("audit rays", *size, "RGBA32F", "RGBA32F")
        ray_cast.draw(drawn, view)
        places, away = drawn.texels(), drawn.texels(1)
        on_low = doubts.on_low
        directions, heights = away[on_low][:, :3], doubts.heights[on_low]
        parts.append(
            (
                numbers[doubts.triangles[on_low] - 1],
                directions,
                places[on_low][:, :3] + directions * heights[:, None],
                heights,
                doubts.missed[on_low],
                doubts.unsure[on_low],
                (doubts.missed | doubts.not_owned | doubts.unsure)[on_low],
            )
        )
    gap = GAP * local_space_of([low]).size / ray_cast.ray_scene.local_space.size
    triangles, directions, hits, heights, *is_bad = map(np.concatenate, zip(*parts, strict=True))
    return Traced(triangles, directions, hits, heights, *is_bad, gap=gap, count=len(numbers))
