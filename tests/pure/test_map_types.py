# SPDX-License-Identifier: GPL-3.0-or-later
"""What the declarations of maps have to keep, for files and shaders that rely on them."""

import re

import pytest

from addon.core import map_types
from addon.core.map_types import Kind
from scripts.imprint import ROOT


def test_names_and_suffixes_are_unlike():
    every = [map_types.NORMAL, map_types.MASK, *map_types.OTHERS]
    assert len(map_types.BY_NAME) == len({one.suffix for one in every}) == len(every)


def test_the_shader_numbers_the_maps_as_they_are_declared():
    source = (ROOT / "shaders" / "bake" / "other_map_values_frag.glsl").read_text(encoding="utf-8")
    found = {name: int(number) for name, number in re.findall(r"const int INDEX_(\w+) = (\d+);", source)}
    assert found == {one.name: one.index for one in map_types.OTHERS if one.index >= 0}


@pytest.mark.parametrize("one", map_types.OTHERS, ids=lambda one: one.name)
def test_labels_are_of_something_and_take_few_bits(one):
    assert (one.kind is Kind.LABEL) == (one.labeled is not None)
    assert not (one.kind is Kind.LABEL and one.is_deep)
