# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what happens on a GPU that refuses memory: a sentence, nothing stays behind, and the next bake succeeds."""

from contextlib import nullcontext

import numpy as np
import pytest

from addon.cli.run_report import Cause
from addon.core.errors import BakeError, NoGpuMemory
from addon.core.preflight import texel_bytes
from addon.core.progress import Pace, finish
from addon.core.settings import Run, Settings
from addon.engine import baking, bands, gpu_memory, tree_cache
from addon.mesh.inputs import Meshes
from addon.mesh.triangle_mesh import Mesh
from addon.passes import allocation, target
from tests.support import drivers

SIZE = 128
MAPS = ("AO", "HEIGHT", "CURVATURE")
SENTENCE = "This bake needs about 0.1 GiB of the GPU's memory"
PLACES = ("texture", "offscreen", "corners", "triangles")
"""The functions of allocation."""


def plane(name, height, count):
    """A bent square of 2 * count^2 triangles."""
    x, y = (side.ravel() for side in np.meshgrid(*[np.linspace(0.0, 1.0, count + 1)] * 2))
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    quads = np.stack([first, first + 1, first + count + 2, first, first + count + 2, first + count + 1], axis=1)
    points = np.column_stack([x, y, height + 0.02 * np.sin(9.0 * x) * np.cos(7.0 * y)])
    return Mesh.of_arrays(name, points, quads.reshape(-1, 3), np.column_stack([x, y]))


def settings_of(method):
    return Settings(method=method, maps=MAPS, rays=8, width=SIZE, height=SIZE, space="OBJECT", samples=4, margin=4)


def bake(method):
    meshes = Meshes.of(plane("low", 0.0, 2), [plane("high", 0.01, 16)])
    with gpu_memory.trimmed():
        return finish(baking.bake(meshes, Run(settings_of(method), Pace())))[1001]


class Refusing:
    """Counts what is allocated, and refuses all that `is_refused` says of its number from 0 and its bytes."""

    def __init__(self, monkeypatch):
        self.count, self.refused, self.is_refused = 0, 0, lambda _number, _size: False
        self.sizes = []
        refusals = allocation._refusals

        def refusing(size):
            number, self.count = self.count, self.count + 1
            self.sizes.append(size)
            if self.is_refused(number, size):
                self.refused += 1
                raise allocation._refused(size)
            return refusals(size)

        monkeypatch.setattr(allocation, "_refusals", refusing)

    def begin(self, is_refused):
        self.count, self.refused, self.is_refused, self.sizes = 0, 0, is_refused, []


@pytest.fixture
def refusing(monkeypatch, gpu_context):
    for module in (baking, bands):
        monkeypatch.setattr(module, "LEAST_ROWS", 8)
    gpu_memory.free()
    yield Refusing(monkeypatch)
    gpu_memory.free()


def same(maps, others):
    return all(np.array_equal(one, other) for name in maps for one, other in zip(maps[name], others[name], strict=True))


@pytest.mark.parametrize("method", ["CAST", "FLATTEN"])
def test_each_allocation_is_refused_in_turn(refusing, method):
    expected = bake(method)
    gpu_memory.free()
    refusing.begin(lambda _number, _size: False)
    bake(method)
    whole = refusing.count
    assert whole > 30
    for first in range(whole):
        gpu_memory.free()
        refusing.begin(lambda number, _size, first=first: number >= first)
        with pytest.raises(NoGpuMemory, match=SENTENCE):
            bake(method)
        assert refusing.refused in {1, 2}  # at most one more try
        assert (target.common.bytes, tree_cache.trees.bytes) == (0, 0)
    refusing.begin(lambda _number, _size: False)
    assert same(bake(method), expected)


def test_half_a_band_is_tried_once(refusing):
    expected = bake("FLATTEN")
    gpu_memory.free()
    refusing.begin(lambda _number, size: size >= SIZE * SIZE * 16)
    found = bake("FLATTEN")
    assert refusing.refused == 1
    for name in expected:
        assert np.array_equal(found[name][1], expected[name][1])
        assert np.allclose(found[name][0], expected[name][0], atol=1e-4)
    gpu_memory.free()
    refusing.begin(lambda _number, size: size >= SIZE * SIZE * 8)
    with pytest.raises(NoGpuMemory, match=SENTENCE):
        bake("FLATTEN")
    assert refusing.refused == 2


