# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that code for older versions of Blender is in one file, and that few lines call it."""

import ast
import functools
import tomllib
from collections import Counter

from scripts.imprint import ROOT

ADDON = ROOT / "addon"
CALLS = {
    ("jobs/job.py", "start_gpu"): 1,
    ("cli/batch.py", "start_gpu"): 1,
    ("cli/batch.py", "with_gpu"): 1,
    ("jobs/bake_jobs.py", "with_gpu"): 1,
    ("jobs/convert.py", "with_gpu"): 1,
    ("ui/modal.py", "with_gpu"): 1,
    ("jobs/lod.py", "start_gpu"): 1,
    ("output/map_nodes.py", "normal_map_values"): 2,
    ("output/map_nodes.py", "normal_map_color"): 1,
    ("export/staging.py", "exported_channels"): 1,
    ("export/staging.py", "switch_on_nodes"): 1,
    ("scene/materials/material_reading.py", "shows_nodes"): 1,
    ("output/materials.py", "switch_on_nodes"): 2,
    ("cli/importers.py", "switch_on_nodes"): 1,
    ("scene/dependencies.py", "kept_properties"): 1,
    ("scene/dependencies.py", "modifier_input"): 2,
    ("scene/dependencies.py", "visit_file_paths"): 1,
    ("cli/scene_files.py", "visit_file_paths"): 1,
}
"""What to change when older versions are dropped: the docstrings of older_blender.py say into what."""


@functools.cache
def trees():
    """Each module of the add-on but the one for older versions, by its path in addon/, parsed as Python 3.11 does."""
    return [
        (path.relative_to(ADDON).as_posix(), ast.parse(path.read_text(encoding="utf-8"), feature_version=(3, 11)))
        for path in sorted(ADDON.rglob("*.py"))
        if path.name != "older_blender.py"
    ]


def test_the_calls_are_known():
    found = Counter(
        (path, node.attr)
        for path, tree in trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "older_blender"
    )
    assert found == CALLS


def test_each_function_says_what_5_2_does():
    tree = ast.parse((ADDON / "older_blender.py").read_text(encoding="utf-8"))
    functions = {
        node.name: ast.get_docstring(node)
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
    }
    assert set(functions) == {name for _, name in CALLS}
    assert [name for name, text in functions.items() if not text.startswith("In 5.2: ")] == []


def test_no_other_module_asks_for_the_version_of_blender():
    found = [
        (path, node.attr)
        for path, tree in trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and node.attr in {"version", "version_string"} and "app" in ast.unparse(node)
    ]
    assert found == [("core/versions.py", "version")]  # for reports


def test_new_materials_get_nodes():
    makers = {path for path, tree in trees() if "bpy.data.materials.new(" in ast.unparse(tree)}
    assert makers == {path for path, name in CALLS if name == "switch_on_nodes"}


def test_no_other_module_starts_the_gpu():
    found = [
        path
        for path, tree in trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and ast.unparse(node) == "gpu.init"
    ]
    assert found == []


def test_the_manifest_names_the_oldest_version():
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert manifest["blender_version_min"] == "4.5.0"
