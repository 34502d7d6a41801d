# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests bakes without --high in a shell: of one mesh, of several, and where a name says what was forgotten."""

import json

import bpy
import numpy as np
import pytest

from addon.cli import arguments, command, run_report
from addon.export.binary_gltf import Glb
from tests.support import glb, gltf_characters, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = ["--size", "64", "--no-normal", "--maps", "position", "--depth", "16", "--margin", "2"]


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """props.blend: two cubes side by side, and a pair by its names."""
    monkeypatch.chdir(tmp_path)
    for number, name in enumerate(("lamp", "table")):
        bpy.ops.mesh.primitive_cube_add(location=(3.0 * number, 0.0, 0.0))
        bpy.context.object.name = name
    zoo.plane("crate_low").location.y = 9.0
    high = zoo.plane("crate_high", slope=0.3)
    high.location.y = 9.0
    save(tmp_path)
    return tmp_path


def save(folder):
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "props.blend"))


def bake(*words, code=run_report.DONE):
    assert command.run(["props.blend", *SIZE, *words]) == code


def read(path):
    image = bpy.data.images.load(str(path))
    texels = np.array(image.pixels, np.float32).reshape(image.size[1], image.size[0], 4)
    bpy.data.images.remove(image)
    return texels


def test_several_low_objects_are_baked_each_onto_itself(scene):
    bake("--low", "lamp", "--low", "table", "--output", "all/{low}.png", "--report", "report.json")
    (entry,) = json.loads((scene / "report.json").read_text())["bakes"]
    assert [(report["low"], report["high"]) for report in entry["reports"]] == [
        ("lamp", ["lamp"]),
        ("table", ["table"]),
    ]
    for name in ("lamp", "table"):
        bake("--low", name, "--output", "one/{low}.png")
        np.testing.assert_array_equal(*(read(scene / each / f"{name}_position.png") for each in ("all", "one")))


def test_they_share_one_map_without_a_name_in_its_path(scene):
    bake("--low", "lamp", "--low", "table", "--output", "atlas.png", "--pack-uvs")
    is_hit = read(scene / "atlas_position.png")[..., 3] > 0.0
    assert is_hit.mean() > 0.3


@pytest.mark.parametrize(("occluders", "is_dark"), [("own", False), ("all", False), ("scene", True)])
def test_what_the_scene_shows_darkens_one_of_its_objects(scene, occluders, is_dark):
    words = ["--low", "lamp", "--maps", "ao", "--occluders", occluders, "--output", "lamp.png"]
    bake(*words)
    texels = read(scene / "lamp_ao.png")
    assert (texels[texels[..., 3] > 0.0, 0].min() < 0.95) == is_dark


def test_a_job_file_names_several(scene, capsys):
    sets = [{"file": "props.blend", "low": ["lamp", "table"], "output": "{low}.png", "size": 64}]
    (scene / "jobs.json").write_text(json.dumps({"bake": sets}))
    assert command.run(["--jobs", "jobs.json", "--resume"]) == run_report.DONE
    assert {path.name for path in scene.glob("*.png")} == {"lamp.png", "table.png"}
    capsys.readouterr()
    assert command.run(["--jobs", "jobs.json", "--resume"]) == run_report.DONE
    assert "1 done before" in capsys.readouterr().out
    assert command.run(["--jobs", "jobs.json", "--list"]) == run_report.DONE
    assert "lamp, table" in capsys.readouterr().out


def test_a_high_object_that_was_forgotten_is_taken_by_its_name_and_told(scene, capsys):
    bake("--low", "crate_low", "--output", "forgotten.png")
    told = "'crate_low' is baked from 'crate_high', as its name says: --high 'crate_low' bakes it onto itself."
    assert told in capsys.readouterr().err
    bake("--low", "crate_low", "--high", "crate_high", "--output", "named.png")
    bake("--low", "crate_low", "--high", "crate_low", "--output", "itself.png")
    assert told not in capsys.readouterr().err
    found = {name: read(scene / f"{name}_position.png") for name in ("forgotten", "named", "itself")}
    np.testing.assert_array_equal(found["forgotten"], found["named"])
    assert np.abs(found["itself"] - found["named"]).max() > 0.05


def test_one_with_a_high_object_and_one_without_are_baked_as_each_is(scene, capsys):
    bake("--low", "crate_low", "--low", "lamp", "--output", "{low}.png", "--report", "report.json")
    (entry,) = json.loads((scene / "report.json").read_text())["bakes"]
    assert [report["high"] for report in entry["reports"]] == [["crate_high"], ["lamp"]]
    assert "'crate_low' is baked from 'crate_high'" in capsys.readouterr().err


