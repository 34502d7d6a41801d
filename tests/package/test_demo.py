# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests a small run of the demo: its maps, its picture, and its scene after the folder has moved."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from scripts import imprint

pytestmark = pytest.mark.slow

SIZE = 128
FLAT = 0.05  # the spread of a map with slopes of about 6 degrees; a map without relief has none
INSPECT = """
import json, sys
import bpy

bpy.ops.wm.open_mainfile(filepath=sys.argv[1])

def source(socket):
    return socket.links[0].from_node

def shown_map(obj):
    output = obj.active_material.node_tree.get_output_node("CYCLES")
    normal = source(output.inputs["Surface"]).inputs["Normal"]
    if not normal.is_linked:
        return None
    image = source(source(normal).inputs["Color"]).image
    return [source(normal).bl_idname, image.filepath, bpy.path.abspath(image.filepath), *image.size]

terrains = [obj for obj in bpy.data.objects if obj.type == "MESH"]
print(json.dumps({obj.name: shown_map(obj) for obj in terrains}))
"""


def run(folder, *arguments):
    """Run this Python in a child process without the user's settings. Returns its output."""
    environment = dict(os.environ, BLENDER_USER_RESOURCES=str(folder / "profile"))
    command = [sys.executable, *map(str, arguments)]
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def pixels(path):
    """A picture's colors, (height, width, 3), from 0 to 1."""
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB")) / 255


def contrast(picture):
    """The mean difference between neighboring pixels."""
    return np.abs(np.diff(picture, axis=1)).mean()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The folder that the demo has written, moved to another path, and the demo's standard output."""
    home = tmp_path_factory.mktemp("demo")
    output = run(home, imprint.SCRIPTS / "demo.py", "--size", SIZE, "--quick", "--output", "made")
    return (home / "made").rename(home / "moved"), output


def test_the_output_lists_all_files(made):
    folder, output = made
    names = ["low_normal.png", "plane_normal.png", "terrain.blend", "terrain.png"]
    assert sorted(path.name for path in folder.iterdir()) == names
    assert all(str(folder.with_name("made") / name) in output for name in names)
    assert output.count("275,772 triangles onto") == 2
    assert all(f" x {SIZE}: {name}" in output for name in ("low_normal", "plane_normal"))
    assert "warning" not in output
    assert "Info:" not in output


def test_the_maps_have_the_relief(made):
    """The plane's has more, because the low mesh itself has the large forms."""
    low, plane = (pixels(made[0] / f"{name}_normal.png") for name in ("low", "plane"))
    assert low.shape == plane.shape == (SIZE, SIZE, 3)
    assert FLAT < low[..., :2].std() < plane[..., :2].std()


def test_the_map_adds_the_detail_in_the_picture(made):
    picture = pixels(made[0] / "terrain.png")
    assert picture.shape == (145, 500, 3)
    high, low, mapped, plane = np.split(picture, 4, axis=1)
    assert np.abs(mapped - high).mean() < np.abs(low - high).mean()
    # The plane's relief is at other pixels than the high mesh's, so this only compares contrast.
    assert contrast(low) < contrast(plane)


def test_the_moved_scene_finds_its_maps(made):
    folder, _ = made
    shown = json.loads(run(folder.parent, "-c", INSPECT, folder / "terrain.blend").splitlines()[-1])
    assert shown == {
        "High": None,
        "Low": None,
        **{
            f"{name} with map": ["ShaderNodeNormalMap", f"//{file}", str(folder / file), SIZE, SIZE]
            for name, file in (("Low", "low_normal.png"), ("Plane", "plane_normal.png"))
        },
    }
