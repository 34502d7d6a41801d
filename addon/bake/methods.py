# SPDX-License-Identifier: GPL-3.0-or-later
"""Flatten or Cast: which of them it is, and what it needs before the passes run."""

import numpy as np

from ..mesh import arrays
from ..passes import resolve
from . import agreement, casting, distances, render
from .errors import BakeError
from .reading import Meshes
from .report import Report
from .settings import Settings


def draw(meshes: Meshes, settings: Settings, report: Report) -> tuple[np.ndarray, np.ndarray]:
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


def _rays(meshes: Meshes, settings: Settings, report: Report) -> render.Source:
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


def _nothing_drawn(meshes: Meshes, report: Report) -> str:
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
