# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the declarations of maps, on which files and shaders rely."""

import re

import pytest

from addon.core import map_types
from addon.core.map_types import Family, Kind
from scripts.imprint import ROOT


def test_names_and_suffixes_are_unique():
    declared = [map_types.NORMAL, map_types.MASK, *map_types.OTHERS]
    assert len(map_types.BY_NAME) == len({map_type.suffix for map_type in declared}) == len(declared)


def test_the_shader_has_the_declared_indices_of_maps():
    source = (ROOT / "shaders" / "bake" / "height_position_ids_frag.glsl").read_text(encoding="utf-8")
    found = {name: int(number) for name, number in re.findall(r"const int INDEX_(\w+) = (\d+);", source)}
    assert found == {map_type.name: map_type.index for map_type in map_types.OTHERS if map_type.family is Family.POINTS}


@pytest.mark.parametrize("map_type", map_types.OTHERS, ids=lambda map_type: map_type.name)
def test_only_label_maps_have_labels_and_they_are_not_deep(map_type):
    assert (map_type.kind is Kind.LABEL) == (map_type.labeled is not None)
    assert not (map_type.kind is Kind.LABEL and map_type.is_deep)
