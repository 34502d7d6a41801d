# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests which bakes of a run are to do: keys, records, and processes that do the same run. The bakes are made up."""

import json
import os
import pickle
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from addon.cli import arguments, clashes, records
from addon.cli import work_queue as turns_module
from addon.cli.claims import Claims
from addon.cli.options import OPTIONS
from addon.cli.plans import Plan
from addon.cli.records import Assignment, Contents
from addon.cli.run_report import Entry, State
from addon.cli.untrusted import Bounds
from addon.cli.work_queue import POLL, ResumeQueue, WorkQueue
from addon.core import versions
from addon.core.errors import BakeError
from addon.output import atomic_file
from addon.output.atomic_file import all_or_none, replacing
from scripts.imprint import ROOT


@pytest.fixture(autouse=True)
def version(monkeypatch):
    """Works in Pythons without Blender's package as well."""
    monkeypatch.setattr(versions, "blender", lambda: "5.2.3")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "in").mkdir()
    for name in ("a", "b"):
        for part in ("low", "high"):
            (tmp_path / "in" / f"{name}_{part}.ply").write_text(f"{name} {part}")
    (tmp_path / "in" / "scene.blend").write_text("scene")
    return tmp_path


class Clock:
    """That of `next`."""

    now = 1000.0

    def __call__(self):
        return self.now


def plan(folder, name="a", *more, output="{low}.png"):
    low, high = (str(folder / "in" / f"{name}_{part}.ply") for part in ("low", "high"))
    words = ["--low-file", low, "--high-file", high, "--output", str(folder / "out" / output), *more]
    return Plan(name, arguments.parse(words), number=sum(name.encode()))


def in_scene(folder, low, *more, output="{low}.png"):
    words = [str(folder / "in" / "scene.blend"), *low, "--output", str(folder / "out" / output), *more]
    return Plan("scene", arguments.parse(words))


def bake(turn, found=(), text="map"):
    """Do an assignment without Blender. Returns the path of the map."""
    path = Path(str(turn.plan.options.output).replace("{low}", turn.plan.name))
    with all_or_none(), replacing(path) as partial:
        partial.write_text(f"{text} of {turn.plan.name}")
    records.write_record(turn, entry(turn, path), Contents().all_of(found), Contents())
    return path


def entry(turn, path):
    return Entry(turn.plan.number, turn.plan.name, files=[{"path": str(path), "what": "map"}])


def run(planned, **more):
    """Do a whole run. Returns the names of the bakes that were done, and why."""
    did = {}
    with ResumeQueue(planned, **more) as left:
        while left.count:
            turn = left.next()
            did[turn.plan.name] = turn.why
            bake(turn)
            left.release(turn.plan.number)
    return did


def why(planned, **more):
    """Why a bake still has to run, or "" if it is done."""
    with ResumeQueue([planned], **more) as left:
        return next((turn.why for turn in left.left), "")


def moved(folder):
    """The folder at another place, as another machine sees it."""
    other = folder.with_name(folder.name + " elsewhere")
    shutil.copytree(folder, other)
    return other


# What is done


def test_what_is_done_is_not_done_again(folder):
    planned = [plan(folder, "a"), plan(folder, "b")]
    assert run(planned) == dict.fromkeys("ab", "It has not been baked.")
    assert run(planned) == {}
    with ResumeQueue(planned) as left:
        assert [(each.name, each.number, each.state) for each in left.done] == [
            (each.name, each.number, State.RESUMED) for each in planned
        ]
    assert sorted(os.listdir(folder / "out")) == ["a.png", "a_low.png.imprint.json", "b.png", "b_low.png.imprint.json"]


def test_all_is_done_again_if_that_is_wanted(folder):
    planned = [plan(folder, "a"), plan(folder, "b")]
    run(planned)
    assert run(planned, is_forced=True) == dict.fromkeys("ab", "All bakes are done again.")


def test_a_bake_that_cannot_be_done_is_returned_and_writes_nothing(folder):
    bad = replace(plan(folder), problem="Two files share a name.")
    with ResumeQueue([bad]) as left:
        turn = left.next()
        assert (turn.plan, turn.record, turn.why) == (bad, None, "Two files share a name.")
        left.release(turn.plan.number)
        assert not left.count
    assert not (folder / "out").exists()


