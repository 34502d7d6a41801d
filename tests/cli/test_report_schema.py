# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that reports have exactly the keys in the manual."""

import hashlib
import json
import platform
from datetime import UTC, datetime
from pathlib import Path

import bpy
import pytest

from addon.cli import command, run_report
from addon.cli.records import Contents
from addon.cli.run_report import Cause, State
from addon.core import versions
from addon.core.progress import STARTUP
from scripts.imprint import ROOT
from tests.support import json_schema, zoo
from tests.support.manual import names, rows, section

pytestmark = pytest.mark.usefixtures("gpu_context")

PAGE = ROOT / "docs" / "command-line.md"
SCHEMA = json.loads((ROOT / "docs" / "report.schema.json").read_text(encoding="utf-8"))
KINDS = {
    "text": str,
    "number": (int, float),
    "object": dict,
    "list": list,
    "true": bool,
    "0": (int, float),
    "two": list,
}
"""The first word of a type in the manual, and the types that json.load returns for it."""


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
        assert list(json_schema.faults(found, SCHEMA)) == []
        return found

    return bake


@pytest.fixture
def report(whole):
    """As `whole`, with the only report of the only bake."""
    return lambda *more: whole(*more)["bakes"][0]["reports"][0]


PAIR = ["file.blend", "--low", "a_low", "--high", "a_high", "--output", "map.png"]


def check_keys(table, values):
    """Check names and types of the keys of `values` against a table of the manual."""
    assert [names(cells[0])[0] for cells in table] == list(values)
    for cells in table:
        (key,) = names(cells[0])
        kind = cells[1].split()[0]
        if not (values[key] is None and "null" in cells[1]):
            assert isinstance(values[key], KINDS[kind]), key


@pytest.mark.parametrize("method", ["flatten", "cast"])
def test_the_report_of_one_bake_has_the_keys_in_the_manual(report, method):
    found = report(*PAIR, "--method", method, "--maps", "height,object-id", "--depth", "8")
    text = section(PAGE, "### The report of one bake")
    check_keys(rows(text), found)
    documented = {names(cells[0])[0]: set(names(cells[2])) for cells in rows(text)}
    assert set(found["triangles"]) == documented["triangles"]
    assert set(found["distances"]) == (documented["distances"] if method == "cast" else set())
    assert set(found["loss"]) == documented["loss"]
    assert set(found["seconds"]) == documented["seconds"]
    assert set(found["startup"]) == set(STARTUP) <= documented["startup"]
    assert {key for how in found["maps"].values() for key in how} <= documented["maps"]


def test_the_checks_of_a_report_are_those_in_the_manual(report):
    found = report(*PAIR)["checks"]
    text = section(PAGE, "### Checks")
    everywhere = {"severity", "count", "of", "share"}
    assert everywhere <= set(names(text))
    documented = {names(cells[0])[0]: set(names(cells[2])) for cells in rows(text)}
    assert set(found) == set(documented)
    assert {kind: set(check) - everywhere for kind, check in found.items()} == documented


def test_all_reports_have_the_keys_in_the_manual(whole, tmp_path):
    text = section(PAGE, "## The report").split("###")[0]
    job = {"bake": [{"file": "file.blend", "low": "a_low", "high": "a_high", "output": "map.png"}]}
    (tmp_path / "jobs.json").write_text(json.dumps(job), encoding="utf-8")
    for words in (["--jobs", "jobs.json"], PAIR, ["--frames", "1-2", *PAIR], ["--pairs", *PAIR[:1], *PAIR[5:]]):
        found = whole(*words)
        check_keys(rows(text), found)
        assert found["imprint_report"] == run_report.VERSION
        assert (found["imprint"], found["blender"]) == (versions.imprint(), bpy.app.version_string.split()[0])
        (entry,) = found["bakes"]
        check_keys(rows(section(PAGE, "### An entry for each bake")), entry)
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
        assert list(json_schema.faults(found, SCHEMA)) == []


def test_files_have_their_sizes_and_hashes(whole, tmp_path):
    (entry,) = whole(*PAIR, "--save-blend", "saved.blend", "--export", "low.glb")["bakes"]
    assert [each["what"] for each in entry["files"]] == ["map", "export", "scene"]
    assert [(Path(each["path"]).name, each["what"]) for each in entry["inputs"]] == [("file.blend", "the file to open")]
    for each in (*entry["files"], *entry["inputs"]):
        content = Path(each["path"]).read_bytes()
        assert (each["bytes"], each["sha256"]) == (len(content), hashlib.sha256(content).hexdigest())


def test_the_words_for_states_and_causes_are_in_the_manual():
    text = section(PAGE, "### An entry for each bake")
    documented = {names(cells[0])[0]: set(names(cells[2])) for cells in rows(text)}
    assert documented["state"] == set(State)
    assert documented["cause"] == set(Cause) - {Cause.NONE}


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
