# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that paths clash exactly if they lead to the same file, as file systems compare them."""

import sys
import unicodedata

import pytest

from addon.core.errors import WrongPlace
from addon.output.path_clashes import Places
from tests.support import clashes
from tests.support.deep_paths import DEEP, few_calls


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """The working folder: in/ with meshes, and an empty out/."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in" / "deep").mkdir(parents=True)
    (tmp_path / "out").mkdir()
    for name in ("a.obj", "skin.1001.png", "skin_0002.png", "é.obj"):
        (tmp_path / "in" / name).write_text(name)
    return tmp_path


SAME = {
    "itself": ("in/a.obj", "in/a.obj"),
    "a dot": ("in/a.obj", "./in/./a.obj"),
    "two dots": ("in/a.obj", "out/../in/a.obj"),
    "two dots below what is not there": ("in/a.obj", "none/../in/a.obj"),
    "slashes": ("in/a.obj", "in///a.obj"),
    "whole": ("in/a.obj", "{here}/in/a.obj"),
    "other letters": ("in/a.obj", "in/A.OBJ"),
    "other letters of what is not there": ("out/r.json", "out/R.json"),
    "other letters of a folder that is not there": ("new/r.json", "New/r.json"),
    "letters of two parts": ("in/é.obj", f"in/{unicodedata.normalize('NFD', 'é')}.obj"),
    "a slash at the end": ("in/a.obj", "in/a.obj/"),
    "a tile": ("in/skin.1001.png", "in/skin.<UDIM>.png"),
    "tiles": ("in/skin.<UDIM>.png", "in/skin.<UDIM>.png"),
    "one of tiles": ("in/skin.<UDIM>.png", "in/skin.1001.png"),
}
OTHER = {
    "other names": ("in/a.obj", "in/b.obj"),
    "other folders": ("in/a.obj", "out/a.obj"),
    "folders that are not there": ("x/a.obj", "y/a.obj"),
    "other endings": ("in/a.obj", "in/a.ob"),
    "no tile": ("in/skin_0002.png", "in/skin_<UDIM>.png"),
    "other tiles": ("in/skin.1001.png", "in/skin.1002.png"),
    "tiles of others": ("in/skin.1001.png", "in/skin2.<UDIM>.png"),
}


@pytest.mark.parametrize("case", SAME)
def test_reading_and_writing_or_writing_twice_is_a_clash(tree, case):
    one, other = (path.replace("{here}", str(tree)) for path in SAME[case])
    clashes.check_same(one, other)


@pytest.mark.parametrize("case", OTHER)
def test_different_files_do_not_clash(tree, case):
    one, other = OTHER[case]
    for first, second in ((one, other), (other, one)):
        places = Places()
        places.read(first, "the mesh")
        places.write(second, "the map")
        places = Places()
        places.write(first, "the report")
        places.write(second, "the map")


def test_reading_a_file_twice_is_no_clash(tree):
    places = Places()
    for path in ("in/a.obj", "./in/a.obj", "in/A.OBJ"):
        places.read(path, "the mesh")


def test_a_file_cannot_be_the_folder_of_another(tree):
    for first, second in (("new/x", "new/x/r.json"), ("new/x/y/r.json", "new/X")):
        places = Places()
        places.write(first, "the map")
        with pytest.raises(WrongPlace, match="one is a folder"):
            places.write(second, "the report")
    places.write("new/y", "another")


def test_paths_of_many_folders_are_compared(tree):
    with few_calls():
        clashes.check_same(f"{DEEP}/a.png", f"{DEEP.upper()}/a.png")
        places = Places()
        places.write(f"{DEEP}/a.png", "the map")
        places.write(f"{DEEP}/b.png", "the mask")
        with pytest.raises(WrongPlace, match="one is a folder"):
            places.write(f"{DEEP[:101]}", "the report")


def test_a_path_that_is_too_long_for_the_system_is_compared(tree):
    clashes.check_same("d/" * 5_000 + "a.png", "d/" * 5_000 + "a.png")


def test_only_permitted_outputs_replace_inputs(tree):
    places = Places()
    places.read("in/a.obj", "the scene", "set 1")
    places.write("out/../in/a.obj", "the scene", may_replace="set 1")
    places = Places()
    places.read("in/a.obj", "the scene", "set 1")
    places.read("in/a.obj", "the scene", "set 2")
    with pytest.raises(WrongPlace):
        places.write("in/a.obj", "the scene", may_replace="set 1")


def test_folders_and_names_of_partial_files_are_refused(tree):
    with pytest.raises(WrongPlace, match="is a folder"):
        Places().write("in", "the report")
    with pytest.raises(WrongPlace, match="temporary files"):
        Places().read("in/.imprint.1.2.partial.obj", "the mesh")


def test_cost_grows_linearly_with_the_number_of_paths(tree):
    """Counts calls instead of measuring time."""

    def calls(count):
        found = 0

        def profile(_frame, event, _argument):
            nonlocal found
            found += event in ("call", "c_call")

        places = Places()
        sys.setprofile(profile)
        try:
            for number in range(count):
                places.read(f"in/{number}.obj", "a mesh")
                places.write(f"out/new/{number}.<UDIM>.png", "a map")
        finally:
            sys.setprofile(None)
        return found

    assert calls(400) < 4.5 * calls(100)


@pytest.mark.parametrize(
    ("other", "count"), [("{here}/out/m.png", 1), ("./out/m.png", 1), ("in/../out/m.png", 1), ("out/M.png", 2)]
)
def test_a_message_names_both_paths_only_if_they_differ(tree, other, count):
    places = Places()
    places.write("out/m.png", "the map")
    with pytest.raises(WrongPlace) as refused:
        places.write(other.format(here=tree), "the report")
    assert str(refused.value).lower().count("m.png'") == count
