# SPDX-License-Identifier: GPL-3.0-or-later
"""Which scene of a .blend is baked in, linked low objects, and low objects that are there when one is to be made."""

import bpy
import pytest

from addon.cli import command
from tests.support import scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


@pytest.fixture
def two(tmp_path, monkeypatch):
    """two.blend, with a pair of its own in the scene that is open, and a linked pair in the scene "other"."""
    monkeypatch.chdir(tmp_path)
    zoo.plane("lo"), zoo.terrain("hi", 8)
    scenes.save(tmp_path / "library.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    other = bpy.data.scenes.new("other")
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, linked):
        linked.objects = ["lo", "hi"]
    for obj in linked.objects:
        other.collection.objects.link(obj)
    zoo.plane("rock_low", 2), zoo.terrain("rock_high", 8)
    scenes.save(tmp_path / "two.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return tmp_path


SMALL = ["--size", "16", "--method", "cast"]
LINKED = ["--low", "lo", "--high", "hi", *SMALL, "--output", "m.png"]


def run(capsys, *words):
    """The exit code of a command, and what it says to people."""
    code = command.run(list(words))
    return code, capsys.readouterr().err


def test_a_scene_is_chosen_by_name_and_a_linked_low_object_needs_no_material(two, capsys):
    """Its material would be seen in a saved .blend alone."""
    assert run(capsys, "two.blend", "--scene", "other", *LINKED) == (0, "")
    assert (two / "m.png").is_file()
    code, text = run(capsys, "two.blend", "--scene", "other", *LINKED, "--save-blend", "saved.blend")
    assert code == 1
    assert "make it local first; --no-material leaves them as they are." in text


def test_without_a_name_it_is_the_one_that_is_open(two, capsys):
    """Also after a bake in another scene of the same file."""
    (two / "jobs.toml").write_text(
        '[defaults]\nfile = "two.blend"\nsize = "16"\nmethod = "cast"\n'
        '[[bake]]\nlow = "lo"\nhigh = "hi"\nscene = "other"\noutput = "a.png"\n'
        '[[bake]]\nlow = "rock_low"\nhigh = "rock_high"\noutput = "b.png"\n'
    )
    assert run(capsys, "--jobs", "jobs.toml") == (0, "")
    assert (two / "a.png").is_file() and (two / "b.png").is_file()
    code, text = run(capsys, "two.blend", *LINKED)
    assert (code, "'lo' is not in scene 'Scene'" in text) == (1, True)


@pytest.mark.parametrize(
    ("words", "code", "expected"),
    [
        (
            ["two.blend", "--scene", "oter", *LINKED],
            1,
            "There is no scene called 'oter' in the file: it has 'other', 'Scene'",
        ),
        (["--scene", "x", "--low-file", "a.obj", "--output", "m.png"], 2, "--scene is for a .blend: leave it out"),
    ],
)
def test_wrong_scenes_are_named(two, capsys, words, code, expected):
    found, text = run(capsys, *words)
    assert found == code
    assert expected in text


def test_a_low_object_that_its_name_has_found_is_said(two, capsys):
    asked = ["asset", "two.blend", "--high", "rock_high", "--size", "32", "--output", "m.png"]
    sentence = "'rock_low' is there already and has 8 triangles, not 3,000: it is baked as it is"
    code, text = run(capsys, *asked, "--triangles", "3000")
    assert (code, sentence in text) == (0, True)
    assert sentence.replace(", not 3,000", "") in run(capsys, *asked)[1]
    for others in (["--triangles", "8"], ["--low", "rock_low"]):
        assert "there already" not in run(capsys, *asked, *others)[1]


def test_what_is_no_mesh_is_named(two, capsys):
    bpy.ops.wm.open_mainfile(filepath="two.blend")
    scenes.link(bpy.data.objects.new("nothing", None))
    bpy.ops.wm.save_mainfile()
    code, text = run(capsys, "two.blend", "--low", "nothing", "--high", "rock_high", *SMALL, "--output", "m.png")
    assert code == 1
    assert "'nothing' is of the type empty, which cannot be baked onto" in text
