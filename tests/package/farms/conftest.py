# SPDX-License-Identifier: GPL-3.0-or-later
"""A program that notes its words stands for Imprint."""

import json
import sys

import pytest

NOTES = """import json, os, sys
with open(os.environ["NOTED"], "a") as file:
    print(json.dumps(sys.argv[1:]), file=file)
sys.exit(int(os.environ.get("CODE", 0)))
"""


@pytest.fixture
def noted(tmp_path, monkeypatch):
    """What starts the program that notes its words, and a function that returns these words, call by call."""
    program, file = tmp_path / "note words.py", tmp_path / "noted"
    program.write_text(NOTES)
    monkeypatch.setenv("NOTED", str(file))
    return f'"{sys.executable}" "{program}"', lambda: list(map(json.loads, file.read_text().splitlines()))
