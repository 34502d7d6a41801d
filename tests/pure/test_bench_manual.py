# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests how the tables of docs/benchmarks.md are filled from the figures of a run."""

import pytest

from scripts.bench.contenders.names import CAST, CYCLES, FLATTEN, MULTIRES, PRESENT
from scripts.bench.report import manual
from scripts.imprint import ROOT

PAGE = (
    "Before\n\n<!-- bench: live -->\n\nold\n\n<!-- end -->\n\nBetween\n\n<!-- bench: storing -->\nkept\n<!-- end -->\n"
)


def timed(*seconds):
    return {"first": 1.0, "seconds": list(seconds), "stages": {}, "gap": ""}


def test_measured_tables_are_filled_and_others_stay():
    live = {"triangles": 8, "touched": 1.0, "size": 16, "update_ms": [9.0, 8.0, 10.0], "image_ms": [1.0] * 3}
    text = manual.fill(PAGE, {"live": [live]})
    assert "| 8 | 100% | 16 | 9.0 (8.0 to 10.0) | 1.0 (1.0 to 1.0) |\n\n<!-- end -->\n\nBetween" in text
    assert text.startswith("Before\n\n<!-- bench: live -->\n\n| triangles |")
    assert "old" not in text
    assert text.endswith("<!-- bench: storing -->\nkept\n<!-- end -->\n")
    assert manual.fill(text, {"live": [live]}) == text


def test_runs_of_one_machine_are_joined():
    about = {"processor": "abacus", "cores": 2, "renderer": "chalk", "backend": "BOARD", "blender": "5.2.3"}
    first = {"machine": about | {"load": 0.5}, "repeats": 5, "live": [1], "storing": [1]}
    second = {"machine": about | {"load": 0.25}, "repeats": 3, "storing": [2]}
    for runs in ((first, second), (second, first)):
        found = manual.joined(runs)
        assert (found["live"], found["repeats"], found["machine"]["load"]) == ([1], 3, 0.5)
        assert found["storing"] == runs[1]["storing"]
        assert "a load of 0.5 at the start; medians of 3 rounds or more" in manual.machine(found)[0]
    with pytest.raises(ValueError, match="cores, blender differ"):
        manual.joined([first, second | {"machine": about | {"load": 0.0, "cores": 4, "blender": "6.0"}}])


def test_unknown_tables_are_an_error():
    with pytest.raises(LookupError, match="poetry"):
        manual.fill("<!-- bench: poetry -->\n<!-- end -->\n", {})


def test_the_page_has_all_tables_once():
    page = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    assert sorted(place[1] for place in manual.PLACE.findall(page)) == sorted(manual.TABLES)


def test_tables_of_bakers_have_ratios_of_medians():
    times = {FLATTEN: timed(0.1, 0.1), CAST: timed(0.5, 0.5), CYCLES: timed(2.0, 2.0), MULTIRES: timed(0.2, 0.2)}
    row = {"pair": "king", "size": 1024, "samples": 1, "is_terrain": False, "times": times, "angles": {}}
    result = {"pairs": [row, row | {"samples": 16}], "closed_forms": [row]}
    assert (
        manual.speed(result)[2]
        == "| king, 1024 | 20.0 (20.0 to 20.0) | 4.00 (4.00 to 4.00) | – | – | 100, 500, 2,000 |"
    )
    assert manual.sixteen(result)[2].endswith("| 2,000 (2,000 to 2,000) | 4.00 (4.00 to 4.00) |")
    assert manual.multires(result)[2] == "| 1024 | 100 (100 to 100) | 200 (200 to 200) | 2.00 (2.00 to 2.00) |"
    assert manual.other_bakers(result) == []
    assert len(manual.speed(result)) == len(manual.sixteen(result)) == 4
    assert any("Cast" in line for line in manual.targets(result))
    assert not any("not measured" in line for line in manual.targets(result))


def test_growth_has_exponents_of_the_largest_points():
    points = [
        {"amount": amount, "seconds": {FLATTEN: [amount**2.0] * 2, CAST: [float(amount)] * 2}}
        for amount in (1, 10, 100, 1000)
    ]
    points[0]["seconds"][CAST] = [500.0] * 2
    assert manual.growth({"growth": {"texels": points}})[2].startswith(
        "| texels, up to 1,000 | 2.00 (2.00 to 2.00) | 1.00 (1.00 to 1.00) |"
    )


def test_several_tables_of_a_section_stay_apart():
    row = {
        "what": "run",
        "pair": "king",
        "size": 16,
        "times": {PRESENT: timed(1.0)},
        "startup": {PRESENT: {"bpy": 0.5}},
        "bake": {PRESENT: {}},
    }
    text = manual.fill("<!-- bench: start -->\n<!-- end -->\n", {"start": [row]})
    assert text.count("\n| --- |") == 2
    assert "|\n\n| version |" in text
    assert "##" not in text
