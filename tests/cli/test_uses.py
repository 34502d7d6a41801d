# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs all commands of the page about uses, on meshes as each of them takes, made small."""

import shlex

import bpy
import numpy as np
import pytest

from addon.cli import command
from scripts.imprint import ROOT
from tests.support import glb, gltf_characters, quick_assets, scans, zoo
from tests.support.manual import blocks, section

pytestmark = [pytest.mark.usefixtures("gpu_context"), pytest.mark.slow]
PAGE = ROOT / "docs" / "uses.md"
PROGRAM = "python3 scripts/imprint.py "
SMALL = {"--size": "64", "--rays": "16", "--triangles": "400", "--distance": "2", "--levels": "1", "--workers": "1"}
"""In place of what the page says, unless it is shares of a mesh."""
ALWAYS = ("--size", "--rays")
"""Those of them that each command gets, also where the page has the defaults: maps of 2048, and 128 rays."""


def commands(heading):
    """The words of the commands below a heading, with the numbers of SMALL."""
    text = section(PAGE, heading).replace("\\\n", " ")
    for line in text.splitlines():
        if line.startswith(PROGRAM):
            words = shlex.split(line.removeprefix(PROGRAM))
            for option, value in SMALL.items():
                if option in words and "%" not in line:
                    words[words.index(option) + 1] = value
                elif option in ALWAYS and option not in words:
                    words += [option, value]
            yield words[words[:1] == ["bake"] :]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    quick_assets.quicken(monkeypatch)
    return tmp_path


def ball(rings=16):
    """(points, triangles) of a ball, which is no object of the scene."""
    obj = zoo.ball("made", rings)
    points = np.empty(len(obj.data.vertices) * 3, np.float32)
    obj.data.vertices.foreach_get("co", points)
    faces = np.array([face.vertices[:] for face in obj.data.polygons])
    bpy.data.meshes.remove(obj.data)
    return points.reshape(-1, 3), faces


def painted(path, shift=0.0):
    """A .ply of a ball that is red on one half."""
    points, faces = ball()
    colors = np.where(points[:, :1] > 0, [[200, 0, 0]], [[0, 0, 200]]).astype(np.uint8)
    scans.write_ply(path, points + shift, faces, colors=colors)


def export(path, *objects):
    bpy.ops.object.select_all(action="DESELECT")
    for obj in objects:
        obj.select_set(True)
    if path.suffix == ".stl":
        bpy.ops.wm.stl_export(filepath=str(path), export_selected_objects=True)
    else:
        bpy.ops.wm.obj_export(filepath=str(path), export_selected_objects=True)


def run(heading):
    """Run the commands below a heading, one after the other. Returns how many there were."""
    number = 0
    for words in commands(heading):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        assert command.run(words) == 0, words
        number += 1
    return number


def test_all_commands_belong_to_a_section():
    whole = sum(text.count(PROGRAM) for language, text in blocks(PAGE) if language == "sh")
    headings = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("## ")]
    assert headings == ["## Generated meshes", "## Museums and anatomy", "## City tiles", "## Avatars"]
    assert whole == sum(len(list(commands(heading))) for heading in headings) == 8


def test_generated_meshes(folder):
    painted(folder / "generated.ply")
    bpy.ops.wm.ply_import(filepath="generated.ply")
    bpy.context.object.data.shade_smooth()
    bpy.ops.export_scene.gltf(filepath="generated.glb", export_vertex_color="ACTIVE")
    assert run("## Generated meshes") == 2
    for name, triangles in (("prop", 400), ("kept", 2 * 32 * 15)):
        tree, _ = glb.parse(folder / "out" / f"{name}.glb")
        corners = tree["accessors"][tree["meshes"][0]["primitives"][0]["indices"]]["count"]
        assert corners / 3 == pytest.approx(triangles, abs=4)
        assert tree["images"]


def test_museums_and_anatomy(folder):
    painted(folder / "vase.ply")
    for name, x in (("skull", 0.0), ("jaw", 3.0)):
        obj = zoo.ball(name, 12)
        obj.location.x = x
        export(folder / f"{name}.stl", obj)
    assert run("## Museums and anatomy") == 2
    assert {path.name for path in (folder / "out").glob("*")} >= {
        "vase.glb",
        "vase.json",
        "head.glb",
        "head_part_id.png",
    }


def test_city_tiles(folder):
    (folder / "tiles").mkdir()
    for name, slope in (("tile_1", 0.1), ("tile_2", 0.2)):
        export(folder / "tiles" / f"{name}_low.obj", zoo.plane(f"{name}_low"))
        export(folder / "tiles" / f"{name}_high.obj", zoo.plane(f"{name}_high", slope=slope))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    zoo.terrain("Tile", 16)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "city.blend"))
    assert run("## City tiles") == 2
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert names >= {"maps/tile_1_low.png", "maps/tile_2_low_base_color.png", "maps/tiles.json", "lods/tile.glb"}


def test_avatars(folder):
    gltf_characters.character(folder / "avatar.glb")
    assert run("## Avatars") == 2
    before, _ = glb.parse(folder / "avatar.glb")
    after, _ = glb.parse(folder / "out" / "one.glb")
    assert len(after["materials"]) < len(before["materials"])
    light, _ = glb.parse(folder / "out" / "light.glb")
    assert light["skins"] and light["meshes"][0]["primitives"][0]["targets"]
