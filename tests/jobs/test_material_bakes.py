# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole bakes of the colors of high meshes, against Cycles' emission bake of the same nodes."""

from types import SimpleNamespace

import pytest

from addon.core import map_types
from addon.core.material_feeds import HighMaterial
from addon.core.settings import Settings
from addon.jobs import material_inputs

pytestmark = pytest.mark.usefixtures("gpu_context")


def test_notes_have_the_order_of_the_maps():
    chosen = [map_type for map_type in map_types.OTHERS if map_type.socket]
    sockets = list(dict.fromkeys(map_type.socket for map_type in chosen))  # two maps are of the same roughness
    notes = {socket: (f"{socket} is left out",) for socket in reversed(sockets)} | {
        "": ("shader",),
        "Normal": ("detail",),
    }
    meshes = SimpleNamespace(materials=[HighMaterial("Rust", notes=notes)])
    names = tuple(map_type.name for map_type in chosen)
    found = material_inputs.notes(meshes, Settings(maps=names).map)
    assert found == [*(f"{socket} is left out" for socket in sockets), "shader", "detail"]
    widened = material_inputs.notes(meshes, Settings(maps=(map_types.WIDENED_ROUGHNESS.name,)).map)
    assert widened[0] == "Roughness is left out"
    assert material_inputs.notes(meshes, Settings(detail_maps=False).map) == []
