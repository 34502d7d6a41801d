# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests --resume and --force with real bakes: what is done is left out, and killed runs lose only what was cut off."""

import hashlib
import json
import os
import platform
import random
import re
import signal
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import bpy
import pytest

from addon.cli import command, run_report
from addon.cli.records import Contents
from addon.core import versions
from addon.core.progress import STARTUP
from scripts.imprint import ROOT
from tests.support import json_schema, random_cases, reports, scenes, zoo
from tests.support.manual import names, rows, section

pytestmark = pytest.mark.usefixtures("gpu_context")


COUNT = 4
ONE = ["--low-file", "low.obj", "--high-file", "high.obj", "--output", "one.png", "--size", "16", "--limit", "9"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with a job file of COUNT bakes."""
    monkeypatch.chdir(tmp_path)
    scenes.plane_files(tmp_path, low=0.0, high=0.2)
    sets = []
    for number in range(COUNT):
        (tmp_path / f"m{number}.obj").write_bytes((tmp_path / "low.obj").read_bytes())
        sets.append({"low-file": f"m{number}.obj", "high-file": "high.obj", "output": f"out/m{number}.png"})
    (tmp_path / "j.json").write_text(json.dumps({"defaults": {"size": 16, "limit": 9}, "bake": sets}))
    return tmp_path


def bake(*words):
    """The states of a run in this process."""
    assert command.run(["--jobs", "j.json", "--report", "r.json", *words]) == 0
    return [(each["name"].partition("(")[2][:-1], each["state"]) for each in reports.bakes(Path("r.json"))]


def save_image(path, value):
    image = bpy.data.images.new("skin", 4, 4)
    image.pixels.foreach_set([value] * 64)
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()


def maps(folder):
    return {path.name: path.read_bytes() for path in (folder / "out").glob("*.png")}


def records(folder):
    return sorted(path.name for path in (folder / "out").glob("*.json"))


def all_are(state):
    return [(f"m{number}", state) for number in range(COUNT)]


def start(*words):
    """A run in processes of its own."""
    command = [sys.executable, str(ROOT / "scripts" / "bake.py"), "--jobs", "j.json", *words]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def test_a_run_without_these_options_writes_no_records(folder):
    assert bake() == all_are("done")
    assert sorted(os.listdir(folder / "out")) == sorted(maps(folder))


def test_what_is_done_is_left_out(folder):
    assert bake("--resume") == all_are("done")
    assert len(records(folder)) == COUNT
    assert bake("--resume") == all_are("resumed")
    (folder / "m1.obj").write_text((folder / "m1.obj").read_text().replace("o low", "o other"))
    (folder / "out" / "m3.png").unlink()
    assert sorted(name for name, state in bake("--resume") if state == "done") == ["m1", "m3"]
    assert bake("--resume", "--size", "32") == all_are("done")
    assert bake("--force", "--size", "32") == all_are("done")
    assert bake("--resume", "--size", "32") == all_are("resumed")


def test_a_single_bake_has_a_record(folder, capfd):
    for more, state in ((["--resume"], "done"), (["--resume"], "resumed"), (["--force"], "done")):
        assert command.run([*ONE, *more, "--report", "one.json"], may_start_processes=True) == 0
        (entry,) = reports.bakes(Path("one.json"))
        assert (entry["name"], entry["state"], entry["log"]) == ("low", state, "")
        assert f"\n{state} " in capfd.readouterr().out
    assert (folder / "one.png.imprint.json").exists()
    (folder / "one.png").unlink()
    assert command.run([*ONE, "--resume"]) == 0
    assert (folder / "one.png").exists()
    assert without_blender([*ONE, "--resume"]) == "0 False"


def test_the_entry_of_a_bake_that_is_left_out_is_that_of_the_bake(folder):
    bake("--resume")
    before = reports.bakes(Path("r.json"))
    bake("--resume")
    for one, other in zip(before, reports.bakes(Path("r.json")), strict=True):
        assert {**one, "state": "resumed", "seconds": 0.0} == other


@pytest.mark.parametrize("ending", ["_mip2.png", ".glb", ".json"])
@pytest.mark.parametrize("is_gone", [True, False])
def test_each_file_that_a_bake_writes_counts(folder, ending, is_gone):
    path = folder / "out" / f"one{ending}"
    job = {"low-file": "m0.obj", "high-file": "high.obj", "output": "out/one.png", "export": "out/one.glb"}
    job |= {"size": 16, "limit": 9, "mip-files": True, "report": "out/one.json"}
    (folder / "j.json").write_text(json.dumps({"bake": [job]}))
    assert [state for _, state in bake("--resume")] == ["done"]
    written = [each["path"] for each in reports.bake(Path("r.json"))["files"]]
    kept = {each.name for each in (folder / "out").iterdir()} - {"one.png.imprint.json", "one.json"}
    assert {os.path.basename(each) for each in written} == kept >= {f"one_mip{level}.png" for level in range(1, 5)}
    assert [state for _, state in bake("--resume")] == ["resumed"]
    before = path.read_bytes()
    path.unlink() if is_gone else path.write_bytes(bytes(len(before)))
    assert [state for _, state in bake("--resume")] == ["done"]
    assert ending == ".json" or path.read_bytes() == before
    assert [state for _, state in bake("--resume")] == ["resumed"]


@pytest.mark.slow
def test_a_change_of_the_high_mesh_s_texture_is_seen(folder):
    (folder / "high.mtl").write_text("newmtl skin\nmap_Kd skin.png\n")
    save_image(folder / "skin.png", 0.0)
    lines = [
        line for line in (folder / "high.obj").read_text().splitlines() if not line.startswith(("mtllib", "usemtl"))
    ]
    first = next(place for place, line in enumerate(lines) if line.startswith("f "))
    (folder / "high.obj").write_text("\n".join(["mtllib high.mtl", *lines[:first], "usemtl skin", *lines[first:]]))
    assert bake("--resume", "--maps", "base-color") == all_are("done")
    assert bake("--resume", "--maps", "base-color") == all_are("resumed")
    save_image(folder / "skin.png", 1.0)
    assert bake("--resume", "--maps", "base-color") == all_are("done")


@pytest.mark.slow
def test_processes_with_the_same_job_do_each_bake_once(folder):
    expected = bake("--resume") and maps(folder)
    for path in (folder / "out").iterdir():
        path.unlink()
    both = [start("--resume", "--report", f"{number}.json") for number in range(2)]
    for process in both:
        assert process.communicate()[1] == ""
        assert process.returncode == 0
    states = [[each["state"] for each in reports.bakes(Path(f"{number}.json"))] for number in range(2)]
    assert states[0].count("done") + states[1].count("done") == COUNT
    assert all(set(found) <= {"done", "resumed"} and len(found) == COUNT for found in states)
    assert maps(folder) == expected


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@random_cases.seeds(3, fast=2)
def test_a_run_after_a_kill_gives_the_same_files(folder, seed):
    expected = bake("--resume") and maps(folder)
    for path in (folder / "out").iterdir():
        path.unlink()
    process = start("--resume")
    while not maps(folder):
        time.sleep(0.001)
    time.sleep(random.Random(seed).random() * 0.5)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert start("--resume", "--report", "r.json").wait() == 0  # a new process, which removes what was left
    assert {each["state"] for each in reports.bakes(Path("r.json"))} <= {"done", "resumed"}
    assert maps(folder) == expected
    assert len(records(folder)) == COUNT
    assert [path.name for path in (folder / "out").iterdir() if path.suffix not in {".png", ".json"}] == []


def test_what_is_done_needs_no_blender(folder):
    bake("--resume")
    assert without_blender(["--jobs", "j.json", "--resume"]) == "0 False"


def without_blender(words):
    """The exit code of a call in a process of its own, and whether that loaded Blender."""
    program = (
        "import sys; from addon.cli import command; "
        f"code = command.run({words}, may_start_processes=True); "
        "print(code, 'bpy' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=dict(os.environ, PYTHONPATH=str(ROOT)),
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()[-1]


# Merged reports


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


# Report schema


PAGE = ROOT / "docs" / "command-line.md"
SCHEMA = json.loads((ROOT / "docs" / "report.schema.json").read_text(encoding="utf-8"))


@pytest.fixture
def whole(tmp_path, monkeypatch):
    """A function that bakes with more arguments, and returns the report from JSON."""
    monkeypatch.chdir(tmp_path)
    zoo.plane("a_low")
    zoo.plane("a_high", slope=0.2)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))

    def bake(*more):
        assert command.run(["--size", "32", "--limit", "9", "--report", "report.json", *more]) == 0
        found = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
        assert list(json_schema.errors(found, SCHEMA)) == []
        return found

    return bake


@pytest.fixture
def report(whole):
    """As `whole`, with the only report of the only bake."""
    return lambda *more: whole(*more)["bakes"][0]["reports"][0]


PAIR = ["file.blend", "--low", "a_low", "--high", "a_high", "--output", "map.png"]


@pytest.mark.parametrize("method", ["flatten", "cast"])
def test_the_report_of_one_bake_has_the_keys_of_its_schema(report, method):
    found = report(*PAIR, "--method", method, "--maps", "height,object-id", "--depth", "8")
    properties = SCHEMA["$defs"]["bake"]["properties"]
    assert set(found) == set(properties)
    found["maps"] = {key: how for maps in found["maps"].values() for key, how in maps.items()}
    for key in ("triangles", "distances", "loss", "seconds", "startup", "maps"):
        described = set(re.findall(r"[a-z]\w+", properties[key]["description"].lower()))
        assert set(found[key]) <= described, key
    assert set(found["startup"]) == set(STARTUP)
    assert bool(found["distances"]) == (method == "cast")


def test_the_checks_of_a_report_are_those_in_the_manual(report):
    found = report(*PAIR)["checks"]
    text = section(PAGE, "### Checks")
    everywhere = {"severity", "count", "of", "share"}
    assert everywhere <= set(names(text))
    documented = {names(cells[0])[0]: set(names(cells[2])) for cells in rows(text)}
    assert set(found) == set(documented)
    assert {kind: set(check) - everywhere for kind, check in found.items()} == documented


def test_all_reports_have_the_keys_of_the_schema(whole, tmp_path):
    job = {"bake": [{"file": "file.blend", "low": "a_low", "high": "a_high", "output": "map.png"}]}
    (tmp_path / "jobs.json").write_text(json.dumps(job), encoding="utf-8")
    for words in (["--jobs", "jobs.json"], PAIR, ["--frames", "1-2", *PAIR], ["--pairs", *PAIR[:1], *PAIR[5:]]):
        found = whole(*words)
        assert set(found) == set(SCHEMA["properties"])
        assert found["imprint_report"] == run_report.VERSION
        assert (found["imprint"], found["blender"]) == (versions.imprint(), bpy.app.version_string.split()[0])
        (entry,) = found["bakes"]
        assert set(entry) == set(SCHEMA["$defs"]["entry"]["properties"])
        assert entry["are"] == {"--frames": "frames", "--pairs": "pairs"}.get(words[0], "")
        assert len(entry["reports"]) == (2 if words[0] == "--frames" else 1)
        assert all(each["version"] == 1 for each in entry["reports"])


@pytest.mark.slow
def test_reports_say_when_and_where_they_were_made_and_by_which_call(whole, tmp_path):
    job = {"file": "file.blend", "low": "a_low", "high": "a_high", "output": "map.png", "report": "own.json"}
    (tmp_path / "jobs.json").write_text(json.dumps({"bake": [job]}), encoding="utf-8")
    words = ["--jobs", "jobs.json", "--size", "32", "--limit", "9", "--report", "all.json"]
    before = datetime.now(UTC).replace(microsecond=0)
    assert command.run(words, may_start_processes=True) == 0
    for name in ("all.json", "own.json"):
        found = json.loads((tmp_path / name).read_text(encoding="utf-8"))
        assert (found["call"], found["host"], found["code"]) == (words, platform.node(), versions.code())
        assert before <= datetime.fromisoformat(found["started"]) <= datetime.now(UTC)
        assert list(json_schema.errors(found, SCHEMA)) == []


def test_files_have_their_sizes_and_hashes(whole, tmp_path):
    (entry,) = whole(*PAIR, "--save-blend", "saved.blend", "--export", "low.glb")["bakes"]
    assert [each["what"] for each in entry["files"]] == ["map", "export", "scene"]
    assert [(Path(each["path"]).name, each["what"]) for each in entry["inputs"]] == [("file.blend", "the file to open")]
    for each in (*entry["files"], *entry["inputs"]):
        content = Path(each["path"]).read_bytes()
        assert (each["bytes"], each["sha256"]) == (len(content), hashlib.sha256(content).hexdigest())


def test_each_file_is_hashed_once_if_at_all(whole, tmp_path, monkeypatch):
    """The report of a set, that of all, and the record want the same hashes."""
    read, hashed = [], Contents._hash
    monkeypatch.setattr(
        Contents, "_hash", lambda self, file: (read.append(Path(file.name).name), hashed(self, file))[1]
    )
    job = {"file": "file.blend", "low": "a_low", "high": "a_high", "output": "map.png", "report": "own.json"}
    (tmp_path / "jobs.json").write_text(json.dumps({"bake": [job]}), encoding="utf-8")
    whole("--jobs", "jobs.json", "--force")
    assert read.count("map.png") == 1
    read.clear()
    assert command.run([*PAIR, "--size", "32", "--limit", "9"]) == 0
    assert read == []
