# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that the reports of the parts of a job file, baked by calls of their own, make the report of one call for all."""

import json

import bpy
import pytest

from addon.cli import command, run_report
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

OF_A_CALL = {"started", "host", "call", "seconds", "startup", "log", "memory"}
"""Keys whose values are of the call and the machine, and not of the bake."""


def without(value):
    """Plain data without what is of a call."""
    if isinstance(value, dict):
        return {key: without(each) for key, each in value.items() if key not in OF_A_CALL}
    return [without(each) for each in value] if isinstance(value, list) else value


def test_four_parts_make_the_report_of_one_call(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    zoo.plane("low")
    zoo.plane("high", slope=0.2)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    usual = {"file": "file.blend", "low": "low", "high": "high", "limit": 9, "strict": "coverage<90%"}
    sets = [{"output": f"{name}.png", "size": 16 + 4 * (name % 3)} for name in range(9)]
    sets[4]["low"] = "missing"
    (tmp_path / "j.json").write_text(json.dumps({"defaults": usual, "bake": sets}))
    assert command.run(["--jobs", "j.json", "--report", "whole.json"]) == run_report.FAILED
    parts = [f"r.{part}.json" for part in (3, 1, 4, 2)]
    for part in parts:
        command.run(["--jobs", "j.json", "--shard", f"{part[2]}/4", "--report", part])
    capsys.readouterr()
    assert command.run(["report", "--merge", "all.json", *parts]) == run_report.FAILED
    assert "missing:" not in capsys.readouterr().err
    whole, merged = (json.loads((tmp_path / name).read_text()) for name in ("whole.json", "all.json"))
    assert without(merged) == without(whole)
    assert whole["summary"]["gate"] == 8
    assert command.run(["report", "--merge", "all.json", *parts[1:]]) == run_report.FAILED
    assert "imprint report: missing: " in capsys.readouterr().err
    for name in ("[12]", "7"):
        command.run(["--jobs", "j.json", "--only", f"set {name} *", "--report", f"only.{name}.json"])
    assert command.run(["report", "--merge", "some.json", "only.[12].json", "only.7.json"]) == run_report.GATE
    assert "missing:" not in capsys.readouterr().err
    some = json.loads((tmp_path / "some.json").read_text())
    assert some["only"] == {"patterns": ["set [12] *", "set 7 *"], "bakes": "1-2, 7"}