def test_a_folder_that_cannot_be_written_to_is_left_to_the_bake(folder):
    (folder / "out").touch()
    with ResumeQueue([plan(folder)]) as left:
        assert left.next().record is None


def overwrite(path, text):
    """Change a file, which keeps its size and time."""
    before = path.stat()
    path.write_text(text)
    assert path.stat().st_size == before.st_size
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def replace_file(path, text):
    """As `overwrite`, by another file that takes its place."""
    other = path.with_name("other")
    shutil.copy2(path, other)
    overwrite(other, text)
    os.replace(other, path)


CHANGES = {
    "high": ("The high mesh's file has changed: 'a_high.ply'.", lambda at: (at / "in/a_high.ply").write_text("a HIGH")),
    "longer": ("The low mesh's file has changed: 'a_low.ply'.", lambda at: (at / "in/a_low.ply").write_text("longer")),
    "gone": ("The low mesh's file has changed: 'a_low.ply'.", lambda at: (at / "in/a_low.ply").unlink()),
    "texture": ("A texture has changed: 'skin.png'.", lambda at: (at / "in/skin.png").write_text("SKIN")),
    "new": ("A library has changed: 'later.mtl'.", lambda at: (at / "in/later.mtl").write_text("new")),
    "map": ("'{}/out/a.png' has changed since it was baked.", lambda at: (at / "out/a.png").write_text("map of A")),
    "time put back": (
        "'{}/out/a.png' has changed since it was baked.",
        lambda at: overwrite(at / "out/a.png", "map of A"),
    ),
    "replaced": (
        "'{}/out/a.png' has changed since it was baked.",
        lambda at: replace_file(at / "out/a.png", "map of A"),
    ),
    "short": ("'{}/out/a.png' has changed since it was baked.", lambda at: (at / "out/a.png").write_text("")),
    "no map": ("'{}/out/a.png' is missing.", lambda at: (at / "out/a.png").unlink()),
    "damaged": ("Its record cannot be read.", lambda at: (at / "out/a_low.png.imprint.json").write_text("{")),
}


@pytest.mark.parametrize("name", CHANGES)
def test_what_changed_is_done_again_and_named(folder, name):
    expected, change = CHANGES[name]
    (folder / "in" / "skin.png").write_text("skin")
    found = [(str(folder / "in" / "skin.png"), "a texture"), (str(folder / "in" / "later.mtl"), "a library")]
    with ResumeQueue([plan(folder)]) as left:
        bake(left.next(), found)
    assert why(plan(folder)) == ""
    change(folder)
    assert why(plan(folder)) == expected.format(folder)
    run([plan(folder)])
    assert why(plan(folder)) == ""


def test_time_alone_changes_nothing(folder):
    run([plan(folder)])
    for path in (folder / "in" / "a_low.ply", folder / "out" / "a.png"):
        os.utime(path, (0, 0))
    assert why(plan(folder)) == ""


def test_another_version_bakes_again(folder, monkeypatch):
    run([plan(folder)])
    monkeypatch.setattr(versions, "blender", lambda: "5.2.4")
    assert why(plan(folder)) == f"It was baked by Imprint {versions.imprint()} in Blender 5.2.3."


def test_other_code_of_the_same_version_bakes_again(folder, monkeypatch):
    run([plan(folder)])
    monkeypatch.setattr(versions, "code", lambda: "0" * 64)
    assert why(plan(folder)) == f"It was baked by other code of Imprint {versions.imprint()}."
    run([plan(folder)])
    assert why(plan(folder)) == ""


def test_the_report_of_a_bake_is_a_file_that_it_wrote(folder):
    report = folder / "out" / "a.json"
    with ResumeQueue([plan(folder, "a", "--report", str(report))]) as left:
        turn = left.next()
        report.parent.mkdir(exist_ok=True)
        report.write_text("{}")
        bake(turn)
    assert why(plan(folder, "a", "--report", str(report))) == ""
    overwrite(report, "[]")
    assert why(plan(folder, "a", "--report", str(report))) == f"'{report}' has changed since it was baked."


