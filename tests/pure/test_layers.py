# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the structure of the code by reading its source: imports run one way."""

import ast
import functools
import graphlib
import re
import subprocess
import sys
from pathlib import PurePath

import pytest

from addon.passes import shader
from scripts.imprint import ROOT
from tests.support import programs

ADDON = ROOT / "addon"
MODULES = sorted(path.relative_to(ROOT) for path in ADDON.rglob("*.py"))

MAY_IMPORT = {
    "core": set(),
    "mesh": {"core"},
    "flamenco": {"core"},
    "blocks": {"core"},
    "passes": {"core", "blocks"},
    "older_blender": {"core", "passes", "engine"},
    "scene": {"core", "mesh", "older_blender"},
    "output": {"core", "blocks", "passes", "older_blender"},
    "engine": {"core", "mesh", "passes"},
    "audit": {"core", "mesh", "passes", "engine"},
    "export": {"core", "mesh", "scene", "output", "older_blender"},
    "jobs": {"core", "mesh", "blocks", "passes", "scene", "output", "engine", "audit", "export", "older_blender"},
    "ui": {"core", "mesh", "passes", "scene", "output", "engine", "jobs", "export", "flamenco", "older_blender"},
    "cli": {"core", "flamenco", "scene", "output", "jobs", "export", "older_blender"},
    "api": {"core", "blocks", "scene", "jobs", "older_blender"},
    "": {"core", "passes", "engine", "ui", "cli"},  # addon/__init__.py, which registers, runs and frees
}
"""The packages that each package may import."""
WITHOUT = {
    "core": {"bpy", "gpu", "mathutils", "bmesh"},
    "mesh": {"bpy", "gpu", "mathutils", "bmesh"},
    "blocks": {"bpy", "gpu", "mathutils", "bmesh"},
    "flamenco": {"bpy", "gpu", "mathutils", "bmesh"},
    "passes": {"bpy", "bmesh"},
    "engine": {"bpy", "bmesh"},
    "audit": {"bpy", "bmesh"},
}
"""The modules of Blender that each package must not import."""
WITHOUT_BLENDER = "addon/cli", "addon/output/atomic_file", "addon/output/path_clashes"
"""Folders and modules that need no Blender, although others of their package do. They import only what needs none."""
WITH_BLENDER = {
    *(
        "addon/cli/baker.py",
        "addon/cli/changed_parts.py",
        "addon/cli/input_checks.py",
        "addon/cli/scene_files.py",
        "addon/cli/scene_jobs.py",
    ),
    "addon/cli/worker.py",
}
"""The modules in these folders that do."""


@functools.cache
def parsed(path):
    """The tree of a file, parsed as the oldest Python does."""
    return ast.parse((ROOT / path).read_text(encoding="utf-8"), feature_version=(3, 11))


@functools.cache
def nodes(path):
    """All nodes of a file: each is walked once, as this takes most of the time of these tests."""
    return list(ast.walk(parsed(path)))


def attributes(path):
    """Where a name is taken from another one: `x.y`."""
    return [node for node in nodes(path) if isinstance(node, ast.Attribute)]


def imports(path, *, at_once=False):
    """The modules that a file imports, as "addon/core/errors" for Imprint's own, and "bpy" for others.

    at_once: only those that it imports when it is imported, and not in functions.
    """
    here = path.parent.parts
    tree = parsed(path)
    for_types = {node for branch in tree.body if is_for_types(branch) for node in ast.walk(branch)}
    for node in tree.body if at_once else nodes(path):
        if not isinstance(node, ast.Import | ast.ImportFrom) or node in for_types:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name.replace(".", "/") for alias in node.names)
        else:
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


def test_one_module_uses_the_network():
    network = {"socket", "ssl", "http", "urllib/request", "ftplib", "smtplib", "socketserver", "xmlrpc"}
    using = {
        path.as_posix()
        for path in MODULES
        for name in imports(path)
        if not {name, name.split("/")[0]}.isdisjoint(network)
    }
    assert using == {"addon/flamenco.py"}


def test_state_is_in_objects():
    """No function assigns to a global name."""
    found = [(path.as_posix(), node.names) for path in MODULES for node in nodes(path) if isinstance(node, ast.Global)]
    assert found == []


# Older blender


OLDER = PurePath("addon/older_blender.py")
OTHERS = [path for path in MODULES if path != OLDER]


def calls_of(path):
    """The functions of older_blender.py that a module calls."""
    return {node.attr for node in attributes(path) if ast.unparse(node.value) == "older_blender"}


def test_each_function_is_called_and_says_what_5_2_does():
    functions = {
        node.name: ast.get_docstring(node)
        for node in parsed(OLDER).body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
    }
    assert set(functions) == set().union(*map(calls_of, OTHERS))
    assert [name for name, text in functions.items() if not text.startswith("In 5.2: ")] == []


def test_no_other_module_starts_the_gpu():
    assert [path for path in OTHERS if "gpu.init" in ends_of(path, "init")] == []


def ends_of(path, name):
    """What a module takes by this name, from whatever: {"gpu.init", "bpy.data.x.init"}."""
    return {ast.unparse(node) for node in attributes(path) if node.attr == name}


