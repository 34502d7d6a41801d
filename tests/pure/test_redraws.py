# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that a bake in the window does not draw the screen, or pictures of the map, more often than it is worth."""

from types import SimpleNamespace

import pytest

from addon.core import progress
from addon.core.progress import Pace, Redraws

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
