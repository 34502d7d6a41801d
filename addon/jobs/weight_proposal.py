# SPDX-License-Identifier: GPL-3.0-or-later
"""Proposes weights for the painted vertex groups: it tries other weights on the whole low mesh, and keeps at each vertex those
that leave the fewest doubtful texels around it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import bpy
import gpu
import numpy as np

from ..core import progress, udim
from ..core.errors import BakeError
from ..core.report import Report
from ..core.timings import Timings
from ..engine import gpu_memory
from ..engine.method_choice import choose_method
from ..engine.rays import ray_casting, ray_doubts
from ..engine.sources import normal_source
from ..mesh.inputs import Meshes
from ..scene import reading, vertex_weights
from .job import check_job
from .report_making import PastBake

GROUP_NAMES = {"offset_group": "Imprint Offset", "straight_group": "Imprint Straight"}
"""The names of groups that are created, by the settings."""
TRIALS = (
    ("offset_group", 0.25),
    ("offset_group", 0.125),
    ("offset_group", 1.0),
    ("straight_group", 0.0),
    ("straight_group", 1.0),
)
"""What is tried: a weight in the group that a setting names. Of equally good ones the first is taken."""
BETTER = 0.75
"""Other weights are proposed only where at most this share of the doubtful texels remains."""
TEXELS = 256
"""The most texels a side that are tried."""


@dataclass(frozen=True)
class Proposal:
    """Weights (V,) float32 by vertex of the low object, by the settings that name their groups.

    They are the present ones where no others are better. before, after: the shares of the tried texels that are doubtful,
    without and with them.
    """

    weights: dict[str, np.ndarray]
    before: float
    after: float


def propose(context: bpy.types.Context, report: Report, groups: dict[str, str]) -> Proposal:
    """Weights for the objects of the bake of `report` as they are now. groups: names of the low object's groups, by setting.

    Raises BakeError if the objects can no longer be baked like that, or if modifiers add or remove vertices.
    """
    past = PastBake.of(report)
    low = past.job.low
    settings = vertex_weights.without_missing(low, replace(past.settings, method=past.method, maps=(), **groups))
    settings = replace(settings.without_file(), material=False, mask=False, **past.distances)
    check_job(context, past.job, settings)
    meshes = reading.read(context, low, past.job.highs, past.job.cage, settings)
    if len(meshes.low.positions) != len(low.data.vertices):
        raise BakeError(
            f"The modifiers of {low.name!r} add or remove vertices: apply them to get weights for its mesh."
        )
    plan = choose_method(meshes, past.tiles, settings)
    with gpu_memory.trimmed():
        ray_cast = progress.finish(normal_source(plan, settings, Timings(), progress.Pace())).ray_cast
        size = min(settings.width, TEXELS), min(settings.height, TEXELS)
        views = [udim.uv_to_clip(tile) for tile in past.tiles]
        return best(
            meshes,
            lambda painted: ray_doubts.count(
                replace(ray_cast, ray_mesh=_ray_mesh(ray_cast, painted)), meshes.low, size, views
            ),
        )


def apply(low: bpy.types.Object, proposal: Proposal, groups: dict[str, str]) -> dict[str, str]:
    """Write the weights of `proposal` into `groups`, as in `propose`. Returns the names of all groups, with those created."""
    names = {}
    for setting, weights in proposal.weights.items():
        names[setting] = vertex_weights.write(low, groups[setting] or GROUP_NAMES[setting], weights)
    low.vertex_groups.active = low.vertex_groups[names["offset_group"]]  # which is painted more often
    return names


def best(meshes: Meshes, doubts: Callable[[Meshes], tuple[np.ndarray, int]]) -> Proposal:
    """The best weights for `meshes`. doubts: counts the doubtful texels of painted meshes, as ray_doubts.count does."""
    present = {
        "offset_group": _by_vertex(meshes, None if meshes.offset is None else meshes.offset / 2.0),
        "straight_group": _by_vertex(meshes, None if meshes.straight is None else (meshes.straight + 1.0) / 2.0),
    }
    before, texels = doubts(_painted(meshes, present))
    fewest, found = _around_vertices(meshes, before) * BETTER, dict(present)
    for setting, weight in TRIALS:
        trial = present | {setting: np.full_like(present[setting], weight)}
        around = _around_vertices(meshes, doubts(_painted(meshes, trial))[0])
        is_better = around < fewest
        fewest = np.where(is_better, around, fewest)
        found = {name: np.where(is_better, trial[name], weights) for name, weights in found.items()}
    after, _ = doubts(_painted(meshes, found))
    if not after.sum() < before.sum():
        found, after = present, before
    return Proposal(found, *(float(count.sum()) / max(1, texels) for count in (before, after)))


def _painted(meshes: Meshes, weights: dict[str, np.ndarray]) -> Meshes:
    """`meshes` with these weights, by setting and by vertex."""
    offset, straight = (weights[setting][meshes.low.vertices] for setting in ("offset_group", "straight_group"))
    return replace(meshes, offset=2.0 * offset, straight=2.0 * straight - 1.0)


def _ray_mesh(ray_cast: ray_casting.RayCast, meshes: Meshes) -> gpu.types.GPUBatch:
    return ray_casting.upload_ray_mesh(meshes, ray_cast.low, ray_cast.ray_scene.local_space)


def _around_vertices(meshes: Meshes, by_triangle: np.ndarray) -> np.ndarray:
    """The sums (V,) float64 of what the triangles around each vertex have, from (T,)."""
    vertices = meshes.low.vertices[meshes.low.triangles].reshape(-1)
    return np.bincount(vertices, weights=np.repeat(by_triangle, 3), minlength=len(meshes.low.positions))


def _by_vertex(meshes: Meshes, by_corner: np.ndarray | None) -> np.ndarray:
    """Weights (V,) float32 by vertex, from weights by corner; neutral where there are none."""
    result = np.full(len(meshes.low.positions), vertex_weights.UNPAINTED, np.float32)
    if by_corner is not None:
        result[meshes.low.vertices] = by_corner
    return result
