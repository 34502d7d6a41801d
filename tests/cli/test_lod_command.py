# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the command `lod`: a table, maps, a scene and a report, and no file if something fails."""

import json

import bpy
import pytest

from addon.cli import command
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

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
    report = json.loads((folder / "report.json").read_text())
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
        (["--json"], "--json is not for lod"),
        (["--workers", "2"], "--workers is not for lod"),
        (["--max-memory", "4G"], "--max-memory is not for lod"),
        (["--degrees", "a"], "are not degrees"),
        (["--degrees", "1,2,3"], "make no pairs"),
        (["--distance", "-1"], "cannot be a limit"),
        (["--output", "maps/one.png"], "put {low} into --output"),
        (["--export", "hill.usd"], "put {low} into --export"),
        (["--sise", "64"], "did you mean"),
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
        (["--low", "Hil"], "did you mean 'Hill'"),
        (["--degrees", "0.001", "--depth", "8"], "alone deviates"),
        (["--uv", "none"], "none"),
    ],
)
def test_errors_leave_no_file(folder, capfd, more, text):
    assert command.run([*CHAIN, *more]) == 1
    assert text in capfd.readouterr().err.splitlines()[-1]
    assert files(folder) == ["hill.blend"]


def test_a_map_of_a_level_must_not_replace_the_scene(folder, capfd):
    (folder / "hill.blend").rename(folder / "Hill_LOD1.png")
    assert command.run(["lod", "Hill_LOD1.png", *CHAIN[2:-1], "{low}.png"]) in {1, 2}
    assert files(folder) == ["Hill_LOD1.png"]


def test_help_names_the_options(capsys):
    assert command.run(["lod", "--help"]) == 0
    out = capsys.readouterr().out
    assert "--degrees" in out and "--distance" in out