def test_other_settings_bake_again(folder):
    run([plan(folder)])
    assert why(plan(folder, "a", "--size", "64", "--samples", "4")) == "Settings have changed: size, samples."
    assert why(plan(folder, "a", "--size", "2048")) == ""  # the default


def test_another_name_bakes_nothing_again(folder):
    run([plan(folder)])
    renamed = plan(folder, "a", "--name", "b")
    assert why(renamed) == ""
    entry = turns_module.resumed(renamed, Entry(renamed.number + 1, "before"))
    assert (entry.name, entry.number) == (renamed.name, renamed.number)


def test_other_files_bake_again(folder):
    run([plan(folder)])
    (folder / "in" / "more.ply").write_text("more")
    assert why(plan(folder, "a", "--high-file", str(folder / "in" / "more.ply"))) == "It was baked from other files."


def test_a_report_that_is_missing_is_written(folder):
    run([plan(folder)])
    assert why(plan(folder, "a", "--report", str(folder / "a.json"))) == f"'{folder}/a.json' is missing."
    assert why(plan(folder, "a", "--report", "-")) == ""


def test_a_folder_that_was_moved_is_still_done(folder):
    """Machines see a share at different places. A copy has other times."""
    run([plan(folder)])
    there = moved(folder)
    assert why(plan(there)) == ""
    (there / "in" / "a_high.ply").write_text("a HIGH")
    assert why(plan(there)) == CHANGES["high"][0]
    assert why(plan(folder)) == ""


