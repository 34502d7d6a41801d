# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that a report is written once, at the end of a bake, and that no step of the bake reads it."""

import base64
import dataclasses
import errno
import html.parser
import json
import os
import random
import tempfile
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from addon.cli import arguments, command, limits, run_report
from addon.cli import sheet as sheet_module
from addon.cli.arguments import WrongUsage
from addon.cli.run_report import Cause, Entry, Only, ReportFile, State, Totals, ranges
from addon.cli.sheet import SheetFile
from addon.core import report
from addon.core.errors import BakeError
from addon.core.report import Report
from addon.output import png_writer
from scripts.dev import report_schema
from tests.support import json_schema, random_cases, reports


@pytest.fixture
def done():
    return Report("CAST", "TANGENT", (16, 16), "lo", ["hi"])


def test_a_report_does_not_change(done):
    with pytest.raises(dataclasses.FrozenInstanceError):
        done.method = "FLATTEN"


def test_more_warnings_make_another_report(done):
    more = done.with_warnings(["first"]).with_warnings(["second"])
    assert (done.warnings, more.warnings) == ([], ["first", "second"])


def test_the_keys_of_a_report_start_with_their_version(done):
    data = json.loads(json.dumps(done.to_dict()))
    assert next(iter(data)) == "version"
    assert data["version"] == report.VERSION
    assert Report(**data).to_dict() == done.to_dict() | {"size": [16, 16]}


def test_the_summary_says_what_black_and_white_stand_for(done):
    maps = {
        "height": {"image": "h", "midlevel": 0.5, "scale": 0.5},
        "distance": {"image": "d", "midlevel": 0.0, "scale": 2.0},
        "ao": {"image": "a", "midlevel": 0.0, "scale": 1.0},
    }
    lines = dataclasses.replace(done, triangles={"high": 1, "low": 1}, maps=maps).summary()
    assert "Height: black is -0.25, white is 0.25" in lines
    assert "Distance: black is 0, white is 2" in lines
    assert not any(line.startswith("Ambient") for line in lines)


@pytest.mark.parametrize(
    ("maximum", "said"), [(6.8e-6, "exact"), (0.02, "off by 6.8e-06 degrees (median), at most 0.02")]
)
def test_normals_that_nobody_sees_as_wrong_are_exact(done, maximum, said):
    stored = dataclasses.replace(done, triangles={"high": 1, "low": 1}, loss={"median": 6.8e-6, "maximum": maximum})
    assert f"Stored: normals {said}" in stored.summary()


def test_the_stages_add_up_to_the_total(done):
    seconds = dict.fromkeys((*report.STAGES, "total"), 0.0) | {"draw": 1.0, "audit": 0.5, "total": 2.0}
    lines = dataclasses.replace(done, triangles={"high": 1, "low": 1}, seconds=seconds).summary()
    assert lines[-1] == "2.00 s (draw 1.00, audit 0.50, other 0.50)"


@pytest.mark.parametrize(
    ("normal", "maps", "is_told"), [(True, ["ao"], True), (False, ["ao"], False), (False, ["ao", "bent_normal"], True)]
)
def test_the_summary_has_the_basis_of_maps_of_normals(done, normal, maps, is_told):
    baked = dataclasses.replace(
        done,
        settings={"basis": "MIKKTSPACE", "normal": normal},
        maps={name: {"image": name} for name in maps},
        triangles={"high": 1, "low": 1},
    )
    assert any(line.startswith("Basis: MikkTSpace") for line in baked.summary()) == is_told


