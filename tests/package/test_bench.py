# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the benchmark's fits, verdicts and report on invented numbers, and one small measurement with known angles."""

import json
import re

import numpy as np
import pytest

import addon
from scripts.bench.contenders import racing
from scripts.bench.contenders.imprint_baker import Imprint
from scripts.bench.contenders.names import CAST, CYCLES, FLATTEN, MULTIRES
from scripts.bench.meshes import scenes
from scripts.bench.parts import limit
from scripts.bench.parts.closed_forms import deviation
from scripts.bench.report import growth_section, race_sections, report, targets, verdicts
from scripts.bench.report.statistics_of_rounds import exponents, ratios
from tests.support import angles

EXACT = 0.6
"""Degrees: the error of triangles with a size of 1/128 of the map, which interpolate normals."""


def timed(*seconds, first=1.0, gap=""):
    stages = dict.fromkeys(race_sections.STAGES, 0.01) | {"draw": 0.02, "image": 0.5, "total": 0.6} if seconds else {}
    return {"first": first, "seconds": list(seconds), "stages": stages, "gap": gap}


def row(**changes):
    times = {FLATTEN: timed(0.1, 0.2, 0.1), CAST: timed(1.0, 1.5, 1.0), CYCLES: timed(2.0, 2.0, 4.0)}
    return {
        "pair": "terrain",
        "is_terrain": True,
        "high": 200_000,
        "low": 9_000,
        "size": 2048,
        "samples": 1,
        "times": times,
    } | changes


def points(power, scatter=0.0, count=5):
    amounts = [10.0 ** (3 + k) for k in range(count)]
    return [
        {
            "amount": int(amount),
            "seconds": dict.fromkeys((FLATTEN, CAST), [1e-6 * amount ** (power + s) for s in (-scatter, 0.0, scatter)]),
            "peak_gigabytes": {FLATTEN: 1.0, CAST: None},
        }
        for amount in amounts
    ]


def result(**parts):
    machine = {
        "processor": "abacus",
        "cores": 2,
        "load": 0.0,
        "system": "none",
        "renderer": "llvmpipe",
        "in_software": True,
        "backend": "OPENGL",
        "blender": "5.2.3",
        "copy_gigabytes_per_second": 10.0,
    }
    return {"quick": True, "repeats": 3, "seconds": 1.0, "machine": machine, "peers": {}} | parts


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_exponents_are_fitted(power):
    found = exponents(points(power, scatter=0.1), FLATTEN)
    assert found == pytest.approx({"median": power, "least": power - 0.1, "most": power + 0.1})


def test_only_the_largest_points_can_be_fitted():
    bent = points(0.0, count=2) + points(2.0)[2:]
    assert exponents(bent, CAST, last=3)["median"] == pytest.approx(2.0)
    assert exponents(bent, CAST)["median"] != pytest.approx(2.0)


def test_ratios_of_medians_and_of_rounds():
    assert ratios(row(), CYCLES, FLATTEN) == pytest.approx({"median": 20.0, "least": 10.0, "most": 40.0})
    assert ratios(row(), "Unknown", FLATTEN) is None


@pytest.mark.parametrize(
    ("seconds", "outcome"),
    [
        ((0.1, 0.1, 0.1), "holds"),
        ((0.1, 0.1, 0.3), "open"),
        ((0.3, 0.3, 0.1), "open"),
        ((0.5, 0.5, 0.5), "missed"),
        ((), "not measured"),
    ],
)
def test_verdicts_of_ratios(seconds, outcome):
    times = {FLATTEN: timed(*seconds), CAST: timed(1.0, 1.0, 1.0), CYCLES: timed(2.0, 2.0, 2.0)}
    found = targets.judge(result(pairs=[row(times=times)]))
    (verdict,) = (verdict for verdict in found if "Flatten 10 times" in verdict.target)
    assert verdict.outcome == outcome
    places = [verdicts.ORDER.index(verdict.outcome) for verdict in found]
    assert places == sorted(places)


@pytest.mark.parametrize(("ours", "outcome"), [(0.305, "holds"), (0.35, "missed")])
def test_verdicts_of_accuracy(ours, outcome):
    found = {
        name: {"median": 0.1, "percentile_99": degrees, "maximum": 1.0, "written": 1.0}
        for name, degrees in ((FLATTEN, ours), (CYCLES, 0.3), (MULTIRES, 0.5))
    }
    assert verdicts.accuracy(row(angles=found)).outcome == outcome


@pytest.mark.parametrize(
    ("power", "scatter", "outcome"), [(0.7, 0.2, "holds"), (0.9, 0.2, "open"), (1.1, 0.2, "open"), (1.5, 0.2, "missed")]
)
def test_verdicts_of_growth(power, scatter, outcome):
    assert verdicts.linear("triangles", points(power, scatter), FLATTEN).outcome == outcome


def test_the_report_starts_with_verdicts_and_has_gaps_for_missing_measurements(tmp_path):
    missing = {"Open3D, RaycastingScene": timed(first=0.0, gap="not today")}
    rows = [row(times=row()["times"] | missing)]
    made = result(
        pairs=rows,
        closed_forms=[row(angles={})],
        growth={"triangles": points(1.0), "texels": points(1.0), "samples": points(1.0)},
        limit=limit.limit(rows[0], 10.0),
        hardware={"error": "no context"},
        figures={"figure_1.png": "A sphere"},
    )
    text = report.markdown(json.loads(json.dumps(made)))
    assert "targets hold" in text.split("\n## ", maxsplit=1)[0]
    assert "nan" not in text.lower()
    assert "None" not in text
    assert "not today" in text
    assert "| – |" in text
    assert "improve next is **image**" in text
    for table in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        assert len({line.count("|") for line in table.splitlines()}) == 1
    growth_section.plot(made["growth"], tmp_path / "growth.png")
    assert (tmp_path / "growth.png").stat().st_size > 0


def test_the_limit_counts_the_bytes_of_each_stage():
    stages = limit.limit(row(), 10.0)["methods"][FLATTEN]["stages"]
    assert stages["draw"]["least_seconds"] == pytest.approx(2 * 16 * 2048**2 / 10e9)
    assert stages["extract"]["bytes"] == 2 * 3 * 32 * 209_000
    assert "total" not in stages


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
        return racing.Contender(name, lambda: order.append(name) or 0.5, lambda: None)

    def fails():
        raise RuntimeError("Error: no image\nmore")

    timed = racing.race([runner("A"), racing.Contender("X", fails, lambda: None), runner("B")], 2)
    assert order == ["A", "B"] * 3
    assert timed["A"].seconds == [0.5, 0.5]
    assert timed["X"].gap == "Error: no image"


@pytest.fixture(autouse=True, scope="module")
def _freed():
    yield
    addon.free()
