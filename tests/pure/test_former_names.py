# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of version 0.2 still work, with a warning, and reports have both."""

import json

import pytest

from addon.cli import arguments, job_file, limits
from addon.core.report import Report
from addon.core.settings import Settings

BAKE = ["lo.blend", "--low", "lo", "--output", "m.png"]


def test_options():
    with pytest.warns(FutureWarning, match="--readers is now called --targets"):
        found = arguments.parse([*BAKE, "--readers", "three,unreal", "--allow-missing-pages"])
    assert found == arguments.parse([*BAKE, "--targets=unreal,three", "--allow-missing-files"])
    with pytest.warns(FutureWarning):
        assert arguments.parse([*BAKE, "--readers=three"]).targets == ("three",)


def test_keys_of_job_files(tmp_path):
    values = {"file": "lo.blend", "low": "lo", "output": "m.png"}
    for number, more in enumerate(
        ({"readers": "three", "allow_missing_pages": True}, {"targets": "three", "allow-missing-files": True})
    ):
        (tmp_path / f"{number}.json").write_text(json.dumps({"bake": [values | more]}))
    with pytest.warns(FutureWarning, match="readers is now called targets"):
        (former,) = job_file.read(str(tmp_path / "0.json"))
    assert former == job_file.read(str(tmp_path / "1.json"))[0]


def test_settings():
    with pytest.warns(FutureWarning, match="readers is now called targets"):
        assert Settings(readers=("three",)) == Settings(targets=("three",))


def test_limits():
    with pytest.warns(FutureWarning, match="readers.three.p99 is now called targets.three.p99"):
        found = limits.parse("readers.three.p99<2deg")
    assert found == limits.parse("targets.three.p99<2deg")


def test_reports_have_both_keys():
    off = {"three": {"median": 1.0}}
    report = Report("CAST", "TANGENT", (16, 16), "lo", ["hi"], targets=off, export={"targets": off}).to_dict()
    assert report["readers"] == report["export"]["readers"] == off
    assert report["seconds"]["pages"] == report["seconds"]["textures"]
