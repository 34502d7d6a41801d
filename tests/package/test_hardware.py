# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that the script that times shaders without Blender gives them all that they take, from the file of the other script."""

import sys
from unittest.mock import MagicMock

import bpy
import numpy as np
import pytest

from addon.core.declarations.choices import Hit
from scripts.dev import export
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


@pytest.fixture
def hardware(monkeypatch):
    """The script, without moderngl, which needs a GPU of its own."""
    monkeypatch.setitem(sys.modules, "moderngl", MagicMock())
    monkeypatch.delitem(sys.modules, "scripts.dev.hardware", raising=False)
    from scripts.dev import hardware

    return hardware


@pytest.mark.parametrize("as_images", [False, True])
def test_shaders_get_all_that_they_take(hardware, tmp_path, as_images):
    zoo.cube("lo")
    zoo.sphere("hi")
    file = tmp_path / "pair.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    export.export(file, tmp_path / "pair.npz")
    gpu = MagicMock()
    for made in (gpu.program.return_value, gpu.compute_shader.return_value):
        made.__contains__.return_value = True  # the compiler keeps every constant
    with np.load(tmp_path / "pair.npz") as data:
        scene = hardware.Scene(gpu, dict(data), 8, as_images=as_images)
    scene.bake_flat()
    scene.start_rays()
    for rule in Hit:
        scene.cast_rays(rule)
    scene.look_up()
    assert gpu.compute_shader.return_value.run.call_count == 2 * len(Hit)  # packets, then rays