def test_the_summary_has_the_rays_without_an_own_hit(done):
    rays = dataclasses.replace(
        done, triangles={"high": 1, "low": 1}, distances={"extrusion": 0.5, "max_distance": 1.0}, missed=0.01
    )
    for counts, expected in (
        ({}, ""),
        ({"not_owned": 0, "backs": 0}, ""),
        ({"not_owned": 4, "backs": 0}, ", 4.00% had no own hit"),
        ({"not_owned": 4, "backs": 1}, ", 4.00% had no own hit, 1.00% hit only backs"),
    ):
        report_of_counts = dataclasses.replace(rays, checks={"unsure": {"of": 100} | counts} if counts else {})
        assert f"Rays: extrusion 0.5 and max distance 1; 1.00% missed{expected}" in report_of_counts.summary()


# Report merge


def entry(number, state=State.DONE, **values):
    return Entry(number, f"set {number}", state, seconds=number * 0.5, **values)


def write(path, numbers, planned, shard="", *, only=None, is_cut_off=False, **values):
    """A report as a call writes it, or the lines that it has left."""
    file = ReportFile(path, run_report.head(planned, shard, only))
    for each in numbers:
        file.add(each if isinstance(each, Entry) else entry(each, **values))
    file.close() if is_cut_off else file.finish()
    return str(path)


def merged(tmp_path, *paths):
    """The exit code, and the report."""
    out = tmp_path / "all.json"
    code = command.run(["report", "--merge", str(out), *map(str, paths)])
    return code, json.loads(out.read_text()) if out.exists() else None


@random_cases.seeds(20, fast=2)
def test_the_parts_of_a_run_make_the_report_of_the_run(tmp_path, seed):
    rng = random.Random(seed)
    planned, count = rng.randint(1, 40), rng.randint(1, 6)
    numbers = list(range(1, planned + 1))
    whole = write(tmp_path / "whole.json", numbers, planned)
    parts = [
        write(tmp_path / f"{part}.json", [n for n in numbers if n % count == part], planned, f"{part + 1}/{count}")
        for part in range(count)
    ]
    rng.shuffle(parts)
    code, found = merged(tmp_path, *parts)
    assert code == run_report.DONE
    same = found.keys() - {"started", "host", "call"}
    expected = json.loads(Path(whole).read_text())
    assert {key: found[key] for key in same} == {key: expected[key] for key in same}
    assert found["call"][:2] == ["report", "--merge"]


@random_cases.seeds(5, fast=2)
def test_a_report_is_in_the_order_of_the_job_file(tmp_path, seed):
    """Several workers end their bakes in another order each time: two reports of one job can be compared."""
    numbers = list(range(1, 12))
    first = write(tmp_path / "first.json", numbers, 11)
    random.Random(seed).shuffle(numbers)
    second = write(tmp_path / "second.json", [entry(number, problems=["ä" * number]) for number in numbers], 11)
    names = [[each["name"] for each in json.loads(Path(path).read_text())["bakes"]] for path in (first, second)]
    assert names[0] == names[1] == [f"set {number}" for number in range(1, 12)]


def test_missing_bakes_are_named(tmp_path, capsys):
    first = write(tmp_path / "1.json", [1, 2, 5], 9, "1/2")
    code, found = merged(tmp_path, first, tmp_path / "2.json")
    assert code == run_report.FAILED
    assert [each["number"] for each in found["bakes"]] == [1, 2, 5]
    out, err = capsys.readouterr()
    assert "missing: 3-4, 6-9" in err
    assert f"There is no report {str(tmp_path / '2.json')!r}." in err
    assert "3 done, 0 failed, 6 stopped or not begun" in out


