# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests a table of a hundred kinds of files that bakes depend on: after a change of one its bake is done again, and one that is
missing, or ends too early, is named."""

import json
import os
import subprocess
import sys
from contextlib import contextmanager

import bpy
import numpy as np
import pytest

from addon.cli import clashes, command, job_file
from addon.cli.clashes import InputFiles
from addon.cli.options import RunOptions
from addon.cli.work_queue import ResumeQueue
from scripts.imprint import ROOT
from tests.support import dependency_kinds, file_kinds, reports, zoo


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """A folder with a bake of each kind that is done, with its record, and the file that each depends on."""
    folder, files, sets = tmp_path_factory.mktemp("table"), {}, []
    for name, make in file_kinds.KINDS.items():
        (folder / name).mkdir()
        files[name], options = make(folder / name)
        sets.append({"name": name, "output": f"out/{name}.png", **options})
    write_jobs(folder, sets)
    first = run(folder)
    assert {name: each["error"] for name, each in first.items() if each["state"] != "done"} == {}
    assert {each["state"] for each in run(folder).values()} == {"resumed"}
    return folder, files


def write_jobs(folder, sets):
    values = {"size": 16, "limit": 9, "method": "cast"}
    (folder / "j.json").write_text(json.dumps({"defaults": values, "bake": sets}))


def run(folder, *words):
    """The entries of the report of a run that leaves out what is done, by the names of bakes."""
    code = command.run(
        ["--jobs", str(folder / "j.json"), "--report", str(folder / "r.json"), "--resume", "--workers", "0", *words]
    )
    assert code in (0, 1)
    return {
        each["name"].partition("(")[2].rstrip(")") or each["name"]: each for each in reports.bakes(folder / "r.json")
    }


def left_out(folder):
    """The names of the bakes that are done."""
    sets = job_file.read(str(folder / "j.json"), [], lambda _: None)
    planned, *_ = clashes.plan_call(RunOptions(jobs=str(folder / "j.json")), sets, InputFiles())
    with ResumeQueue(planned) as turns:
        return {each.name.partition("(")[2][:-1] for each in turns.done}


@contextmanager
def changed(files, change):
    """Change the content of files, and put their times back."""
    before = {path: (path.read_bytes(), path.stat()) for path in set(files)}
    try:
        for path, (content, state) in before.items():
            new = change(content)
            path.unlink()
            if new is not None:
                path.write_bytes(new)
                os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
        yield
    finally:
        for path, (content, _) in before.items():
            path.write_bytes(content)


def flipped(content):
    """The same number of bytes, of which one differs."""
    at = len(content) // 2
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


@pytest.mark.slow
def test_each_of_a_hundred_kinds_of_files_is_known_when_it_changes(table):
    """Their size and time stay."""
    folder, files = table
    assert len(files) >= 100
    assert left_out(folder) == set(files)
    with changed(files.values(), flipped):
        assert left_out(folder) == set()


MISSING = {
    "material_sequence": "is an image sequence",
    "nodes_bake": "has no faces",
}
"""What is said of a file that is missing, where another sentence comes first."""
CUT = {
    "nodes_import_ply": "PLY Importer: failed",
    "points_of_gltf": "buffer is smaller",
    "usd_cache": "Blender leaves out the modifier 'cache'",
} | MISSING
"""What is said of a file that ends too early."""
WITHOUT_END = {".mtl", ".csv", ".txt"}
"""Text that may end anywhere."""


@pytest.mark.slow
@pytest.mark.parametrize("is_cut", [False, True])
def test_a_file_that_is_missing_or_ends_too_early_is_named(table, is_cut):
    folder, files = table
    chosen = dict(files)
    if is_cut:
        del chosen["alembic_cache"]  # ends Blender while it opens the scene, which fails the bake of a worker
    with changed(chosen.values(), (lambda content: content[: len(content) // 2]) if is_cut else lambda _: None):
        found = run(folder)
    texts = CUT if is_cut else MISSING
    silent = {}
    for name, path in chosen.items():
        each = found[name]
        said = " ".join([each["error"], *(text for report in each["reports"] for text in report["warnings"])])
        is_named = path.name in said or (name in texts and texts[name] in said)
        if is_cut and path.suffix in WITHOUT_END:
            is_named = each["state"] == "done"
        if not is_named:
            silent[name] = each["state"], said
    assert silent == {}


IN_WORKERS = [
    *("alembic_cache", "usd_layer_of_a_layer", "binary_usd_reference", "high_obj", "high_stl_of_text", "image_of_usda"),
    *(
        "dynamic_paint_cache",
        "displace_movie",
        "volume_to_mesh",
        "linked_high",
        "displace_image_hdr",
        "material_image_jpg",
    ),
]


@pytest.mark.slow
def test_a_shell_does_them_again_and_fails(tmp_path):
    """In processes of their own: an Alembic file that ends too early ends one while it opens the scene."""
    files, sets = {}, []
    for name in IN_WORKERS:
        (tmp_path / name).mkdir()
        files[name], options = file_kinds.KINDS[name](tmp_path / name)
        sets.append({"name": name, "output": f"out/{name}.png", **options})
    write_jobs(tmp_path, sets)
    words = [sys.executable, str(ROOT / "scripts" / "bake.py"), "--jobs", "j.json", "--resume", "--report", "r.json"]

    def states():
        done = subprocess.run([*words, "--workers", "1"], cwd=tmp_path, capture_output=True, text=True, check=False)
        return done.returncode, {each["state"] for each in reports.bakes(tmp_path / "r.json")}, done.stderr

    assert states()[:2] == (0, {"done"})
    assert states()[:2] == (0, {"resumed"})
    with changed(files.values(), lambda content: content[: len(content) // 2]):
        code, found, said = states()
        assert (code, found) == (1, {"failed"})
        assert {name for name in files if f"({name})" not in said} == set()


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
    assert "--allow-missing-files" in err
    assert not (tmp_path / "skin_out.png").exists()
    command.run([*words, "--allow-missing-files"])
    assert str(path) in capfd.readouterr().err


@pytest.mark.parametrize("role", ["high", "cage"])
def test_a_bake_whose_nodes_compute_the_path_of_a_file_is_done_again(role, tmp_path, capfd):
    objects = {name: zoo.plane(name, 8) for name in ("low", "high", "cage")}
    dependency_kinds.nodes_import_by_text_node(objects[role], tmp_path)
    modifier = objects[role].modifiers[0]
    node = next(each for each in modifier.node_group.nodes if each.bl_idname == "GeometryNodeImportOBJ")
    tree = modifier.node_group
    text, joined = node.inputs[0].links[0].from_node, tree.nodes.new("GeometryNodeStringJoin")
    tree.links.new(text.outputs[0], joined.inputs["Strings"])
    tree.links.new(joined.outputs[0], node.inputs[0])
    if role == "cage":
        end = next(each for each in tree.nodes if each.type == "GROUP_OUTPUT")
        tree.links.new(next(each for each in tree.nodes if each.type == "GROUP_INPUT").outputs[0], end.inputs[0])
    blend = str(tmp_path / "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=blend)
    write_jobs(tmp_path, [{"name": "computed", "file": blend, "output": "computed.png", **PARTS}])
    for _ in range(2):
        assert run(tmp_path)["computed"]["state"] == "done"
        assert "the node 'Import OBJ' of 'nodes' computes the path of its file" in capfd.readouterr().err


PARTS = {"low": "low", "high": ["high"], "cage": "cage"}


@pytest.mark.parametrize("is_cache", [False, True])
def test_a_usd_file_whose_layers_cannot_be_followed_is_read_again(is_cache, tmp_path, capfd):
    if is_cache:
        _, options = file_kinds.KINDS["usd_cache_of_layers"](tmp_path)
    else:
        _, options = file_kinds.KINDS["usd_sublayer"](tmp_path)
    root = tmp_path / "root.usda"
    more = 'customLayerData = { string templateAssetPath = "./clip.##.usd" }\n    subLayers'
    root.write_text(root.read_text().replace("subLayers", more))
    write_jobs(tmp_path, [{"name": "clips", "output": "clips.png", **options}])
    for _ in range(2):
        assert run(tmp_path)["clips"]["state"] == "done"
        assert f"{str(root)!r} names files in a way that cannot be followed, so --resume" in capfd.readouterr().err


SOME = ["usd_reference", "usd_layer_of_a_layer", "usd_cache_of_layers", "dynamic_paint_cache"]


def test_layers_and_caches_are_known_when_they_change(tmp_path):
    """A few of the kinds of the table."""
    files, sets = {}, []
    for name in SOME:
        (tmp_path / name).mkdir()
        files[name], options = file_kinds.KINDS[name](tmp_path / name)
        sets.append({"name": name, "output": f"out/{name}.png", **options})
    write_jobs(tmp_path, sets)
    assert {each["state"] for each in run(tmp_path).values()} == {"done"}
    assert left_out(tmp_path) == set(SOME)
    with changed(files.values(), flipped):
        assert left_out(tmp_path) == set()


def test_a_tile_that_faces_show_and_that_no_file_has_is_named(tmp_path, capsys):
    path, options = file_kinds.KINDS["tile_of_obj"](tmp_path)
    words = ["--low-file", options["low-file"], "--high-file", options["high-file"][0], "--maps", "base-color"]
    words += ["--output", str(tmp_path / "m.png"), "--size", "16"]
    assert command.run(words) == 0
    path.unlink()
    assert command.run(words) == 1
    assert repr(str(path)) in capsys.readouterr().err
    assert command.run([*words, "--allow-missing-files"]) == 0
    assert repr(str(path)) in capsys.readouterr().err


def test_a_map_takes_the_place_of_no_layer(tmp_path, capsys):
    path, options = file_kinds.KINDS["usd_reference"](tmp_path)
    content = path.read_bytes()
    words = ["--low-file", options["low-file"], "--high-file", options["high-file"][0], "--export", str(path)]
    assert command.run([*words, "--output", str(tmp_path / "m.png"), "--size", "16"]) == 2
    assert "what 'root.usda' refers to" in capsys.readouterr().err
    assert path.read_bytes() == content
