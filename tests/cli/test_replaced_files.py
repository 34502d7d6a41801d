# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of replaced files where systems are POSIX: a second signal, modes and groups."""

import os
import stat
import subprocess
import sys

import pytest

from scripts.imprint import ROOT
from tests.pure.test_atomic_file import tree, write

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals and modes of POSIX")

ENDED = """
import os, signal, sys
from pathlib import Path
from addon.cli import interruption
from addon.output.atomic_file import all_or_none, replacing
folder, has_parts, moment = Path(sys.argv[1]), sys.argv[2] == "parts", sys.argv[3]
def end():
    signal.raise_signal(signal.SIGTERM)
    signal.raise_signal(signal.SIGTERM)
def write(name):
    with replacing(folder / name) as partial:
        partial.write_text("new")
replace = os.replace
def replaces(source, target):
    replace(source, target)
    if moment == "restoring" and Path(target).name == "b.png" and Path(target).read_text() == "old":
        end()
os.replace = replaces
with interruption.listening(), all_or_none(has_parts=has_parts):
    with all_or_none():
        write("a.png")
    with all_or_none():
        write("b.png")
        write("sub/c.png")
        if moment == "writing":
            end()
        if moment == "restoring":
            raise ValueError
"""


@pytest.mark.parametrize("moment", ["writing", "restoring"])
@pytest.mark.parametrize(("word", "first"), [("whole", "old"), ("parts", "new")])
def test_a_second_signal_restores_what_was_replaced(tmp_path, word, first, moment):
    """Of a sequence, the frames that are finished stay."""
    for name in ("a.png", "b.png"):
        (tmp_path / name).write_text("old")
    program = [sys.executable, "-c", ENDED, str(tmp_path), word, moment]
    done = subprocess.run(program, capture_output=True, text=True, check=False, cwd=ROOT)
    assert (done.returncode, done.stderr) == (143, "")
    assert tree(tmp_path) == {"a.png": first, "b.png": "old"}


@pytest.mark.parametrize("mode", [0o600, 0o664, 0o444])
def test_a_file_that_is_replaced_keeps_its_mode(tmp_path, mode):
    path = tmp_path / "map.png"
    path.write_text("old")
    path.chmod(mode)
    write(path)
    assert (path.read_text(), stat.S_IMODE(path.stat().st_mode)) == ("new", mode)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root is in all groups")
def test_a_file_that_is_replaced_keeps_its_group(tmp_path, monkeypatch):
    path = tmp_path / "map.png"
    path.write_text("old")
    os.chown(path, -1, 4321)
    path.chmod(0o664)
    write(path)
    assert (path.stat().st_gid, stat.S_IMODE(path.stat().st_mode)) == (4321, 0o664)

    def refuse(*_):
        raise PermissionError

    monkeypatch.setattr(os, "chown", refuse)  # as for a user who is not in it
    write(path)
    assert (path.stat().st_gid, stat.S_IMODE(path.stat().st_mode)) == (os.getgid(), 0o644)
