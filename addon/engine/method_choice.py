# SPDX-License-Identifier: GPL-3.0-or-later
"""Decides how a bake is done: Flatten or Cast, on which UDIM tiles, and from which of the high meshes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core import udim
from ..core.declarations.choices import Method
from ..core.errors import BakeError, Length, plain_length, shorten_list
from ..core.settings import SamplingSettings, TracingSettings
from ..mesh import triangle_mesh, uv_layout
from ..mesh.edges import is_without_area
from ..mesh.inputs import Meshes
from ..mesh.local_space import gap, local_space_of
from . import separation, tree_cache, uv_agreement

FAR_APART = 0.5
"""Share of the low mesh's radius. Meshes whose boxes have a larger gap between them belong together only if most rays hit, as
of a card before a wall."""
FARTHEST_APART = 2.0
"""The same, from which on they do not belong together, unless distances are set."""


@dataclass(frozen=True)
class Plan:
    """How a bake is done, decided before anything is drawn.

    method: FLATTEN or CAST. why: a clause; empty where the settings name the method. tiles: UDIM numbers. meshes: those
    that were read, reduced to the parts that the method can use. separation: the result of separation.sample if the choice
    needed it, or None. warnings: sentences. has_rays: whether FLATTEN casts rays where the UV layouts do not agree. apart: if
    the meshes are far apart, and no distance is set, a sentence for rays that miss.
    """

    method: str
    tiles: tuple[int, ...]
    meshes: Meshes
    why: str = ""
    separation: np.ndarray | None = None
    warnings: tuple[str, ...] = ()
    has_rays: bool = False
    apart: str = ""

    @property
    def casts_rays(self) -> bool:
        """Whether rays are cast, for all texels or for some."""
        return self.method == Method.CAST or self.has_rays


def choose_method(
    meshes: Meshes, tiles: Sequence[int], tracing: TracingSettings, length: Length = plain_length
) -> Plan:
    """Decide between Flatten and Cast, and drop the parts of meshes that the method cannot use.

    length: a length in scene units as text. Raises BakeError for meshes that are too far apart.
    """
    plan = Plan(tracing.method, tuple(tiles), meshes)
    if tracing.method == Method.AUTO:
        plan = _measured(plan)
    return _within_reach(plan, tracing, length) if plan.casts_rays else _flattened(plan)


def tiles_to_bake(meshes: Meshes, sampling: SamplingSettings) -> list[int]:
    """The UDIM tiles of `sampling` that the low mesh covers. Raises BakeError if there is none, or far too many."""
    if not sampling.udim:
        return [udim.FIRST]
    low = meshes.low
    found = uv_layout.tiles(low)
    if len(found) > udim.MOST_BAKED and not sampling.tiles:
        raise BakeError(f"{low.name!r} covers {len(found)} UDIM tiles: list the tiles to bake, or look for stray UVs.")
    wanted = [tile for tile in found if not sampling.tiles or tile in sampling.tiles]
    if not wanted:
        where = shorten_list(found) or "no tile"
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


def _measured(plan: Plan) -> Plan:
    """`plan` with the method that suits its meshes."""
    meshes = plan.meshes
    if meshes.is_own_base and meshes.highs[0].uv is not None and not meshes.highs[0].instances:
        return replace(plan, method=Method.FLATTEN, why="a surface and its own base mesh share their UVs")
    if meshes.cage is not None:
        return replace(plan, method=Method.CAST, why="there is a cage")
    agreement = uv_agreement.measure(meshes.low, meshes.drawn_highs, plan.tiles)
    method = Method.FLATTEN if agreement.is_shared else Method.CAST
    has_rays = False
    if agreement.separation is not None and not agreement.is_everywhere:
        has_rays = _can_cast(meshes, agreement.separation)
    return replace(plan, method=method, why=agreement.why, separation=agreement.separation, has_rays=has_rays)


def _can_cast(meshes: Meshes, texels: np.ndarray) -> bool:
    """Whether rays from the low mesh find what Flatten draws of the high ones. texels: as Plan.separation has them."""
    aside = np.linalg.norm(separation.offset(texels, Method.FLATTEN)) / local_space_of([meshes.low]).size
    return bool(aside < uv_agreement.CLOSE) and tree_cache.fits(meshes.highs) and tree_cache.low_fits(meshes.whole_low)


def _flattened(plan: Plan) -> Plan:
    """`plan` without the corners whose UVs are not finite."""
    highs = [triangle_mesh.keep_corners(high, triangle_mesh.finite_rows(high.uv)) for high in plan.meshes.highs]
    return replace(plan, meshes=replace(plan.meshes, highs=highs))


def _within_reach(plan: Plan, tracing: TracingSettings, length: Length) -> Plan:
    """`plan` without the high meshes that no ray can reach."""
    meshes = plan.meshes
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
    near = [high for high in meshes.highs if gap(meshes.low, [high]) <= reach]
    if not near:
        return plan
    kept = set(map(id, near))
    left_out = (
        f"{high.name!r} lies out of reach of the rays and was left out."
        for high in meshes.listed_highs
        if id(high) not in kept
    )
    return replace(plan, meshes=replace(meshes, highs=near), warnings=(*plan.warnings, *left_out))


def _place(tiles: Sequence[int]) -> str:
    return "0 to 1" if list(tiles) == [udim.FIRST] else f"the tiles {shorten_list(tiles)}"


def _names(highs: Sequence[triangle_mesh.Mesh]) -> str:
    return shorten_list(repr(high.name) for high in highs)


def _far_apart(meshes: Meshes, distance: str) -> str:
    return f"{meshes.low.name!r} and {_names(meshes.listed_highs)} do not overlap: they are {distance} apart."
