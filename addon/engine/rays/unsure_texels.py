# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds texels whose hit may be on the wrong layer of the high mesh: looks farther along their rays than a bake does."""

from dataclasses import dataclass, fields, replace

import gpu
import numpy as np

from ...core.declarations.choices import Hit
from ...core.udim import UvToClip
from ...mesh.local_space import FARTHEST, local_space_of
from ...mesh.triangle_mesh import Mesh
from ...passes import data_texture, target
from ...passes.audit import later_rays
from ...passes.bake import cast
from .ray_casting import RayCast

GAP = 2e-4
"""Share of the low mesh's radius. Closer hits of a ray are the same, as on an edge that two triangles share."""
STEEP = 2.0
"""The least slope of a jump: the difference of two heights, in distances between the texels."""
TOUCHING = 4.0
"""Neighbors in the map touch on the low surface if they are at most this far apart, in usual distances between neighbors."""


@dataclass(frozen=True)
class Doubts:
    """What speaks against the hits of texels, (height, width) bool each.

    on_low: the texels of the low mesh. not_owned: those that own none of the hits that face their rays, and show the nearest.

    The others are reasons to be unsure. undecided: not_owned, and there are several hits to choose from. backs: the ray hits
    only backs of triangles. contested: the texel owns several hits, and one of them may belong to another layer of the low
    mesh, which is on the ray as well. jumps: a texel next to it on the surface has a hit at another height, and there are
    several hits and layers. other_layer: the settings choose hits by another rule than OWN, and the texel's own hit is another.
    """

    on_low: np.ndarray
    not_owned: np.ndarray
    undecided: np.ndarray
    backs: np.ndarray
    contested: np.ndarray
    jumps: np.ndarray
    other_layer: np.ndarray

    @property
    def unsure(self) -> np.ndarray:
        """The texels with at least one reason."""
        return np.logical_or.reduce([getattr(self, reason) for reason in REASONS])


REASONS = tuple(field.name for field in fields(Doubts))[2:]
"""The names of the reasons to be unsure."""


@dataclass(frozen=True)
class _Hits:
    """The hits of rays. points (height, width, 3): of the low surface; heights (height, width): above it, along the rays; both
    float32 and in local space. The others are (height, width) bool."""

    points: np.ndarray
    heights: np.ndarray
    is_hit: np.ndarray
    is_not_owned: np.ndarray
    is_back: np.ndarray

    def at(self, place: tuple[slice, ...]) -> "_Hits":
        return _Hits(**{field.name: getattr(self, field.name)[place] for field in fields(self)})


