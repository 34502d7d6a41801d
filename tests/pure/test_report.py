# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a bake's time goes: each second is of one stage, and of none while nobody lets the bake go on."""

import json
from types import SimpleNamespace

import pytest

from addon.core import report
from addon.core.report import STAGES, Report


@pytest.fixture
def clock(monkeypatch):
    """Time that passes when the test says so: clock.now seconds."""
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(report, "time", SimpleNamespace(perf_counter=lambda: clock.now))
    return clock


@pytest.fixture
def told():
    return Report("CAST", "TANGENT", (16, 16), "lo", ["hi"])


def staged(told):
    return {stage: told.seconds[stage] for stage in STAGES if told.seconds[stage]}


def test_a_stage_inside_another_counts_for_itself_alone(clock, told):
    with told.timed("tree"):
        clock.now += 1.0
        for _ in range(2):
            with told.timed("upload"):
                clock.now += 10.0
                with told.timed("read"):
                    clock.now += 100.0
        clock.now += 2.0
    with told.timed("tree"):
        clock.now += 0.5
    assert staged(told) == {"tree": 3.5, "upload": 20.0, "read": 200.0}


def test_a_stage_that_fails_is_counted_and_ends(clock, told):
    with pytest.raises(KeyError), told.timed("tree"), told.timed("upload"):
        clock.now += 1.0
        raise KeyError
    with told.timed("draw"):
        clock.now += 2.0
    assert staged(told) == {"upload": 1.0, "draw": 2.0}


def test_what_waits_between_two_steps_costs_nothing(clock, told):
    def work():
        for _ in range(3):
            with told.timed("draw"):
                clock.now += 1.0
            yield "a step"
        return "done"

    steps = told.counted(work())
    with pytest.raises(StopIteration) as end:
        while True:
            assert next(steps) == "a step"
            clock.now += 1000.0
    assert end.value.value == "done"
    assert told.seconds["total"] == told.seconds["draw"] == 3.0


def test_work_that_is_given_up_is_closed(told):
    closed = []

    def work():
        try:
            yield
        finally:
            closed.append(True)

    steps = told.counted(work())
    next(steps)
    steps.close()
    assert closed


def test_the_keys_of_a_report_start_with_their_version(told):
    data = json.loads(json.dumps(told.to_dict()))
    assert next(iter(data)) == "version"
    assert data["version"] == report.VERSION
    assert Report(**data).to_dict() == told.to_dict() | {"size": [16, 16]}
