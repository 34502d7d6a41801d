# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests --resume with --untrusted: what came with the files, or was changed later, is never taken for done."""

import json
import os
from pathlib import Path

import pytest

from addon.cli import command
from addon.cli.records import CLAIM, ENDING, Contents
from tests.support import untrusted
from tests.support.untrusted import MESH, bake

pytestmark = untrusted.needs_sandbox
MAP = Path("out/m.png")
SET = {**MESH, "output": str(MAP)}


@pytest.fixture
def root(tmp_path, monkeypatch):
    return untrusted.folder(tmp_path, monkeypatch)


def state(root, *sets, word="--resume"):
    """What becomes of the first set, or of SET."""
    return bake(root, sets or [SET], word, "--records", str(root / "records"))[1]["state"]


def records(root):
    return sorted(path.name for path in (root / "records").iterdir())


@pytest.mark.slow
def test_what_is_done_is_left_out_and_nothing_lies_beside_the_maps(root):
    assert state(root) == "done"
    (name,) = records(root)
    assert name.startswith("m.png.") and name.endswith(ENDING)
    assert sorted(os.listdir("out")) == ["link", "m.png"]
    assert state(root) == "resumed"
    assert state(root, word="--force") == "done"
    Path("high.obj").write_text(Path("high.obj").read_text().replace("vt 0", "vt 0.01", 1))
    assert state(root) == "done"
    assert state(root) == "resumed"
    assert records(root) == [name]


@pytest.mark.slow
def test_a_file_that_only_the_bake_found_counts(root):
    mesh = Path("high.obj").read_text().replace("\no ", "\nmtllib own.mtl\no ").replace("\nf ", "\nusemtl a\nf ", 1)
    Path("shown.obj").write_text(mesh)
    Path("own.mtl").write_text("newmtl a\nKd 1 0 0\n")
    shown = {**SET, "high-file": "shown.obj"}
    assert [state(root, shown), state(root, shown)] == ["done", "resumed"]
    Path("own.mtl").write_text("newmtl a\nKd 0 1 0\n")
    assert state(root, shown) == "done"


@pytest.mark.slow
def test_a_record_that_came_with_the_files_is_not_believed(root):
    """It is a real one, of the same bake, and says what the planted map contains."""
    words = ["--jobs", "j.json", "--resume", "--size", "16", "--limit", "9", "--method", "flatten"]
    Path("j.json").write_text(json.dumps({"bake": [SET]}))
    assert command.run(words) == 0
    true, record = MAP.read_bytes(), MAP.with_name(MAP.name + ENDING)
    MAP.write_bytes(b"planted")
    values = json.loads(record.read_text())
    values["files"][0] |= {"bytes": 7, "sha256": Contents().of(str(MAP)).sha256, "modified": os.stat(MAP).st_mtime_ns}
    record.write_text(json.dumps(values))
    assert command.run([*words, "--report", "resumed.json"]) == 0
    assert MAP.read_bytes() == b"planted"  # files that are trusted would be taken for done
    assert state(root) == "done"
    assert MAP.read_bytes() == true


@pytest.mark.slow
@pytest.mark.parametrize("make", [os.mkfifo, lambda path: os.symlink("/dev/zero", path)], ids=["pipe", "link"])
def test_claims_and_records_that_came_with_the_files_are_not_opened(root, make):
    for ending in (ENDING, ENDING + CLAIM):
        make(f"{MAP}{ending}")
    assert [state(root), state(root)] == ["done", "resumed"]


@pytest.mark.slow
def test_a_map_that_was_replaced_is_baked_again_even_if_it_has_the_same_time_and_size(root):
    assert state(root) == "done"
    true, found = MAP.read_bytes(), os.stat(MAP)
    MAP.write_bytes(true[:-1] + b"!")
    os.utime(MAP, ns=(found.st_atime_ns, found.st_mtime_ns))
    assert state(root) == "done"
    assert MAP.read_bytes() == true
