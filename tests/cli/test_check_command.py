# SPDX-License-Identifier: GPL-3.0-or-later
"""The command check: what the high mesh of a bake is, without a bake."""

import bpy
import numpy as np
import pytest

from addon.cli import command
from addon.mesh.welding import weld
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
    assert said.startswith("hi, baked onto lo:\n  1,152 triangles in 1 connected parts")
    assert "1 of 1 parts, 25.0% of the faces, will be turned over" in said
    assert "Distance to the low mesh" in said
    assert sorted(tmp_path.iterdir()) == before


def test_high_meshes_alone_are_looked_at_for_an_asset(file, capsys):
    assert command.run(["check", file, "--high", "hi"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("hi, for an asset:\n  1,152 triangles in 1 connected parts, 0 of them closed\n")
    assert "  25.0% of the faces will be turned over\n" in said
    assert "Open edges: 96. 0 small holes will be filled, 0 stay." in said


def test_files_of_high_meshes_alone(tmp_path, capsys):
    """A ball with a small hole, without UVs and normals."""
    soup = spoiled.of_object(zoo.ball("hi", 96))
    points, triangles = weld(soup.points, soup.triangles)
    lines = [f"v {x} {y} {z}" for x, y, z in points]
    lines += [
        f"f {' '.join(str(number + 1) for number in each)}"
        for each in np.delete(triangles, len(triangles) // 2, axis=0)
    ]
    (tmp_path / "hi.obj").write_text("\n".join(["o hi", *lines]) + "\n")
    said = []
    for words in (["--high-file", str(tmp_path / "hi.obj")], [str(tmp_path / "hi.obj")]):
        assert command.run(["check", *words]) == 0
        said.append(capsys.readouterr().out)
    assert said[0] == said[1] and said[0].startswith(f"hi, for an asset:\n  {len(triangles) - 1:,} triangles in 1")
    assert "No face will be turned over" in said[0] and "edges below 40 degrees are smooth" in said[0]
    assert "Open edges: 3. 1 small holes will be filled, 0 stay." in said[0]


def test_meshes_that_belong_together_by_their_names_are_named(tmp_path, capsys):
    for name in ("a_low", "a_high"):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        zoo.cube(name)
        bpy.ops.wm.obj_export(filepath=str(tmp_path / f"{name}.obj"), export_materials=False)
    assert command.run(["check", str(tmp_path / "a_low.obj"), str(tmp_path / "a_high.obj")]) == 0
    out, err = capsys.readouterr()
    assert [line for line in out.splitlines() if line.endswith("itself:")] == [
        "a_low, baked onto itself:",
        "a_high, baked onto itself:",
    ]
    assert "'a_low' and 'a_high' are each baked onto itself: --low 'a_low' bakes the first from the others" in err


@untrusted.needs_sandbox
def test_untrusted_files_are_looked_at_in_the_sandbox(file, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(command, "load_blender", None)  # this process opens no file
    before = sorted(tmp_path.iterdir())
    words = ["check", file, "--low", "lo", "--untrusted", "--output-folder", str(tmp_path / "out")]
    assert command.run([*words, "--high", "hi"]) == 0
    said = capfd.readouterr().out
    assert "1 of 1 parts, 25.0% of the faces, will be turned over" in said and "EGL" not in said
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
        ([], 1, "Name the low mesh with --low, or high meshes alone with --high. Meshes of the file: 'hi', 'lo'."),
        (["--cage", "hi"], 2, "--low"),
    ],
)
def test_wrong_calls_end_in_a_sentence(file, capsys, words, code, said):
    assert command.run(["check", file, *words]) == code
    assert said in capsys.readouterr().err