def test_what_a_cut_off_call_has_left_is_read(tmp_path, capsys):
    first = write(tmp_path / "1.json", [1, 3], 4, "1/2")
    write(tmp_path / "2.json", [2, 4], 4, "2/2", is_cut_off=True)
    assert not (tmp_path / "2.json").exists()
    assert merged(tmp_path, first, tmp_path / "2.json")[0] == run_report.DONE
    lines = tmp_path / "2.json.lines"
    assert merged(tmp_path, first, lines)[0] == run_report.DONE
    lines.write_bytes(lines.read_bytes()[:-20])  # cut off in the middle of a line
    code, found = merged(tmp_path, first, lines)
    assert (code, [each["number"] for each in found["bakes"]]) == (run_report.FAILED, [1, 2, 3])
    assert "missing: 4" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("before", "after", "state"),
    [
        (State.FAILED, State.DONE, State.DONE),
        (State.DONE, State.FAILED, State.DONE),
        (State.DONE, State.RESUMED, State.DONE),
        (State.STOPPED, State.FAILED, State.FAILED),
        (State.GATE, State.DONE, State.DONE),
        (State.DONE, State.GATE, State.GATE),
        (State.FAILED, State.RESUMED, State.RESUMED),
    ],
)
def test_of_several_entries_the_one_that_did_it_counts(tmp_path, before, after, state):
    paths = [write(tmp_path / f"{name}.json", [1], 1, state=name) for name in (before, after)]
    assert merged(tmp_path, *paths)[1]["bakes"][0]["state"] == state


def test_reports_without_the_keys_that_were_added_are_read(tmp_path):
    path = Path(write(tmp_path / "1.json", [1, 2], 2))
    report = json.loads(path.read_text(encoding="utf-8"))
    for each in report["bakes"]:
        for key in run_report.ADDED:
            del each[key]
    path.write_text(json.dumps(report), encoding="utf-8")
    code, found = merged(tmp_path, path)
    assert (code, [each["picture"] for each in found["bakes"]]) == (run_report.DONE, ["", ""])


def test_a_later_call_for_the_same_report_counts_beside_what_it_left(tmp_path):
    path = write(tmp_path / "1.json", [entry(1), entry(2, State.FAILED)], 2)
    write(tmp_path / "1.json", [entry(2)], 2, is_cut_off=True)
    code, found = merged(tmp_path, path)
    assert (code, [each["state"] for each in found["bakes"]]) == (run_report.DONE, ["done", "done"])


@pytest.mark.parametrize(
    ("entries", "code"),
    [
        ([entry(1), entry(2, State.RESUMED)], run_report.DONE),
        ([entry(1), entry(2, State.FAILED, cause=Cause.INPUT)], run_report.FAILED),
        ([entry(1), entry(2, State.FAILED, cause=Cause.GPU)], run_report.NO_MACHINE),
        ([entry(1), entry(2, State.GATE, gate=["missed is 1 %."])], run_report.GATE),
        ([entry(1), entry(2, State.STOPPED)], run_report.FAILED),
    ],
)
def test_the_exit_code_is_that_of_a_call_for_all(tmp_path, entries, code, capsys):
    paths = [write(tmp_path / f"{each.number}.json", [each], 2) for each in entries]
    assert merged(tmp_path, *paths)[0] == code
    if code == run_report.GATE:
        assert "imprint report: set 2: missed is 1 %." in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "part"),
    [
        ("", "it is not JSON"),
        ("[1]", "is not a report of Imprint"),
        ("{}", "is not a report of Imprint"),
        ('{"imprint_report": 1}', "is a report of version 1, not 2"),
        (
            '{"imprint_report": 2, "planned": 1, "imprint": "1", "blender": "5", "bakes": [{}]}',
            "is not a report of Imprint",
        ),
        (
            '{"imprint_report": 2, "planned": 1, "imprint": "1", "blender": "5", "bakes": 7}',
            "is not a report of Imprint",
        ),
    ],
)
def test_what_is_no_report_is_an_error(tmp_path, content, part, capsys):
    path = tmp_path / "1.json"
    path.write_text(content)
    assert merged(tmp_path, path) == (run_report.WRONG_USAGE, None)
    assert part in capsys.readouterr().err


