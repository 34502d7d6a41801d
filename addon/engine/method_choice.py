# SPDX-License-Identifier: GPL-3.0-or-later
"""Flatten or Cast: which of them it is, and what it needs before the passes run."""

from collections.abc import Sequence
from dataclasses import replace

from ..core import udim
from ..core.errors import BakeError, shorten_list
from ..core.progress import Pace, Progress, Task
from ..core.report import Report
from ..core.settings import Settings
from ..mesh import triangle_mesh, uv_layout
from ..mesh.inputs import Meshes
from ..mesh.local_space import gap, local_space_of
from ..passes import mesh_upload
from . import ray_casting, ray_distances, sources, uv_agreement

FAR_APART = 0.5
"""Of the low mesh's radius: boxes that lie farther from each other than this have nothing to do with each other."""


def choose(meshes: Meshes, tiles: Sequence[int], settings: Settings, report: Report) -> Meshes:
    """Put into the report which method it is, and why where that was left open. Returns what that method can use."""
    if settings.method == "AUTO":
        with report.timed("method"):
            if meshes.is_own_base and meshes.highs[0].uv is not None and not meshes.highs[0].instances:
                report.method, report.why = "FLATTEN", "a surface and its own base mesh share their UVs"
            elif meshes.cage is not None:
                report.method, report.why = "CAST", "there is a cage"
            else:
                report.method, report.why, seen = uv_agreement.choose(meshes.low, meshes.highs, tiles)
                meshes = replace(meshes, apart=seen)
    if report.method == "FLATTEN":
        return replace(
            meshes,
            highs=[triangle_mesh.keep_corners(high, triangle_mesh.finite_rows(high.uv)) for high in meshes.highs],
        )
    apart = gap(meshes.low, meshes.highs)
    radius = local_space_of([meshes.low]).size
    if apart > FAR_APART * radius and settings.max_distance is None and meshes.cage is None:
        raise BakeError(_apart(report, apart))
    # What no ray can reach would only make the tree coarse: the size of its boxes' steps is that of all high meshes.
    far = max(settings.extrusion or 0.0, settings.max_distance or 0.0, 2.0 * radius)
    out_of_reach = [gap(meshes.low, [high]) > far for high in meshes.highs]
    if all(out_of_reach):
        return meshes
    report.warnings += [
        f"{high.name!r} lies out of reach of the rays and was left out."
        for high, is_out in zip(meshes.highs, out_of_reach, strict=True)
        if is_out
    ]
    return replace(meshes, highs=[high for high, is_out in zip(meshes.highs, out_of_reach, strict=True) if not is_out])


def source(
    meshes: Meshes,
    tiles: Sequence[int],
    settings: Settings,
    report: Report,
    pace: Pace,
    *,
    uploads: mesh_upload.UploadCache | None = None,
) -> Task[sources.Source]:
    """What draws the normals; `uploads` holds what was uploaded before."""
    if report.method == "FLATTEN":
        return sources.Flat(meshes.low, meshes.highs, settings, report, uploads=uploads)
    yield Progress("Building the tree", 0.0)
    ray_scene = ray_casting.trees.ray_scene_of(meshes.highs, report)
    yield Progress("Measuring distances", 0.5)
    with report.timed("upload"):
        rays = ray_casting.rays(meshes.low, meshes.directions, meshes.cage, ray_scene.local_space)
    # With a cage rays start on it, and nowhere else.
    extrusion, reach = 0.0 if meshes.cage is not None else settings.extrusion, settings.max_distance
    if extrusion is None or reach is None:
        with report.timed("distances"):
            outside, inside = ray_distances.measure(
                ray_scene.tables,
                rays,
                (settings.width, settings.height),
                tiles,
                has_cage=meshes.cage is not None,
                facing_only=settings.facing_only,
            )
        extrusion = outside * ray_scene.local_space.size if extrusion is None else extrusion
        # What was measured from the low surface, from wherever rays start.
        reach = extrusion + inside * ray_scene.local_space.size if reach is None else reach
        report.measured = True
    report.distances = {"extrusion": extrusion, "max_distance": reach}
    size = ray_scene.local_space.size
    ray_cast = ray_casting.RayCast(ray_scene, rays, extrusion / size, reach / size, settings.facing_only)
    return sources.Rays(meshes.low, ray_cast, meshes.highs, settings, pace)


def nothing_drawn(meshes: Meshes, tiles: Sequence[int], report: Report) -> str:
    """Why no texel was written, as a sentence."""
    names = shorten_list(map(repr, report.high))
    if not set(tiles).intersection(uv_layout.tiles(meshes.low)):
        return f"No triangle of {report.low!r} lies on the map: its UVs are outside {_place(tiles)}, or empty."
    if report.method == "FLATTEN":
        if not any(set(tiles).intersection(uv_layout.tiles(high)) for high in meshes.highs):
            return f"No triangle of {names} lies on the map: its UVs are outside {_place(tiles)}, or empty."
        return f"{report.low!r} and {names} have no texel in common: their UV layouts differ, so cast rays instead."
    apart = gap(meshes.low, meshes.highs)
    if apart > 0.0:
        return _apart(report, apart)
    return f"No ray from {report.low!r} hit {names}: give a larger extrusion and maximum distance."


def _place(tiles: Sequence[int]) -> str:
    return "0 to 1" if list(tiles) == [udim.FIRST] else f"the tiles {shorten_list(tiles)}"


def _apart(report: Report, distance: float) -> str:
    names = shorten_list(map(repr, report.high))
    return f"{report.low!r} and {names} do not overlap: they are {distance:.4g} apart."
