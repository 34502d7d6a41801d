# SPDX-License-Identifier: GPL-3.0-or-later
"""The seconds of the stages in a report add up to the total."""

from types import SimpleNamespace

import bpy
import pytest

from addon.core import progress
from addon.core.progress import Pace
from addon.core.settings import Settings
from addon.engine import tree_cache
from addon.jobs import Job, bake_jobs
from tests.support import zoo


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("share_image", [False, True])
@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_stages_add_up_to_the_total_without_waiting(method, share_image, monkeypatch):
    clock = SimpleNamespace(now=0.0)

    def tick():
        clock.now += 1.0  # each look at the clock takes a second
        return clock.now

    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=tick))
    tree_cache.trees.free()
    jobs = [Job(zoo.plane("lo"), [zoo.terrain("hi")])]
    settings = Settings(method=method, width=32, height=32, image="map", storage="MEMORY", material=False)
    work = bake_jobs.work(bpy.context, jobs, settings, Pace(0.01), share_image=share_image)
    try:
        while True:
            next(work)
            clock.now += 1e6
    except StopIteration as end:
        (report,) = end.value
    stages = {stage: seconds for stage, seconds in report.seconds.items() if stage != "total"}
    assert stages["draw"] > 0.0 and (stages["tree"] > 0.0) == (method == "CAST")
    assert 0.0 < sum(stages.values()) <= report.seconds["total"] < 1e6
