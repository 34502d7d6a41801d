# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps, file formats, bases and UDIM tiles are named where they are declared and nowhere else. Read from the source."""

import ast
import functools

import pytest

from addon.core import bases, file_formats, map_types, udim
from scripts.imprint import ROOT

ADDON = ROOT / "addon"
FILES = sorted(path for path in ADDON.rglob("*.py") if "presets" not in path.relative_to(ADDON).parts[:-1])
FORMATS = {name for one in file_formats.FORMATS for name in (one.blender, *one.endings)}
DECLARED = {
    "map_types.py": set(map_types.BY_NAME) - {"DISTANCE"},
    "file_formats.py": FORMATS,
    "bases.py": set(bases.BY_NAME),
    "udim.py": {udim.TOKEN, udim.FIRST},
}
"""The file in core/ that declares things, to the constants that name them. DISTANCE is a kind of number in Blender as well."""


@functools.cache
def constants(path):
    """The strings and numbers in a file."""
    return {
        node.value
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str | int)
    }


@pytest.mark.parametrize("owner", DECLARED)
def test_nothing_else_names_what_is_declared(owner):
    found = {
        path.relative_to(ADDON).as_posix(): constants(path) & DECLARED[owner] for path in FILES if path.name != owner
    }
    assert {path: names for path, names in found.items() if names} == {}


def test_the_names_are_found_where_they_are_declared():
    for owner, names in DECLARED.items():
        assert names <= constants(ADDON / "core" / owner) | {udim.FIRST}
