# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests atomic replacement of files: links are kept, folders created and removed, other paths refused, changes undone."""

import os
import sys
import unicodedata
from pathlib import Path

import pytest

from addon.cli import many_bakes, run_report
from addon.cli.run_report import Entry, ReportFile
from addon.cli.sheet import SheetFile
from addon.core.errors import BakeError, WrongPlace
from addon.output import atomic_file
from addon.output.atomic_file import Partial, Replaced, all_or_none, check_writable, make_folder, replacing
from addon.output.path_clashes import Places
from tests.support import clashes
from tests.support.deep_paths import DEEP, few_calls


def tree(folder):
    """Every path below `folder`, with the contents of files."""
    return {path.relative_to(folder).as_posix(): path.is_file() and path.read_text() for path in folder.rglob("*")}


def write(path, text="new"):
    with replacing(path) as partial:
        partial.write_text(text)


def test_missing_folders_are_created_when_the_file_is_stored(tmp_path):
    path = tmp_path / "a" / "b" / "map.png"
    check_writable(path)
    assert os.listdir(tmp_path) == []
    write(path)
    assert tree(tmp_path) == {"a": False, "a/b": False, "a/b/map.png": "new"}


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("No such file or directory", "Blender could not write all of it, as on a full disk"),
        (
            "Failed to write blendfile: No such file or directory",
            "Blender could not write all of it, as on a full disk",
        ),
        ("Failed to write blendfile", "Blender could not write all of it, as on a full disk"),
        (
            "Cannot open file a.blend@ for writing: Is a directory",
            "Cannot open file a.blend@ for writing: Is a directory",
        ),
        ("Failed to write blendfile: of the moon", "Failed to write blendfile: of the moon"),
    ],
)
def test_errors_of_blender_are_shown_unless_they_are_the_last_error_of_the_system(tmp_path, said, shown):
    partial = Partial(tmp_path / "a.blend")
    with pytest.raises(BakeError) as error, partial.writing():
        raise RuntimeError(f"Error: {said}\n")
    assert str(error.value) == f"{str(tmp_path / 'a.blend')!r} could not be written: {shown}."


@pytest.mark.parametrize("first", [0, 1])
def test_new_folders_are_removed_if_all_files_in_them_fail(tmp_path, first):
    def partials():
        result = [Partial(tmp_path / "a" / "b" / name) for name in ("1.png", "2.png")]
        for partial in result:
            with partial.writing():
                partial.temporary.write_text("x")
        return result[first], result[1 - first]

    earlier, later = partials()
    earlier.discard()
    assert (tmp_path / "a" / "b").is_dir()
    later.discard()
    assert os.listdir(tmp_path) == []
    earlier, later = partials()
    earlier.commit()
    later.discard()
    earlier.discard()
    assert len(tree(tmp_path)) == 3


def test_many_folders_are_made(tmp_path):
    with few_calls():
        made = make_folder(tmp_path / DEEP)
    assert (len(made), made[-1]) == (250, tmp_path / DEEP)
    assert make_folder(tmp_path / DEEP) == []
    with few_calls():
        many_bakes._prepare_folder("--log", str(tmp_path / "log" / DEEP))
        for path in (tmp_path / "report" / DEEP / "r.json", tmp_path / "page" / DEEP / "s.html"):
            file = (
                ReportFile(path, run_report.head(1)) if path.suffix == ".json" else SheetFile(path, run_report.head(1))
            )
            file.add(Entry(1, "a"))
            file.finish()
            assert path.is_file()


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "a").touch()
    with pytest.raises(NotADirectoryError):
        make_folder(tmp_path / "a")


def test_existing_folders_are_kept(tmp_path):
    (tmp_path / "a").mkdir()
    with pytest.raises(BakeError), replacing(tmp_path / "a" / "b" / "map.png"):
        raise OSError("full")
    assert tree(tmp_path) == {"a": False}


class Stop(Exception):
    """An exception that no code expects."""


@pytest.mark.parametrize("can_link", [True, False])
def test_replaced_files_are_restored_after_an_error(tmp_path, monkeypatch, can_link):
    def fail(*_):
        raise OSError("no hard links here")

    if not can_link:
        monkeypatch.setattr(os, "link", fail)
    (tmp_path / "old.png").write_text("old")
    before = tree(tmp_path)

    def replace_all(end):
        with Replaced() as replaced:
            write(tmp_path / "old.png")
            write(tmp_path / "a" / "b" / "new.png")
            with replaced.restoring():
                write(tmp_path / "old.png", "newer")
                write(tmp_path / "a" / "report.json")
                end()

    with pytest.raises(Stop):
        replace_all(lambda: (_ for _ in ()).throw(Stop()))
    assert tree(tmp_path) == before
    replace_all(lambda: None)
    assert tree(tmp_path) == {
        "old.png": "newer",
        "a": False,
        "a/b": False,
        "a/b/new.png": "new",
        "a/report.json": "new",
    }


