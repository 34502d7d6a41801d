# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the structure of the code by reading its source: imports run one way."""

import ast
import functools
import graphlib
import subprocess
import sys
from pathlib import PurePath

from scripts.imprint import ROOT

ADDON = ROOT / "addon"
TESTS_IN_THE_WINDOW = sorted(
    path.relative_to(ROOT) for folder in ("ui", "window") for path in (ROOT / "tests" / folder).glob("*.py")
)
MODULES = sorted(
    path.relative_to(ROOT) for path in ADDON.rglob("*.py") if "presets" not in path.relative_to(ADDON).parts[:-1]
)

MAY_IMPORT = {
    "core": set(),
    "mesh": {"core"},
    "flamenco": {"core"},
    "passes": {"core"},
    "older_blender": {"core", "passes", "engine"},
    "scene": {"core", "mesh", "older_blender"},
    "output": {"core", "older_blender"},
    "engine": {"core", "mesh", "passes"},
    "audit": {"core", "mesh", "passes", "engine"},
    "export": {"core", "mesh", "scene", "output", "older_blender"},
    "jobs": {"core", "mesh", "passes", "scene", "output", "engine", "audit", "export", "older_blender"},
    "ui": {"core", "mesh", "passes", "scene", "output", "engine", "jobs", "export", "flamenco", "older_blender"},
    "cli": {"core", "flamenco", "scene", "output", "jobs", "export", "older_blender"},
    "api": {"core", "jobs", "cli"},
    "": {"passes", "engine", "ui", "cli"},  # addon/__init__.py, which registers and frees
}
"""The packages that each package may import."""
WITHOUT = {
    "core": {"bpy", "gpu", "mathutils", "bmesh"},
    "mesh": {"bpy", "gpu", "mathutils", "bmesh"},
    "flamenco": {"bpy", "gpu", "mathutils", "bmesh"},
    "passes": {"bpy", "bmesh"},
    "engine": {"bpy", "bmesh"},
    "audit": {"bpy", "bmesh"},
}
"""The modules of Blender that each package must not import."""
WITHOUT_BLENDER = "addon/cli", "addon/output/atomic_file", "addon/output/path_clashes"
"""Folders and modules that need no Blender, although others of their package do. They import only what needs none."""
WITH_BLENDER = {
    *("addon/cli/batch.py", "addon/cli/importers.py", "addon/cli/input_checks.py", "addon/cli/scene_files.py"),
    "addon/cli/worker.py",
}
"""The modules in these folders that do."""


@functools.cache
def parsed(path):
    return ast.parse((ROOT / path).read_text(encoding="utf-8"))


def imports(path, *, at_once=False):
    """The modules that a file imports, as "addon/core/errors" for Imprint's own, and "bpy" for others.

    at_once: only those that it imports when it is imported, and not in functions.
    """
    here = path.parent.parts
    tree = parsed(path)
    for_types = {node for branch in tree.body if is_for_types(branch) for node in ast.walk(branch)}
    for node in tree.body if at_once else ast.walk(tree):
        if node in for_types:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name.replace(".", "/") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = list(here[: len(here) - node.level + 1]) if node.level else []
            base += (node.module or "").split(".") if node.module else []
            # "from . import x" imports modules, "from .x import y" imports their contents.
            found = ["/".join([*base, alias.name]) for alias in node.names]
            yield from (name if is_module(name) else "/".join(base) for name in found)


def is_for_types(node):
    """Whether the node is `if TYPE_CHECKING:`, whose imports never run."""
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def is_module(name):
    return (ROOT / name).is_dir() or (ROOT / f"{name}.py").is_file()


def package(name):
    """The package of a module, "" for addon/__init__.py, or None for modules outside addon/."""
    parts = PurePath(name).as_posix().removesuffix(".py").removesuffix("/__init__").split("/")
    if parts[0] != "addon":
        return None
    return parts[1] if len(parts) > 1 else ""


def test_the_table_names_each_package():
    assert {package(path) for path in MODULES} == set(MAY_IMPORT)


def test_the_table_has_no_circle():
    left = dict(MAY_IMPORT)
    while left:
        free = [name for name, others in left.items() if not others & set(left)]
        assert free, f"these import each other: {left}"
        for name in free:
            del left[name]


def test_imports_run_one_way():
    wrong = [
        (path.as_posix(), name)
        for path in MODULES
        for name in imports(path)
        if package(name) not in MAY_IMPORT[package(path)] | {package(path), None}
    ]
    assert wrong == []


def test_modules_import_each_other_in_no_circle():
    graph = {path.with_suffix("").as_posix(): set(imports(path, at_once=True)) for path in MODULES}
    graphlib.TopologicalSorter({name: found & set(graph) for name, found in graph.items()}).prepare()


def test_packages_do_not_import_forbidden_modules():
    wrong = [
        (path.as_posix(), name)
        for path in MODULES
        for name in imports(path)
        if name.split("/")[0] in WITHOUT.get(package(path), ())
    ]
    assert wrong == []


def test_folders_without_blender_import_none():
    names = [
        ".".join(path.with_suffix("").parts)
        for path in MODULES
        if {path.parent.as_posix(), path.with_suffix("").as_posix()} & set(WITHOUT_BLENDER)
        and path.as_posix() not in WITH_BLENDER
    ]
    program = f"import importlib, sys; [importlib.import_module(name) for name in {names}]; print('bpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_state_is_in_objects():
    """No function assigns to a global name."""
    found = [
        (path.as_posix(), node.names)
        for path in MODULES
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.Global)
    ]
    assert found == []


def test_tests_of_the_window_use_public_names():
    private = [
        (path.as_posix(), node.attr)
        for path in TESTS_IN_THE_WINDOW
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.Attribute) and is_private(node)
    ]
    assert private == []


def is_private(attribute):
    """Whether an attribute is private to another object: `x._y`, but not `self._y`."""
    is_own = isinstance(attribute.value, ast.Name) and attribute.value.id == "self"
    return attribute.attr.startswith("_") and not attribute.attr.startswith("__") and not is_own


def test_blenders_entry_point_imports_nothing_until_it_is_called():
    tree = ast.parse((ROOT / "__init__.py").read_text(encoding="utf-8"))
    imported = [ast.unparse(node) for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    assert imported == ["from typing import TYPE_CHECKING, Any"]
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert functions == {"register", "unregister", "__getattr__"}
