# SPDX-License-Identifier: GPL-3.0-or-later
"""The objects of one bake: held, matched by name, and checked before anything is read."""

from collections.abc import Sequence

import bpy
import gpu

from ..core.errors import BakeError
from ..core.name_matching import Suffixes, match
from ..core.settings import Settings
from ..engine.bands import bands
from ..output import image_writer, materials
from ..output.output_clashes import settings_by_map
from ..scene import bake_objects


class Job:
    """The objects of one bake. `highs` may be [low] alone: its surface with modifiers goes onto its own base mesh.

    It outlives renaming and undo. The attributes `low`, `highs` and `cage`, which has the topology of `low` and lets rays
    start on it, raise BakeError for an object that was deleted.
    """

    def __init__(self, low: bpy.types.Object, highs: Sequence[bpy.types.Object], cage: bpy.types.Object | None = None):
        self.refs = [bake_objects.hold(obj) for obj in (low, *highs, *([cage] if cage else []))]
        self._has_cage = cage is not None

    @property
    def low(self) -> bpy.types.Object:
        return self.refs[0].resolve()

    @property
    def high_refs(self) -> list[bake_objects.ObjectRef]:
        return self.refs[1 : len(self.refs) - self._has_cage]

    @property
    def highs(self) -> list[bpy.types.Object]:
        return [ref.resolve() for ref in self.high_refs]

    @property
    def cage(self) -> bpy.types.Object | None:
        return self.refs[-1].resolve() if self._has_cage else None

    def renew(self) -> bool:
        """Whether one has another session_uid now, as after its library was reloaded; from then on it is known by that.

        Raises BakeError if one was deleted.
        """
        found = [ref.resolve() for ref in self.refs]
        is_new = any(obj.session_uid != ref.uid for obj, ref in zip(found, self.refs, strict=True))
        if is_new:
            self.refs = [bake_objects.hold(obj) for obj in found]
        return is_new


def jobs_by_name(context: bpy.types.Context, suffixes: Suffixes) -> tuple[list[Job], list[str]]:
    """The jobs of the view layer's objects that are matched by name, and sentences about those that are not.

    Raises BakeError when there is no job.
    """
    objects = context.view_layer.objects
    found, problems = match(objects.keys(), suffixes)
    if not found:
        raise BakeError(" ".join(problems) or f"No object is called something{suffixes.low}.")
    jobs = [
        Job(objects[pair.low], [objects[name] for name in pair.highs], objects[pair.cage] if pair.cage else None)
        for pair in found
    ]
    return jobs, problems


def check_job(context: bpy.types.Context, job: Job, settings: Settings) -> None:
    """Raise BakeError for what can be known before anything is read."""
    # Scripts link, move and bake without a redraw between: view layers and matrices lag behind until asked.
    context.view_layer.update()
    reason = bake_objects.problem(context, job.low, job.highs, job.cage, settings.method)
    if reason:
        raise BakeError(reason)
    for image_settings in settings_by_map(settings).values():
        image_writer.check(job.low.name, image_settings)
    if settings.material:
        materials.check(job.low)
    try:
        gpu.init()
    except (SystemError, RuntimeError) as error:
        raise BakeError(f"There is no GPU to bake on: {error}.") from error
    limit = gpu.capabilities.max_texture_size_get()
    tallest = max(band.height for band in bands(settings.width, settings.height, settings.margin))
    if max(settings.width, tallest) > limit:
        raise BakeError(
            f"A map of {settings.width} x {settings.height} texels does not fit this GPU, whose textures have at most {limit} "
            "a side."
        )
