# SPDX-License-Identifier: GPL-3.0-or-later
"""Hundreds of bakes, many samples, and canceled bakes: memory does not grow, and nothing remains.

With IMPRINT_ENDURANCE=1, there are 500 bakes instead of 200, and maps for samples have 2048 texels a side instead of 1024.
"""

import ctypes
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.core.progress import Pace
from addon.core.settings import Settings
from addon.engine import tree_cache
from addon.jobs import Job, bake_jobs, bake_pair
from addon.passes import target
from scripts import imprint
from tests.support import scenes, zoo
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")

FULL = bool(os.environ.get("IMPRINT_ENDURANCE"))
METHODS = ("FLATTEN", "CAST")
MIB = 2**20
needs_proc = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")


# Many bakes

WARM, BAKES = 100, 500 if FULL else 200
"""The numbers of bakes after which memory is measured."""
GROWTH = 6 * MIB
"""How much memory may grow in between: less than a map of 64 x 64 texels per bake."""
SIZES = ((16, 16), (64, 64), (128, 32), (256, 256))


def resident():
    """Bytes of memory of this process, without those that the C library keeps for reuse."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim:
        trim(0)
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * resource.getpagesize()


def held():
    """Counts that must not grow from bake to bake."""
    lists = [p.identifier for p in bpy.data.bl_rna.properties if p.type == "COLLECTION"]
    nodes = [len(material.node_tree.nodes) for material in bpy.data.materials]
    return {name: len(getattr(bpy.data, name)) for name in lists}, nodes, target.common.roles


@pytest.mark.slow
@needs_proc
def test_memory_stays_flat_over_hundreds_of_bakes(tmp_path, monkeypatch):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    rng = np.random.default_rng(0)
    low, high = zoo.plane("lo", 4), zoo.terrain("hi", 32)
    positions = high.data.attributes["position"].data
    points = np.empty((len(positions), 3), np.float32)
    positions.foreach_get("vector", points.ravel())
    for number in range(BAKES):
        points[:, 2] = rng.uniform(-0.05, 0.05, len(points))
        positions.foreach_set("vector", points.ravel())
        high.data.update()
        width, height = SIZES[number % len(SIZES)]
        storage = ("PACK", "FILE", "MEMORY")[number % 3]
        settings = Settings(
            method=METHODS[number // 2 % 2],
            width=width,
            height=height,
            samples=(1, 4)[number // 4 % 2],
            depth=(8, 16)[number // 8 % 2],
            image=storage,
            storage=storage,
            output=str(tmp_path / "map.png"),
        )
        bake_pair(bpy.context, low, [high], settings)
        assert len(tree_cache.trees) <= tree_cache.CACHED_TREES
        assert target.common.bytes <= target.KEPT_BYTES
        if number + 1 == WARM:
            before, memory = held(), resident()
    assert not list(temporary.iterdir())
    assert held() == before
    assert resident() - memory < GROWTH


# Many samples

SIDE = 2048 if FULL else 1024
MORE = 1.3
"""Factor: the memory for sixteen samples over the memory for one, at most."""
PEAK = """
import resource, sys
import bpy, gpu
gpu.init()
from addon.jobs import bake_pair
from addon.core.settings import Settings
from tests.support import scenes, zoo

method, samples, output = sys.argv[1:]
bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
settings = Settings(method=method, samples=int(samples), width={side}, height={side}, storage="FILE", output=output)
low, high = zoo.plane("lo", 1), zoo.terrain("hi", 16)
for obj in (low, high):
    uv = obj.data.uv_layers[0].uv
    uv.foreach_set("vector", [0.25 * part.vector[axis] for part in uv for axis in range(2)])
