# SPDX-License-Identifier: GPL-3.0-or-later
"""Divides a bake into texture sets: an image for each material of the low mesh."""

from collections.abc import Sequence

import bpy
import numpy as np

from ..core.errors import BakeError
from ..core.naming import MATERIAL
from ..core.settings import StorageSettings
from ..mesh.inputs import Meshes
from ..scene.high_materials import sets_of
from .job import Job


def by_material(jobs: Sequence[Job], settings: StorageSettings) -> list[Job]:
    """A job for each texture set of each of `jobs`. Raises BakeError for names that the sets would share."""
    found = [job.of_set(one) for job in jobs for one in sets_of(job.low)]
    if len(found) > len(jobs):
        for text, what in ((settings.output, "file"), (settings.image, "image")):
            if text and MATERIAL not in text:
                raise BakeError(f"Texture sets need {MATERIAL} in the name of the {what}: {text!r} has none.")
    return found


def numbers(low: bpy.types.Object, meshes: Meshes) -> np.ndarray | None:
    """The number (T,) int of the texture set of each triangle of the low mesh, as it was read; None if there is only one, or if
    they were not read, as for maps without tangents."""
    found = sets_of(low)
    if len(found) < 2 or meshes.basis is None or len(meshes.basis.triangles) != len(meshes.low.triangles):
        return None
    of_slot = np.zeros(max(1, len(low.material_slots)), np.int64)
    for number, one in enumerate(found):
        of_slot[list(one.slots)] = number
    return of_slot[meshes.basis.labels[:, 0].astype(np.int64).clip(0, len(of_slot) - 1)]
