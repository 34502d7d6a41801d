# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes from the command line warn of what other programs show differently, once, before they draw."""

import json
import sys

import bpy
import pytest

from addon.cli import command
from addon.jobs import bake
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


@pytest.fixture
def scene(tmp_path):
    """A file with a low object of quads and a high one."""
    zoo.terrain("lo", 4, waves=1)
    zoo.terrain("hi", 8)
    path = tmp_path / "file.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def test_a_bake_warns_once_before_it_draws(scene, capsys, monkeypatch):
    drawn, shares = [], bake._shares

    def note(plan):
        sys.stderr.write("drawing\n")
        drawn.append(plan)
        return shares(plan)

    monkeypatch.setattr(bake, "_shares", note)
    words = [str(scene), "--low", "lo", "--high", "hi", "--method", "flatten", "--size", "16"]
    out, report = str(scene.with_name("map.png")), scene.with_name("report.json")
    assert command.run([*words, "--output", out, "--green", "-y", "--report", str(report)]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if "quads" in line or line == "drawing"]
    assert len(lines) == 2
    assert lines[0].startswith("imprint: warning: 'lo' has 16 quads")
    assert sum("quads" in warning for warning in json.loads(report.read_text())["warnings"]) == 1
    assert command.run([*words, "--output", out]) == 0
    assert "quads" not in capsys.readouterr().err