report = bake_pair(bpy.context, low, [high], settings)
print("peak", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.slow
@needs_proc
@pytest.mark.parametrize("method", METHODS)
def test_memory_does_not_grow_with_samples(method, tmp_path):
    """Compares peaks of a process for each. With software OpenGL they include the textures, which are as large as the map."""
    peaks = {}
    for samples in (1, 16):
        output = str(tmp_path / f"{samples}.png")
        command = [sys.executable, "-c", PEAK.format(side=SIDE), method, str(samples), output]
        run = subprocess.run(command, cwd=imprint.ROOT, capture_output=True, text=True, check=True)
        peaks[samples] = int(run.stdout.rpartition("peak ")[2])
    assert peaks[16] < MORE * peaks[1], peaks


# Canceling

SHARES = (0.0, *np.random.default_rng(0).random(8).round(3), 1.0)
"""Shares of a bake after which it is canceled."""


def cancel(low, high, settings, share):
    """Close a bake after `share` of it. At 1, after the last step before anything is stored."""
    work = bake_jobs.work(bpy.context, [Job(low, [high])], settings, Pace(0.01))
    next(step for step in work if step.done >= share and (share < 1.0 or step.what == "Storing"))
    work.close()


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def contents(path):
    """The pixels of the images as stored, the nodes and the lists of a saved file. Opens that file."""
    bpy.ops.wm.open_mainfile(filepath=str(path))
    state = snapshot()
    images = [
        (image.name, image.source, tuple(image.size), [part.packed_file.data for part in image.packed_files])
        for image in bpy.data.images
    ]
    return images, {key: value for key, value in state.items() if isinstance(key, str) or key[0] == "material"}


@pytest.mark.parametrize(
    ("method", "storage", "is_there"),
    [("FLATTEN", "PACK", True), ("FLATTEN", "FILE", False), ("CAST", "PACK", False), ("CAST", "FILE", True)],
)
def test_a_canceled_bake_changes_nothing(method, storage, is_there, tmp_path):
    low, high = zoo.plane("lo", 4), zoo.terrain("hi", 48)
    low.data.materials.append(bpy.data.materials.new("Skin"))
    folder, old, new = tmp_path / "maps", tmp_path / "old.blend", tmp_path / "new.blend"
    folder.mkdir()
    output = str(folder / "map.png")
    settings = Settings(
        method=method, width=256, height=256, samples=4, mask=True, depth=8, storage=storage, output=output
    )
    if is_there:
        bake_pair(bpy.context, low, [high], settings)
        high.rotation_euler.x = 0.1  # so that the new map differs from the old one
    before, there = snapshot(), files(folder)
    bpy.ops.wm.save_as_mainfile(filepath=str(old), copy=True)
    for share in SHARES:
        cancel(low, high, settings, share)
        assert difference(before, snapshot()) == {}
        assert files(folder) == there
    bpy.ops.wm.save_as_mainfile(filepath=str(new), copy=True)
    expected = contents(old)
    assert contents(new) == expected

    bake_pair(bpy.context, bpy.data.objects["lo"], [bpy.data.objects["hi"]], settings)
    assert set(files(folder)) == ({"map.png", "map_missed.png"} if storage == "FILE" else set())
    bpy.ops.wm.save_as_mainfile(filepath=str(new), copy=True)
    assert contents(new) != expected or files(folder) != there


# Many maps

FEW, MORE_BAKES = 8, 24
"""The numbers of bakes of many maps after which counts are compared; with IMPRINT_ENDURANCE=1, of 300 bakes."""


@pytest.mark.slow
@needs_proc
def test_bakes_of_many_maps_leave_nothing_behind():
    """Images of the high mesh change, and so do its shape, the size and the samples."""
    low, high = zoo.plane("lo", 4), zoo.terrain("hi", 24)
    material = scenes.material("painted")
    picture = scenes.image("picture", np.full((64, 64, 3), 0.5))
    shown = scenes.texture(material, picture).outputs["Color"]
    bump = material.node_tree.nodes.new("ShaderNodeBump")
    material.node_tree.links.new(shown, bump.inputs["Height"])
    scenes.set_inputs(material, Base_Color=shown, Roughness=shown, Normal=bump.outputs["Normal"])
    high.data.materials.append(material)
    names = ("POSITION", "AO", "BENT_NORMAL", "THICKNESS", "CURVATURE", "BASE_COLOR", "ROUGHNESS", "ATTRIBUTE")
    for number in range(300 if FULL else MORE_BAKES):
        high.scale.z = 1.0 + 0.001 * number
        picture.pixels.foreach_set(np.full(64 * 64 * 4, number / 300, np.float32))
        width, height = SIZES[number % 3]
        settings = Settings(
            method=METHODS[number // 2 % 2],
            width=width,
            height=height,
            samples=(1, 4)[number % 2],
            rays=16,
            maps=names,
            image="map",
            storage="PACK",
            connect_maps=True,
        )
        bake_pair(bpy.context, low, [high], settings)
        assert len(tree_cache.trees) <= tree_cache.CACHED_TREES
        assert target.common.bytes <= target.KEPT_BYTES
        if number + 1 == FEW:
            before, memory = held(), resident()
    assert held() == before
    assert resident() - memory < GROWTH
