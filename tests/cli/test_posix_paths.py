# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests paths that are not possible on Windows."""

import json
import os

import pytest

from addon.cli import arguments, command, job_file

pytestmark = pytest.mark.skipif(os.name == "nt", reason="on Windows, two slashes start the name of a server")


def test_two_slashes_in_a_job_file_become_one(tmp_path):
    content = {"bake": [{"file": "//a.blend", "low": "a", "output": "//m.png"}]}
    (tmp_path / "jobs.json").write_text(json.dumps(content), encoding="utf-8")
    (found,) = job_file.read(str(tmp_path / "jobs.json"))
    assert (found.file, arguments.settings(found).storing.output) == (["/a.blend"], "/m.png")


@pytest.mark.parametrize(
    "words", [["a.blend", "--low", "a", "--output", "/m.png"], ["--jobs", "j.toml"], ["lod"], ["report"]]
)
def test_a_folder_that_was_removed_is_one_sentence(tmp_path, monkeypatch, capsys, words):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert command.run(words) == 2
    reason = "The folder in which this was started cannot be read: No such file or directory. Start it in another one."
    assert capsys.readouterr().err == f"imprint: {reason}\n"