def test_a_record_whose_key_was_changed_does_not_count(folder):
    run([plan(folder)])
    (path,) = folder.rglob("*.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | {"key": "0" * 64}))
    assert why(plan(folder)) == "Its record was changed."


# Files that are not trusted, whose records are in a folder of the caller


@pytest.fixture
def untrusted(folder):
    """What ResumeQueue needs for them."""
    place = Path(os.path.realpath(folder))
    return {"records": str(place / "records"), "bounds": Bounds(str(place / "in"), str(place / "out"))}


def changed(untrusted, key, path, **values):
    """Add a file to the only record."""
    (record,) = Path(untrusted["records"]).glob("*.json")
    found = json.loads(record.read_text())
    content = Contents().of(str(path))
    added = {"path": str(path), "bytes": content.size, "sha256": content.sha256, "stamp": ""}
    found[key].append({**added, "what": "a texture", **values})
    record.write_text(json.dumps(found))


def test_levels_have_another_record_than_a_bake_of_their_mesh(folder):
    """Their maps have other names."""
    options = plan(folder).options
    levels = arguments.argparse.Namespace(**{**vars(options), "levels": ("1,2", "1")})
    assert records.record_path(levels) != records.record_path(options)


def test_records_in_a_folder_are_found_there_alone(folder, untrusted):
    planned = [plan(folder, "a"), plan(folder, "b"), plan(folder, "a", output="other/{low}.png")]
    (folder / "out/other").mkdir(parents=True)
    run(planned, **untrusted)
    assert len(os.listdir(folder / "records")) == 3
    assert [why(each, **untrusted) for each in planned] == ["", "", ""]
    assert [why(each) for each in planned] == ["It has not been baked."] * 3
    assert [path for path in folder.rglob("*.json") if path.parent.name != "records"] == []


@pytest.mark.parametrize("key", ["inputs", "files"])
def test_what_a_record_names_in_other_folders_is_not_read(folder, untrusted, monkeypatch, key):
    run([plan(folder)], **untrusted)
    (folder / "outside").write_text("secret")
    changed(untrusted, key, folder / "outside")
    assert not read_of(folder, untrusted, monkeypatch, "outside")


def read_of(folder, untrusted, monkeypatch, *names):
    """The files of these names that are read to find out that the only record is of files that have changed."""
    read, of = [], Contents.of
    monkeypatch.setattr(Contents, "of", lambda self, path, *more: read.append(path) or of(self, path, *more))
    assert "has changed" in why(plan(folder), **untrusted)
    return [path for path in read if path.endswith(names)]


def test_a_file_that_was_replaced_with_its_time_and_size_counts(folder, untrusted):
    run([plan(folder)], **untrusted)
    path = folder / "out/a.png"
    before = os.stat(path)
    path.write_text("map of A")
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert "has changed since it was baked" in why(plan(folder), **untrusted)


def said(folder, path="", **values):
    """What a process says of a file: what is true, but for `values`."""
    return {**Contents().of(path or str(folder / "out/a_low.png"), "map").facts(), **values}


def lie(folder, untrusted, *, has_record=True, **values):
    """The entry of a bake whose process gives other values of its files."""
    own = plan(folder)
    files = clashes.RunFiles(bounds=untrusted["bounds"])
    assert files.add([(own.name, own.options)]) == []
    with ResumeQueue([own], **untrusted) as left:
        turn = left.next()
        (folder / "out").mkdir(exist_ok=True)
        for name in ("out/a_low.png", "out/other.png", "outside"):
            (folder / name).write_text("map")
        done = Entry(7, "another", files=[Contents().of(str(folder / "out/a_low.png"), "map").facts()])
        for name, value in values.items():
            setattr(done, name, [said(folder, **value)] if isinstance(value, dict) else value)
        unplanned = partial(files.unplanned, own.name, own.options)
        turn = turn if has_record else Assignment(own)
        done = records.check_untrusted(turn, done, untrusted["bounds"], unplanned)
    assert (done.number, done.name, done.picture) == (own.number, own.name, "")
    return done


NO_REPORT = {"output": [], "export": {}, "mip_files": {}}
LIES = {
    "a map elsewhere": {"files": {"path": "{}/outside"}},
    "a file of the system": {"files": {"path": "/etc/passwd"}},
    "another file of the folder": {"files": {"path": "{}/out/other.png"}},
    "a map that is not there": {"files": {"path": "{}/out/none.png"}},
    "a map whose name no system takes": {"files": {"path": "{}/out/a\0"}},
    "a map whose name is no text": {"files": {"path": "{}/out/\ud800"}},
    "an input whose name no system takes": {"inputs": {"path": "{}/in/a\0"}},
    "another hash of the map": {"files": {"sha256": "0" * 64}},
    "no map": {"files": []},
    "an input elsewhere": {"inputs": {"path": "{}/outside"}},
    "an input that is a device": {"inputs": {"path": "/dev/zero"}},
    "a map elsewhere in its report": {"reports": [{**NO_REPORT, "output": ["/etc/passwd"]}]},
    "a file for engines elsewhere in its report": {"reports": [{**NO_REPORT, "export": {"files": ["/etc/passwd"]}}]},
    "a mip level elsewhere in its report": {"reports": [{**NO_REPORT, "mip_files": {"a": ["/etc/passwd"]}}]},
    "that another call did it": {"state": State.RESUMED},
}


@pytest.mark.parametrize("has_record", [True, False], ids=["record", "no record"])
@pytest.mark.parametrize("values", LIES.values(), ids=LIES)
def test_a_process_that_lies_of_its_files_has_failed(folder, untrusted, values, has_record):
    values = {
        name: {key: text.format(folder) for key, text in each.items()} if isinstance(each, dict) else each
        for name, each in values.items()
    }
    entry = lie(folder, untrusted, has_record=has_record, **values)
    assert entry.state == State.FAILED
    assert (entry.files, entry.inputs, entry.reports) == ([], [], [])
    assert entry.error.startswith("Its process gave a wrong result: ")
    assert not (folder / "records").exists()


@pytest.mark.parametrize("kind", ["folder", "nothing"])
def test_a_map_of_a_process_that_lies_is_a_file(folder, untrusted, monkeypatch, kind):
    def make(path):
        if kind == "folder":
            path.mkdir()
            (path / "x").write_text("map")

    entry = lie_of_map(folder, untrusted, monkeypatch, make)
    assert (entry.state, entry.files) == (State.FAILED, [])


def lie_of_map(folder, untrusted, monkeypatch, make):
    """As `lie`, with something else in the place of the map. make: makes that at its path. On Linux the process cannot."""
    path, check = folder / "out/a_low.png", records._check_written

    def replaced(entry):
        path.unlink()
        make(path)
        entry.files[:] = [Contents().of(str(path), "map").facts()]

    monkeypatch.setattr(records, "_check_written", lambda entry, *given: (replaced(entry), check(entry, *given)))
    return lie(folder, untrusted, picture="/etc/passwd")


@pytest.mark.parametrize("has_record", [True, False], ids=["record", "no record"])
def test_an_input_that_was_changed_during_an_untrusted_bake_is_a_warning(folder, untrusted, has_record):
    values = {"inputs": {"path": str(folder / "in/b_low.ply"), "sha256": "0" * 64}}
    done = lie(folder, untrusted, has_record=has_record, **values)
    assert done.state == State.DONE
    (warning,) = done.warnings
    assert "b_low.ply' is not as it was in the bake" in warning
    assert not (folder / "records").exists()


def test_a_process_that_says_what_is_true_gets_a_record(folder, untrusted):
    done = lie(folder, untrusted)
    assert (done.state, done.warnings) == (State.DONE, [])
    assert len(os.listdir(folder / "records")) == 1


# Keys


def key(planned):
    return records.key_of(planned.options, Contents()).value


def test_each_setting_counts(folder):
    """Whichever option is added later: only those that say where files are, names of bakes, and limits, do not count."""
    usual = plan(folder).options
    changed = {}
    for name in (name.replace("-", "_") for options in OPTIONS.values() for name in options):
        dest = {"no_normal": "normal"}.get(name, name)
        if dest not in vars(usual) or dest in (
            "low_file",
            "high_file",
            "cage_file",
            "convert",
            "report",
            "pairs",
            "strict",
            "name",
        ):
            continue
        other = arguments.argparse.Namespace(**{**vars(usual), dest: "other"})
        changed[name] = records.key_of(other, Contents()).value
    assert len(changed) > 60
    assert len({key(plan(folder)), *changed.values()}) == len(changed) + 1


def test_the_content_of_files_counts_and_their_folders_do_not(folder):
    before = key(plan(folder))
    assert key(plan(moved(folder))) == before
    (folder / "in" / "a_high.ply").write_text("a HIGH")
    assert key(plan(folder)) != before


def test_files_that_the_run_writes_beside_do_not_count(folder):
    assert key(plan(folder, "a", "--report", "r.json")) == key(plan(folder))


def test_a_key_can_go_to_another_process(folder):
    with ResumeQueue([plan(folder)]) as left:
        turn = left.next()
    assert pickle.loads(pickle.dumps(turn)) == turn


def test_tiles_count_together(folder):
    for tile in (1001, 1002):
        (folder / f"n.{tile}.png").write_text(str(tile))
    path = str(folder / "n.<UDIM>.png")
    first = Contents().of(path)
    assert (first.size, records.size_of(path), records.stamp_of(path)) == (8, 8, first.stamp)
    (folder / "n.1003.png").write_text("")
    assert not Contents().of(path).is_same(first)
    assert Contents().of(str(folder / "m.<UDIM>.png")).sha256 is None


# Records


def record_of(planned):
    return records.record_path(planned.options).name


def test_a_record_is_named_after_its_map(folder):
    assert record_of(plan(folder, output="m.png")) == "m.png.imprint.json"
    assert record_of(plan(folder)) == "a_low.png.imprint.json"
    assert record_of(in_scene(folder, ["--low", "my: low"])) == "my_ low.png.imprint.json"
    assert record_of(in_scene(folder, ["--low", "lo"], output="m.<UDIM>.png")) == "m._UDIM_.png.imprint.json"


def test_bakes_of_several_objects_have_records_of_their_own(folder):
    (folder / "in" / "two.blend").touch()
    other = [str(folder / "in" / "two.blend"), "--pairs", "--output", str(folder / "out" / "{low}.png")]
    found = [record_of(in_scene(folder, ["--pairs"])), record_of(Plan("", arguments.parse(other)))]
    assert len(set(found)) == 2
    assert all(name.startswith("{low}.png.") and name.endswith(".imprint.json") for name in found)
    there = moved(folder)
    assert record_of(in_scene(there, ["--pairs"], "--size", "64")) == found[0]


def test_bakes_that_differ_by_the_cage_alone_are_two(folder):
    """And one that is done does not leave out the other one, also where both would write the same map."""
    parts = ["--low", "a", "--high", "b"]
    planned = [
        replace(in_scene(folder, parts, "--cage", cage, output=f"{place}/{{low}}.png"), name=cage)
        for place, cage in (("here", "tight"), ("here", "wide"), ("there", "wide"))
    ]
    for more in ({}, {"records": str(folder / "records")}):
        names = [records.record_path(each.options, more.get("records")) for each in planned]
        assert len(set(names)) == (3 if more else 2)  # beside a map there is one
        keys = [key(each) for each in planned]
        assert keys[0] != keys[1] == keys[2]  # which folder does not count
        assert list(run([planned[0]], **more)) == ["tight"]
        assert why(planned[0], **more) == "" and why(planned[1], **more) != ""


def test_sequences_of_one_path_have_records_of_their_own(folder):
    found = [
        record_of(in_scene(folder, ["--low", "a", "--frames", each], output="m_##.png")) for each in ("1-3", "4-6")
    ]
    assert len(set(found)) == 2
    assert all(name.startswith("m_##.png.") and name.endswith(".imprint.json") for name in found)


def test_a_record_with_a_long_name_can_be_written(folder):
    output = "ä" * 120 + ".png"
    run([plan(folder, output=output)])
    assert why(plan(folder, output=output)) == ""


def test_a_record_says_what_was_baked(folder):
    run([plan(folder)])
    values = json.loads((folder / "out" / "a_low.png.imprint.json").read_text())
    assert values["imprint_record"] == 1
    assert (values["name"], values["blender"], values["result"]["name"]) == ("a", "5.2.3", "a")
    assert values["key"] == key(plan(folder))
    assert [(each["path"], each["what"], each["bytes"]) for each in values["declared"]] == [
        ("../in/a_low.ply", "the low mesh's file", 5),
        ("../in/a_high.ply", "the high mesh's file", 6),
    ]
    assert [(each["path"], each["bytes"], len(each["sha256"])) for each in values["files"]] == [("a.png", 8, 64)]


def test_a_record_without_a_whole_entry_cannot_be_read(folder):
    run([plan(folder)])
    path = folder / "out" / "a_low.png.imprint.json"
    values = json.loads(path.read_text())
    del values["result"]["reports"]
    path.write_text(json.dumps(values))
    assert why(plan(folder)) == "Its record cannot be read."


def test_a_file_that_changed_during_the_bake_leaves_no_record(folder):
    with ResumeQueue([plan(folder)]) as left:
        turn = left.next()
        (folder / "in" / "a_high.ply").write_text("saved meanwhile")
        with pytest.raises(BakeError, match="'.*a_high.ply' was changed during the bake"):
            bake(turn)
    assert os.listdir(folder / "out") == ["a.png"]
    assert why(plan(folder)) == "It has not been baked."


def test_a_bake_that_saves_over_its_file_has_a_record_and_is_done_again(folder):
    scene = str(folder / "in" / "scene.blend")
    planned = in_scene(folder, ["--low", "lo"], "--save-blend", scene)
    with ResumeQueue([planned]) as left:
        turn = left.next()
        Path(scene).write_text("saved")
        records.write_record(turn, entry(turn, scene), [], Contents())
    assert why(planned) == "The file to open has changed: 'scene.blend'."


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"imprint_record": 2}', "[" * 100_000, "\0", '{"imprint_record": 1}']
)
def test_a_record_that_is_none_is_no_error(folder, text):
    run([plan(folder)])
    (folder / "out" / "a_low.png.imprint.json").write_text(text)
    assert why(plan(folder)) == "Its record cannot be read."