# Program


PROGRAMS = programs.find_all()


def files_of(declared):
    """The shader files of a program."""
    return [name for name in (declared.vertex, declared.fragment, declared.compute) if name]


def test_every_file_is_used_and_named_for_its_stage():
    used = {name for each in PROGRAMS.values() for name in files_of(each)}
    files = {path.relative_to(shader.SHADERS).as_posix(): path for path in shader.SHADERS.rglob("*.glsl")}
    for name, path in files.items():
        stage = path.stem.rsplit("_", 1)[1]
        text = path.read_text(encoding="utf-8")
        assert text.count("void main()") == (0 if stage == "lib" else 1), name
        if stage == "lib":
            is_included = any(f'#include "{name}"' in other.read_text(encoding="utf-8") for other in files.values())
            assert is_included or any(each.library == name for each in PROGRAMS.values())
        else:
            assert stage in {"vert", "frag", "comp"}
            assert name in used


def test_includes_are_resolved_once_and_lines_keep_their_numbers(tmp_path, monkeypatch):
    (tmp_path / "a_lib.glsl").write_text("float a_one() { return 1.0; }\n")
    (tmp_path / "b_lib.glsl").write_text('#include "a_lib.glsl"\nfloat b_one() { return a_one(); }\n')
    (tmp_path / "c_frag.glsl").write_text('#include "a_lib.glsl"\n#include "b_lib.glsl"\nvoid main() {}\n')
    monkeypatch.setattr(shader, "SHADERS", tmp_path)
    text = shader.source("c_frag.glsl")
    assert text.count("float a_one") == 1
    assert text.count("float b_one") == 1
    assert "#include" not in text
    assert text.splitlines()[text.splitlines().index("void main() {}") - 1] == "#line 3"


@pytest.mark.parametrize("declared", PROGRAMS.values(), ids=PROGRAMS)
def test_shaders_use_all_declared_names(declared):
    """Some drivers remove unused names, and setting them is an error."""
    text = "\n".join(shader.source(name, *declared.before) for name in files_of(declared))
    words = set(re.findall(r"\w+", text))
    varyings = declared.varyings + declared.flat
    kinds = (declared.inputs, varyings, declared.samplers, declared.constants, declared.outputs)
    names = [name for kind in kinds for _, name in kind]
    names += [name for _, _, name in declared.texels] + [name for _, _, name, _ in declared.images]
    assert names
    assert len(set(names)) == len(names)
    assert [name for name in names if name not in words] == []


BYTES = {
    "INT": (4, 4),
    "FLOAT": (4, 4),
    "VEC2": (8, 8),
    "VEC3": (12, 16),
    "VEC4": (16, 16),
    "IVEC4": (16, 16),
    "MAT4": (64, 16),
}
"""The size of a constant, and the number of bytes of which its place is a multiple."""
MOST_CONSTANTS = 128
"""The bytes of push constants that every Vulkan driver supports."""


@pytest.mark.parametrize("declared", PROGRAMS.values(), ids=PROGRAMS)
def test_constants_fit_on_every_vulkan_driver(declared):
    end = 0
    for kind, _ in declared.constants:
        size, multiple = BYTES[kind]
        end = -(-end // multiple) * multiple + size
    assert end <= MOST_CONSTANTS


@pytest.mark.parametrize("path", sorted(shader.SHADERS.rglob("*_lib.glsl")), ids=lambda path: path.stem)
def test_names_of_a_library_start_with_its_own(path):
    text = path.read_text(encoding="utf-8")
    defined = re.findall(r"^(?:const )?(?:int|float|[iu]?vec\d|mat\d) (\w+)", text, re.MULTILINE)
    own = path.stem.removesuffix("_lib")
    assert [name for name in defined if not name.lower().startswith(f"{own}_")] == []


@pytest.mark.parametrize(
    ("renderer", "expected"),
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", True),
        ("Google SwiftShader", True),
        ("NVIDIA H200/PCIe/SSE2", False),
        ("AMD Radeon RX 7900 XTX (radeonsi, navi31, LLVM 17.0.6)", False),
        ("Intel(R) UHD Graphics 620", False),
        ("Apple M3 Max", False),
    ],
)
def test_software_renderers_are_recognized(renderer, expected):
    assert shader.is_software(renderer) == expected


IN_A_SHELL = "cli", "flamenco", "core/declarations", "core/errors", "core/processes", "api"
"""Below addon/: what only a shell shows or starts, and the clauses that a window leaves out."""


def test_no_sentence_of_a_window_names_an_option():
    named = {
        (str(path), node.value)
        for path in MODULES
        if not path.as_posix().removeprefix("addon/").startswith(IN_A_SHELL)
        for node in nodes(path)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        if re.search(r"(?<![\w-])--[a-z]", node.value) and not _is_docstring(path, node)
    }
    assert named == set()


def _is_docstring(path, node):
    """Whether a text stands alone, as a docstring does."""
    return any(isinstance(each, ast.Expr) and each.value is node for each in nodes(path))