def test_reports_of_different_job_files_are_an_error(tmp_path, capsys):
    paths = [write(tmp_path / f"{planned}.json", [1], planned) for planned in (1, 2)]
    assert merged(tmp_path, *paths) == (run_report.WRONG_USAGE, None)
    other = write(tmp_path / "other.json", [Entry(1, "another")], 1)
    assert merged(tmp_path, paths[0], other) == (run_report.WRONG_USAGE, None)
    err = capsys.readouterr().err
    assert "is of 2 bakes" in err
    assert "Bake 1 is 'set 1' in one report, and 'another' in another." in err


def test_no_report_at_all_is_an_error(tmp_path, capsys):
    assert merged(tmp_path, tmp_path / "1.json") == (run_report.WRONG_USAGE, None)
    assert command.run(["report", str(tmp_path / "1.json")]) == run_report.WRONG_USAGE
    assert command.run(["report", "--merge", "x.json"]) == run_report.WRONG_USAGE


def test_other_versions_are_a_warning(tmp_path, monkeypatch, capsys):
    first = write(tmp_path / "1.json", [1], 2)
    monkeypatch.setattr(run_report.versions, "imprint", lambda: "9.9.9")
    assert merged(tmp_path, first, write(tmp_path / "2.json", [2], 2))[0] == run_report.DONE
    assert "warning: " in capsys.readouterr().err


def test_other_code_of_one_version_is_a_warning(tmp_path, monkeypatch, capsys):
    first = write(tmp_path / "1.json", [1], 3)
    before = run_report.versions.code()
    monkeypatch.setattr(run_report.versions, "code", lambda: "0" * 64)
    second = write(tmp_path / "2.json", [2], 3)
    monkeypatch.setattr(run_report.versions, "code", lambda: "")  # as one that was written before reports had it
    third = write(tmp_path / "3.json", [3], 3)
    code, found = merged(tmp_path, first, second, third)
    assert (code, found["code"]) == (run_report.DONE, before)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"imprint report: warning: {second!r} and {first!r} are by other code of Imprint")


def test_ranges():
    assert ranges([1, 2, 3, 5, 7, 8]) == "1-3, 5, 7-8"
    assert ranges([]) == ""


# --only


def only(*numbers, pattern="a*"):
    return Only.of([pattern], numbers)


@pytest.mark.parametrize("is_cut_off", [False, True])
def test_what_no_call_was_for_is_not_missing(tmp_path, capsys, is_cut_off):
    parts = [
        write(tmp_path / "1.json", [2, 5], 9, "1/2", only=only(2, 3, 5), is_cut_off=is_cut_off),
        write(tmp_path / "2.json", [7], 9, "2/2", only=only(7, 8, pattern="b?")),
    ]
    code, found = merged(tmp_path, *parts)
    assert code == run_report.FAILED
    out, err = capsys.readouterr()
    assert "missing: 3, 8\n" in err
    assert "3 done, 0 failed, 2 stopped or not begun" in out
    assert (found["planned"], found["only"]) == (9, {"patterns": ["a*", "b?"], "bakes": "2-3, 5, 7-8"})
    rest = write(tmp_path / "3.json", [3, 8], 9, only=only(3, 8))
    assert merged(tmp_path, tmp_path / "all.json", rest)[0] == run_report.DONE  # merged ones can be merged


def test_beside_a_call_for_all_bakes_all_are_wanted(tmp_path, capsys):
    parts = [
        write(tmp_path / "1.json", [2], 4, only=only(2)),
        write(tmp_path / "2.json", [1], 4, "1/2"),
    ]
    code, found = merged(tmp_path, *parts)
    assert (code, found["only"]) == (run_report.FAILED, None)
    assert "missing: 3-4" in capsys.readouterr().err


@random_cases.seeds(20, fast=2)
def test_the_numbers_of_only_are_read_as_they_were_written(seed):
    rng = random.Random(seed)
    numbers = rng.sample(range(1, 100), rng.randint(1, 99))
    assert Only.from_dict(only(*numbers).to_dict(), 100) == only(*numbers)