class Explorer:
    """Looks along the rays of `ray_cast`, which start at the mesh `low`."""

    def __init__(self, ray_cast: RayCast, low: Mesh):
        self._ray_cast = ray_cast
        self._unit = ray_cast.ray_scene.local_space.size
        self._gap = GAP * local_space_of([low]).size / self._unit
        owners, corners = ray_cast.low.owners, _corners(ray_cast, low)
        self._low_tables = cast.Tables(
            owners.nodes, corners, corners, owners.first_leaf, owners.origin, owners.scale, bytes=0
        )

    def doubts(self, size: tuple[int, int], uv_to_clip: UvToClip) -> Doubts:
        """The doubts about a map, with jumps between all neighbors. size: width and height."""
        first, doubts, may_jump = self._look(size, uv_to_clip)
        if may_jump.any():
            for before, after in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
                jumps = _jumps(first.at(before), first.at(after), self._gap)
                doubts.jumps[before] |= jumps & may_jump[before]
                doubts.jumps[after] |= jumps & may_jump[after]
        return doubts

    def sampled_doubts(self, size: tuple[int, int], uv_to_clip: UvToClip, to_neighbors: UvToClip) -> Doubts:
        """The doubts about separate texels, with jumps to one neighbor each: the one that `to_neighbors` draws in its place."""
        first, doubts, may_jump = self._look(size, uv_to_clip)
        if may_jump.any():
            rays, hits = self._rays(size, uv_to_clip=to_neighbors), self._targets(size)[0]
            self._ray_cast.trace(hits, rays)
            doubts.jumps[:] = _jumps(first, _hits(hits, rays), self._gap) & may_jump
        return doubts

    def _look(self, size: tuple[int, int], uv_to_clip: UvToClip) -> tuple[_Hits, Doubts, np.ndarray]:
        """The hits of a bake, the doubts about them without jumps, and where (height, width) bool jumps would count."""
        ray_cast, rays, (hits, other_hits) = self._ray_cast, self._rays(size, uv_to_clip), self._targets(size)
        ray_cast.trace(hits, rays)
        first, nothing = _hits(hits, rays), np.zeros(size[::-1], bool)
        on_low = _read(rays, 0)[..., 3] > 0.0
        if ray_cast.hit != Hit.OWN:
            replace(ray_cast, hit=Hit.OWN).trace(other_hits, rays)
            is_other = self._differ(first, _hits(other_hits, rays))
            return first, Doubts(on_low, nothing, nothing, nothing, nothing, nothing, is_other), nothing
        replace(ray_cast, hit=Hit.OUTERMOST, facing_only=True).trace(other_hits, rays)
        outermost = _hits(other_hits, rays)
        later = target.get("audit later rays", *size, "RGBA32F", "RGBA32F")
        later_rays.draw(later, rays, hits, self._gap, from_hits=True)
        replace(ray_cast, facing_only=True).trace(other_hits, later)
        following = self._in_reach(_hits(other_hits, later), rays)
        is_layered = self._is_layered(rays, later, other_hits)
        is_several = following.is_hit | (outermost.is_hit & self._differ(first, outermost))
        is_owned = first.is_hit & ~first.is_not_owned & ~first.is_back
        doubts = Doubts(
            on_low,
            not_owned=first.is_not_owned,
            undecided=first.is_not_owned & is_several,
            backs=first.is_back,
            contested=is_owned & following.is_hit & ~following.is_not_owned & is_layered,
            jumps=nothing,
            other_layer=np.zeros_like(nothing),
        )
        return first, doubts, is_several & is_layered

    def _is_layered(self, rays: target.Target, later: target.Target, hits: target.Target) -> np.ndarray:
        """Where another layer of the low mesh, which faces the ray too, is on the ray. Writes into `later` and `hits`."""
        above = self._trace_low(hits, rays, inside=-self._gap)
        later_rays.draw(later, rays, hits, self._gap, from_hits=False)
        inside = (self._ray_cast.max_distance - self._ray_cast.extrusion) / self._unit
        below = self._in_reach(self._trace_low(hits, later, inside=inside), rays)
        return above.is_hit | below.is_hit

    def _trace_low(self, hits: target.Target, rays: target.Target, inside: float) -> _Hits:
        """The first hits of the low mesh itself."""
        cast.trace(
            hits,
            rays,
            self._low_tables,
            None,
            rule=Hit.OUTERMOST,
            inside=inside,
            max_t=FARTHEST,
            facing_only=True,
        )
        return _hits(hits, rays)

    def _in_reach(self, hits: _Hits, rays: target.Target) -> _Hits:
        """`hits` of rays that start later, without those beyond the ends of `rays`: with a cage, rays have a length."""
        if not self._ray_cast.has_cage:
            return hits
        ends = _read(rays, 1)[..., 3] - self._ray_cast.max_distance / self._unit
        return replace(hits, is_hit=hits.is_hit & (hits.heights >= ends))

    def _differ(self, one: _Hits, other: _Hits) -> np.ndarray:
        """Where two rules choose different hits, or only one of them finds a hit."""
        return (one.is_hit != other.is_hit) | (one.is_hit & (np.abs(one.heights - other.heights) > self._gap))

    def _rays(self, size: tuple[int, int], uv_to_clip: UvToClip) -> target.Target:
        rays = target.get("audit rays", *size, "RGBA32F", "RGBA32F")
        self._ray_cast.draw(rays, uv_to_clip)
        return rays

    def _targets(self, size: tuple[int, int]) -> list[target.Target]:
        return [target.get(role, *size, "RGBA32UI") for role in ("audit hits", "audit other hits")]


def _jumps(one: _Hits, other: _Hits, gap: float) -> np.ndarray:
    """Where the heights of two texels that touch on the surface are far apart."""
    is_pair = one.is_hit & other.is_hit
    if not is_pair.any():
        return is_pair
    steps = np.linalg.norm(one.points - other.points, axis=-1)
    usual = np.median(steps[is_pair])
    difference = np.abs(one.heights - other.heights)
    return is_pair & (steps < TOUCHING * usual) & (difference > STEEP * np.maximum(steps, usual)) & (difference > gap)


def _hits(hits: target.Target, rays: target.Target) -> _Hits:
    """What cast.trace wrote into `hits`."""
    found = target.get("audit far", hits.width, hits.height, "RGBA32F")
    cast.heights(found, hits, rays)
    heights = _read(found, 0)
    return _Hits(
        _read(rays, 0)[..., :3], heights[..., 0], heights[..., 3] > 0.0, heights[..., 1] > 0.0, heights[..., 2] > 0.0
    )


def _read(drawn: target.Target, slot: int) -> np.ndarray:
    texels = np.empty((drawn.height, drawn.width, 4), np.float32)
    drawn.read(texels, slot)
    return texels


def _corners(ray_cast: RayCast, low: Mesh) -> gpu.types.GPUTexture:
    """The corners of the low mesh's triangles, three texels each, in the order of its tree."""
    # A mirrored matrix reverses the winding, which decides whether a ray hits the front or the back.
    triangles = low.triangles[:, ::-1] if np.linalg.det(low.to_world[:3, :3]) < 0.0 else low.triangles
    ordered = np.empty_like(triangles)
    ordered[ray_cast.low.numbers - 1] = triangles
    corners = low.vertices[ordered.reshape(-1)]
    return data_texture.upload_gathered(
        ray_cast.ray_scene.local_space.points(low), corners, data_texture.empty(len(corners))
    )
