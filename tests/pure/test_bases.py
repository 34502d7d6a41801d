# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the declarations of bases, on which shaders rely."""

import re

from addon.core.declarations import bases
from addon.passes.view import lit
from scripts.imprint import ROOT


def test_the_shader_has_the_declared_indices_of_bases():
    source = (ROOT / "shaders" / "lib" / "map_lib.glsl").read_text(encoding="utf-8")
    found = {name: int(number) for name, number in re.findall(r"const int MAP_(\w+) = (\d+);", source)}
    declared = {one.name: one.index for one in bases.BASES}
    assert found == {"WORLD": lit.WORLD, "OBJECT": lit.OBJECT, **declared}


def test_each_render_engine_has_one_basis():
    engines = [engine for one in bases.BASES for engine in one.engines]
    assert len(set(engines)) == len(engines)
    assert all(bases.of_engine(engine).engines.count(engine) for engine in engines)