def test_records_with_parts_missing_or_of_another_kind_are_no_error(folder):
    run([plan(folder)])
    path = folder / "out" / "a_low.png.imprint.json"
    values, seed = json.loads(path.read_text()), random.Random(17)
    for name in values:
        for other in (None, 3, "x", [], {}, [None], [{}], {"a": [1]}):
            path.write_text(json.dumps({**values, name: other}))
            why(plan(folder))
        path.write_text(json.dumps({key: value for key, value in values.items() if key != name}))
        assert why(plan(folder)) == ("" if name == "name" else "Its record cannot be read.")
    text = json.dumps(values)
    for _ in range(50):
        start = seed.randrange(len(text))
        path.write_text(text[:start] + seed.choice('{}[]",:0x') + text[start + seed.randrange(4) :])
        why(plan(folder))


# Several processes


def test_who_finds_a_claim_does_its_other_bakes_first_and_then_takes_the_result(folder, monkeypatch):
    monkeypatch.setattr(turns_module, "POLL", 0.0)
    planned = [plan(folder, "a"), plan(folder, "b")]
    with ResumeQueue(planned) as first, ResumeQueue(planned) as second:
        mine, its = first.next(), second.next()
        assert (mine.plan.name, its.plan.name) == ("a", "b")
        assert first.next() is None
        assert first.count
        bake(its)
        second.release(its.plan.number)
        found = first.next()
        assert (found.name, found.state) == ("b", State.RESUMED)
        bake(mine)
        first.release(mine.plan.number)
        assert isinstance(second.next(), Entry)
        assert first.count == second.count == 0


