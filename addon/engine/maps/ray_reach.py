# SPDX-License-Identifier: GPL-3.0-or-later
"""How far the rays of ambient occlusion, thickness and curvature go: the settings' distances in local space."""

import math
from collections.abc import Sequence

from ...core.declarations.choices import DistanceUnit, Occluders
from ...core.declarations.map_settings import CURVATURE_SHARE, THICKNESS_SHARE
from ...core.map_types import BY_NAME, Family
from ...core.progress import Timings
from ...core.settings import Settings, TracingSettings
from ...mesh.local_space import LocalSpace
from ...mesh.triangle_mesh import Mesh
from ...passes.hemisphere import curvature, openness
from ..high_surface import HighSurface
from ..rays import tree_cache

WITH_MEANING = Family.THICKNESS, Family.CURVATURE
"""The families of maps that `meanings` explains."""


def in_scene(distance: float, settings: TracingSettings, space: LocalSpace) -> float:
    """A distance of the settings in scene units. space: of the high meshes; its size is half of their diagonal."""
    return distance * 2.0 * space.size if settings.distance_unit == DistanceUnit.DIAGONAL else distance


def thickness_distance(settings: TracingSettings, space: LocalSpace) -> float:
    """In scene units."""
    share = settings.thickness_distance
    return THICKNESS_SHARE * 2.0 * space.size if share is None else in_scene(share, settings, space)


def curvature_radius(settings: TracingSettings, space: LocalSpace) -> float:
    """In scene units."""
    share = settings.curvature_radius
    return CURVATURE_SHARE * 2.0 * space.size if share is None else in_scene(share, settings, space)


def meanings(settings: Settings, space: LocalSpace) -> dict[str, dict[str, float]]:
    """What the values of maps mean, by name: (value - midlevel) * scale is a length or a curvature in scene units.

    The scales of curvature are those of curvature.mean_curvature_scale: positive is convex.
    """
    to_curvature = curvature.mean_curvature_scale(curvature_radius(settings.tracing, space))
    by_family = {
        Family.THICKNESS: [(0.0, thickness_distance(settings.tracing, space))],
        Family.CURVATURE: [(0.5, to_curvature), (0.0, 0.5 * to_curvature), (0.0, -0.5 * to_curvature)],
    }
    found = {}
    for name in settings.map.drawn_maps:
        if BY_NAME[name].family in by_family:
            midlevel, scale = by_family[BY_NAME[name].family][BY_NAME[name].index]
            found[name] = {"midlevel": midlevel, "scale": scale}
    return found


def occluders(
    surface: HighSurface, others: Sequence[Mesh], settings: TracingSettings, timings: Timings
) -> openness.Occluders:
    """What blocks the rays of ambient occlusion. others: the high meshes of other low objects."""
    space = surface.local_space
    tables, scale, offset = None, 1.0, (0.0, 0.0, 0.0)
    highs = list(surface.highs)
    if settings.occluders == Occluders.ALL and others:
        # In the same order for all low objects, which then share a tree.
        highs = sorted([*highs, *others], key=lambda high: high.name)
        ray_scene = tree_cache.trees.ray_scene_of(highs, timings)
        tables, all_space = ray_scene.tables, ray_scene.local_space
        scale = space.size / all_space.size
        offset = tuple(((space.origin - all_space.origin) / all_space.size).tolist())
    return openness.Occluders(
        tables,
        scale,
        offset,
        farthest=None if settings.ao_distance is None else in_scene(settings.ao_distance, settings, space) / space.size,
        fade=settings.ao_fade,
        two_sided=settings.two_sided,
        bias=math.radians(settings.bias_angle),
        floor=min(_lowest(high, space) for high in highs) if settings.floor else None,
    )


def _lowest(mesh: Mesh, space: LocalSpace) -> float:
    """The lowest z of the vertices that triangles of `mesh` use."""
    return float(space.points(mesh)[mesh.vertices[mesh.triangles.reshape(-1)], 2].min())
