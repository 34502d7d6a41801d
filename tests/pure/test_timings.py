# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the time measured for each stage of a bake: each second counts for one stage, and pauses count for none."""

import itertools
import re
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from addon.core import asset_limits, progress
from addon.core.progress import (
    BEGUN,
    LONGEST,
    SLICE_ROWS,
    SLOWEST,
    STAGES,
    STARTUP,
    Pace,
    Progress,
    Redraws,
    Startup,
    Timings,
    aside,
    costs_of_rows,
    finish,
    run_for,
)


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test sets: clock.now, in seconds."""
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=lambda: clock.now, time=lambda: clock.now))
    return clock


@pytest.fixture
def measured():
    return Timings()


def staged(measured):
    return {stage: measured.seconds[stage] for stage in STAGES if measured.seconds[stage]}


def test_a_stage_inside_another_counts_only_for_itself(clock, measured):
    with measured.timed("tree"):
        clock.now += 1.0
        for _ in range(2):
            with measured.timed("upload"):
                clock.now += 10.0
                with measured.timed("read"):
                    clock.now += 100.0
        clock.now += 2.0
    with measured.timed("tree"):
        clock.now += 0.5
    assert staged(measured) == {"tree": 3.5, "upload": 20.0, "read": 200.0}


def test_a_stage_that_fails_is_counted_and_ends(clock, measured):
    with pytest.raises(KeyError), measured.timed("tree"), measured.timed("upload"):
        clock.now += 1.0
        raise KeyError
    with measured.timed("draw"):
        clock.now += 2.0
    assert staged(measured) == {"upload": 1.0, "draw": 2.0}


def test_each_stage_that_the_code_times_is_declared():
    addon = Path(progress.__file__).parents[1]
    timed = {
        stage for path in addon.rglob("*.py") for stage in re.findall(r"timed\(.*\"(\w+)\"\)", path.read_text("utf-8"))
    }
    assert timed == {*STAGES, *asset_limits.STAGES}


def test_time_between_steps_does_not_count(clock, measured):
    def work():
        for _ in range(3):
            with measured.timed("draw"):
                clock.now += 1.0
            yield "a step"
        return "done"

    steps = measured.counted(work())
    with pytest.raises(StopIteration) as end:
        while True:
            assert next(steps) == "a step"
            clock.now += 1000.0
    assert end.value.value == "done"
    assert measured.seconds["total"] == measured.seconds["draw"] == 3.0


def test_work_is_closed_with_its_timer(measured):
    closed = []

    def work():
        try:
            yield
        finally:
            closed.append(True)

    steps = measured.counted(work())
    next(steps)
    steps.close()
    assert closed


def test_each_stage_before_a_bake_is_reported_once(clock):
    startup = Startup()
    for stage in STARTUP:
        with startup.spent(stage):
            clock.now += 1.0
    with startup.spent("opening"):
        clock.now += 2.0
    assert startup.take() == dict.fromkeys(STARTUP, 1.0) | {"opening": 3.0}
    assert startup.take() == dict.fromkeys(STARTUP, 0.0)


@pytest.mark.parametrize(("begun", "seconds"), [("97.5", 2.5), ("101.0", 0.0), ("soon", 0.0), (None, 0.0)])
def test_the_launcher_counts_from_its_start(clock, monkeypatch, begun, seconds):
    clock.now = 100.0
    monkeypatch.delenv(BEGUN, raising=False)
    if begun:
        monkeypatch.setenv(BEGUN, begun)
    startup = Startup()
    startup.add_launcher()
    assert startup.take()["launcher"] == seconds


# Progress


def test_slices_adapt_to_the_intended_time(monkeypatch):
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=lambda: clock.now))
    pace = Pace(0.5)
    costs = [0.5 * FIRST] * 125
    seen = list(pace.slices("rays", costs, 1000, lambda rows: advance(clock, 0.01 * len(rows))))
    assert [row for rows in seen for row in rows] == list(range(1000))
    assert [len(rows) for rows in seen] == [16, 32, *[48] * 19, 40]
    assert [len(rows) for rows in pace.slices("rays", costs[:9], 72, lambda rows: None)] == [48, 24]
    assert len(next(pace.slices("others", costs, 1000, lambda rows: None))) == 16


FIRST = SLOWEST * 0.5 * Pace.EARLY
"""The rays of the first slice of 0.5 seconds for a listener."""


def advance(clock, seconds):
    clock.now += seconds


@pytest.fixture
def ticking(monkeypatch):
    """A clock that tests move on with `advance`."""
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=lambda: clock.now))
    return clock


def sliced(clock, costs, rate, pace=None, overhead=0.0):
    """The number of STEPs and the seconds of each slice. rate: rays per second. overhead: seconds of each slice."""
    found = []

    def draw(rows):
        seconds = overhead + sum(costs[rows.start // SLICE_ROWS : -(-rows.stop // SLICE_ROWS)]) / rate
        found.append((-(-len(rows) // SLICE_ROWS), seconds))
        advance(clock, seconds)

    for _ in (pace or Pace()).slices("rays", costs, SLICE_ROWS * len(costs), draw):
        advance(clock, 10.0)  # what the caller does between two slices does not count
    assert sum(steps for steps, _ in found) == len(costs)
    return found


@pytest.mark.parametrize("rate", [1e7, 4e7, 1e8, 1e9])
@pytest.mark.parametrize("rays", [1e3, 3e4, 9e5])
def test_no_slice_takes_longer_than_planned(ticking, rate, rays):
    found = sliced(ticking, [rays] * 1000, rate)
    assert max(seconds for _, seconds in found) <= LONGEST * (1.0 + 1e-6)
    assert found[0][1] <= SLOWEST * LONGEST / rate * (1.0 + 1e-6)
    assert all(later <= 2 * before for (before, _), (later, _) in itertools.pairwise(found))


def test_rows_without_texels_let_no_slice_grow(ticking):
    """All rows of a map of 16,384 texels a side: those above have 64 rays in each texel, those below have none."""
    covered = np.concatenate([np.zeros(1024), np.full(1024, 8.0 * 16384)])
    found = sliced(ticking, costs_of_rows(covered, 16384, 32.0).tolist(), SLOWEST)
    assert max(seconds for _, seconds in found) <= 32.0 * 8 * 16384 / SLOWEST * 1.01
    assert max(steps for steps, seconds in found) > 100


def test_slices_that_take_no_time_grow_only_to_what_is_sure(ticking):
    found = sliced(ticking, [1e4] * 4000, 1e12, overhead=0.001)
    assert [steps for steps, _ in found[:4]] == [100, 200, 400, 400]
    pace = Pace()
    assert sliced(ticking, [1e4] * 1000, 1e8, pace)[-1][0] == 300  # in 30 ms, which is sure
    assert max(steps for steps, _ in sliced(ticking, [1e4] * 9000, 1e12, pace, overhead=0.001)) == 4 * 300


def test_the_end_of_a_map_makes_no_later_slice_smaller(ticking):
    pace = Pace()
    sliced(ticking, [99e3] * 1000, 2e7, pace)
    assert sliced(ticking, [99e3] * 21, 2e7, pace)[0][0] == 20
    assert sliced(ticking, [99e3] * 21, 2e7, pace)[0][0] == 20


@pytest.mark.parametrize(("count", "cost", "step"), [(4096, 4096.0, 8), (4096, 0.0, 8), (5, 1e9, 8), (10**7, 0.25, 1)])
def test_pieces_are_what_the_slowest_gpu_draws(count, cost, step):
    found = progress.pieces(count, cost, step)
    assert [each for piece in found for each in (piece.start, piece.stop)][1:-1:2] == [p.stop for p in found[:-1]]
    assert (found[0].start, found[-1].stop) == (0, count)
    assert all(piece.start % step == 0 for piece in found)
    assert max(len(piece) for piece in found) * cost <= max(SLOWEST * LONGEST, step * cost)
    assert len(found) == 1 or min(len(piece) for piece in found[:-1]) * cost > SLOWEST * LONGEST - step * cost


# Redraws


TICK = 0.1


@pytest.mark.parametrize("cost", [0.001, 0.02, 0.25, 2.0])
def test_redraws_take_a_small_share_of_the_time(cost):
    """`cost` is that of one redraw, in seconds."""
    clock, counted = SimpleNamespace(now=7.0), 0
    redraws = Redraws(lambda: clock.now)
    while clock.now < 207.0:
        redraws.note_done()
        clock.now += TICK
        if redraws.are_due():
            counted += 1
            clock.now += cost
    assert counted * cost <= Redraws.SHARE * 200.0 + cost
    often_enough = max(Redraws.EVERY + TICK, cost / Redraws.SHARE + TICK)
    assert counted >= 200.0 / often_enough - 1
    assert counted <= 200.0 / Redraws.EVERY


def test_a_slow_tick_without_a_redraw_counts_as_none():
    clock = SimpleNamespace(now=0.0)
    redraws = Redraws(lambda: clock.now)
    assert redraws.are_due()
    redraws.note_done()
    clock.now = 1.0
    redraws.note_done()
    assert redraws.are_due()


@pytest.mark.parametrize("pace", [Pace(), Pace(0.05, has_picture=False)])
def test_no_picture_is_drawn_that_nobody_sees(pace):
    assert not pace.takes_picture()


def test_most_slices_draw_no_picture(monkeypatch):
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=lambda: clock.now))
    pace, slices, pictures = Pace(0.05), 0, 0
    while clock.now < 20.0:
        slices += 1
        pictures += pace.takes_picture()
        clock.now += 0.05
    assert slices >= 400
    assert 20.0 / (Pace.PICTURES + 0.05) <= pictures <= 20.0 / Pace.PICTURES + 1


def test_a_tick_ends_after_its_seconds_and_before_a_long_operation(clock):
    def work():
        for number in range(9):
            clock.now += 0.05
            yield Progress("Unwrapping", number / 9, is_before_long=number == 3)

    task = work()
    assert [round(9 * run_for(task, 0.12).done) for _ in range(3)] == [2, 3, 6]


def test_what_runs_aside_has_steps_until_it_ends():
    goes_on, step = threading.Event(), Progress("Sorting", 0.5)
    task = aside(lambda: goes_on.wait(2.0), step)
    assert next(task) is step
    goes_on.set()
    assert finish(task)


def test_what_fails_aside_raises_its_error():
    with pytest.raises(ZeroDivisionError):
        finish(aside(lambda: 1 // 0, Progress("", 0.0)))


def test_who_leaves_does_not_wait_for_what_runs_aside():
    goes_on, ends = threading.Event(), threading.Event()
    task = aside(lambda: goes_on.wait(2.0) and ends.set(), Progress("", 0.0))
    next(task)
    task.close()
    assert not ends.is_set()
    goes_on.set()
    assert ends.wait(2.0)