def test_what_fails_elsewhere_is_tried_here(folder, monkeypatch):
    monkeypatch.setattr(turns_module, "POLL", 0.0)
    with ResumeQueue([plan(folder)]) as first, ResumeQueue([plan(folder)]) as second:
        turn = first.next()
        assert second.next() is None
        first.release(turn.plan.number)
        assert second.next().plan.name == "a"


def test_claims_of_others_are_looked_at_now_and_then(folder):
    clock = Clock()
    with ResumeQueue([plan(folder)]) as first, ResumeQueue([plan(folder)], clock=clock) as second:
        turn = first.next()
        assert second.next() is None
        first.release(turn.plan.number)
        assert second.next() is None
        clock.now += POLL
        assert second.next().plan.name == "a"


def test_a_run_that_is_stopped_returns_no_more(folder):
    for turns in (ResumeQueue([plan(folder)]), WorkQueue([plan(folder)])):
        with turns:
            assert turns.count == 1
            turns.stop()
            assert turns.count == 0


def test_a_run_without_records_does_all_in_order(folder):
    bad = replace(plan(folder, "b"), problem="Two files share a name.")
    with WorkQueue([plan(folder, "a"), bad]) as turns:
        first, second = turns.next(), turns.next()
        turns.release(first.plan.number)
        assert first == Assignment(plan(folder, "a"))
        assert second == Assignment(bad, "Two files share a name.")
        assert (turns.count, turns.done) == (0, [])
    assert not (folder / "out").exists()