def test_completed_files_are_kept_when_a_later_one_fails(tmp_path):
    """This keeps the finished frames of a sequence, and the finished pairs of a batch."""
    with pytest.raises(Stop), Replaced():
        write(tmp_path / "1.png")
        raise Stop
    assert tree(tmp_path) == {"1.png": "new"}


def test_a_file_that_cannot_be_restored_is_reported_and_its_copy_kept(tmp_path, monkeypatch):
    (tmp_path / "a.png").write_text("old")
    (tmp_path / "b.png").write_text("old")
    real = os.replace

    def fail(source, target):
        if os.path.basename(target) == "a.png" and source.read_text() == "old":
            raise OSError(5, "Input/output error")
        real(source, target)

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(BakeError, match="could not be restored") as error, Replaced() as replaced:
        write(tmp_path / "a.png")
        write(tmp_path / "b.png")
        with replaced.restoring():
            raise Stop
    assert (tmp_path / "b.png").read_text() == "old"
    (kept,) = (path for path in tmp_path.iterdir() if path.name not in {"a.png", "b.png"})
    assert str(kept) in str(error.value)
    assert kept.read_text() == "old"


@pytest.mark.parametrize("can_link", [True, False])
def test_all_files_are_replaced_or_none(tmp_path, monkeypatch, can_link):
    real = os.replace

    def fail(source, target):
        if target.name == "c.png":
            raise OSError(13, "Permission denied")
        real(source, target)

    def refuse(*_):
        raise OSError("no hard links here")

    for name in ("a.png", "c.png"):
        (tmp_path / name).write_text(f"old {name}")
    before = tree(tmp_path)
    monkeypatch.setattr(os, "replace", fail)
    if not can_link:
        monkeypatch.setattr(os, "link", refuse)
    with pytest.raises(BakeError, match="Permission denied"), Replaced(), all_or_none():
        for name in ("a.png", "b.png", "c.png"):
            write(tmp_path / name)
    assert tree(tmp_path) == before


def test_an_outer_block_can_undo_files_that_were_replaced_together(tmp_path):
    (tmp_path / "a.png").write_text("old")
    with pytest.raises(Stop), Replaced() as replaced:
        with all_or_none():
            write(tmp_path / "a.png")
            write(tmp_path / "b.png")
        assert tree(tmp_path)["a.png"] == "new"
        with replaced.restoring():
            raise Stop
    assert tree(tmp_path) == {"a.png": "old"}


def test_blocks_that_have_ended_are_not_restored_at_the_end(tmp_path):
    for name, error in (("a", None), ("b", Stop)):
        try:
            with all_or_none():
                write(tmp_path / name)
                if error:
                    raise error
        except Stop:
            pass
    atomic_file.leave()
    assert tree(tmp_path) == {"a": "new"}


# Temporary paths


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_partial_file_is_hidden_and_in_the_folder_of_its_target(tmp_path):
    partial = Partial(tmp_path / "map.png")
    assert partial.temporary.parent == tmp_path
    assert partial.temporary.name.startswith(".imprint.")
    assert partial.temporary.suffix == ".png"
    partial.discard()
    assert names(tmp_path) == []


def test_processes_with_the_same_id_have_different_files(tmp_path, monkeypatch):
    """In two containers, both can be process 1."""
    monkeypatch.setattr(os, "getpid", lambda: 1)
    both = [Partial(tmp_path / "map.png") for _ in range(2)]
    for text, partial in zip("ab", both, strict=True):
        partial.temporary.write_text(text)
    for text, partial in zip("ab", both, strict=True):
        partial.commit()
        assert (tmp_path / "map.png").read_text() == text
    assert names(tmp_path) == ["map.png"]


def test_a_name_is_never_shared(tmp_path, monkeypatch):
    monkeypatch.setattr(atomic_file.secrets, "token_hex", lambda _: "same")
    first, second = Partial(tmp_path / "map.png"), Partial(tmp_path / "map.png")
    first.temporary.write_text("whole")
    with pytest.raises(FileExistsError):
        second.temporary  # noqa: B018 - reading the attribute reserves the path
    second.discard()
    first.commit()
    assert names(tmp_path) == ["map.png"]


