# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests a table of files that bakes depend on: after a change of one its bake is done again, and one that is missing, or ends
too early, is named."""

import json

import bpy
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
