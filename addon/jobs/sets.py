# SPDX-License-Identifier: GPL-3.0-or-later
"""A set: low objects that are baked together, with the same settings, under one name. Here as plain data, for any caller."""

from collections.abc import Collection
from dataclasses import dataclass, field

import bpy

from ..core.progress import Pace, Task
from ..core.report import Report
from ..core.settings import Settings
from . import bake_jobs
from .job import NOTHING_ELSE, Job, Wants


@dataclass(frozen=True)
class SetJob:
    """What is baked of a set.

    Attributes:
        name: Of the set, which an image has that all parts share.
        jobs: One for each part.
        settings: Of all of them, with placeholders in names.
        share_image: Whether parts share images: one for all, or one for each material if the settings have texture sets.
        left_out: The names of parts that cannot be baked, and why in a sentence.
        off: The session_uids of the low objects that are switched off. They keep their texels, and shade others as usual.
    """

    name: str
    jobs: tuple[Job, ...]
    settings: Settings
    share_image: bool = False
    left_out: tuple[tuple[str, str], ...] = ()
    off: frozenset[int] = field(default_factory=frozenset)

    def wanted(self, only: Collection[int] | None = None) -> list[Job]:
        """The jobs that are baked. only: the session_uids of the low objects, of which those that are off are none."""
        return [
            job for job in self.jobs if job.low_ref.uid not in self.off and (only is None or job.low_ref.uid in only)
        ]


def work(
    context: bpy.types.Context,
    set_job: SetJob,
    pace: Pace,
    *,
    only: Collection[int] | None = None,
    wants: Wants = NOTHING_ELSE,
) -> Task[list[Report]]:
    """Bake a set, as bake_jobs.work; a part that fails does not end the others, unless they share an image.

    only: the session_uids of the low objects that are baked; None for all. The others keep their texels.
    """
    return (
        yield from bake_jobs.work(
            context,
            set_job.wanted(only),
            set_job.settings,
            pace,
            wants=wants,
            share_image=set_job.share_image,
            goes_on=not set_job.share_image,
        )
    )
