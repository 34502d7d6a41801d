# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that no input decides what becomes of the run: a bake of a file that names the run's own files fails alone."""

import json

import bpy
import pytest

from addon.cli import command, run_report, worker_pool
from addon.core.errors import NoGpu
from tests.support import reports, scenes, zoo

OLD = "2001-01-01T00:00:00Z"
"""When the call before began, of whose bakes all were done."""


@pytest.fixture
def folder(tmp_path, monkeypatch, gpu_context):
    """The working folder, with a pair of meshes, and a report and a page of an earlier call."""
    monkeypatch.chdir(tmp_path)
    scenes.plane_files(tmp_path, low=0.0, high=0.2)
    before = run_report.document(
        [run_report.Entry(number, f"set {number} (low)") for number in (1, 2)], run_report.head(2) | {"started": OLD}
    )
    (tmp_path / "r.json").write_text(json.dumps(before))
    (tmp_path / "r.json.lines").write_text(json.dumps({**before, "bakes": []}) + "\n")
    (tmp_path / "s.html").write_text("<!doctype html>OF BEFORE")
    return tmp_path


def by_ply(folder, path):
    (folder / "evil.ply").write_text(
        f"ply\nformat ascii 1.0\ncomment TextureFile {path}\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nproperty float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\n"
        "end_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
    )
    return {"low-file": "low.obj", "high-file": "evil.ply"}


def by_mtl(folder, path):
    (folder / "evil.obj").write_text("mtllib evil.mtl\nusemtl a\n" + (folder / "high.obj").read_text())
    (folder / "evil.mtl").write_text(f"newmtl a\nmap_Kd {path}\n")
    return {"low-file": "low.obj", "high-file": "evil.obj"}


def by_blend(folder, path):
    zoo.plane("low")
    high = zoo.plane("high", slope=0.2)
    image = bpy.data.images.new("evil", 4, 4)
    image.source, image.filepath = "FILE", f"//{path}"
    scenes.show(high, image)
    scenes.save(folder / "evil.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return {"file": "evil.blend", "low": "low", "high": "high", "maps": "base-color"}


INPUTS = {"ply": by_ply, "mtl": by_mtl, "blend": by_blend}
RECORD = "b.png.imprint.json"


@pytest.mark.parametrize(
    ("kind", "path"),
    [
        *(("ply", path) for path in ("r.json", "r.json.lines", "s.html", RECORD)),
        *(("mtl", path) for path in ("s.html", RECORD)),
        *(("blend", path) for path in ("r.json", RECORD)),
    ],
)
def test_a_bake_that_would_read_what_the_run_writes_fails_alone(folder, kind, path, capsys):
    evil, good = {**INPUTS[kind](folder, path), "output": "a.png"}, {"low-file": "low.obj", "high-file": "high.obj"}
    code, found = run(folder, evil, {**good, "output": "b.png"})
    assert (code, [each["state"] for each in found]) == (run_report.FAILED, ["failed", "done"])
    assert "would overwrite" in found[0]["error"] and path in found[0]["error"]
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "would overwrite" in line]
    assert line.startswith("imprint: set 1 ")
    assert "set 2 (low)" in (folder / "s.html").read_text() and not (folder / "a.png").exists()


@pytest.mark.parametrize("path", ["..", ".", "/"])
def test_a_texture_that_is_a_folder_takes_no_report(folder, path):
    good = {"low-file": "low.obj", "high-file": "high.obj", "output": "b.png"}
    _, found = run(folder, {**by_ply(folder, path), "output": "a.png"}, good)
    assert found[1]["state"] == "done"


def run(folder, *sets):
    """The exit code of a call for these sets, and the entries of its report."""
    (folder / "j.json").write_text(
        json.dumps({"defaults": {"size": 16, "limit": 9, "method": "flatten"}, "bake": sets})
    )
    code = command.run(["--jobs", "j.json", "--report", "r.json", "--sheet", "s.html", "--resume"])
    assert json.loads((folder / "r.json").read_text())["started"] > OLD
    return code, reports.bakes(folder / "r.json")


def test_a_call_that_cannot_bake_leaves_no_older_report(folder, monkeypatch, capsys):
    def bake_all(*_):
        raise NoGpu("Blender does not start here.")
        yield

    monkeypatch.setattr(worker_pool.WorkerPool, "__enter__", lambda self: self)
    monkeypatch.setattr(worker_pool.WorkerPool, "__exit__", lambda *_: None)
    monkeypatch.setattr(worker_pool.WorkerPool, "bake_all", bake_all)
    sets = [{"low-file": "low.obj", "high-file": "high.obj", "output": f"{name}.png"} for name in "ab"]
    (folder / "j.json").write_text(json.dumps({"bake": sets}))
    words = ["--jobs", "j.json", "--report", "r.json", "--sheet", "s.html"]
    assert command.run(words, may_start_processes=True) == run_report.NO_MACHINE
    assert reports.bakes(folder / "r.json") == [] and "OF BEFORE" not in (folder / "s.html").read_text()
    assert command.run(["report", "--merge", "all.json", "r.json"]) == run_report.FAILED
    assert "missing: 1-2" in capsys.readouterr().err


def test_what_a_killed_call_has_left_counts_and_not_the_report_before_it(folder, capsys):
    file = run_report.ReportFile(folder / "r.json", run_report.head(2))
    file.add(run_report.Entry(1, "set 1 (low)", run_report.State.FAILED, "No."))
    file.close()
    assert command.run(["report", "--merge", "all.json", "r.json"]) == run_report.FAILED
    assert [each["state"] for each in reports.bakes(folder / "all.json")] == ["failed"]
    assert "missing: 2" in capsys.readouterr().err
