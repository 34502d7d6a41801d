# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests a table of files that bakes depend on: after a change of one its bake is done again, and one that is missing, or ends
too early, is named."""

import json

import bpy
import numpy as np
import pytest

from addon.cli import command
from tests.support import dependency_kinds, reports, zoo


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """A folder with a bake of each kind that is done, with its record, and the file that each depends on."""
    folder, files, sets = tmp_path_factory.mktemp("table"), {}, []
    for name, make in dependency_kinds.KINDS.items():
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        (folder / name).mkdir()
        blend = str(folder / name / "scene.blend")
        bpy.ops.wm.save_as_mainfile(filepath=blend)
        low, high = zoo.plane("low", 8), zoo.plane("high", 8)
        files[name] = make(high, folder / name)
        bpy.ops.wm.save_as_mainfile(filepath=blend)
        sets.append({"name": name, "file": blend, "low": low.name, "high": [high.name], "output": f"out/{name}.png"})
    values = {"size": 16, "limit": 9, "method": "cast", **dependency_kinds.OPTIONS}
    (folder / "j.json").write_text(json.dumps({"defaults": values, "bake": sets}))
    first = run(folder)
    assert {name: each["error"] for name, each in first.items() if each["state"] != "done"} == {}
    assert {each["state"] for each in run(folder).values()} == {"resumed"}
    return folder, files


def run(folder, *words):
    """The entries of the report of a run that leaves out what is done, by the names of bakes."""
    code = command.run(
        ["--jobs", str(folder / "j.json"), "--report", str(folder / "r.json"), "--resume", "--workers", "0", *words]
    )
    assert code in (0, 1)
    return {
        each["name"].partition("(")[2].rstrip(")") or each["name"]: each for each in reports.bakes(folder / "r.json")
    }


def test_a_file_that_has_changed_is_baked_again(table):
    folder, files = table
    for path in files.values():
        path.write_bytes(path.read_bytes() + b"\n")
    found = run(folder)
    assert {name: each["state"] for name, each in found.items()} == dict.fromkeys(files, "done")


@pytest.mark.parametrize("is_cut", [False, True])
def test_a_file_that_is_missing_fails_and_one_that_is_cut_fails_or_is_baked_again(table, is_cut):
    folder, files = table
    before = {name: path.read_bytes() for name, path in files.items()}
    try:
        for name, path in files.items():
            if not is_cut:
                path.unlink()
            elif path.suffix != ".abc":  # ends Blender while it opens the scene, which fails the bake of a worker
                path.write_bytes(before[name][: len(before[name]) // 2])
        found = run(folder)
    finally:
        for name, path in files.items():
            path.write_bytes(before[name])
    if is_cut:
        found.pop("alembic_cache")
    silent = {name for name, each in found.items() if each["state"] != "failed"}
    assert not [name for name in silent if found[name]["state"] == "resumed"]
    # Text has no end that could be missing, and Blender reads what is there.
    assert silent <= ({name for name, path in files.items() if path.suffix in MAY_BE_CUT} if is_cut else set())
    for name in set(found) - silent:
        assert repr(str(files[name])) in found[name]["error"] or "leaves out the modifier" in found[name]["error"]


MAY_BE_CUT = {".obj", ".usda"}


def textured(folder, ending, change):
    """A .blend whose high mesh shows an image file of noise, which `change` was applied to; and the path of the image."""
    low, high = zoo.plane("low"), zoo.plane("high")
    image = bpy.data.images.new("skin", 64, 64)
    image.pixels.foreach_set(np.random.default_rng(1).random(64 * 64 * 4).astype(np.float32))
    path = folder / f"skin{ending}"
    settings = bpy.context.scene.render.image_settings
    settings.file_format = {".png": "PNG", ".jpg": "JPEG", ".tif": "TIFF", ".exr": "OPEN_EXR"}[ending]
    image.save_render(str(path))
    bpy.data.images.remove(image)
    material = bpy.data.materials.new("skin")
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.load(str(path))
    shader = next(each for each in material.node_tree.nodes if each.type == "BSDF_PRINCIPLED")
    material.node_tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    high.data.materials.append(material)
    node.image.buffers_free()
    blend = folder / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    path.write_bytes(change(path.read_bytes()))
    return [str(blend), "--low", low.name, "--high", high.name, "--output", str(folder / "skin_out.png")], path


POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12345\n"
DAMAGE = {
    "a pointer of Git LFS": lambda _: POINTER,
    "a page of a web site": lambda _: b"<!DOCTYPE html><html></html>" * 20,
    "nothing": lambda _: b"",
    "a half": lambda content: content[: len(content) // 2],
}


@pytest.mark.parametrize("ending", [".png", ".jpg", ".tif", ".exr"])
@pytest.mark.parametrize("damage", DAMAGE)
def test_a_texture_that_is_no_whole_image_fails_like_a_missing_one(ending, damage, tmp_path, capfd):
    words, path = textured(tmp_path, ending, DAMAGE[damage])
    words += ["--maps", "base-color", "--no-normal", "--size", "16"]
    assert command.run(words) == 1
    err = capfd.readouterr().err
    assert repr(str(path)) in err
    assert "--allow-missing-pages" in err
    assert not (tmp_path / "skin_out.png").exists()
    command.run([*words, "--allow-missing-pages"])
    assert str(path) in capfd.readouterr().err


def test_a_bake_whose_nodes_compute_the_path_of_a_file_is_done_again(tmp_path, capfd):
    low, high = zoo.plane("low", 8), zoo.plane("high", 8)
    dependency_kinds.nodes_import_by_text_node(high, tmp_path)
    tree = high.modifiers[0].node_group
    node = next(each for each in tree.nodes if each.bl_idname == "GeometryNodeImportOBJ")
    text, joined = node.inputs[0].links[0].from_node, tree.nodes.new("GeometryNodeStringJoin")
    tree.links.new(text.outputs[0], joined.inputs["Strings"])
    tree.links.new(joined.outputs[0], node.inputs[0])
    blend = str(tmp_path / "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=blend)
    sets = [{"name": "computed", "file": blend, "low": low.name, "high": [high.name], "output": "computed.png"}]
    (tmp_path / "j.json").write_text(json.dumps({"defaults": {"size": 16}, "bake": sets}))
    for _ in range(2):
        assert run(tmp_path)["computed"]["state"] == "done"
        assert "the node 'Import OBJ' of 'nodes' computes the path of its file" in capfd.readouterr().err
