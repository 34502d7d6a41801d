# SPDX-License-Identifier: GPL-3.0-or-later
"""The command check: what the high mesh of a bake is, without a bake."""

import bpy
import numpy as np
import pytest

from addon.cli import command
from tests.support import scenes, spoiled, untrusted, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


@pytest.fixture
def file(tmp_path):
    """A file with a low plane and a high terrain of which a part is flipped."""
    zoo.plane("lo")
    soup = spoiled.of_object(zoo.terrain("quads", 24))
    bpy.data.objects.remove(bpy.data.objects["quads"])
    spoiled.build("hi", spoiled.flipped_in_regions(soup, np.random.default_rng(2), 0.25))
    return scenes.save(tmp_path / "scan.blend")


def test_what_will_be_changed_is_printed(file, tmp_path, capsys):
    before = sorted(tmp_path.iterdir())
    assert command.run(["check", file, "--low", "lo", "--high", "hi"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("lo:\n  1,152 triangles in 1 connected parts")
    assert "1 of 1 parts, 25.0% of the faces, will be turned over" in said
    assert "Distance to the low mesh" in said
    assert sorted(tmp_path.iterdir()) == before


@untrusted.needs_sandbox
def test_untrusted_files_are_looked_at_in_the_sandbox(file, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(command, "load_blender", None)  # this process opens no file
    before = sorted(tmp_path.iterdir())
    words = ["check", file, "--low", "lo", "--untrusted", "--output-folder", str(tmp_path / "out")]
    assert command.run([*words, "--high", "hi"]) == 0
    assert "1 of 1 parts, 25.0% of the faces, will be turned over" in capfd.readouterr().out
    assert command.run([*words, "--high=none"]) == 1
    assert "none" in capfd.readouterr().err
    assert command.run([*words, "--high", "hi", f"--input-folder={tmp_path / 'other'}"]) == 2
    (tmp_path / "other").mkdir()
    assert command.run([*words, "--high", "hi", f"--input-folder={tmp_path / 'other'}"]) == 2
    assert "the only folder that --untrusted reads" in capfd.readouterr().err
    (tmp_path / "other").rmdir()
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--low", "lo", "--high", "none"], 1, "none"),
        (["--jobs", "some.toml"], 2, "one bake"),
        (["--high", "hi"], 2, "--low"),
    ],
)
def test_wrong_calls_end_in_a_sentence(file, capsys, words, code, said):
    assert command.run(["check", file, *words]) == code
    assert said in capsys.readouterr().err
