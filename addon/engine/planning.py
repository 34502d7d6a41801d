# SPDX-License-Identifier: GPL-3.0-or-later
"""Decides how a bake is done, once, before anything is drawn: what it does is a value."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from ..core import udim
from ..core.declarations.choices import Method
from ..core.errors import BakeError, Length, plain_length, shorten_list
from ..core.progress import Timings
from ..core.settings import SamplingSettings, Settings, TracingSettings
from ..core.values import ComparedByValue
from ..mesh import corner_normals, triangle_mesh, uv_layout
from ..mesh.edges import is_without_area
from ..mesh.inputs import Meshes
from ..mesh.local_space import gap, local_space_of
from ..mesh.triangle_mesh import Mesh
from . import draw_order, orienting, rounded_edges, separation, tree_cache, wrapping
from .draw_order import Order
from .high_masks import HighMasks, Mended
from .method_choice import FAR_APART, Choice, choose_method
from .ray_casting import RayLengths

FARTHEST_APART = 2.0
"""Share of the low mesh's radius. Meshes whose boxes have a larger gap between them do not belong together, unless distances
are set."""


@dataclass(frozen=True, eq=False)
class Plan(ComparedByValue):
    """How a bake is done. Plans that decide the same are equal, whatever meshes they are for.

    Attributes:
        read: The meshes as they were read.
        tiles: UDIM numbers.
        choice: The method.
        order: In which triangles are drawn.
        masks: What is changed of each high mesh; empty for nothing.
        smooth: How many rounds the high normals are smoothed.
        is_reached: Which of the high meshes rays can reach; empty for all.
        told: What the report has of changes of the high meshes; None for nothing.
        apart: If the meshes are far apart, and no distance is set, a sentence for rays that miss.
        rays: How far its rays reach, once it is ready to be drawn; None if it casts none.
        has_clearances: Whether the clearances of low triangles are measured, a search for each, which makes searches for owners
            quicker. With fewer than about 16 texels a triangle it takes longer: 512 texels a side of a shader ball with 11 for
            each 0.24 s, and 0.19 s without; 1024 a side 0.35 and 0.37 s. Other hits may win where two are as good.
    """

    read: Meshes = field(compare=False)
    tiles: tuple[int, ...]
    choice: Choice
    order: Order = field(default_factory=Order)
    masks: tuple[HighMasks, ...] = ()
    smooth: int = 0
    is_reached: tuple[bool, ...] = ()
    told: Mended | None = None
    apart: str = ""
    rays: RayLengths | None = None
    has_clearances: bool = True

    @property
    def method(self) -> str:
        """FLATTEN or CAST."""
        return self.choice.method

    @property
    def has_rays(self) -> bool:
        """Whether FLATTEN casts rays where the UV layouts do not agree."""
        return self.choice.has_rays

    @property
    def casts_rays(self) -> bool:
        """Whether rays are cast, for all texels or for some."""
        return self.choice.casts_rays

    @property
    def warnings(self) -> list[str]:
        """What is left out, in sentences."""
        left_out = (high for high, is_near in zip(self.read.highs, self.is_reached, strict=False) if not is_near)
        return [f"{high.name!r} lies out of reach of the rays and was left out." for high in left_out]

    @cached_property
    def highs(self) -> list[Mesh]:
        """All high meshes with their changes, in the order of the objects."""
        return [mesh for mesh, _ in self._changed]

    @property
    def degrees(self) -> np.ndarray:
        """By how many degrees each corner was turned to smooth the high normals (N,)."""
        return np.concatenate([degrees for _, degrees in self._changed])

    @cached_property
    def _changed(self) -> list[tuple[Mesh, np.ndarray]]:
        masks = self.masks or (HighMasks(),) * len(self.read.highs)
        highs, repeat = [one.of(high) for one, high in zip(masks, self.read.highs, strict=True)], self.read.repeat
        if repeat is not None:
            highs = [repeat.joined(high) for high in highs]
        if not self.smooth:
            return [(high, np.zeros(0)) for high in highs]
        smoothed, rounds = corner_normals.smoothed, self.smooth
        places = [None if repeat is None else repeat.places(high) for high in highs]
        return [
            high.remembered(f"smoothed {rounds}", (at,), partial(smoothed, high, rounds, at))
            for high, at in zip(highs, places, strict=True)
        ]

    @cached_property
    def listed(self) -> Meshes:
        """The meshes as they are drawn, but all high ones, and these in the order of the objects."""
        in_order = self.order.of(self.read)
        return replace(in_order, highs=self.highs, is_reversed=False)

    @cached_property
    def drawn_highs(self) -> list[Mesh]:
        """The high meshes reduced to what the method can use, in the order of the objects."""
        if not self.casts_rays:
            return [triangle_mesh.keep_corners(high, triangle_mesh.finite_rows(high.uv)) for high in self.highs]
        is_reached = self.is_reached or (True,) * len(self.highs)
        return [high for high, is_near in zip(self.highs, is_reached, strict=True) if is_near]

    @cached_property
    def meshes(self) -> Meshes:
        """The meshes as they are drawn, in their order."""
        return self.order.of(replace(self.read, highs=self.drawn_highs))

    def of_part(self, meshes: Meshes) -> "Plan":
        """The same for a part of the meshes that it draws."""
        return Plan(meshes, self.tiles, self.choice, apart=self.apart)


def plan_of(
    meshes: Meshes,
    settings: Settings,
    timings: Timings | None = None,
    *,
    tiles: Sequence[int] | None = None,
    before: Plan | None = None,
    length: Length = plain_length,
) -> Plan:
    """Decide how meshes are baked.

    Args:
        meshes: as they were read.
        tiles: the UDIM tiles; None for all that the settings ask for.
        before: of these objects when they had other shapes. The method stays, and all that follows from meshes that are the
            same.
        length: a length in scene units as text.

    Raises BakeError for meshes that are too far apart, for a low mesh on no tile, and for an edge radius that is too large.
    """
    timings = timings or Timings()
    rounded_edges.check_radius(meshes, settings.map.edge_radius, length)
    plan = decided(meshes, settings, timings, tiles=tiles, before=before)
    if plan.smooth:
        turned = plan.degrees if len(plan.degrees) else np.zeros(1)
        degrees = tuple(float(np.percentile(turned, share)) for share in (50.0, 95.0))
        plan = replace(plan, told=replace(plan.told or Mended.nothing(meshes.highs), degrees=degrees))
    with timings.timed("method"):
        return _within_reach(plan, settings.tracing, length) if plan.casts_rays else plan


def decided(
    meshes: Meshes,
    settings: Settings,
    timings: Timings,
    *,
    tiles: Sequence[int] | None = None,
    before: Plan | None = None,
) -> Plan:
    """As `plan_of`, for meshes that may be too far apart, and with all high meshes."""
    meshes, tracing = wrapping.repeated(meshes, settings), settings.tracing
    tiles = tuple(tiles_to_bake(meshes, settings.sampling) if tiles is None else tiles)
    with timings.timed("method"):
        known = before.order if before is not None and before.read.low is meshes.low else None
        order = known or draw_order.order_of(meshes, tiles, settings.sampling)
        choice = before and replace(before.choice, separation=None)
        choice = choice or choose_method(order.of(meshes), tiles, tracing)
    plan = Plan(meshes, tiles, choice, order, smooth=tracing.smooth_high)
    if tracing.keep_faces or meshes.is_own_base:
        return plan
    with timings.timed("orient"):
        if before is not None and _is_oriented_alike(meshes, before.read):
            return replace(plan, masks=before.masks, told=before.told)
        return _oriented(plan, timings)


def _oriented(plan: Plan, timings: Timings) -> Plan:
    """`plan` with what is changed of the high meshes."""
    order, by_rays = plan.order, plan.method == Method.CAST
    orientation = orienting.orientation_of(
        plan.read, timings, casts_rays=by_rays, is_reversed=by_rays and order.is_reversed
    )
    plan = replace(plan, masks=orientation.masks, told=orientation.told)
    if any(one.left_out is not None for one in plan.masks):
        return replace(plan, choice=replace(plan.choice, separation=None))  # some of what it was measured on is gone
    if orientation.scene is not None:
        in_order = order.of(replace(plan.read, highs=plan.highs)).highs
        tree_cache.trees.ray_scene_of(in_order, timings, like=orientation.scene)
    return plan


def _is_oriented_alike(meshes: Meshes, before: Meshes) -> bool:
    """Whether meshes have the low mesh and the triangles of others, so that what points to the wrong side is the same."""
    if len(meshes.highs) != len(before.highs) or meshes.low is not before.low:
        return False
    return all(
        one is other or orienting.same_triangles(one, other)
        for one, other in zip(meshes.highs, before.highs, strict=True)
    )


def tiles_to_bake(meshes: Meshes, sampling: SamplingSettings) -> list[int]:
    """The UDIM tiles of `sampling` that the low mesh covers. Raises BakeError if there is none, or far too many."""
    if not sampling.udim:
        return [udim.FIRST]
    low = meshes.low
    covered = uv_layout.tiles(low)
    if len(covered) > udim.MOST_BAKED and not sampling.tiles:
        raise BakeError(
            f"{low.name!r} covers {len(covered)} UDIM tiles: list the tiles to bake, or look for stray UVs."
        )
    wanted = [tile for tile in covered if not sampling.tiles or tile in sampling.tiles]
    if not wanted:
        where = shorten_list(covered) or "no tile"
        raise BakeError(
            f"{low.name!r} lies on {where}"
            + (f", not on {shorten_list(sampling.tiles)}." if sampling.tiles else ": its UVs are empty or negative.")
        )
    return wanted


def nothing_drawn(plan: Plan, length: Length = plain_length, *, is_covered: bool = True) -> str:
    """Why no texel was written, as a sentence.

    Args:
        length: a length in scene units as text.
        is_covered: whether rays left from any texel.
    """
    low, highs, tiles = plan.meshes.low, plan.meshes.listed_highs, plan.tiles
    if not set(tiles).intersection(uv_layout.tiles(low)):
        return f"No triangle of {low.name!r} lies on the map: its UVs are outside {_place(tiles)}, or empty."
    if plan.method == Method.FLATTEN:
        if not any(set(tiles).intersection(uv_layout.tiles(high)) for high in highs):
            return f"No triangle of {_names(highs)} lies on the map: its UVs are outside {_place(tiles)}, or empty."
        return (
            f"{low.name!r} and {_names(highs)} have no texel in common: their UV layouts differ, so cast rays instead."
        )
    for meshes in ([low], highs):
        if all(map(is_without_area, meshes)):
            return f"All faces of {_names(meshes)} are points or lines without an area: no ray can meet them."
    if not is_covered:
        return f"No texel of the map has its center in a triangle of {low.name!r}: set a larger map, or give it larger UVs."
    distance = gap(low, highs)
    if distance > 0.0:
        return _far_apart(plan.meshes, length(distance))
    if not separation.boxes_fit(plan.meshes):
        return f"No ray from {low.name!r} hit {_names(highs)}: they differ in place or size."
    return f"No ray from {low.name!r} hit {_names(highs)}: increase the extrusion and the maximum distance."


def _within_reach(plan: Plan, tracing: TracingSettings, length: Length) -> Plan:
    """`plan` without the high meshes that no ray can reach."""
    meshes = plan.listed
    distance = gap(meshes.low, meshes.highs)
    radius = local_space_of([meshes.low]).size
    is_measured = tracing.extrusion is None and tracing.max_distance is None and meshes.cage is None
    if is_measured and distance > FAR_APART * radius:
        plan = replace(plan, apart=_far_apart(meshes, length(distance)))
        if distance > FARTHEST_APART * radius:
            raise BakeError(plan.apart)
    # Distant meshes would make the tree less precise: the steps of its quantized boxes grow with the extent of all meshes.
    painted = 1.0 if meshes.offset is None else float(meshes.offset.max())
    reach = max((tracing.extrusion or 0.0) * painted, tracing.max_distance or 0.0, 2.0 * radius)
    if meshes.repeat is not None:  # what does not reach into the tile is left out triangle by triangle
        return plan
    is_reached = tuple(gap(meshes.low, [high]) <= reach for high in meshes.highs)
    return replace(plan, is_reached=is_reached) if any(is_reached) and not all(is_reached) else plan


def _place(tiles: Sequence[int]) -> str:
    return "0 to 1" if list(tiles) == [udim.FIRST] else f"the tiles {shorten_list(tiles)}"


def _names(highs: Sequence[triangle_mesh.Mesh]) -> str:
    return shorten_list(repr(high.name) for high in highs)


def _far_apart(meshes: Meshes, distance: str) -> str:
    return f"{meshes.low.name!r} and {_names(meshes.listed_highs)} do not overlap: they are {distance} apart."
