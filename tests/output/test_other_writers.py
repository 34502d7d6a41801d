# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests several processes that write into one folder: only the temporary files of ended processes are removed."""

import os
import shutil
import subprocess
import sys
import time

import pytest

from addon.core.errors import BakeError
from addon.output import atomic_file
from addon.output.atomic_file import Partial, check_writable
from scripts.imprint import ROOT

pytestmark = pytest.mark.skipif(os.name == "nt", reason="locks of POSIX, and files removed while they are open")


def names(folder):
    return sorted(path.name for path in folder.iterdir())


WRITER = """
import sys
from pathlib import Path
from addon.output.atomic_file import Partial
partial = Partial(Path(sys.argv[1]))
partial.temporary.write_text("half")
partial.temporary.with_name(partial.temporary.name + "@").write_text("half")  # as Blender does with a .blend
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


def test_temporary_files_of_a_running_process_are_kept(tmp_path, writer):
    before = names(tmp_path)
    assert len(before) == 3
    atomic_file.sweep(tmp_path)
    check_writable(tmp_path / "map.blend")
    assert names(tmp_path) == before


def test_temporary_files_of_a_killed_process_are_removed_by_the_next_one(tmp_path, writer):
    writer.kill()
    writer.wait()
    assert len(names(tmp_path)) == 3
    check_writable(tmp_path / "map.blend")
    assert names(tmp_path) == []


def test_temporary_files_of_another_machine_are_kept_for_a_week(tmp_path, writer, monkeypatch):
    writer.kill()
    writer.wait()
    before = names(tmp_path)
    monkeypatch.setattr(atomic_file, "machine", lambda: "elsewhere")
    atomic_file.sweep(tmp_path)
    assert names(tmp_path) == before
    long_ago = time.time() - atomic_file.WEEK - 1
    for name in before[1:]:
        os.utime(tmp_path / name, (long_ago, long_ago))
    atomic_file.sweep(tmp_path)
    assert names(tmp_path) == before  # one file is recent, so its process may be writing
    os.utime(tmp_path / before[0], (long_ago, long_ago))
    atomic_file.sweep(tmp_path)
    assert names(tmp_path) == []


def test_a_folder_replaced_by_a_file_during_the_bake_raises_only_a_bake_error(tmp_path):
    folder = tmp_path / "maps"
    partial = Partial(folder / "map.png")
    with partial.writing():
        partial.temporary.write_text("half")
    shutil.rmtree(folder)
    folder.touch()
    with pytest.raises(BakeError, match="could not be written"):
        partial.commit()
    partial.discard()
    assert names(tmp_path) == ["maps"]


def test_a_guard_that_is_removed_before_it_is_locked_is_made_again(tmp_path, monkeypatch):
    """Another process may find it unlocked, and remove it as that of an ended process."""
    lock = atomic_file._lock

    def late(descriptor):
        monkeypatch.setattr(atomic_file, "_lock", lock)
        for name in names(tmp_path):
            (tmp_path / name).unlink()
        lock(descriptor)

    monkeypatch.setattr(atomic_file, "_lock", late)
    partial = Partial(tmp_path / "map.png")
    assert partial.temporary.with_suffix("").exists()
    partial.discard()
    assert names(tmp_path) == []
