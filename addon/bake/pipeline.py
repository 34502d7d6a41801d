# SPDX-License-Identifier: GPL-3.0-or-later
"""The story of a bake: check, read the meshes, draw, read back, store, hook up, report."""

from collections.abc import Sequence

import bpy
import gpu
import numpy as np

from ..mesh import arrays, extract
from ..passes import resolve, target
from . import images, materials, render, subjects
from .errors import BakeError
from .report import Report
from .settings import Settings


def bake(
    context: bpy.types.Context, low: bpy.types.Object, highs: Sequence[bpy.types.Object], settings: Settings
) -> Report:
    """Bake the detail of `highs` into a map for `low`, and put the map into its material.

    `highs` may be [low] alone: then its surface with modifiers goes onto its own base mesh. Raises BakeError, with the
    scene, the image and its file as before, when that cannot be done.
    """
    report = Report(
        settings.method, settings.space, (settings.width, settings.height), low.name, [h.name for h in highs]
    )
    with report.timed("total"):
        _check(context, low, highs, settings)
        report.backend, report.renderer = gpu.platform.backend_type_get(), gpu.platform.renderer_get()
        with report.timed("extract"), subjects.ready(context, low, highs, settings.modifiers) as depsgraph:
            low_mesh, high_meshes = _read(low, highs, depsgraph, settings, report)
        try:
            texels, state = render.flattened(low_mesh, high_meshes, settings, report)
        finally:
            target.trim()
        _tell(low_mesh, high_meshes, state, report)
        if not report.coverage:
            raise BakeError(
                f"No triangle of {', '.join(report.high)} lies on the map: its UVs are outside 0 to 1, or empty."
            )
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


def _tell(low: arrays.Mesh, highs: list[arrays.Mesh], state: np.ndarray, report: Report) -> None:
    """Put into the report what was covered and what was left out."""
    report.triangles = {"high": sum(len(high.triangles) for high in highs), "low": len(low.triangles)}
    report.coverage = np.count_nonzero(state == resolve.WRITTEN) / state.size
    report.margin = np.count_nonzero(state == resolve.MARGIN) / state.size
    for mesh in {id(mesh): mesh for mesh in (low, *highs)}.values():
        no_area, outside = arrays.uv_flaws(mesh)
        for count, what in (
            (mesh.not_finite, "left out: their coordinates are NaN or infinite"),
            (no_area, "have no area in UV space and cannot be drawn"),
            (outside, "reach outside the UV tile 0 to 1 and are cut off there"),
        ):
            if count:
                report.warnings.append(f"{mesh.name!r}: {count:,} of its triangles {what}.")


def _check(
    context: bpy.types.Context, low: bpy.types.Object, highs: Sequence[bpy.types.Object], settings: Settings
) -> None:
    settings.check()
    # Scripts link, move and bake without a redraw between: view layers and matrices lag behind until asked.
    context.view_layer.update()
    reason = subjects.problem(context, low, highs)
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


def _read(
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    depsgraph: bpy.types.Depsgraph,
    settings: Settings,
    report: Report,
) -> tuple[arrays.Mesh, list[arrays.Mesh]]:
    with extract.base(low) if low in highs else extract.evaluated(low, depsgraph) as data:
        report.uv_layer = _uv_layer(low, data, settings.uv_layer)
        read = extract.with_tangents if settings.space == "TANGENT" else extract.surface
        low_mesh = read(data, report.uv_layer, low.name, extract.matrix(low))
    high_meshes = []
    for high in highs:
        with extract.evaluated(high, depsgraph) as data:
            # The layer of the same name is the shared one; else the one that the artist sees in the UV editor.
            wanted = report.uv_layer if report.uv_layer in data.uv_layers else ""
            high_meshes.append(extract.surface(data, _uv_layer(high, data, wanted), high.name, extract.matrix(high)))
    return low_mesh, high_meshes


def _uv_layer(obj: bpy.types.Object, data: bpy.types.Mesh, wanted: str) -> str:
    if not data.polygons:
        raise BakeError(f"{obj.name!r} has no faces.")
    if not data.uv_layers:
        raise BakeError(f"{obj.name!r} has no UV layer: unwrap it first.")
    if wanted and wanted not in data.uv_layers:
        known = ", ".join(repr(layer.name) for layer in data.uv_layers)
        raise BakeError(f"{obj.name!r} has no UV layer {wanted!r}: it has {known}.")
    return wanted or data.uv_layers.active.name
