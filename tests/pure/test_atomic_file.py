# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests atomic replacement of files: links are kept, folders created and removed, other paths refused, changes undone."""

import os

import pytest

from addon.cli import many_bakes, run_report
from addon.cli.run_report import Entry, ReportFile
from addon.cli.sheet import SheetFile
from addon.core.errors import BakeError
from addon.output import atomic_file
from addon.output.atomic_file import Partial, Replaced, all_or_none, check_writable, make_folder, replacing
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
