# SPDX-License-Identifier: GPL-3.0-or-later
"""Divides a bake into texture sets: an image for each material of the low mesh."""

from collections.abc import Sequence

from ..core.errors import BakeError
from ..core.names.file_names import MATERIAL
from ..core.settings import Settings
from ..scene.high_layers.material_sets import sets_of
from .job import Job


def by_material(jobs: Sequence[Job], settings: Settings) -> list[Job]:
    """A job for each texture set of each of `jobs`. Raises BakeError for names that the sets would share."""
    found = [job.of_set(one) for job in jobs for one in sets_of(job.low)]
    if len(found) > len(jobs):
        for text, what in ((settings.output, "file"), (settings.image, "image")):
            if text and MATERIAL not in text:
                raise BakeError(f"Texture sets need {MATERIAL} in the name of the {what}: {text!r} has none.")
    return found
