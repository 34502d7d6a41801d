# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that slices of work take the intended time."""

from types import SimpleNamespace

from addon.core import progress
from addon.core.progress import Pace


def test_slices_adapt_to_the_intended_time(monkeypatch):
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=lambda: clock.now))
    seen = []
    for rows in Pace(0.5).slices(1000):
        seen.append(rows)
        clock.now += 0.01 * len(rows)
    assert [row for rows in seen for row in rows] == list(range(1000))
    assert [len(rows) for rows in seen] == [8, 16, 32, *[48] * 19, 32]