def test_other_files_are_not_removed(tmp_path):
    for name in (".imprint.toml", ".imprint.partial.png", "imprint.1.2.partial.png", ".other.1.2.partial.png", "a.png"):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (0, 0))
    before = names(tmp_path)
    atomic_file.sweep(tmp_path)
    assert names(tmp_path) == before


def test_a_process_that_exits_at_once_leaves_no_files(tmp_path):
    partial = Partial(tmp_path / "map.png")
    partial.temporary.write_text("half")
    atomic_file.remove_all()
    assert names(tmp_path) == []


def test_files_that_cannot_be_removed_raise_no_error(tmp_path, monkeypatch):
    """The folder may have become read-only, or a network share may be gone."""
    first, second = Partial(tmp_path / "a.png"), Partial(tmp_path / "b.png")
    for partial in (first, second):
        partial.temporary.write_text("half")

    def refuses(*_, **__):
        raise PermissionError

    with monkeypatch.context() as folder:
        folder.setattr(Path, "unlink", refuses)
        first.discard()
        atomic_file.remove_all()
    atomic_file.sweep(tmp_path)  # their process still runs, but has unlocked them
    assert names(tmp_path) == []


def test_partial_files_of_blender_are_removed_as_well(tmp_path):
    partial = Partial(tmp_path / "scene.blend")
    for path in (partial.temporary, partial.temporary.with_name(f"{partial.temporary.name}@")):
        path.write_text("half")
    partial.discard()
    assert names(tmp_path) == []


# Path clashes


@pytest.fixture
def tree_of(tmp_path, monkeypatch):
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
def test_reading_and_writing_or_writing_twice_is_a_clash(tree_of, case):
    one, other = (path.replace("{here}", str(tree_of)) for path in SAME[case])
    clashes.check_same(one, other)


@pytest.mark.parametrize("case", OTHER)
def test_different_files_do_not_clash(tree_of, case):
    one, other = OTHER[case]
    for first, second in ((one, other), (other, one)):
        places = Places()
        places.read(first, "the mesh")
        places.write(second, "the map")
        places = Places()
        places.write(first, "the report")
        places.write(second, "the map")


def test_reading_a_file_twice_is_no_clash(tree_of):
    places = Places()
    for path in ("in/a.obj", "./in/a.obj", "in/A.OBJ"):
        places.read(path, "the mesh")


def test_a_file_cannot_be_the_folder_of_another(tree_of):
    for first, second in (("new/x", "new/x/r.json"), ("new/x/y/r.json", "new/X")):
        places = Places()
        places.write(first, "the map")
        with pytest.raises(WrongPlace, match="one is a folder"):
            places.write(second, "the report")
    places.write("new/y", "another")


def test_paths_of_many_folders_are_compared(tree_of):
    with few_calls():
        clashes.check_same(f"{DEEP}/a.png", f"{DEEP.upper()}/a.png")
        places = Places()
        places.write(f"{DEEP}/a.png", "the map")
        places.write(f"{DEEP}/b.png", "the mask")
        with pytest.raises(WrongPlace, match="one is a folder"):
            places.write(f"{DEEP[:101]}", "the report")


def test_a_path_that_is_too_long_for_the_system_is_compared(tree_of):
    clashes.check_same("d/" * 5_000 + "a.png", "d/" * 5_000 + "a.png")


def test_only_permitted_outputs_replace_inputs(tree_of):
    places = Places()
    places.read("in/a.obj", "the scene", "set 1")
    places.write("out/../in/a.obj", "the scene", may_replace="set 1")
    places = Places()
    places.read("in/a.obj", "the scene", "set 1")
    places.read("in/a.obj", "the scene", "set 2")
    with pytest.raises(WrongPlace):
        places.write("in/a.obj", "the scene", may_replace="set 1")


def test_folders_and_names_of_partial_files_are_refused(tree_of):
    with pytest.raises(WrongPlace, match="is a folder"):
        Places().write("in", "the report")
    with pytest.raises(WrongPlace, match="temporary files"):
        Places().read("in/.imprint.1.2.partial.obj", "the mesh")


def test_cost_grows_linearly_with_the_number_of_paths(tree_of):
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
def test_a_message_names_both_paths_only_if_they_differ(tree_of, other, count):
    places = Places()
    places.write("out/m.png", "the map")
    with pytest.raises(WrongPlace) as refused:
        places.write(other.format(here=tree_of), "the report")
    assert str(refused.value).lower().count("m.png'") == count