@pytest.mark.parametrize("bakes", ["", "a", "1-99999999999", "10", "-1", None])
def test_numbers_that_cannot_be_are_an_error(tmp_path, bakes, capsys):
    path = write(tmp_path / "1.json", [1], 9, only=only(1))
    values = json.loads(Path(path).read_text())
    values["only"]["bakes"] = bakes
    Path(path).write_text(json.dumps(values))
    assert merged(tmp_path, path) == (run_report.WRONG_USAGE, None)
    assert "is not a report of Imprint" in capsys.readouterr().err


# Schema file


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


def test_each_key_is_described():
    kinds = SCHEMA, *SCHEMA["$defs"].values()
    assert [key for kind in kinds for key, value in kind["properties"].items() if not value.get("description")] == []


def test_reports_fit():
    assert list(json_schema.errors(document(), SCHEMA)) == []


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
    assert list(json_schema.errors(found, SCHEMA))


@pytest.mark.parametrize(
    "place", [("blender",), ("summary", "gate"), ("bakes", 1, "log"), ("bakes", 0, "reports", 0, "low")]
)
def test_keys_cannot_be_missing(place):
    found = document()
    at = found
    for step in place[:-1]:
        at = at[step]
    del at[place[-1]]
    assert list(json_schema.errors(found, SCHEMA))


def test_new_keys_fit():
    found = document()
    found["new"] = found["bakes"][0]["new"] = 1
    assert list(json_schema.errors(found, SCHEMA)) == []


# Gates


REPORT = {
    "low": "rock",
    "missed": 0.002,
    "overlap": 0.0,
    "coverage": 0.75,
    "mirrored": 3,
    "checks": {"unsure": {"share": 0.01, "count": 7}, "hard_edges": {"count": 5, "of": 100}, "far": {"share": 0.0}},
    "deviation": {"median": 0.5, "percentile_95": 1.0, "percentile_99": 2.5, "maximum": 9.0},
    "targets": {"unity-built-in": {"percentile_99": 3.0}},
    "export": {"basis": "CYCLES", "degrees": {"CYCLES": {"maximum": 0.25}, "NORMALIZED": {"maximum": 20.0}}},
    "loss": {},
    "warnings": ["a", "b"],
    "seconds": {"total": 1.5},
}
WORDS = ["--low", "a", "--output", "b.png"]


def over(text, *reports):
    return limits.over(limits.parse(text), reports or [REPORT])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("missed<0.1%", "missed is 0.2 %, and must be less than 0.1 %."),
        ("missed<0.001", "missed is 0.2 %, and must be less than 0.1 %."),
        ("coverage >= 80 %", "coverage is 75 %, and must be at least 80 %."),
        ("unsure<1%", "unsure is 1 %, and must be less than 1 %."),
        ("mirrored=0", "mirrored is 3, and must be exactly 0."),
        ("hard_edges<=4", "hard_edges is 5, and must be at most 4."),
        ("Deviation.P99<2deg", "deviation.p99 is 2.5 degrees, and must be less than 2 degrees."),
        ("deviation.max<.5", "deviation.max is 9 degrees, and must be less than 0.5 degrees."),
        (
            "targets.unity-built-in.p99<2deg",
            "targets.unity-built-in.p99 is 3 degrees, and must be less than 2 degrees.",
        ),
        ("targets.three.p99<2deg", "targets.three.p99 was not measured, and must be less than 2 degrees."),
        ("export.max<0.2deg", "export.max is 0.25 degrees, and must be less than 0.2 degrees."),
        ("warnings==0", "warnings is 2, and must be exactly 0."),
        ("seconds<1s", "seconds is 1.5 s, and must be less than 1 s."),
        ("coverage>0.75", "coverage is 75 %, and must be more than 75 %."),
    ],
)
def test_a_figure_over_its_limit_is_named_with_its_value_and_the_limit(text, sentence):
    assert over(text) == [sentence]


