# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests paths that are not possible on Windows."""

import json
import os

import pytest

from addon.cli.usage import arguments, job_file

pytestmark = pytest.mark.skipif(os.name == "nt", reason="on Windows, two slashes start the name of a server")


def test_two_slashes_in_a_job_file_become_one(tmp_path):
    content = {"bake": [{"file": "//a.blend", "low": "a", "output": "//m.png"}]}
    (tmp_path / "jobs.json").write_text(json.dumps(content), encoding="utf-8")
    (found,) = job_file.read(str(tmp_path / "jobs.json"))
    assert (found.file, arguments.settings(found).output) == (["/a.blend"], "/m.png")
