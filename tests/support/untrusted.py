# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes files as --untrusted does, in a process of its own, and looks at all that is on the disk."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from addon.cli import run_report
from scripts.imprint import ROOT
from tests.support import reports, scenes, trees

SABOTAGE = ROOT / "tests" / "support" / "sabotage"
HAS_SANDBOX = sys.platform == "linux" and (shutil.which("bwrap") is not None or os.environ.get("CI") == "true")
needs_sandbox = pytest.mark.skipif(not HAS_SANDBOX, reason="no bubblewrap; where CI=true these tests fail then")
MESH = {"low-file": "low.obj", "high-file": "high.obj"}


def folder(tmp_path, monkeypatch):
    """A folder with job/, in which the files of others are and which is the working folder, and outside/. Logs and records have
    folders, too."""
    for name in ("outside", "job/out", "logs", "records", "home"):
        (tmp_path / name).mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "job")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "outside/secret.txt").write_text("secret")
    for path in ("job/link", "job/out/link"):
        (tmp_path / path).symlink_to(tmp_path / "outside")
    scenes.plane_files(tmp_path / "job", low=0.0, high=0.2)
    return tmp_path


def bake(root, sets, *words):
    """Bake sets of untrusted files. Returns the entries of the report by number, after comparing all other files."""
    usual = {"size": 16, "limit": 9, "method": "flatten"}
    (root / "job/j.json").write_text(json.dumps({"defaults": usual, "bake": sets}))
    report = root / "logs/r.json"
    of_call = [root / "logs", root / "records", root / "job/out"]
    before = trees.snapshot(root, *of_call)
    words = ["--jobs", "j.json", "--untrusted", "--report", str(report), "--log", str(root / "logs"), *words]
    done = subprocess.run(
        [sys.executable, str(ROOT / "scripts" / "bake.py"), *words],
        capture_output=True,
        text=True,
        env=dict(os.environ, PYTHONPATH=str(SABOTAGE)),
        check=False,
    )
    assert trees.snapshot(root, *of_call) == before
    assert done.returncode in {run_report.DONE, run_report.FAILED, run_report.NO_MACHINE}, done.stderr
    return {each["number"]: each for each in reports.bakes(report)}
