# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests, by reading the source, that only the declarations name maps, file formats, bases and UDIM tiles."""

import ast
import functools

import pytest

from addon.core import file_formats, map_types, udim
from addon.core.declarations import bases
from scripts.imprint import ROOT

ADDON = ROOT / "addon"
FILES = sorted(path for path in ADDON.rglob("*.py") if "presets" not in path.relative_to(ADDON).parts[:-1])
FORMATS = {name for one in file_formats.FORMATS for name in one.endings}
DECLARED = {
    "map_types.py": set(map_types.BY_NAME) - {"DISTANCE", "ALPHA"},
    "file_formats.py": FORMATS,
    "bases.py": set(bases.BY_NAME) - {"CYCLES"},
    "udim.py": {udim.TOKEN, udim.FIRST},
}
"""The constants that each declaring file in core/ may name. DISTANCE is also a kind of number in Blender, ALPHA a
way of blending, and CYCLES a render engine."""


@functools.cache
def constants(path):
    """The strings and numbers in a file."""
    return {
        node.value
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str | int)
    }


@pytest.mark.parametrize("owner", DECLARED)
def test_no_other_module_names_declared_constants(owner):
    found = {
        path.relative_to(ADDON).as_posix(): constants(path) & DECLARED[owner] for path in FILES if path.name != owner
    }
    assert {path: names for path, names in found.items() if names} == {}


def test_the_declarations_name_the_constants():
    for owner, names in DECLARED.items():
        assert names <= constants(next(ADDON.glob(f"core/**/{owner}"))) | {udim.FIRST}
