# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests --export in bakes of pairs, folders and job files: which files it writes, and which it refuses."""

import bpy
import pytest

from addon.cli import command
from tests.support import glb, reports, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = ["--size", "32", "--limit", "9", "--method", "flatten"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with rocks.blend: two pairs with UVs in the halves of an atlas."""
    monkeypatch.chdir(tmp_path)
    for number, name in enumerate("ab"):
        for ending, slope in (("low", 0.0), ("high", 0.3)):
            obj = zoo.plane(f"{name}_{ending}", 2, slope=slope)
            obj.location.x = 3.0 * number
            for value in obj.data.uv_layers[zoo.LAYER].uv:
                value.vector.x = (value.vector.x + number) / 2.0
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rocks.blend"))
    return tmp_path


def nodes(path):
    return sorted(node["name"] for node in glb.parse(path)[0]["nodes"])


def test_each_pair_has_a_file(folder):
    words = ["rocks.blend", "--pairs", "--output", "{low}.png", "--export", "out/{low}.glb", "--report", "report.json"]
    assert command.run([*words, *SIZE]) == 0
    assert nodes(folder / "out" / "a_low.glb") == ["a_low"]
    assert nodes(folder / "out" / "b_low.glb") == ["b_low"]
    found = reports.bake(folder / "report.json")["reports"]
    assert [pair["export"]["files"] for pair in found] == [
        [str(folder / "out" / f"{name}.glb")] for name in ("a_low", "b_low")
    ]


def test_an_atlas_with_all_its_meshes_goes_into_one_file(folder):
    assert command.run(["rocks.blend", "--pairs", "--output", "atlas.png", "--export", "all.glb", *SIZE]) == 0
    assert nodes(folder / "all.glb") == ["a_low", "b_low"]
    tree, _ = glb.parse(folder / "all.glb")
    assert len(tree["images"]) == 1
    moved = next(node for node in tree["nodes"] if node["name"] == "b_low")
    assert moved["translation"] == [3, 0, 0]


def test_a_job_file_and_a_folder_take_the_same_key(folder):
    (folder / "jobs.toml").write_text(
        '[defaults]\nsize = 32\nlimit = "9"\nmethod = "flatten"\n'
        '[[bake]]\nfile = "rocks.blend"\nlow = "a_low"\nhigh = "a_high"\noutput = "a.png"\nexport = "out/a.glb"\n',
        encoding="utf-8",
    )
    assert command.run(["--jobs", "jobs.toml"]) == 0
    assert nodes(folder / "out" / "a.glb") == ["a_low"]


def test_meshes_of_a_folder_are_exported_under_their_files_names(folder):
    (folder / "meshes").mkdir()
    for obj in list(bpy.data.objects):
        bpy.ops.object.select_all(action="DESELECT")
        obj.select_set(True)
        bpy.ops.wm.obj_export(
            filepath=str(folder / "meshes" / f"{obj.name}.obj"), export_selected_objects=True, export_materials=False
        )
    words = ["--pairs", "meshes", "--output", "{low}.png", "--export", "out/{low}.glb", *SIZE]
    assert command.run(words) == 0
    assert sorted(path.name for path in (folder / "out").iterdir()) == ["a_low.glb", "b_low.glb"]
    assert nodes(folder / "out" / "a_low.glb") == ["a_low"]


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (["--low-file", "a_low.glb", "--high-file", "b.glb", "--export", "a_low.glb"], "would overwrite"),
        (["rocks.blend", "--low", "a_low", "--high", "a_high", "--export", "rocks.fbx/x.glb"], ""),
        (["--pairs", ".", "--export", "one.glb"], "--export needs {low}"),
    ],
)
def test_what_would_harm_files_is_refused(folder, capsys, more, reason):
    for name in ("a_low.glb", "b.glb", "rocks.fbx"):
        (folder / name).write_bytes(b"mesh")
    before = {path: path.read_bytes() for path in folder.iterdir()}
    assert command.run([*more, "--output", "{low}.png", *SIZE]) != 0
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    assert reason in capsys.readouterr().err


def test_textures_beside_a_file_replace_no_map_of_another_bake(folder, capsys):
    bake = '[[bake]]\nfile = "rocks.blend"\nlow = "{0}_low"\nhigh = "{0}_high"\noutput = "{1}"\n'
    texture = "textures/rock_a_low_normal.png"
    (folder / "jobs.toml").write_text(
        '[defaults]\nsize = 32\nlimit = "9"\nmethod = "flatten"\nimage = "a_low_normal"\n'
        + bake.format("a", "a.png")
        + 'export = "rock.usda"\n'
        + bake.format("b", texture),
        encoding="utf-8",
    )
    assert command.run(["--jobs", "jobs.toml", "--report", "report.json"]) == 1
    assert f"would both be {str(folder / texture)!r}" in capsys.readouterr().err
    first, second = reports.bakes(folder / "report.json")
    assert (first["state"], second["state"]) == ("failed", "done")
    assert not (folder / "rock.usda").exists()
    assert not (folder / "a.png").exists()
    assert [path.name for path in (folder / "textures").iterdir()] == ["rock_a_low_normal.png"]