@pytest.mark.parametrize(
    "text",
    [
        "missed<0.3%",
        "overlap=0",
        "far<0.1%",
        "loss.max<0.1deg",
        "unsure<=1%",
        "mirrored>2",
        "coverage>=75%",
        "coverage<=1",
        "missed<100%",
        "",
    ],
)
def test_a_figure_within_its_limit_is_not_named(text):
    assert over(text) == []


def test_several_limits_and_reports():
    assert over("missed<0.1%, overlap=0,mirrored<1", REPORT, {**REPORT, "low": "moss", "mirrored": 0}) == [
        "rock: missed is 0.2 %, and must be less than 0.1 %.",
        "rock: mirrored is 3, and must be less than 1.",
        "moss: missed is 0.2 %, and must be less than 0.1 %.",
    ]


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("mised<1%", "'mised' is not a metric of a bake, did you mean 'missed'?"),
        ("deviation.p98<1", "did you mean 'deviation.p"),
        ("beauty>1", "choose one of missed, coverage"),
        ("missed<1deg", "'missed<1deg': missed takes %, or no unit, and not 'deg'"),
        ("deviation.p99<1%", "takes deg, or no unit"),
        ("mirrored<1%", "takes no unit"),
        ("missed~1", "is not a limit, such as missed<0.1%"),
        ("missed", "is not a limit"),
        ("missed<", "is not a limit"),
        ("missed<-1", "is not a limit"),
        ("missed<nan", "is not a limit"),
        ("missed<1e999", "is not a limit"),
        ("missed!=1", "is not a limit"),
        ("<1", "is not a limit"),
        ("missed<5", "'missed<5': missed is a share of texels, from 0 to 1: for percent, write missed<5%."),
        ("coverage>50", "write coverage>50%"),
        ("overlap<=1.01", "from 0 to 1"),
        ("missed<101%", "missed is a share of texels, which is 100 % at most."),
    ],
)
def test_a_limit_that_cannot_be_read_is_an_error_before_the_bake(text, part):
    with pytest.raises(BakeError) as error:
        limits.parse(text)
    assert part in str(error.value)
    with pytest.raises(WrongUsage, match="argument --strict: "):
        arguments.parse([*WORDS, "--strict", text])


@pytest.mark.parametrize(
    ("words", "mistake"),
    [
        (["--strict", "deviation.p99<1", "--no-normal", "--maps", "ao"], "deviation.p99 needs a normal map"),
        (["--strict", "targets.three.p99<1"], "targets.three.p99 needs --targets three"),
        (["--strict", "targets.three.p99<1", "--targets", "unreal"], "targets.three.p99 needs --targets three"),
        (["--strict", "targets.unreal.compressed.p99<1"], "targets.unreal.compressed.p99 needs --targets unreal"),
        (
            ["--strict", "targets.unreal.compressed.p99<1", "--targets=unreal", "--output=a.dds"],
            "targets.unreal.compressed.p99 is not measured of DDS files, which are compressed already",
        ),
        (["--strict", "export.p99<1"], "export.p99 needs --export"),
        (["--strict", "missed<1%", "--convert", "old.png"], "a conversion does not measure missed"),
    ],
)
def test_a_figure_that_will_not_be_measured_is_an_error_before_the_bake(words, mistake):
    assert [text for text in arguments.mistakes(arguments.parse([*WORDS, *words])) if mistake in text]


@pytest.mark.parametrize(
    "words",
    [
        ["--strict", "deviation.p99<1"],
        ["--strict", "targets.three.p99<1", "--targets", "unreal,three"],
        ["--strict", "targets.unreal.compressed.p99<1", "--targets", "unreal"],
        ["--strict", "targets.unreal.p99<1", "--targets=unreal", "--output=a.dds"],
        ["--strict", "export.p99<1", "--export", "a.glb"],
        ["--strict", "coverage>1%,loss.max<1,warnings=0", "--convert", "old.png"],
    ],
)
def test_a_figure_that_will_be_measured_is_no_mistake(words):
    assert list(arguments.mistakes(arguments.parse([*WORDS, *words]))) == []


