# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the pages that runs write, with real bakes: each bake has its picture, wherever it was done and when."""

import base64
import io
import json
import re
import tempfile
from pathlib import Path

import bpy
import numpy as np
import pytest
from PIL import Image

from addon.audit.pictures import PICTURE_SIDE
from addon.cli import command
from addon.cli.baker import MOST_PICTURES
from addon.cli.sheet import SheetFile
from addon.core.errors import BakeError
from tests.support import reports, scenes, zoo

COUNT = 3


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with a job file of COUNT bakes of other slopes, and one that fails."""
    monkeypatch.chdir(tmp_path)
    scenes.plane_files(tmp_path, low=0.0, **{f"high{number}": 0.2 * number for number in range(COUNT)})
    sets = [
        {"low-file": "low.obj", "high-file": f"high{number}.obj", "output": f"m{number}.png"} for number in range(COUNT)
    ]
    sets.append({"low-file": "none.obj", "high-file": "low.obj", "output": "none.png"})
    (tmp_path / "j.json").write_text(json.dumps({"defaults": {"size": 32, "limit": 9}, "bake": sets}))
    return tmp_path


def run(*words, is_apart=False):
    return command.run(list(words), may_start_processes=is_apart)


def images(page):
    """The PNG files in a page, by the names of the bakes."""
    found = re.findall(r'src="data:image/png;base64,([^"]*)" alt="([^"]*): map', page.read_text(encoding="utf-8"))
    return {name: base64.b64decode(data) for data, name in found}


@pytest.mark.slow
def test_each_bake_has_its_picture_also_from_another_process(folder):
    assert run("--jobs", "j.json", "--sheet", "here.html", "--workers", "0") == 1
    assert run("--jobs", "j.json", "--sheet", "apart.html", "--workers", "2", is_apart=True) == 1
    here = images(folder / "here.html")
    assert list(here) == [f"set {number + 1} (low)" for number in range(COUNT)]
    assert images(folder / "apart.html") == here
    shown = [np.array(Image.open(io.BytesIO(data))) for data in here.values()]
    assert [each.shape for each in shown] == [(PICTURE_SIDE, 3 * PICTURE_SIDE, 3)] * COUNT
    middle = [each[PICTURE_SIDE // 2, PICTURE_SIDE // 2].tolist() for each in shown]
    assert middle[0][2] == 255 and middle[0][0] == 128
    assert middle[0][0] > middle[1][0] > middle[2][0]  # the highs lean to the left
    assert not list(folder.glob("*.lines")) and sorted(path.suffix for path in folder.glob("m*")) == [".png"] * COUNT


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device that is always full")
def test_a_page_on_a_full_disk_fails_with_one_sentence(folder, monkeypatch, capsys):
    monkeypatch.setattr(tempfile, "TemporaryFile", lambda **_: open("/dev/full", "w+b"))  # noqa: SIM115
    assert run("--jobs", "j.json", "--only", "set 4*", "--report", "r.json", "--sheet", "s.html") == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == f"imprint: {str(folder / 's.html')!r} could not be written: No space left on device."
    assert [each["number"] for each in reports.bakes(folder / "r.json")] == [4]


def test_a_later_run_finds_the_pictures_of_bakes_that_are_done(folder):
    words = "--jobs", "j.json", "--pictures", "pictures", "--report", "r.json"
    assert run(*words, "--resume") == 1
    assert len(list((folder / "pictures").iterdir())) == COUNT
    paths = [each["picture"] for each in reports.bakes(folder / "r.json")]
    assert [bool(path) for path in paths] == [True] * COUNT + [False]
    (folder / "m1.png").unlink()
    assert run(*words, "--resume", "--sheet", "s.html") == 1
    found = sorted(reports.bakes(folder / "r.json"), key=lambda each: each["number"])
    assert [each["state"] for each in found] == ["resumed", "done", "resumed", "failed"]
    assert [each["picture"] for each in found] == paths
    assert len(images(folder / "s.html")) == COUNT
    assert run("report", "--sheet", "again.html", "r.json") == 1
    assert images(folder / "again.html") == images(folder / "s.html")


@pytest.mark.parametrize("is_gone", [True, False])
def test_a_picture_that_a_run_kept_counts(folder, is_gone):
    words = "--jobs", "j.json", "--only", "set 2*", "--resume", "--report", "r.json"
    pictures = "--pictures", "pictures"
    assert run(*words, *pictures) == 0
    (path,) = (folder / "pictures").iterdir()
    before = path.read_bytes()
    path.unlink() if is_gone else path.write_bytes(b"junk")
    assert run(*words) == 0  # which keeps no pictures
    assert reports.bake(folder / "r.json")["state"] == "resumed"
    assert run(*words, *pictures) == 0
    assert reports.bake(folder / "r.json")["state"] == "done"
    assert path.read_bytes() == before
    assert run(*words, *pictures) == 0
    assert reports.bake(folder / "r.json")["state"] == "resumed"


def test_a_single_bake_has_a_page(folder):
    words = "--low-file", "low.obj", "--high-file", "high1.obj", "--output", "one.png", "--size", "32", "--limit", "9"
    assert run(*words, "--sheet", "s.html", "--report", "r.json") == 0
    assert list(images(folder / "s.html")) == ["low"]
    assert reports.bake(folder / "r.json")["picture"] == ""


@pytest.mark.slow
def test_untrusted_bakes_have_pictures(folder):
    assert run("--jobs", "j.json", "--untrusted", "--pictures", "../pictures", "--only", "set 2*") == 2
    words = (
        "--low-file",
        "low.obj",
        "--high-file",
        "high1.obj",
        "--output",
        "out/one.png",
        "--size",
        "32",
        "--limit",
        "9",
    )
    assert run(*words, "--untrusted", "--sheet", "s.html", is_apart=True) == 0
    assert len(images(folder / "s.html")) == 1


def test_a_page_does_not_replace_what_is_read(folder, capsys):
    (folder / "high1.obj").rename(folder / "high1.html")
    (folder / "high1.obj").symlink_to("high1.html")
    before = (folder / "high1.html").read_bytes()
    assert run("--jobs", "j.json", "--sheet", "high1.html") == 2
    assert (folder / "high1.html").read_bytes() == before
    assert "The page of results would overwrite" in capsys.readouterr().err


def test_a_page_has_the_ending_of_one(folder, capsys):
    assert run("--jobs", "j.json", "--sheet", "s.pdf") == 2
    assert "argument --sheet: 's.pdf' does not end in .html" in capsys.readouterr().err
    assert run("report", "--sheet", "s.pdf", "r.json") == 2
    assert "'s.pdf' does not end in .html" in capsys.readouterr().err


def test_a_folder_that_cannot_be_made_is_an_error_before_the_bakes(folder, capsys):
    (folder / "file").touch()
    assert run("--jobs", "j.json", "--pictures", "file/pictures") == 2
    assert "--pictures: no files can be written to 'file/pictures'" in capsys.readouterr().err
    assert not list(folder.glob("m*.png"))


def test_a_run_without_a_page_measures_no_deviations(folder):
    assert run("--jobs", "j.json", "--report", "r.json") == 1
    assert [each["reports"][0]["deviation"] for each in reports.bakes(folder / "r.json")[:COUNT]] == [{}] * COUNT


def test_another_map_of_the_same_bake_has_another_picture(folder):
    words = "--jobs", "j.json", "--only", "set 2*", "--pictures", "pictures"
    assert run(*words) == 0
    assert run(*words, "--limit", "9", "--size", "64") == 0
    assert len(list((folder / "pictures").iterdir())) == 2


def test_a_picture_that_cannot_be_written_is_a_warning(folder, capsys):
    words = "--jobs", "j.json", "--only", "set 2*", "--pictures", "pictures", "--sheet", "s.html"
    assert run(*words) == 0
    before = images(folder / "s.html")
    (picture,) = (folder / "pictures").iterdir()
    picture.unlink()
    picture.mkdir()
    assert run(*words) == 0
    assert "warning" in capsys.readouterr().err
    assert images(folder / "s.html") == before


def test_of_many_pairs_the_first_few_are_shown(folder):
    for number in range(6):
        for name in ("low", "high"):
            zoo.plane(f"p{number}_{name}")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "s.blend"))
    words = "s.blend", "--pairs", "--output", "{low}.png", "--size", "16", "--limit", "9", "--sheet", "s.html"
    assert run(*words) == 0
    (data,) = images(folder / "s.html").values()
    assert Image.open(io.BytesIO(data)).size == (3 * PICTURE_SIDE, MOST_PICTURES * PICTURE_SIDE)


def test_each_texture_set_has_a_picture(folder):
    low = zoo.plane("low")
    for name in "ab":
        low.data.materials.append(bpy.data.materials.new(name))
    low.data.polygons[0].material_index = 1
    zoo.plane("high")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "s.blend"))
    words = "s.blend", "--low", "low", "--high", "high", "--output", "{material}.png", "--size", "16", "--limit", "9"
    assert run(*words, "--texture-sets", "--sheet", "s.html", "--report", "r.json") == 0
    (data,) = images(folder / "s.html").values()
    count = len(reports.bake(folder / "r.json")["reports"])
    assert Image.open(io.BytesIO(data)).size == (3 * PICTURE_SIDE, count * PICTURE_SIDE)


def test_a_page_that_cannot_be_written_at_the_end_costs_no_report(folder, capsys, monkeypatch):
    def fail(self):
        raise BakeError("The page could not be written.")

    monkeypatch.setattr(SheetFile, "finish", fail)
    assert run("--jobs", "j.json", "--only", "set 2*", "--sheet", "s.html", "--report", "r.json") == 1
    assert [each["state"] for each in reports.bakes(folder / "r.json")] == ["done"]
    assert "The page could not be written." in capsys.readouterr().err