@pytest.mark.parametrize("megabytes", [0.01, 0.05, 0.1, 0.3, 16.0])
def test_a_gpu_of_few_megabytes(refusing, megabytes):
    """All that goes beyond so many bytes in all is refused."""

    def is_refused(_number, size):
        return sum(count() for count in allocation.held) + size > megabytes * 2**20

    refusing.begin(is_refused)
    with pytest.raises(NoGpuMemory, match=SENTENCE) if megabytes < 1.0 else nullcontext():
        bake("CAST")
    assert sum(count() for count in allocation.held) <= megabytes * 2**20


@pytest.mark.parametrize("error", [RuntimeError, MemoryError])
@pytest.mark.parametrize("place", PLACES)
def test_what_a_driver_raises_ends_in_the_sentence(monkeypatch, gpu_context, place, error):
    class Types:
        def __getattr__(self, _name):
            raise error("gpu.texture.new(...) failed with 'unknown error. See console'")

    values = np.zeros((4, 3), np.float32)
    calls = {
        "texture": lambda: allocation.texture((4, 4), "R8"),
        "offscreen": lambda: allocation.offscreen((4, 4), "RGBA8"),
        "corners": lambda: allocation.corners("position", values),
        "triangles": lambda: allocation.triangles(values.astype(np.int32)),
    }
    real = allocation.gpu.types
    if place == "corners":
        monkeypatch.setattr(allocation.gpu, "types", OnlyFormats(real, Types()), raising=False)
    else:
        monkeypatch.setattr(allocation.gpu, "types", Types(), raising=False)
    with pytest.raises(NoGpuMemory, match=SENTENCE):
        calls[place]()


class OnlyFormats:
    """Types of the gpu module, of which only formats can be made."""

    def __init__(self, real, others):
        self.GPUVertFormat, self._others = real.GPUVertFormat, others

    def __getattr__(self, name):
        return getattr(self._others, name)


@pytest.mark.parametrize(("text", "expected"), [("", allocation.BUDGET), ("64", 64 * 2**20), ("900", 900 * 2**20)])
def test_the_budget_of_the_environment(monkeypatch, text, expected):
    monkeypatch.setenv(allocation.VARIABLE, text)
    assert allocation.budget() == expected


@pytest.mark.parametrize("text", ["63", "-1", "1.5", "x", "²"])
def test_a_wrong_budget_is_refused(monkeypatch, text):
    monkeypatch.setenv(allocation.VARIABLE, text)
    with pytest.raises(BakeError, match="IMPRINT_GPU_MEMORY"):
        allocation.budget()


def test_a_farm_may_try_another_machine():
    assert Cause.of(NoGpuMemory(2**31)) is Cause.MEMORY


@pytest.mark.parametrize("method", ["CAST", "FLATTEN"])
@pytest.mark.parametrize("rows", [24, 40, 76])
def test_any_budget_gives_the_same_maps(refusing, monkeypatch, method, rows):
    """To the bit where no drawn number counts: a GPU rounds what it interpolates by where in the texture it is."""
    whole = bake(method)
    seen = []
    cut = bands.bands
    monkeypatch.setattr(
        baking, "bands", lambda *given, **more: seen.append(list(cut(*given, **more))) or iter(seen[-1])
    )
    texel = texel_bytes(settings_of(method), method, has_detail=False)
    monkeypatch.setattr(allocation, "BUDGET", rows * SIZE * texel)
    parts = bake(method)
    assert len(seen[0]) == -(-SIZE // (rows - 12))
    for name in whole:
        assert np.array_equal(parts[name][1], whole[name][1]), name
        off = np.abs(parts[name][0] - whole[name][0]).max(axis=-1)
        most = {"AO": 0.0, "CURVATURE": drivers.limit(3e-5, 0.01)}
        assert off.max() <= most.get(name, drivers.limit(2e-7, 2e-5)), name
