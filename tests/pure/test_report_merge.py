# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that reports of parts become one report. Needs no Blender."""

import json
import random
from pathlib import Path

import pytest

from addon.cli import command, run_report
from addon.cli.run_report import Cause, Entry, Only, ReportFile, State, ranges


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


@pytest.mark.parametrize("seed", range(20))
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


@pytest.mark.parametrize("seed", range(5))
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


@pytest.mark.parametrize("seed", range(20))
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
