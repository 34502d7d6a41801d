# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests --texture-sets of several pairs with an output that names no low object: one image for each material, as in Python."""

import bpy
import numpy as np
import pytest

from addon.cli import command
from addon.core.settings import Settings
from addon.jobs import bake_all, jobs_by_name
from addon.jobs.job import Suffixes
from addon.output import image_file
from tests.support import glb, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

WORDS = ["props.blend", "--pairs", "--texture-sets", "--size", "32", "--method", "cast", "--limit", "9"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with props.blend: three pairs side by side in the map. The second low object wears both materials."""
    monkeypatch.chdir(tmp_path)
    wood, metal = map(bpy.data.materials.new, ("Wood", "Metal"))
    for number, worn in enumerate(([wood], [wood, metal], [metal])):
        low, high = zoo.plane(f"{number}_low", 2), zoo.terrain(f"{number}_high", 8, height=0.1 + 0.05 * number)
        low.location.x = high.location.x = 3.0 * number
        scenes.move_uvs(low, (0.3, 0.9), (0.02 + number / 3.0, 0.05))
        for material in worn:
            low.data.materials.append(material)
        low.data.polygons.foreach_set("material_index", [0, 0, *[len(worn) - 1] * 2])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "props.blend"))
    return tmp_path


def test_each_material_has_the_files_that_python_writes(folder):
    assert command.run([*WORDS, "--output", "shell/T_{material}_N.png", "--maps", "ao", "--export", "all.glb"]) == 0
    bpy.ops.wm.open_mainfile(filepath=str(folder / "props.blend"))
    jobs, _ = jobs_by_name(bpy.context, Suffixes())
    settings = Settings(
        width=32, height=32, method="CAST", texture_sets=True, maps=("AO",), storage="FILE",
        output=str(folder / "python" / "T_{material}_N.png"),
    )  # fmt: skip
    bake_all(bpy.context, jobs, settings, share_image=True)
    names = {f"T_{material}_{ending}.png" for material in ("Wood", "Metal") for ending in ("N", "AO")}
    for where in ("shell", "python"):
        assert {path.name for path in (folder / where).iterdir()} == names
    for name in names:
        assert (folder / "shell" / name).read_bytes() == (folder / "python" / name).read_bytes()
    tree, _ = glb.parse(folder / "all.glb")
    assert len(tree["meshes"]) == 3
    assert {material["name"] for material in tree["materials"]} == {"Wood", "Metal"}


def test_a_pair_that_is_not_found_keeps_its_texels(folder):
    """In files alone: another process has no image. Without its low object, nothing is written."""
    assert command.run([*WORDS, "--output", "{material}.png"]) == 0
    before = {name: image_file.read(folder / name) for name in ("Wood.png", "Metal.png")}
    bpy.ops.wm.open_mainfile(filepath=str(folder / "props.blend"))
    bpy.data.objects["1_high"].name = "1_hihg"
    bpy.data.objects["0_high"].scale.z = bpy.data.objects["2_high"].scale.z = -2.0
    bpy.ops.wm.save_mainfile()
    assert command.run([*WORDS, "--output", "{material}.png"]) == 0
    for (name, texels), rows in zip(before.items(), (slice(2, 15), slice(17, 30)), strict=True):
        is_changed = (image_file.read(folder / name) != texels).any(axis=-1)
        assert not is_changed[rows, 11:21].any()
        assert is_changed.mean() > 0.2
    bpy.data.objects.remove(bpy.data.objects["1_low"])
    bpy.ops.wm.save_mainfile()
    written = {name: (folder / name).read_bytes() for name in before}
    assert command.run([*WORDS, "--output", "{material}.png"]) != 0
    assert {name: (folder / name).read_bytes() for name in before} == written


def test_the_islands_of_each_material_are_packed(folder):
    more = ["--pack-uvs", "--save-blend", "packed.blend", "--output", "{material}.png"]
    assert command.run([*WORDS, *more]) == 0
    texels = image_file.read(folder / "Wood.png")
    assert np.mean(texels[..., 3] > 0.0) > 0.4
    bpy.ops.wm.open_mainfile(filepath=str(folder / "packed.blend"))
    assert all("Atlas" in bpy.data.objects[f"{number}_low"].data.uv_layers for number in range(3))
