# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the JSON Schema of the report. Needs no Blender."""

import json
from copy import deepcopy

import pytest

from addon.cli import run_report
from addon.cli.run_report import Cause, Entry, State
from addon.core.report import Report
from scripts.dev import report_schema
from tests.support import json_schema

SCHEMA = json.loads(report_schema.PATH.read_text(encoding="utf-8"))


def document():
    """A report with an entry of each state."""
    file = {"path": "/a.png", "bytes": 7, "sha256": "0" * 64, "what": "map"}
    report = json.loads(json.dumps(Report("CAST", "TANGENT", (16, 16), "low", ["high"]).to_dict()))
    entries = [
        Entry(1, "a", files=[file], inputs=[file], reports=[report]),
        Entry(2, "b", State.FAILED, "It crashed.", Cause.CRASH, "SIGSEGV", seconds=0.5, log="/a.log"),
        Entry(3, "c", State.GATE, gate=["missed is 1 %, and must be less than 0.1 %."], reports=[report]),
        Entry(4, "d", State.RESUMED),
        Entry(5, "e", State.STOPPED, files=[{**file, "bytes": None, "sha256": None}]),
    ]
    return json.loads(json.dumps(run_report.document(entries, run_report.head(5, "1/2"))))


def test_the_file_is_that_of_the_dataclasses():
    assert report_schema.schema() == SCHEMA, "run scripts/dev/report_schema.py"


def test_reports_fit():
    assert list(json_schema.faults(document(), SCHEMA)) == []


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("imprint_report",), 1),
        (("planned",), -1),
        (("planned",), True),
        (("shard",), "half"),
        (("bakes", 0, "state"), "finished"),
        (("bakes", 0, "cause"), "bad luck"),
        (("bakes", 0, "number"), "1"),
        (("bakes", 0, "seconds"), None),
        (("bakes", 0, "gate"), "none"),
        (("bakes", 0, "files", 0, "sha256"), "abc"),
        (("bakes", 0, "reports", 0, "size"), [16]),
        (("bakes", 0, "reports", 0, "missed"), "0.1"),
        (("bakes", 0, "reports", 0, "targets"), {"three": {"median": "small"}}),
        (("summary", "done"), 1.5),
    ],
)
def test_other_values_do_not_fit(place, value):
    found = deepcopy(document())
    at = found
    for step in place[:-1]:
        at = at[step]
    at[place[-1]] = value
    assert list(json_schema.faults(found, SCHEMA))


@pytest.mark.parametrize(
    "place", [("blender",), ("summary", "gate"), ("bakes", 1, "log"), ("bakes", 0, "reports", 0, "low")]
)
def test_keys_cannot_be_missing(place):
    found = document()
    at = found
    for step in place[:-1]:
        at = at[step]
    del at[place[-1]]
    assert list(json_schema.faults(found, SCHEMA))


def test_new_keys_fit():
    found = document()
    found["new"] = found["bakes"][0]["new"] = 1
    assert list(json_schema.faults(found, SCHEMA)) == []
