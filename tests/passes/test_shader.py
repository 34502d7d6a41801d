# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that all programs compile, and that reading images and reading samplers give the same map."""

import numpy as np
import pytest

from addon import passes
from addon.passes import high_in_uv, shader
from tests.support import programs, zoo
from tests.support.maps import bake

PROGRAMS = programs.find_all()


@pytest.fixture(params=[True, False], ids=["images", "samplers"])
def reading(request, monkeypatch):
    """Run a test twice: programs read their texels as images, for software drivers, and as samplers."""
    shader.load.cache_clear()
    monkeypatch.setattr(shader, "reads_images", lambda: request.param)
    yield
    shader.load.cache_clear()


@pytest.mark.usefixtures("gpu_context", "reading")
@pytest.mark.parametrize("program", PROGRAMS.values(), ids=PROGRAMS)
def test_every_program_compiles_once(program, capfd):
    assert shader.load(program) is shader.load(program)
    out, err = capfd.readouterr()
    assert "Push constants" not in out + err  # users would see what Blender prints above its limit


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_samplers_and_images_make_the_same_map(method, monkeypatch):
    """With seams, a margin, tangents and several samples."""
    low, high = zoo.sphere("low", 8), zoo.sphere("high", 32)
    high.scale.z = 1.2
    rays = {"extrusion": 0.3, "max_distance": 0.6} if method == "CAST" else {}
    maps = []
    for as_images in (True, False):
        shader.load.cache_clear()
        monkeypatch.setattr(shader, "reads_images", lambda as_images=as_images: as_images)
        maps.append(bake(low, high, method=method, samples=4, margin=4, margin_type="ADJACENT_FACES", **rays))
    shader.load.cache_clear()
    assert len(np.unique(maps[0])) > 1000
    assert np.array_equal(*maps)


@pytest.mark.usefixtures("gpu_context")
def test_free_leaves_no_gpu_object():
    shader.load(high_in_uv.NORMALS)
    passes.free()
    assert shader.load.cache_info().currsize == 0
