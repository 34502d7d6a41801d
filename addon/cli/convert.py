# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversions of maps on the command line: the image file to convert, and its low object."""

import argparse
from pathlib import Path

import bpy

from ..core import udim
from ..core.conversion import ConversionReport
from ..core.errors import BakeError
from ..core.progress import Pace, Task
from ..core.settings import Settings
from ..jobs import bake_jobs, convert
from ..jobs.convert import Conversion
from ..jobs.job import Job
from ..scene import object_checks
from . import arguments


def convert_map(
    context: bpy.types.Context, job: Job, options: argparse.Namespace, settings: Settings
) -> Task[ConversionReport]:
    """Convert the image file that the options name, a map of the job's low object. Raises BakeError.

    A low object without other high ones is its own if its modifiers add detail; then the map is of its base mesh, as in bakes.
    """
    low = job.low
    is_own_base = job.highs == [low] == object_checks.own_highs(low)
    image = _loaded(options.convert)
    try:
        conversion = Conversion(low, image, arguments.stored_normals(options), is_own_base=is_own_base)
        pace = Pace(bake_jobs.PROGRESS_SECONDS, has_picture=False)
        return (yield from convert.work(context, conversion, settings, pace))
    finally:
        bpy.data.images.remove(image)


def _loaded(path: str) -> bpy.types.Image:
    """A new image datablock of a file, or of the files of all tiles. Raises BakeError."""
    full = Path(path).absolute()
    is_tiled = udim.is_tiled(str(full))
    if not (udim.files(str(full)) if is_tiled else full.is_file()):
        raise BakeError(f"{path!r} does not exist.")
    image = bpy.data.images.new(full.name, 1, 1)
    image.source, image.filepath = "FILE", str(full)
    if is_tiled:
        image.source = "TILED"  # looks for the files
    return image
