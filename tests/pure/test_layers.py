# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports run one way: what a person touches, then bake, then passes and mesh. Read from the source, nothing is run."""

import ast

import pytest

from scripts.imprint import ROOT

ADDON = ROOT / "addon"
MODULES = sorted(path.relative_to(ROOT) for path in ADDON.rglob("*.py"))

MAY_IMPORT = {
    "ui": {"ui", "bake", "passes"},  # passes for no more than freeing them
    "bake": {"bake", "passes", "mesh"},
    "passes": {"passes"},
    "mesh": {"mesh"},
}
PURE = [
    *("addon/bake/settings.py", "addon/bake/errors.py", "addon/bake/report.py", "addon/mesh/arrays.py"),
    *("addon/bake/files.py", "addon/bake/places.py", "addon/companions.py"),
]
"""Plain data and numbers: of use without Blender."""


def imports(path):
    """The modules that a file imports anywhere, as ("addon/bake/errors", ...) for ours and ("bpy", ...) for others."""
    here = path.parent.parts
    for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.replace(".", "/") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = list(here[: len(here) - node.level + 1]) if node.level else []
            base += (node.module or "").split(".") if node.module else []
            # "from . import x" names modules, "from .x import y" their contents.
            found = ["/".join([*base, alias.name]) for alias in node.names]
            yield from (name if is_module(name) else "/".join(base) for name in found)


def is_module(name):
    return (ROOT / name).is_dir() or (ROOT / f"{name}.py").is_file()


def layer(name):
    """The layer of one of our modules, or None for those of others."""
    parts = str(name).removesuffix(".py").split("/")
    if parts[0] != "addon":
        return None
    return parts[1] if len(parts) > 1 and parts[1] in MAY_IMPORT else "ui"


def test_all_layers_are_there():
    assert {layer(path) for path in MODULES} == set(MAY_IMPORT)


@pytest.mark.parametrize("path", MODULES, ids=str)
def test_imports_run_one_way(path):
    ours = {name: layer(name) for name in imports(path) if layer(name)}
    assert {name: where for name, where in ours.items() if where not in MAY_IMPORT[layer(path)]} == {}


@pytest.mark.parametrize("path", [path for path in MODULES if layer(path) == "ui"], ids=str)
def test_what_a_person_touches_knows_of_the_passes_only_that_they_can_be_freed(path):
    assert [name for name in imports(path) if layer(name) == "passes" and name != "addon/passes"] == []


@pytest.mark.parametrize("path", [path for path in MODULES if layer(path) == "passes"], ids=str)
def test_passes_know_nothing_of_blenders_data(path):
    assert "bpy" not in {name.split("/")[0] for name in imports(path)}


@pytest.mark.parametrize("path", PURE)
def test_plain_data_needs_no_blender(path):
    top = {name.split("/")[0] for name in imports(ROOT.joinpath(path).relative_to(ROOT))}
    assert not top & {"bpy", "gpu", "mathutils", "bmesh"}


def test_blenders_door_opens_nothing_before_it_is_asked():
    tree = ast.parse((ROOT / "__init__.py").read_text(encoding="utf-8"))
    assert not [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    assert {node.name for node in tree.body if isinstance(node, ast.FunctionDef)} == {"register", "unregister"}
