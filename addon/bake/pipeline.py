# SPDX-License-Identifier: GPL-3.0-or-later
"""The story of a bake: check, read the meshes, draw, read back, store, hook up, report."""

from collections.abc import Sequence

import bpy
import gpu
import numpy as np

from ..mesh import arrays
from ..passes import resolve, target
from . import agreement, casting, distances, images, materials, reading, render, subjects
from .errors import BakeError
from .report import Report
from .settings import Settings

MANY_MISSES = 1e-3
"""Share of rays that may hit nothing without a warning."""


def bake(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    settings: Settings,
    cage: bpy.types.Object | None = None,
) -> Report:
    """Bake the detail of `highs` into a map for `low`, and put the map into its material.

    `highs` may be [low] alone: then its surface with modifiers goes onto its own base mesh. `cage` has the topology of
    `low`; rays start on it. Raises BakeError, with the scene, the image and its file as before, when that cannot be done.
    """
    report = Report(settings.method, settings.space, (settings.width, settings.height), low.name, [h.name for h in highs])
    with report.timed("total"):
        _check(context, low, highs, cage, settings)
        report.backend, report.renderer = gpu.platform.backend_type_get(), gpu.platform.renderer_get()
        with report.timed("extract"):
            meshes = reading.read(context, low, highs, cage, settings)
        report.uv_layer = meshes.uv_layer
        try:
            texels, state = _draw(meshes, settings, report)
        finally:
            target.trim()
            casting.trim()
        _tell(meshes, state, report)
        with report.timed("image"):
            image = images.store(texels, low.name, settings)
            report.image, report.output = image.name, settings.output
            if settings.material:
                report.warnings += materials.hook_up(
                    low,
                    image,
                    space=settings.space,
                    uv_layer=report.uv_layer,
                    green=settings.green,
                    single_user=settings.single_user,
                )
    return report


def _draw(meshes: reading.Meshes, settings: Settings, report: Report) -> tuple[np.ndarray, np.ndarray]:
    """Texels and their state, by the method asked for or, with AUTO, by the one that fits."""
    if settings.method == "AUTO":
        if meshes.is_own_base:
            report.method, report.why = "FLATTEN", "a surface and its own base mesh share their UVs"
        elif meshes.cage is not None:
            report.method, report.why = "CAST", "there is a cage"
        else:
            report.method, report.why = agreement.choose(meshes.low, meshes.highs)
    if report.method == "FLATTEN":
        source = render.flattened(meshes.low, meshes.highs, settings, report)
    else:
        source = _rays(meshes, settings, report)
    texels, state = render.texels(source, meshes.basis, settings, report)
    if not (state == resolve.WRITTEN).any():
        raise BakeError(_nothing_drawn(meshes, report))
    return texels, state


def _rays(meshes: reading.Meshes, settings: Settings, report: Report) -> render.Source:
    aim = casting.target_of(meshes.highs, report)
    rays = casting.rays(meshes.low, meshes.directions, meshes.cage, aim.frame)
    extrusion, reach = settings.extrusion, settings.max_distance
    if extrusion is None or reach is None:
        with report.timed("distances"):
            size = settings.width, settings.height
            measured = distances.measure(
                aim.tables, rays, size, has_cage=meshes.cage is not None, facing_only=settings.facing_only
            )
        if reach is None:
            # What was measured from the low surface, from wherever rays start.
            reach = (measured[1] - measured[0]) * aim.frame.size
            reach += measured[0] * aim.frame.size if extrusion is None else extrusion
        extrusion = measured[0] * aim.frame.size if extrusion is None else extrusion
    report.distances = {"extrusion": extrusion, "max_distance": reach}
    return render.casted(
        meshes.low, rays, aim, settings, extrusion=extrusion / aim.frame.size, reach=reach / aim.frame.size
    )


def _nothing_drawn(meshes: reading.Meshes, report: Report) -> str:
    """Why no texel was written, as a sentence."""
    names = ", ".join(map(repr, report.high))
    if not arrays.is_on_tile(meshes.low):
        return f"No triangle of {report.low!r} lies on the map: its UVs are outside 0 to 1, or empty."
    if report.method == "FLATTEN":
        if not any(map(arrays.is_on_tile, meshes.highs)):
            return f"No triangle of {names} lies on the map: its UVs are outside 0 to 1, or empty."
        return f"{report.low!r} and {names} have no texel in common: their UV layouts differ, so cast rays instead."
    gap = arrays.gap(meshes.low, meshes.highs)
    if gap > 0.0:
        return f"{report.low!r} and {names} do not overlap: they are {gap:.4g} apart."
    return f"No ray from {report.low!r} hit {names}: give a larger extrusion and maximum distance."


def _tell(meshes: reading.Meshes, state: np.ndarray, report: Report) -> None:
    """Put into the report what was covered, what was missed and what was left out."""
    report.triangles = {"high": sum(len(high.triangles) for high in meshes.highs), "low": len(meshes.low.triangles)}
    counts = np.bincount(state.reshape(-1), minlength=4)
    report.coverage = int(counts[resolve.WRITTEN]) / state.size
    report.margin = int(counts[resolve.MARGIN]) / state.size
    report.missed = int(counts[resolve.MISSED]) / max(1, int(counts[resolve.MISSED] + counts[resolve.WRITTEN]))
    if report.missed > MANY_MISSES:
        report.warnings.append(
            f"{report.missed:.2%} of the rays from {report.low!r} hit nothing: those texels have alpha 0. "
            "Look at the extrusion and the maximum distance."
        )
    for mesh in (meshes.low, *meshes.highs):
        laid_flat = mesh is meshes.low or report.method == "FLATTEN"
        no_area, outside = arrays.uv_flaws(mesh) if laid_flat else (0, 0)
        for count, what in (
            (mesh.not_finite, "left out: their coordinates are NaN or infinite"),
            (no_area, "have no area in UV space and cannot be drawn"),
            (outside, "reach outside the UV tile 0 to 1 and are cut off there"),
        ):
            if count:
                report.warnings.append(f"{mesh.name!r}: {count:,} of its triangles {what}.")


def _check(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    cage: bpy.types.Object | None,
    settings: Settings,
) -> None:
    settings.check()
    # Scripts link, move and bake without a redraw between: view layers and matrices lag behind until asked.
    context.view_layer.update()
    reason = subjects.problem(context, low, highs, cage)
    if reason:
        raise BakeError(reason)
    images.check(low.name, settings)
    if settings.material:
        materials.check(low)
    try:
        gpu.init()
    except (SystemError, RuntimeError) as error:
        raise BakeError(f"There is no GPU to bake on: {error}.") from error
    limit = gpu.capabilities.max_texture_size_get()
    if settings.width > limit:
        raise BakeError(f"A map {settings.width} texels wide does not fit this GPU, whose limit is {limit}.")
