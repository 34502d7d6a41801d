# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of bakes over a limit: they are done, named, and end with an exit code of their own."""

import json

import bpy
import pytest
from mathutils import Matrix

from addon.cli import command, run_report
from tests.support import reports, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

OVER = "coverage is 100 %, and must be less than 10 %."


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with file.blend."""
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b"):
        zoo.plane(f"{name}_low")
        zoo.plane(f"{name}_high", slope=0.2)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    return tmp_path


def bake(*words):
    return command.run(["--size", "32", "--limit", "9", "--report", "r.json", *words])


PAIR = ["file.blend", "--low", "a_low", "--high", "a_high", "--output", "a.png"]


def test_a_bake_over_a_limit_keeps_its_map_and_ends_with_4(folder, capsys):
    assert bake(*PAIR, "--strict", "coverage<10%, missed<0.1%") == run_report.GATE
    entry = reports.bake(folder / "r.json")
    assert (entry["state"], entry["gate"], entry["error"]) == ("gate", [OVER], "")
    assert (folder / "a.png").is_file()
    assert f"imprint: {OVER}" in capsys.readouterr().err.splitlines()


def test_a_bake_within_its_limits_is_done(folder):
    assert (
        bake(*PAIR, "--strict", "coverage>90%, missed<0.1%, deviation.p99<1deg, appearance.wrong=0") == run_report.DONE
    )
    entry = reports.bake(folder / "r.json")
    assert (entry["state"], entry["gate"]) == ("done", [])
    assert entry["reports"][0]["deviation"]["texels"] == 32 * 32
    assert entry["reports"][0]["appearance"]["pixels"] > 40 * 512 * 512 / 10


def test_plates_on_one_uv_square_with_different_detail_are_over_a_limit(folder, capsys):
    """The map is that of the first plate, exactly: the second one, tilted against it by 11.3 degrees, shows it as well."""
    low, high = bpy.data.objects["a_low"], bpy.data.objects["a_high"]
    high.data.transform(Matrix.Diagonal((1.0, 1.0, 0.0, 1.0)))
    for obj, other in ((low, "b_low"), (high, "b_high")):
        bpy.data.objects[other].data.transform(Matrix.Translation((3.0, 0.0, 0.0)))
        with bpy.context.temp_override(active_object=obj, selected_editable_objects=[obj, bpy.data.objects[other]]):
            bpy.ops.object.join()
    bpy.ops.wm.save_mainfile()
    assert bake(
        *PAIR, "--method", "cast", "--max-distance", "1", "--extrusion", "0.5", "--strict", "deviation.p99<2deg"
    ) == (run_report.GATE)
    (gate,) = reports.bake(folder / "r.json")["gate"]
    assert gate.startswith("deviation.p99 is 11.3")


def test_pairs_over_a_limit_are_named(folder):
    words = ["file.blend", "--pairs", "--output", "{low}.png", "--strict", "coverage<10%"]
    assert bake(*words) == run_report.GATE
    assert reports.bake(folder / "r.json")["gate"] == [f"a_low: {OVER}", f"b_low: {OVER}"]


def test_each_set_has_limits_of_its_own(folder, capsys):
    sets = [
        {"low": "a_low", "high": "a_high", "output": "a.png", "strict": ["coverage<10%", "missed=0"]},
        {"low": "b_low", "high": "b_high", "output": "b.png"},
    ]
    job = {"defaults": {"file": "file.blend", "strict": "coverage>10%"}, "bake": sets}
    (folder / "j.json").write_text(json.dumps(job))
    assert bake("--jobs", "j.json") == run_report.GATE
    assert [each["state"] for each in reports.bakes(folder / "r.json")] == ["gate", "done"]
    out, err = capsys.readouterr()
    assert f"imprint: set 1 (a_low): {OVER}" in err.splitlines()
    assert "2 done, 0 failed, 1 over a limit" in out
    assert bake("--jobs", "j.json", "--strict", "coverage>20%") == run_report.DONE
    job["bake"][1]["high"] = "missing"
    (folder / "j.json").write_text(json.dumps(job))
    assert bake("--jobs", "j.json") == run_report.FAILED
    assert [each["state"] for each in reports.bakes(folder / "r.json")] == ["gate", "failed"]


def test_limits_count_for_bakes_that_were_done_before(folder):
    job = {"bake": [{"file": "file.blend", "low": "a_low", "high": "a_high", "output": "a.png"}]}
    (folder / "j.json").write_text(json.dumps(job))
    words = ["--jobs", "j.json", "--resume", "--strict"]
    states = []
    for limits in (
        "coverage<10%",
        "coverage<10%",
        "coverage>10%",
        *["deviation.p99<1deg"] * 2,
        *["appearance.p99<9deg"] * 2,
    ):
        code = bake(*words, limits)
        entry = reports.bake(folder / "r.json")
        states.append((code, entry["state"], entry["gate"], entry["seconds"] > 0.0))
    assert states == [
        (run_report.GATE, "gate", [OVER], True),
        (run_report.GATE, "gate", [OVER], False),
        (run_report.DONE, "resumed", [], False),
        *[(run_report.DONE, "done", [], True), (run_report.DONE, "resumed", [], False)] * 2,  # it is measured first
    ]


def test_a_wrong_limit_stops_the_call_before_the_first_bake(folder, capsys):
    assert bake(*PAIR, "--strict", "mised<1%") == run_report.WRONG_USAGE
    assert "did you mean 'missed'?" in capsys.readouterr().err
    job = {
        "bake": [{"file": "file.blend", "low": "a_low", "high": "a_high", "output": "a.png", "strict": "missed<1deg"}]
    }
    (folder / "j.json").write_text(json.dumps(job))
    assert bake("--jobs", "j.json") == run_report.WRONG_USAGE
    assert "set 1: strict: 'missed<1deg': missed takes %, or no unit, and not 'deg'" in capsys.readouterr().err
    assert not (folder / "a.png").exists()
