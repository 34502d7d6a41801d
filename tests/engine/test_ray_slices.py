# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays go to the GPU in slices, with a listener for their steps or without, and slices do not change the map."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.audit import tally
from addon.core import progress
from addon.core.progress import Pace
from addon.core.settings import Settings
from addon.engine import tree_cache
from addon.jobs import bake_pair
from addon.passes import cast, target
from tests.support import maps, zoo

SIZE = 256
RAYS = {"method": "CAST", "size": (SIZE, SIZE), "space": "OBJECT"}


@pytest.fixture
def slow(monkeypatch):
    """A GPU that takes 0.05 s for each row. Returns a list of the slices, as ranges of rows."""
    clock, given, trace, finish = SimpleNamespace(now=0.0, left=0.0), [], cast.trace, target.Target.finish

    def slow_trace(into, rays, *arguments, rows=None, **options):
        given.append(range(rays.height) if rows is None else rows)
        clock.left += 0.05 * len(given[-1])
        trace(into, rays, *arguments, rows=rows, **options)

    def slow_finish(self):
        clock.now, clock.left = clock.now + clock.left, 0.0  # drivers start their work later
        finish(self)

    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=lambda: clock.now))
    monkeypatch.setattr(cast, "trace", slow_trace)
    monkeypatch.setattr(target.Target, "finish", slow_finish)
    tree_cache.trees.free()
    return given


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("distances", [{}, {"extrusion": 0.2, "max_distance": 0.4}], ids=["measured", "set"])
def test_slices_are_short_without_a_listener(slow, distances):
    maps.bake(zoo.plane("lo"), zoo.terrain("hi"), **RAYS, **distances)
    baked = slow[-SIZE // Pace.STEP :]
    assert max(map(len, slow)) == Pace.FIRST  # the first of each
    assert sum(map(len, slow)) >= SIZE
    assert [len(rows) for rows in baked].count(Pace.STEP) > 16
    assert all(rows.start % Pace.STEP == 0 for rows in slow)


@pytest.mark.usefixtures("gpu_context", "slow")
@pytest.mark.parametrize("samples", [1, 4])
def test_slices_do_not_change_the_map(monkeypatch, samples):
    low, high = zoo.plane("lo"), zoo.terrain("hi")
    sliced = maps.bake(low, high, **RAYS, samples=samples)
    monkeypatch.setattr(Pace, "FIRST", SIZE)
    assert np.array_equal(sliced, maps.bake(low, high, **RAYS, samples=samples))
    assert len(np.unique(sliced)) > 1000


@pytest.mark.usefixtures("gpu_context")
def test_probes_for_distances_and_checks_are_sliced_too(slow):
    low, high = zoo.plane("lo"), zoo.terrain("hi")
    settings = Settings(method="CAST", width=SIZE, height=SIZE, image="map", storage="MEMORY", material=False)
    bake_pair(bpy.context, low, [high], settings)
    # The distances, and parts that stand off; then the map; then the checks on some of its texels: hits, and other layers of
    # the low mesh on both sides.
    starts = [rows.start for rows in slow].count(0)
    assert starts == 6
    assert max(map(len, slow)) == Pace.FIRST < tally.SAMPLES_A_SIDE
