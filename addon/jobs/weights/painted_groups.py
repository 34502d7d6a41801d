# SPDX-License-Identifier: GPL-3.0-or-later
"""Which low objects of several bakes have the vertex groups that the settings name."""

from collections.abc import Sequence

from ...core.declarations.choices import Method
from ...core.errors import BakeError
from ...core.settings import Settings
from ...scene import vertex_weights
from ..job import Job


def settings_by_job(jobs: Sequence[Job], settings: Settings) -> list[Settings]:
    """The settings for each job. Where several are baked, a low object without a group is baked as unpainted.

    Raises BakeError if none of several low objects has the group. One low object may lack a group that another object has,
    as vertex_weights.weights reads it.
    """
    if len(jobs) < 2 or settings.tracing.method == Method.FLATTEN:
        return [settings] * len(jobs)
    lows = [job.low for job in jobs]
    for name in filter(None, (getattr(settings.tracing, setting) for setting in vertex_weights.GROUPS)):
        if not any(name in low.vertex_groups for low in lows):
            raise BakeError(f"No low object has a vertex group {name!r}: name one that they have, or none.")
    return [vertex_weights.without_missing(low, settings) for low in lows]
