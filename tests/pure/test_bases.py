# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the declarations of bases, on which shaders rely."""

import argparse
import re

import pytest

from addon.cli import option_types
from addon.core.declarations import bases
from addon.core.declarations.all_settings import DECLARED
from addon.passes import lit
from scripts.imprint import ROOT

FLAGS = ("bitangent_of_vertices", "normalizes_tangent", "normalizes_bitangent", "normalizes_normal")


def constants(library, prefix):
    """The numbers in a library of shaders whose names have this prefix, by the rest of their names."""
    source = (ROOT / "shaders" / "lib" / f"{library}.glsl").read_text(encoding="utf-8")
    return {name: int(number) for name, number in re.findall(rf"const int {prefix}_(\w+) = (\d+);", source)}


def test_the_shader_has_the_declared_kinds_of_maps():
    assert constants("decode_lib", "DECODE") == {
        "WORLD": lit.WORLD,
        "OBJECT": lit.OBJECT,
        "TANGENT": lit.TANGENT,
        "REBUILT_Z": lit.REBUILT_Z,
    }


@pytest.mark.parametrize("name", FLAGS)
def test_the_shader_has_the_declared_flags_of_bases(name):
    one = bases.Basis("X", "", "", **{name: True})
    assert constants("basis_lib", "BASIS")[name.upper()] == one.flags
    assert set(constants("basis_lib", "BASIS")) == {flag.upper() for flag in FLAGS}


def test_each_basis_has_rules_of_its_own():
    assert len({one.flags for one in bases.BASES}) == len(bases.BASES) == 4


def test_files_of_blender_keep_their_basis():
    """They hold the place in the list."""
    assert DECLARED["basis"].values[:3] == (bases.AUTO, "CYCLES", "MIKKTSPACE")


def test_earlier_names_of_a_basis_are_read_as_its_name():
    read = option_types.one_of(DECLARED["basis"])
    assert [read(word) for word in ("blender", "BLENDER", "cycles", "mikktspace-vertex", "mikktspacevertex")] == [
        "CYCLES",
        "CYCLES",
        "CYCLES",
        "MIKKTSPACE_VERTEX",
        "MIKKTSPACE_VERTEX",
    ]
    with pytest.raises(argparse.ArgumentTypeError, match="auto, cycles, mikktspace, mikktspace-vertex, normalized$"):
        read("blend")


def test_each_render_engine_has_one_basis():
    engines = [engine for one in bases.BASES for engine in one.engines]
    assert len(set(engines)) == len(engines)
    assert all(bases.of_engine(engine).engines.count(engine) for engine in engines)
