# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes from the command line warn of what other programs show differently, once, before they draw."""

import sys

import bpy
import pytest

from addon.cli import command
from addon.jobs import bake
from tests.support import reports, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


@pytest.fixture
def scene(tmp_path):
    """A file with a low object of quads and a high one."""
    zoo.terrain("lo", 4, waves=1)
    zoo.terrain("hi", 8)
    path = tmp_path / "file.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


@pytest.fixture
def drawing(monkeypatch):
    """Makes each bake print a line before it draws."""
    shares = bake.shares_of_tiles

    def note(plan):
        sys.stderr.write("drawing\n")
        return shares(plan)

    monkeypatch.setattr(bake, "shares_of_tiles", note)


@pytest.mark.usefixtures("drawing")
def test_a_bake_warns_once_before_it_draws(scene, capsys):
    words = [str(scene), "--low", "lo", "--high", "hi", "--method", "flatten", "--size", "16"]
    out, report = str(scene.with_name("map.png")), scene.with_name("report.json")
    assert command.run([*words, "--output", out, "--green", "-y", "--report", str(report)]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if "quads" in line or line == "drawing"]
    assert len(lines) == 2
    assert lines[0].startswith("imprint: warning: 'lo' has 16 quads")
    assert sum("quads" in warning for warning in reports.one(report)["warnings"]) == 1
    assert command.run([*words, "--output", out]) == 0
    assert "quads" not in capsys.readouterr().err


@pytest.mark.usefixtures("drawing")
@pytest.mark.parametrize("more", [[], ["--green", "-y"]])
@pytest.mark.parametrize("sets", [[], ["--texture-sets"]])
def test_an_export_is_warned_of_what_it_does_not_cure(scene, capsys, more, sets):
    bpy.data.objects["lo"].data.polygons.foreach_set("use_smooth", [False] * 16)
    for name in ("lo", "hi"):
        bpy.data.objects[name].data.materials.append(bpy.data.materials.new("stone"))
    bpy.ops.wm.save_mainfile()
    words = [str(scene), "--low", "lo", "--high", "hi", "--method", "flatten", "--size", "16", *more, *sets]
    words += ["--output", str(scene.with_name("{material}.png" if sets else "map.png"))]
    assert command.run([*words, "--export", str(scene.with_name("out.glb"))]) == 0
    said = capsys.readouterr().err.partition("drawing")[0]
    assert "24 hard edges" in said
    assert "quads" not in said
    assert command.run(words) == 0
    said = capsys.readouterr().err.partition("drawing")[0]
    assert ("hard edges" in said, "quads" in said) == (bool(more), bool(more))
