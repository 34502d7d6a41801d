# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what a report of the test of a GPU says."""

import json
import math

import pytest

from addon.core.gpu_report import GpuReport, Outcome, Timed, Verdict
from scripts.imprint import ROOT
from tests.support import json_schema

SCHEMA = json.loads((ROOT / "docs" / "gpu-report.schema.json").read_text(encoding="utf-8"))
MACHINE = dict.fromkeys(SCHEMA["properties"]["machine"]["properties"], "images") | {"renderer": "a | b"}
KEPT = Outcome("Read-backs wait", Verdict.RIGHT, "60 ms")
EQUAL = Outcome("Cast: normal", Verdict.EQUAL, "", 0, 2304, 0.0, "degrees")
WITHIN = Outcome("Rays: ambient occlusion", Verdict.WITHIN, "", 3, 2304, 1 / 64)
WRONG = Outcome("Flatten: normal", Verdict.WRONG, "12 by more than 0.05", 1200, 2304, 7.25, "degrees")
LOST = Outcome("Margin: normal", Verdict.WRONG, "Shader Compile Error")


def report(*tests, **more):
    maps = [each for each in tests if each is not KEPT]
    times = [Timed("Own hits", 812.5, "M rays/s", "512 x 512"), Timed("Occlusion", 1234.0, "M rays/s")]
    return GpuReport(MACHINE, {"texture size": 16384}, [KEPT], maps, times, 7.3, **more)


def test_what_is_right_is_said():
    found = report(EQUAL, WITHIN)
    assert found.verdict == (
        "All right: the driver passes 1 checks, and 2 maps are right, 1 of them equal to their answers."
    )
    assert found.wrong == []
    lines = found.text.splitlines()
    assert "  right  Read-backs wait: 60 ms" in lines
    assert "  equal  Cast: normal: all 2,304 texels" in lines
    assert "  within Rays: ambient occlusion: 3 of 2,304 texels differ, by at most 0.0156" in lines
    assert "  Own hits: 812 M rays/s (512 x 512)" in lines
    assert "texture size           16384" in lines


def test_what_is_wrong_comes_first():
    found = report(EQUAL, WRONG, LOST)
    assert found.verdict == "2 of 4 tests are wrong: bakes may be, too."
    lines = found.text.splitlines()
    at = lines.index("Maps")
    assert lines[at + 1] == (
        "  WRONG  Flatten: normal: 1,200 of 2,304 texels differ, by at most 7.25 degrees; 12 by more than 0.05"
    )
    assert lines[at + 2] == "  WRONG  Margin: normal: Shader Compile Error"
    assert lines[at + 3].startswith("  equal")


@pytest.mark.parametrize("tests", [(), (EQUAL, WITHIN), (WRONG, LOST)])
def test_the_schema_describes_the_json(tests):
    found = json.loads(json.dumps(report(*tests).to_dict(), allow_nan=False))
    assert list(json_schema.errors(found, SCHEMA)) == []
    assert found.keys() == SCHEMA["properties"].keys()
    assert found["machine"].keys() == SCHEMA["properties"]["machine"]["properties"].keys()
    for test in found["driver_checks"] + found["maps"]:
        assert test.keys() <= SCHEMA["$defs"]["test"]["properties"].keys()
    assert found["is_right"] == (WRONG not in tests)


def test_what_is_no_number_has_a_place_in_json():
    endless = Outcome("Cast: normal", Verdict.WRONG, "", 2304, 2304, math.inf, "degrees")
    found = json.loads(json.dumps(report(endless).to_dict(), allow_nan=False))
    assert found["maps"][0]["worst"] is None
    assert list(json_schema.errors(found, SCHEMA)) == []


def test_a_row_of_the_manual_has_the_columns_of_its_table():
    lines = (ROOT / "docs" / "platforms.md").read_text(encoding="utf-8").splitlines()
    heads = [line for line in lines if line.startswith("| system | Blender | backend | driver |")]
    assert len(heads) == 1
    row = report(EQUAL).row
    assert "a / b" in row
    assert "all right" in row
    assert row.count("|") == heads[0].count("|")
    assert "| Flatten: normal |" in report(WRONG).row
