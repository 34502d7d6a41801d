# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the benchmark: its tables and comparison on invented numbers, and one small measurement with known angles."""

import numpy as np
import pytest

import addon
from scripts.bench import bakers, comparing, scenes, tables
from scripts.bench.bakers import Imprint
from scripts.bench.comparing import CAST, CYCLES, FLATTEN
from scripts.bench.parts.closed_forms import deviation
from tests.support import angles

EXACT = 0.6
"""Degrees: the error of triangles with a size of 1/128 of the map, which interpolate normals."""


def result(**rounds):
    times = {name: {"seconds": seconds} for name, seconds in rounds.items()}
    machine = dict.fromkeys((*comparing.SAME, "load"), "one")
    return {"machine": machine, "pairs": [{"pair": "rock", "size": 512, "samples": 1, "times": times}]}


def test_tables_have_ratios_of_medians_and_of_rounds():
    found = result(**{FLATTEN: [0.1, 0.2, 0.1], CAST: [1.0, 1.0, 1.0], CYCLES: [2.0, 2.0, 4.0]})
    row = "| rock, 512 | 20.00 (10.00 to 40.00) | 2.00 (2.00 to 4.00) | – | 100, 1,000, 2,000 |"
    assert tables.lines_of("speed", found)[2:] == [row]
    page = "a\n<!-- bench: speed -->\nold\n<!-- end -->\n<!-- bench: live -->\nold\n<!-- end -->\n"
    assert row in tables.fill(page, found) and tables.fill(page, found).count("old") == 1
    assert row in tables.markdown(found)


def test_exponents_are_those_of_the_largest_points():
    points = [{"amount": n, "seconds": {CAST: [0.5 + n * n]}} for n in (1e-3, 1e3, 1e4, 1e5)]
    assert tables.exponent(points, CAST) == "2.00 (2.00 to 2.00)"


def test_slower_is_what_is_slower_in_all_rounds():
    old = result(**{FLATTEN: [1.0, 1.1, 1.2], CAST: [1.0, 1.1, 1.2], CYCLES: [1.0]})
    new = result(**{FLATTEN: [1.3, 1.4, 1.5], CAST: [1.1, 1.4, 1.5], CYCLES: [9.0]})
    found = {change.name.rpartition(": ")[2]: change.is_slower for change in comparing.changes(old, new)}
    assert found == {FLATTEN: True, CAST: False}
    assert not any(change.is_slower or change.is_faster for change in comparing.changes(old, old))
    assert comparing.lines(old, new)[0] == "1 of 2 measurements are slower beyond the spread, 0 faster."


@pytest.mark.parametrize("build", [scenes.sine, scenes.belt])
def test_maps_agree_with_the_closed_form(build):
    """Checks the formula on the mesh as well, whose quads nearly have the surface's normal at their center."""
    pair = build(128)
    high = pair.high.data
    normals, uv = np.empty(3 * len(high.polygons), np.float32), np.empty(2 * len(high.loops), np.float32)
    high.polygons.foreach_get("normal", normals)
    high.uv_layers.active.uv.foreach_get("vector", uv)
    truth = pair.truth(*uv.reshape(-1, 4, 2).mean(axis=1, dtype=np.float64).T)
    assert angles.degrees(normals.reshape(-1, 3), truth).max() < EXACT

    contender = Imprint(FLATTEN, pair, 64, method="FLATTEN", space="WORLD")
    contender.bake()
    found = deviation(pair, contender.normals())
    assert found["maximum"] < EXACT
    assert found["written"] == 1.0
    flipped = deviation(pair, -contender.normals())
    assert flipped["median"] > 179.0


def test_a_race_alternates_contenders_and_reports_gaps():
    order = []

    def runner(name):
        return bakers.Contender(name, lambda: order.append(name) or 0.5, lambda: None)

    def fails():
        raise RuntimeError("Error: no image\nmore")

    timed = bakers.race([runner("A"), bakers.Contender("X", fails, lambda: None), runner("B")], 2)
    assert order == ["A", "B"] * 3
    assert timed["A"].seconds == [0.5, 0.5]
    assert timed["X"].gap == "Error: no image"


@pytest.fixture(autouse=True, scope="module")
def _freed():
    yield
    addon.free()
