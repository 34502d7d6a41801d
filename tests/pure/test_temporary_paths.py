# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests temporary files: each process has its own, and those of ended processes are removed."""

import os
from pathlib import Path

import pytest

from addon.output import atomic_file
from addon.output.atomic_file import Partial


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
