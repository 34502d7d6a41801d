# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that reports have exactly the keys in the manual."""

import json

import bpy
import pytest

from addon.cli import command
from addon.core.timings import STARTUP
from scripts.imprint import ROOT
from tests.support import zoo
from tests.support.manual import names, rows, section

pytestmark = pytest.mark.usefixtures("gpu_context")

PAGE = ROOT / "docs" / "command-line.md"
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
def report(tmp_path, monkeypatch):
    """A function that bakes with more arguments, and returns the report from JSON."""
    monkeypatch.chdir(tmp_path)
    zoo.plane("a_low")
    zoo.plane("a_high", slope=0.2)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))

    def bake(*more):
        assert command.run(["--size", "32", "--limit", "9", "--report", "report.json", *more]) == 0
        return json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))

    return bake


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


def test_the_entry_of_a_batch_has_the_keys_in_the_manual(report, tmp_path):
    job = {"bake": [{"file": "file.blend", "low": "a_low", "high": "a_high", "output": "map.png"}]}
    (tmp_path / "jobs.json").write_text(json.dumps(job), encoding="utf-8")
    (entry,) = report("--jobs", "jobs.json")
    check_keys(rows(section(PAGE, "### An entry of many")), entry)


@pytest.mark.parametrize(
    ("more", "key"),
    [(["--frames", "1-2", *PAIR], "frames"), (["--pairs", *PAIR[:1], *PAIR[5:]], "pairs")],
)
def test_reports_of_pairs_and_frames_are_in_a_list(report, more, key):
    found = report(*more)
    assert set(found) == {key, "problems"}
    assert all(each["version"] == 1 for each in found[key])
    (call,) = [cells for cells in rows(section(PAGE, "## The report")) if f"`--{key}`" in cells[0]]
    assert set(json.loads(names(call[1])[0].replace("report, ...", "").replace("sentence, ...", ""))) == set(found)
