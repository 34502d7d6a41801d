# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertex groups of low meshes that change rays: which of them the objects of a call have, and a proposal of weights.

A proposal tries other weights on the whole low mesh, and keeps at each vertex those that leave the fewest doubtful texels
around it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ..core import progress, udim
from ..core.declarations.choices import Method
from ..core.errors import BakeError
from ..core.report import Report
from ..core.settings import Run, Settings
from ..engine import baking, gpu_memory, unsure_texels
from ..engine.planning import plan_of
from ..mesh.inputs import Meshes
from ..scene.mesh_elements import GROUPS, UNPAINTED, without_missing, write_weights
from .job import Job, PastBake, Request, check_job, read_meshes


def settings_by_job(jobs: Sequence[Job], settings: Settings, wanted: Sequence[Job] | None = None) -> list[Settings]:
    """The settings for each job. Where several are baked, a low object without a group is baked as unpainted.

    wanted: those of `jobs` of which the settings are returned; None for all.

    Raises BakeError if none of several low objects has the group. One low object may lack a group that another object has,
    as mesh_elements.weights reads it.
    """
    wanted = jobs if wanted is None else wanted
    names = [name for setting in GROUPS if (name := getattr(settings.tracing, setting))]
    if len(jobs) < 2 or settings.tracing.method == Method.FLATTEN or not names:
        return [settings] * len(wanted)
    for name in names:
        if not any(name in job.low.vertex_groups for job in jobs):
            raise BakeError(f"No low object has a vertex group {name!r}: name one that they have, or none.")
    return [without_missing(job.low, settings) for job in wanted]


GROUP_NAMES = {"offset_group": "Imprint Offset", "straight_group": "Imprint Straight"}
"""The names of groups that are created, by the settings."""
TRIALS = (
    ("offset_group", 0.25),
    ("offset_group", 0.125),
    ("offset_group", 0.0625),
    ("offset_group", 0.0),
    ("offset_group", 1.0),
    ("straight_group", 0.0),
    ("straight_group", 1.0),
)
"""What is tried: a weight in the group that a setting names. Of equally good ones the first is taken."""
BETTER = 0.75
"""Other weights are proposed only where at most this share of the doubtful texels remains."""
TEXELS = 256
"""The most texels a side that are tried."""
CHECKED_TEXELS = 1024
"""The most texels a side on which the result is checked. Several tiles share them."""
ROUNDS = 4
"""How often weights are taken back where they change sure texels, before all are."""


@dataclass(frozen=True)
class Proposal:
    """Weights (V,) float32 by vertex of the low object, by the settings that name their groups.

    They are the present ones where no others are better.

    Attributes:
        before, after: The shares of the checked texels that are doubtful, without and with them.
        weights: Groups by the names of settings.
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
    settings = past.settings.without_other_maps().without_file().without_materials()
    settings = without_missing(low, settings.traced(**groups, **past.distances))
    check_job(context, past.job, settings)
    meshes = read_meshes(context, Request(past.job.but(texture_set=None), settings))
    if len(meshes.low.positions) != len(low.data.vertices):
        raise BakeError(
            f"The modifiers of {low.name!r} add or remove vertices: apply them to get weights for its mesh."
        )
    with gpu_memory.trimmed():
        plan = plan_of(meshes, settings, tiles=past.tiles)
        meshes = plan.meshes
        ray_cast = progress.finish(baking.draw(plan, Run(settings))).ray_cast
        views = [udim.uv_to_clip(tile) for tile in past.tiles]

        def trace(painted: Meshes, most: int) -> unsure_texels.Traced:
            most = max(TEXELS, int(most / len(views) ** 0.5))  # as much memory for many tiles as for one
            size = min(settings.sampling.width, most), min(settings.sampling.height, most)
            return unsure_texels.trace_doubts(ray_cast.of(painted), meshes.low, size, views)

        return best(meshes, trace)


def apply(low: bpy.types.Object, proposal: Proposal, groups: dict[str, str]) -> dict[str, str]:
    """Write the weights of `proposal` into `groups`, as in `propose`. Returns the names of all groups, with those created."""
    names = {}
    for setting, weights in proposal.weights.items():
        names[setting] = write_weights(low, groups[setting] or GROUP_NAMES[setting], weights)
    low.vertex_groups.active = low.vertex_groups[names["offset_group"]]  # which is painted more often
    return names


def best(meshes: Meshes, trace: Callable[[Meshes, int], unsure_texels.Traced]) -> Proposal:
    """The best weights for `meshes`. trace: casts the rays of painted meshes, for at most so many texels a side.

    No weights are proposed that change what a sure texel shows.
    """
    present = {
        "offset_group": _by_vertex(meshes, None if meshes.offset is None else meshes.offset / 2.0),
        "straight_group": _by_vertex(meshes, None if meshes.straight is None else (meshes.straight + 1.0) / 2.0),
    }
    now = trace(_painted(meshes, present), TEXELS)
    fewest, proposed = _around_vertices(meshes, now.doubtful()) * BETTER, dict(present)
    for setting, weight in TRIALS:
        trial = present | {setting: np.full_like(present[setting], weight)}
        traced = trace(_painted(meshes, trial), TEXELS)
        around = _around_vertices(meshes, traced.doubtful())
        is_better = (around < fewest) & (_around_vertices(meshes, now.lost(traced)) == 0)
        fewest = np.where(is_better, around, fewest)
        proposed = {name: np.where(is_better, trial[name], weights) for name, weights in proposed.items()}
    return _checked(meshes, trace, present, proposed)


def _checked(
    meshes: Meshes,
    trace: Callable[[Meshes, int], unsure_texels.Traced],
    present: dict[str, np.ndarray],
    proposed: dict[str, np.ndarray],
) -> Proposal:
    """`found` as far as it changes no sure texel, or `present` if that is no better. They are as Proposal.weights."""
    now = trace(_painted(meshes, present), CHECKED_TEXELS)
    before, texels = now.doubtful().sum(), max(1, len(now.triangles))
    # Between vertices with different weights, rays are between those of two trials.
    for _ in range(ROUNDS):
        then = trace(_painted(meshes, proposed), CHECKED_TEXELS)
        is_harmful = _around_vertices(meshes, now.lost(then)) > 0
        if not is_harmful.any():
            after = then.doubtful().sum()
            if after < before:
                return Proposal(proposed, float(before / texels), float(after / texels))
            break
        proposed = {name: np.where(is_harmful, present[name], weights) for name, weights in proposed.items()}
    return Proposal(present, float(before / texels), float(before / texels))


def _painted(meshes: Meshes, weights: dict[str, np.ndarray]) -> Meshes:
    """`meshes` with these weights, by setting and by vertex."""
    offset, straight = (weights[setting][meshes.low.vertices] for setting in ("offset_group", "straight_group"))
    return replace(meshes, offset=2.0 * offset, straight=2.0 * straight - 1.0)


def _around_vertices(meshes: Meshes, by_triangle: np.ndarray) -> np.ndarray:
    """The sums (V,) float64 of what the triangles around each vertex have, from (T,)."""
    vertices = meshes.low.vertices[meshes.low.triangles].reshape(-1)
    return np.bincount(vertices, weights=np.repeat(by_triangle, 3), minlength=len(meshes.low.positions))


def _by_vertex(meshes: Meshes, by_corner: np.ndarray | None) -> np.ndarray:
    """Weights (V,) float32 by vertex, from weights by corner; neutral where there are none."""
    result = np.full(len(meshes.low.positions), UNPAINTED, np.float32)
    if by_corner is not None:
        result[meshes.low.vertices] = by_corner
    return result
