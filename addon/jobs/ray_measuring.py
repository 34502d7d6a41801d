# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures what a bake would measure of its rays, without a bake."""

from collections.abc import Sequence
from dataclasses import replace

import bpy

from ..core import progress
from ..core.settings import Run, Settings
from ..engine import gpu_memory, shared_uvs
from ..engine.method_choice import choose_method, tiles_to_bake
from ..engine.rays.ray_casting import RayCast
from ..engine.sources import normal_source
from ..scene import reading
from .job import Job, check_job


def measure(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    settings: Settings,
    cage: bpy.types.Object | None = None,
) -> RayCast | None:
    """The rays of a bake of these objects; None if it would cast none. Raises BakeError as the bake does."""
    # Nothing is stored, so it does not matter where.
    settings = replace(settings.without_file(), material=False)
    settings.check()
    job = Job(low, highs, cage)
    check_job(context, job, settings)
    meshes = reading.read(context, low, highs, cage, settings)
    with gpu_memory.trimmed():
        tiles = tiles_to_bake(meshes, settings.sampling)
        in_order = shared_uvs.ordered(meshes, tiles, settings.sampling)
        plan = choose_method(in_order, tiles, settings.tracing, reading.lengths_of(context.scene))
        return progress.finish(normal_source(plan, Run(settings))).ray_cast
