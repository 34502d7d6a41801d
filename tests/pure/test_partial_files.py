# SPDX-License-Identifier: GPL-3.0-or-later
"""Partial files: nobody shares one, and what dead writers left is swept."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from addon.core.errors import BakeError
from addon.output import partial_files
from addon.output.atomic_file import Partial, check_writable
from scripts.imprint import ROOT

posix = pytest.mark.skipif(os.name == "nt", reason="locks of POSIX")


def names(folder):
    return sorted(path.name for path in folder.iterdir())


WRITER = """
import sys
from pathlib import Path
from addon.output.atomic_file import Partial
partial = Partial(Path(sys.argv[1]))
partial.here.write_text("half")
partial.here.with_name(partial.here.name + "@").write_text("half")  # as Blender does with a .blend
print(flush=True)
sys.stdin.read()
"""


@pytest.fixture
def writer(tmp_path):
    """Another process that is writing map.blend in tmp_path."""
    program = [sys.executable, "-c", WRITER, str(tmp_path / "map.blend")]
    with subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT) as process:
        process.stdout.readline()
        yield process
        process.kill()


def test_a_partial_file_is_hidden_and_beside_its_target(tmp_path):
    partial = Partial(tmp_path / "map.png")
    assert partial.here.parent == tmp_path
    assert partial.here.name.startswith(".imprint.")
    assert partial.here.suffix == ".png"
    partial.discard()
    assert names(tmp_path) == []


def test_processes_with_one_number_have_files_of_their_own(tmp_path, monkeypatch):
    """As in two containers, where each is process 1."""
    monkeypatch.setattr(os, "getpid", lambda: 1)
    both = [Partial(tmp_path / "map.png") for _ in range(2)]
    for text, partial in zip("ab", both, strict=True):
        partial.here.write_text(text)
    for text, partial in zip("ab", both, strict=True):
        partial.commit()
        assert (tmp_path / "map.png").read_text() == text
    assert names(tmp_path) == ["map.png"]


def test_a_name_is_never_shared(tmp_path, monkeypatch):
    monkeypatch.setattr(partial_files.secrets, "token_hex", lambda _: "same")
    first, second = Partial(tmp_path / "map.png"), Partial(tmp_path / "map.png")
    first.here.write_text("whole")
    with pytest.raises(FileExistsError):
        second.here  # noqa: B018 - looking is taking
    second.discard()
    first.commit()
    assert names(tmp_path) == ["map.png"]


@posix
def test_what_a_living_process_writes_is_left_alone(tmp_path, writer):
    before = names(tmp_path)
    assert len(before) == 3
    partial_files.sweep(tmp_path)
    check_writable(tmp_path / "map.blend")
    assert names(tmp_path) == before


@posix
def test_what_a_killed_process_left_is_swept_by_the_next_that_writes_there(tmp_path, writer):
    writer.kill()
    writer.wait()
    assert len(names(tmp_path)) == 3
    check_writable(tmp_path / "map.blend")
    assert names(tmp_path) == []


@posix
def test_another_machines_files_are_left_alone_for_a_week(tmp_path, writer, monkeypatch):
    writer.kill()
    writer.wait()
    before = names(tmp_path)
    monkeypatch.setattr(partial_files, "machine", lambda: "elsewhere")
    partial_files.sweep(tmp_path)
    assert names(tmp_path) == before
    long_ago = time.time() - partial_files.WEEK - 1
    for name in before[1:]:
        os.utime(tmp_path / name, (long_ago, long_ago))
    partial_files.sweep(tmp_path)
    assert names(tmp_path) == before  # one of them is young: somebody writes
    os.utime(tmp_path / before[0], (long_ago, long_ago))
    partial_files.sweep(tmp_path)
    assert names(tmp_path) == []


def test_nothing_else_is_swept(tmp_path):
    for name in (".imprint.toml", ".imprint.partial.png", "imprint.1.2.partial.png", ".other.1.2.partial.png", "a.png"):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (0, 0))
    before = names(tmp_path)
    partial_files.sweep(tmp_path)
    assert names(tmp_path) == before


def test_a_process_that_ends_at_once_leaves_nothing(tmp_path):
    partial = Partial(tmp_path / "map.png")
    partial.here.write_text("half")
    partial_files.remove_ours()
    assert names(tmp_path) == []


def test_a_folder_that_lets_nothing_go_is_no_error(tmp_path, monkeypatch):
    """As one that has become read-only, or a share that went away."""
    first, second = Partial(tmp_path / "a.png"), Partial(tmp_path / "b.png")
    for partial in (first, second):
        partial.here.write_text("half")

    def refuses(*_, **__):
        raise PermissionError

    with monkeypatch.context() as folder:
        folder.setattr(Path, "unlink", refuses)
        first.discard()
        partial_files.remove_ours()
    partial_files.sweep(tmp_path)  # their writer has let them go, alive as it is
    assert names(tmp_path) == []


def test_a_folder_that_becomes_a_file_is_told_and_nothing_else_raised(tmp_path):
    """Somebody tidies up while a bake goes on."""
    folder = tmp_path / "maps"
    partial = Partial(folder / "map.png")
    with partial.told():
        partial.here.write_text("half")
    shutil.rmtree(folder)
    folder.touch()
    with pytest.raises(BakeError, match="could not be written"):
        partial.commit()
    partial.discard()
    assert names(tmp_path) == ["maps"]


def test_a_guard_that_is_swept_before_it_is_locked_is_made_anew(tmp_path, monkeypatch):
    """By a process that looked just then, and took it for a dead one's."""
    lock = partial_files._lock

    def late(descriptor):
        monkeypatch.setattr(partial_files, "_lock", lock)
        for name in names(tmp_path):
            (tmp_path / name).unlink()
        lock(descriptor)

    monkeypatch.setattr(partial_files, "_lock", late)
    partial = Partial(tmp_path / "map.png")
    assert partial.here.with_suffix("").exists()
    partial.discard()
    assert names(tmp_path) == []


def test_blenders_own_partial_file_goes_as_well(tmp_path):
    partial = Partial(tmp_path / "scene.blend")
    for path in (partial.here, partial.here.with_name(f"{partial.here.name}@")):
        path.write_text("half")
    partial.discard()
    assert names(tmp_path) == []
