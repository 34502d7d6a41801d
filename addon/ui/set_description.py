# SPDX-License-Identifier: GPL-3.0-or-later
"""The sets of the open file as plain data, for job files and for a shell, which does not enable the add-on."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy

from ..core.declarations.choices import Storage
from ..core.errors import BakeError
from ..core.scene_sets import Part, SceneSet
from ..jobs.job import Job
from ..output import map_names
from . import object_pairs, properties, sets


def described() -> list[SceneSet]:
    """The sets of all scenes of the open file, in their order. Shows the scenes one after the other."""
    window, before = bpy.context.window, bpy.context.window.scene
    result = []
    try:
        for scene in bpy.data.scenes:
            if len(scene.imprint_sets):
                window.scene = scene
                bpy.context.view_layer.update()
                result += map(describe, scene.imprint_sets)
    finally:
        window.scene = before
    return result


def describe(one: sets.ImprintSet) -> SceneSet:
    """A set of the scene that is shown."""
    scene, settings = one.id_data.name, one.settings
    output = map_names.output_for(settings) if settings.storing.storage == Storage.FILE else ""
    usual = {"settings": settings, "is_on": one.is_on}
    paths = {"output": output, "export": one.own.whole.export}
    usual |= {name: bpy.path.abspath(path) for name, path in paths.items() if path}
    try:
        made = sets.resolve(bpy.context, one)
    except BakeError as error:
        return SceneSet(one.name, scene, (), problem=str(error), **usual)
    return SceneSet(
        one.name,
        scene,
        tuple(_part(job, is_on=job.low_ref.uid not in made.off) for job in made.jobs),
        share_image=made.share_image,
        left_out=tuple(f"{name}: {why}" for name, why in made.left_out),
        states={job.low.name: state for job in made.jobs if (state := job.low.imprint.state)},
        **usual,
    )


def _part(job: Job, *, is_on: bool) -> Part:
    highs = [high.name for high in job.highs]
    cage = job.cage.name if job.cage else ""
    return Part(job.low.name, tuple(highs), cage, job.size, job.distance, job.sizes, is_on)


@contextmanager
def registered() -> Iterator[None]:
    """Register what `described` reads, and nothing else, for a process that has not enabled the add-on."""
    with ExitStack() as undo:
        for module in () if hasattr(bpy.types.Scene, "imprint") else (object_pairs, properties, sets):
            module.register()
            undo.callback(module.unregister)
        yield