def test_modifiers_come_before_names_as_they_always_did(scene, capsys):
    bpy.ops.wm.open_mainfile(filepath=str(scene / "props.blend"))
    bpy.data.objects["crate_low"].modifiers.new("Subdivision", "SUBSURF")
    save(scene)
    bake("--low", "crate_low", "--output", "m.png", "--report", "report.json")
    (entry,) = json.loads((scene / "report.json").read_text())["bakes"]
    assert [report["high"] for report in entry["reports"]] == [["crate_low"]]
    assert "'crate_low' is baked from its own modifiers or UV maps: --high takes 'crate_high' instead." in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--high", "crate_high"], "--high is for one low object: give --low once"),
        (["--frames", "1-2"], "--frames is for one low object: give --low once"),
        (["--low", "lamp"], "--low names 'lamp' twice"),
    ],
)
def test_what_several_cannot_have_is_told(scene, capsys, words, text):
    bake("--low", "lamp", "--low", "table", "--output", "{low}.png", *words, code=run_report.WRONG_USAGE)
    assert text in capsys.readouterr().err


def test_all_meshes_of_a_file_get_one_material_in_the_same_file(tmp_path, monkeypatch, capsys):
    """Without names, and without a path for the maps, which go beside the file."""
    monkeypatch.chdir(tmp_path)
    path = gltf_characters.cart(tmp_path / "cart.glb")
    wires = Glb.parsed(path.read_bytes())  # a mesh without faces is left out
    wires.tree["meshes"].append(
        {"name": "wire", "primitives": [wires.tree["meshes"][0]["primitives"][0] | {"mode": 1}]}
    )
    wires.tree["nodes"].append({"name": "wire", "mesh": len(wires.tree["meshes"]) - 1})
    wires.tree["scenes"][0]["nodes"].append(len(wires.tree["nodes"]) - 1)
    path.write_bytes(wires.packed())
    before, _ = glb.parse(path)
    words = ["cart.glb", "--size", "64", "--no-normal", "--maps", "base-color", "--one-material", "--export", "one.glb"]
    assert command.run(words) == run_report.DONE
    after, _ = glb.parse(tmp_path / "one.glb")
    assert after["nodes"] == before["nodes"]
    used = {each["material"] for mesh in after["meshes"][:2] for each in mesh["primitives"]}
    assert [after["materials"][number]["name"] for number in used] == ["atlas"]
    assert (tmp_path / "one_base_color.png").is_file()
    assert "material, too" not in capsys.readouterr().err


def test_low_objects_are_joined_in_the_saved_scene(scene):
    words = ["--low", "lamp", "--low", "table", "--one-material", "--join", "--save-blend", "joined.blend"]
    bake(*words, "--output", "atlas.png", "--pack-uvs")
    bpy.ops.wm.open_mainfile(filepath=str(scene / "joined.blend"))
    assert "table" not in bpy.data.objects
    lamp = bpy.data.objects["lamp"]
    assert len(lamp.data.polygons) == 12
    assert [slot.material.name for slot in lamp.material_slots] == ["atlas"]


@pytest.mark.parametrize("lacking", ["--low", "--one-material", "--save-blend"])
def test_what_joining_needs_is_told(lacking):
    words = {"--low": ["--low", "b"], "--one-material": ["--one-material"], "--save-blend": ["--save-blend", "b.blend"]}
    given = [word for name, each in words.items() if name != lacking for word in each]
    options = arguments.parse(["a.blend", "--low", "a", "--join", "--output", "a.png", *given])
    assert "--join is for several low objects, with --one-material and --save-blend" in arguments.mistakes(options)


def test_with_a_high_object_the_low_one_is_exported_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    gltf_characters.cart(tmp_path / "cart.glb")
    words = ["--size", "64", "--low", "box", "--high", "wheel left", "--method", "cast", "--hit", "nearest"]
    assert command.run(["cart.glb", *words, "--extrusion", "1", "--max-distance", "3", "--export", "low.glb"]) == 0
    after, _ = glb.parse(tmp_path / "low.glb")
    assert [node["name"] for node in after["nodes"]] == ["box"]


@pytest.mark.parametrize("name", ["scene.blend", "cart.glb"])
def test_a_mesh_file_needs_no_name_but_a_scene_does(name):
    options = arguments.parse([name, "--output", "a.png"])
    assert arguments.takes_all(options) is (name == "cart.glb")
    assert any("one of --low" in text for text in arguments.mistakes(options)) is (name == "scene.blend")


@pytest.mark.parametrize("words", [["--high", "a"], ["--pairs"], ["--frames", "1-2"], ["--convert", "a.png"]])
def test_other_words_name_their_own_objects(words):
    assert not arguments.takes_all(arguments.parse(["cart.glb", *words, "--output", "a.png"]))
