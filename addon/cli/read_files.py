# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that a bake reads, as they are known once those of its options are open: for reports, records and clashes."""

import argparse
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import bpy

from ..core.file_structure import usd_layers
from ..jobs.job import Job
from ..output import datablocks
from ..scene import dependencies
from .plan import plans
from .plan.clashes import InputFiles


def read_by(options: argparse.Namespace, jobs: Sequence[Job]) -> Iterator[tuple[str, str]]:
    """The files that the open scene's bake reads beside those of its options, and what they are. Some may not exist."""
    yield from used(options)
    for name in plans.scene_paths(options):
        title = f"what {os.path.basename(name)!r} refers to"
        yield from ((path, title) for path in InputFiles().references(name))
    lows, highs = [job.low for job in jobs], [high for job in jobs for high in job.highs]
    cages = [job.cage for job in jobs if job.cage]
    for each in dependencies.of([*lows, *highs, *cages], highs):
        # The materials of a low object that is its own high one show the maps that the bake replaces.
        if not (each.is_own_map and set(lows) & set(highs)):
            yield each.path, each.what


def not_followed(options: argparse.Namespace, jobs: Sequence[Job]) -> list[str]:
    """Why the bake may read files that `read_by` does not know, in clauses."""
    objects = [obj for job in jobs for obj in (job.low, *job.highs, job.cage) if obj]
    return [
        *filter(None, (usd_layers.named(name).unknown for name in plans.scene_paths(options))),
        *dependencies.not_followed(objects),
    ]


def used(options: argparse.Namespace) -> Iterator[tuple[str, str]]:
    """The files that the open scene uses beside its own, and what they are: libraries, caches, layers of USD files, textures of
    imported meshes."""
    yield from (
        (path, what) for path, what in datablocks.sources() if path != bpy.data.filepath
    )  # it may be saved over
    # The images of a .blend may be maps of an earlier bake, which the next bake replaces.
    named = plans.scene_paths(options)
    for name in named:
        yield from ((path, f"what {os.path.basename(name)!r} refers to") for path in usd_layers.named(name).layers)
    if named and not any(Path(name).suffix.lower().startswith(".blend") for name in named):
        for image in bpy.data.images:
            if image.filepath and image.source in {"FILE", "TILED", "SEQUENCE"}:
                yield bpy.path.abspath(image.filepath), "a texture of the meshes"