# Result sheet


class Reader(html.parser.HTMLParser):
    """The cells of the table as text, and all elements."""

    def __init__(self):
        super().__init__()
        self.rows, self.tags, self.is_in_cell = [], [], False
        self.images = []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.images += [dict(attrs)] if tag == "img" else []
        if tag == "tr":
            self.rows.append([])
        elif tag in {"td", "th"}:
            self.rows[-1].append("")
            self.is_in_cell = True

    def handle_endtag(self, tag):
        self.is_in_cell &= tag not in {"td", "th"}

    def handle_data(self, data):
        if self.is_in_cell:
            self.rows[-1][-1] += data


def read(text):
    reader = Reader()
    reader.feed(text)
    return reader


def whole(report, title="r.json", picture=b""):
    return "".join(sheet_module.page(report, title, (sheet_module.row(entry, picture) for entry in report["bakes"])))


def test_a_row_has_the_figures_of_its_bake():
    head, first, second, third = read(whole(reports.of_three())).rows
    assert tuple(head) == sheet_module.COLUMNS
    assert first[:2] + first[3:10] == ["1", "done", "", "50", "", "0", "2.25", "", "2.00"]
    assert second[:3] == ["2", "failed", "a"]
    assert second[3:9] == ["", "", "", "", "", ""]
    assert third[-1] == "missed is 50 %."


def test_a_row_has_the_worst_of_engines_and_their_compressors():
    entry = reports.of_three()["bakes"][0]
    angles = {name: {"percentile_99": value} for name, value in (("three", 0.5), ("unreal", 0.25))}
    for compressed, worst in (({}, "0.5"), ({"compressed": {"percentile_99": 1.25}}, "1.25")):
        entry["reports"][0]["targets"] = {**angles, "unreal": angles["unreal"] | compressed}
        _, found = read(whole({**reports.of_three(), "bakes": [entry]})).rows
        assert found[sheet_module.COLUMNS.index("Engines p99")] == worst


def test_names_with_quotes_and_tags_are_text():
    found = read(whole(reports.of_three(), reports.EVIL))
    assert found.tags.count("script") == 1
    assert "img" not in found.tags
    assert found.rows[1][2] == f"b {reports.EVIL}"
    assert found.rows[2][-1] == reports.EVIL
    assert found.rows[1][-2] == f"{reports.EVIL.replace('/', '')}.png"


def test_the_command_writes_the_page(tmp_path):
    path, sheet = tmp_path / "r.json", tmp_path / "sheet.html"
    path.write_text(json.dumps(reports.of_three()), encoding="utf-8")
    assert command.run(["report", "--sheet", str(sheet), str(path)]) == 1  # a bake failed
    assert len(read(sheet.read_text(encoding="utf-8")).rows) == 4
    both = tmp_path / "all.json"
    assert command.run(["report", "--sheet", str(sheet), "--merge", str(both), str(path)]) == 1
    assert both.is_file()


def test_a_picture_is_in_the_page_and_its_name_is_text():
    found = read(whole(reports.of_three(), picture=b"\x89PNG"))
    assert [each["alt"].rpartition(":")[0] for each in found.images] == [f"b {reports.EVIL}", "a", "c"]
    assert {each["src"] for each in found.images} == {"data:image/png;base64," + base64.b64encode(b"\x89PNG").decode()}
    assert found.tags.count("img") == 3