def test_two_that_do_all_again_do_each_bake_once(folder):
    run([plan(folder)])
    with ResumeQueue([plan(folder)], is_forced=True) as first, ResumeQueue([plan(folder)], is_forced=True) as second:
        turn = first.next()
        bake(turn)
        first.release(turn.plan.number)
        assert isinstance(second.next(), Entry)


WORK = """
import json, random, sys, time
sys.path.insert(0, {root!r})
from tests.pure import test_resuming as own
own.versions.blender = lambda: "5.2.3"
own.turns_module.POLL = 0.01
from pathlib import Path
folder, seed = Path(sys.argv[1]), random.Random(sys.argv[2])
planned = [own.plan(folder, f"n{{number}}") for number in range(25)]
print("ready", flush=True)
sys.stdin.readline()
with own.ResumeQueue(planned) as left:
    while left.count:
        turn = left.next()
        if turn is None:
            time.sleep(0.01)
        elif not isinstance(turn, own.Entry):
            time.sleep(seed.random() * 0.01)
            with (folder / "log").open("a") as log:
                log.write(turn.plan.name + "\\n")
            own.bake(turn)
            left.release(turn.plan.number)
"""


def workers(folder, count):
    for number in range(25):
        for part in ("low", "high"):
            (folder / "in" / f"n{number}_{part}.ply").write_text(f"{number} {part}")
    command = [sys.executable, "-c", WORK.format(root=str(ROOT)), str(folder)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "cwd": ROOT}
    found = [subprocess.Popen([*command, str(seed)], **pipes) for seed in range(count)]
    for process in found:
        assert process.stdout.readline() == "ready\n"
        process.stdin.write("\n")
        process.stdin.flush()
    return found


