# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the command `lod`: a table, maps, a scene and a report, and no file if something fails."""

import json

import bpy
import pytest

from addon.cli import command, run_report
from scripts.imprint import ROOT
from tests.support import json_schema, reports, trees, untrusted, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SCHEMA = json.loads((ROOT / "docs" / "report.schema.json").read_text(encoding="utf-8"))
CHAIN = ["lod", "hill.blend", "--low", "Hill", "--distance", "2,4", "--size", "64", "--output", "maps/{low}.png"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with hill.blend."""
    monkeypatch.chdir(tmp_path)
    zoo.terrain("Hill", 12)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "hill.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return tmp_path


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_maps_a_scene_a_report_and_a_table(folder, capfd):
    assert command.run([*CHAIN, "--save-blend", "levels.blend", "--report", "report.json", "--export", "hill.glb"]) == 0
    assert files(folder) == sorted(
        ["hill.blend", "hill.glb", "levels.blend", "maps/Hill_LOD1.png", "maps/Hill_LOD2.png", "report.json"]
    )
    whole = json.loads((folder / "report.json").read_text())
    assert list(json_schema.errors(whole, SCHEMA)) == []
    (entry,) = whole["bakes"]
    assert (entry["name"], entry["state"], entry["are"], entry["problems"]) == ("Hill", "done", "levels", [])
    assert [each["what"] for each in entry["files"]] == ["map", "map", "export", "scene"]
    assert [each["what"] for each in entry["inputs"]] == ["the file to open"]
    assert [each["low"] for each in entry["reports"]] == ["Hill_LOD1", "Hill_LOD2"]
    report = entry["chain"]
    assert report["triangles"] == 288
    assert [level["limit"] for level in report["levels"]] == [{"distance": 0.02}, {"distance": 0.04}]
    out = capfd.readouterr().out
    assert all(
        f"{level['name']}  {100 * level['limit']['distance']:g} % of the size" in out for level in report["levels"]
    )
    assert f"{report['levels'][0]['beyond']}: " in out
    assert all(name in out.splitlines()[-1] for name in files(folder) if name != "hill.blend")
    assert b"MSFT_lod" in (folder / "hill.glb").read_bytes()
    bpy.ops.wm.open_mainfile(filepath=str(folder / "levels.blend"))
    for level in report["levels"]:
        obj = bpy.data.collections["Hill_LODs"].objects[level["name"]]
        assert len(obj.data.polygons) == level["triangles"]
        assert obj.data.materials[0].node_tree.nodes


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (["--high", "Hill"], "--high is not for lod"),
        (["--convert", "hill.png"], "--convert is not for lod"),
        (["--jobs", "jobs.toml"], "--jobs is not for lod"),
        (["--json"], "--json is for --list"),
        (["--workers", "2"], "--workers is not for lod"),
        (["--shard", "1/2"], "--shard is for many bakes"),
        (["--strict", "appearance.p99<1deg"], "lod does not measure appearance.p99"),
        (["--strict", "deviation.p99<1deg"], "lod keeps deviation.p99 within --degrees"),
        (["--degrees", "a"], "are not degrees"),
        (["--triangles", "50%"], "give it without --degrees and --distance"),
        (["--degrees", "1,2,3"], "make no pairs"),
        (["--distance", "-1"], "cannot be a limit"),
        (["--output", "maps/one.png"], "put {low} into --output"),
        (["--export", "hill.usd"], "put {low} into --export"),
        (["--sise", "64"], "did you mean '--size'?"),
        (["--degree", "2"], "did you mean '--degrees'?"),
    ],
)
def test_wrong_usage(folder, capfd, more, text):
    assert command.run([*CHAIN, *more]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert text in line
    assert files(folder) == ["hill.blend"]


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (["--degrees", "0.001", "--depth", "8"], "alone deviates"),
        (["--uv", "none"], "none"),
    ],
)
def test_errors_leave_no_file(folder, capfd, more, text):
    assert command.run([*CHAIN, *more]) == 1
    assert text in capfd.readouterr().err.splitlines()[-1]
    assert files(folder) == ["hill.blend"]


def test_a_misspelled_object_leaves_no_file(folder, capfd):
    assert command.run(["Hil" if word == "Hill" else word for word in CHAIN]) == 1
    assert "did you mean 'Hill'" in capfd.readouterr().err.splitlines()[-1]
    assert files(folder) == ["hill.blend"]


def test_several_objects_are_refused(folder, capfd):
    assert command.run([*CHAIN, "--low", "Vale"]) == 2
    assert "lod is for one low object: give --low once" in capfd.readouterr().err


def test_levels_have_so_many_triangles(folder, capfd):
    words = [word for word in CHAIN if word not in ("--distance", "2,4")]
    assert command.run([*words, "--triangles", "50%,60", "--report", "report.json"]) == 0
    whole = json.loads((folder / "report.json").read_text())
    assert list(json_schema.errors(whole, SCHEMA)) == []
    found = whole["bakes"][0]["chain"]["levels"]
    assert [level["limit"] for level in found] == [{"triangles": 0.5}, {"triangles": 60}]
    assert [level["triangles"] for level in found] == [pytest.approx(144, abs=2), pytest.approx(60, abs=2)]
    assert command.run([*words, "--triangles", "half"]) == 2
    assert "'half' is no number of triangles" in capfd.readouterr().err


def entry_of(folder, code, *words, **more):
    """The entry in the report of a call with this exit code."""
    assert command.run([*CHAIN, "--report", "report.json", *words], **more) == code
    return reports.bake(folder / "report.json")


def test_a_figure_over_its_limit(folder, capfd):
    entry = entry_of(folder, run_report.GATE, "--strict", "coverage<1%")
    assert entry["state"] == "gate"
    assert [text.partition(":")[0] for text in entry["gate"]] == ["Hill_LOD1", "Hill_LOD2"]
    assert "imprint lod: Hill_LOD1: coverage is " in capfd.readouterr().err


def test_a_limit_without_a_level_of_its_own_is_a_problem(folder, capfd):
    entry = entry_of(folder, run_report.DONE, "--distance", "2,2.0001,4")
    (problem,) = entry["problems"]
    assert problem.endswith("they have one level.")
    assert f"imprint lod: warning: {problem}" in capfd.readouterr().err
    assert not any(problem in each["warnings"] for each in entry["reports"])


@pytest.mark.slow
def test_a_chain_is_left_out_if_it_is_done(folder):
    assert [entry_of(folder, run_report.DONE, "--resume")["state"] for _ in range(2)] == ["done", "resumed"]
    assert entry_of(folder, run_report.DONE, "--resume", "--distance", "3,4")["state"] == "done"


@pytest.mark.slow
@untrusted.needs_sandbox
def test_files_of_others(tmp_path, monkeypatch):
    root = untrusted.folder(tmp_path, monkeypatch)
    zoo.terrain("Hill", 12)
    bpy.ops.wm.save_as_mainfile(filepath=str(root / "job/hill.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    (root / "job/maps").mkdir()
    before = trees.snapshot(root, root / "job/maps")
    entry = entry_of(
        root / "job/maps", run_report.DONE, "--untrusted", "--report", "maps/report.json", may_start_processes=True
    )
    assert entry["state"] == "done"
    assert files(root / "job/maps") == ["Hill_LOD1.png", "Hill_LOD2.png", "report.json"]
    assert command.run([*CHAIN, "--untrusted", "--save-blend", "../outside/s.blend"]) == run_report.WRONG_USAGE
    assert trees.snapshot(root, root / "job/maps") == before


@pytest.mark.slow
def test_a_chain_that_takes_too_long_is_ended(folder):
    entry = entry_of(folder, run_report.FAILED, "--timeout", "0.1", may_start_processes=True)
    assert (entry["cause"], files(folder)) == ("timeout", ["hill.blend", "report.json"])


def test_a_map_of_a_level_must_not_replace_the_scene(folder, capfd):
    (folder / "hill.blend").rename(folder / "Hill_LOD1.png")
    assert command.run(["lod", "Hill_LOD1.png", *CHAIN[2:-1], "{low}.png"]) == run_report.WRONG_USAGE
    assert files(folder) == ["Hill_LOD1.png"]


def test_help_names_the_options(capsys):
    assert command.run(["lod", "--help"]) == 0
    out = capsys.readouterr().out
    assert "--degrees" in out and "--distance" in out