def test_rows_are_in_the_order_of_the_job_file(tmp_path):
    sheet = SheetFile(tmp_path / "s.html", run_report.head(3))
    for number in (3, 1, 2):
        sheet.add(Entry(number, f"n{number}", image=b"p" * number))
    assert not (tmp_path / "s.html").exists()
    sheet.finish()
    assert [row[2] for row in read((tmp_path / "s.html").read_text(encoding="utf-8")).rows[1:]] == ["n1", "n2", "n3"]
    assert "3 planned: 3 done" in (tmp_path / "s.html").read_text(encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == ["s.html"]


def test_a_name_with_bytes_that_are_no_text_has_question_marks(tmp_path):
    """Python has such a byte of a file's name as half a character, which no encoding takes."""
    named, head = Entry(1, "crate \udcff"), run_report.head(1)
    sheet = SheetFile(tmp_path / "a.html", head)
    sheet.add(named)
    sheet.finish()
    merged = {**head, "summary": Totals([named]).to_dict()}
    sheet_module.write(tmp_path / "b.html", merged, iter([sheet_module.row(named.to_dict(), b"")]))
    for name in ("a.html", "b.html"):
        assert "<td>crate ?</td>" in (tmp_path / name).read_text(encoding="utf-8")


def test_a_page_that_cannot_be_written_is_an_error(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(BakeError, match="file"):
        SheetFile(tmp_path / "file" / "s.html", run_report.head(1))


def test_a_full_disk_stops_no_bake_and_is_an_error_at_the_end(tmp_path, monkeypatch):
    def full(**_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    sheet = SheetFile(tmp_path / "s.html", run_report.head(1))
    sheet.add(Entry(1, "a"))
    with pytest.raises(BakeError, match="No space left on device"):
        sheet.finish()
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_ends_early_leaves_no_file(tmp_path):
    sheet = SheetFile(tmp_path / "s.html", run_report.head(1))
    sheet.add(Entry(1, "a"))
    sheet.close()
    assert sheet._rows._file.closed
    assert list(tmp_path.iterdir()) == []


def done_entry(picture=b"", sha256="0" * 64, *, number=1, of="2" * 64):
    file, mesh = {"path": "m.png", "sha256": sha256}, {"path": "m.obj", "sha256": of}
    return Entry(number, f"set {number} (a/b)", inputs=[mesh], files=[file], image=picture)


def test_a_picture_is_found_again_for_the_same_map(tmp_path):
    first, again, other = done_entry(b"picture"), done_entry(number=2), done_entry(sha256="1" * 64)
    mesh = done_entry(of="3" * 64)  # another mesh with the same map
    for each in (first, again, other, mesh):
        sheet_module.keep_picture(str(tmp_path), each)
    (path,) = tmp_path.iterdir()
    assert path.name.startswith("m_")
    assert path.read_bytes() == b"picture"
    assert [each.picture for each in (first, again, other, mesh)] == [str(path), str(path), "", ""]


def test_a_bake_that_wrote_nothing_has_no_picture(tmp_path):
    bake = Entry(1, "a", image=b"picture")
    sheet_module.keep_picture(str(tmp_path), bake)
    assert (bake.picture, list(tmp_path.iterdir())) == ("", [])


def test_the_command_takes_the_pictures_that_a_run_kept(tmp_path):
    report = reports.of_three()
    picture = png_writer.small(np.zeros((1, 1, 3), np.uint8))
    (tmp_path / "p.png").write_bytes(picture)
    report["bakes"][0]["picture"], report["bakes"][1]["picture"] = str(tmp_path / "p.png"), str(tmp_path / "gone.png")
    (tmp_path / "r.json").write_text(json.dumps(report), encoding="utf-8")
    assert command.run(["report", "--sheet", str(tmp_path / "s.html"), str(tmp_path / "r.json")]) == 1
    (image,) = read((tmp_path / "s.html").read_text(encoding="utf-8")).images
    assert image["src"] == "data:image/png;base64," + base64.b64encode(picture).decode()


def test_what_is_no_path_is_no_link():
    entry = reports.of_three()["bakes"][0]
    entry["files"][0]["path"] = "javascript:alert(1)"
    assert "<td>javascript:alert(1)</td>" in sheet_module.row(entry, b"")