@pytest.mark.slow
def test_processes_with_the_same_run_do_each_bake_once(folder):
    for process in workers(folder, 3):
        process.communicate()
        assert process.returncode == 0
    log = (folder / "log").read_text().split()
    assert sorted(log) == sorted(f"n{number}" for number in range(25))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_run_after_a_kill_does_what_is_left_and_what_was_cut_off(folder, seed):
    (process,) = workers(folder, 1)
    while not (folder / "log").exists():
        time.sleep(0.001)
    time.sleep(random.Random(seed).random() * 0.3)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    done = len(list((folder / "out").glob("*.imprint.json")))
    (process,) = workers(folder, 1)
    process.communicate(timeout=30)
    assert process.returncode == 0
    log = (folder / "log").read_text().split()
    assert len(set(log)) == 25
    assert 25 <= len(log) <= 26  # the one that was cut off
    assert len(log) - len(set(log)) <= 1 and done <= 25
    expected = sorted(name for number in range(25) for name in (f"n{number}.png", f"n{number}_low.png.imprint.json"))
    assert sorted(os.listdir(folder / "out")) == expected


def test_the_claim_of_a_process_that_was_killed_after_its_record_is_removed(folder):
    run([plan(folder)])
    lock = folder / "out" / f"a_low.png.imprint.json{records.CLAIM}"
    lock.write_text(json.dumps({"machine": atomic_file.machine()}))
    assert why(plan(folder)) == ""
    assert not lock.exists()


def test_claims_are_given_up_at_the_end(folder):
    with ResumeQueue([plan(folder)], claims=Claims()) as left:
        left.next()
        assert list((folder / "out").iterdir()) == [folder / "out" / f"a_low.png.imprint.json{records.CLAIM}"]
    assert not (folder / "out").exists()


# Chains


def chain(folder):
    """Three bakes of a chain, and one beside it."""
    plans = [
        replace(plan(folder, "a", output=f"{number}.png"), name=f"c{number}", number=number) for number in (1, 2, 3)
    ]
    return [*(replace(each, chain=1) for each in plans), plan(folder, "b")]


def test_a_chain_is_done_together(folder):
    planned = chain(folder)
    assert list(run(planned)) == ["c1", "c2", "c3", "b"]
    assert run(planned) == {}
    (folder / "out" / "2.png").unlink()
    found = run(planned)
    assert list(found) == ["c1", "c2", "c3"]
    assert found["c1"] == "Another bake of this scene has to run before the scene is saved."


def test_a_chain_has_one_claim_until_its_last_bake(folder):
    planned = chain(folder)
    with ResumeQueue(planned) as here, ResumeQueue(planned) as there:
        first = here.next()
        assert first.plan.number == 1
        assert there.next().plan.name == "b"
        assert there.next() is None
        bake(first)
        here.release(1)
        assert there.next(()) is None
        for number in (2, 3):
            turn = here.next()
            assert turn.plan.number == number
            bake(turn)
            here.release(number)
        there._ask_at = 0.0
        assert [(turn.number, turn.state) for turn in (there.next(), there.next(), there.next())] == [
            (number, State.RESUMED) for number in (1, 2, 3)
        ]
    assert not list(folder.rglob("*.lock"))


def test_a_chain_keeps_its_claim_if_the_next_bake_begins_before_the_last_one_is_released(folder):
    planned = chain(folder)
    with ResumeQueue(planned) as here, ResumeQueue(planned) as there:
        for number in (1, 2, 3):
            bake(here.next())
            here.release(number - 1)
        assert here.next().plan.name == "b"
        assert there.next() is None
        here.release(3)
        there._ask_at = 0.0
        assert there.next().number == 1


def test_a_chain_of_another_worker_waits(folder):
    planned = chain(folder)
    for turns in (WorkQueue(planned), ResumeQueue(planned)):
        with turns:
            assert turns.next().plan.number == 1
            assert turns.next({1}).plan.name == "b"
            assert turns.next({1}) is None
            assert [turns.next().plan.number for _ in range(2)] == [2, 3]
