# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo, run as a person runs it, but small: its maps, its picture, and its scene after the folder has moved."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from scripts import imprint

SIZE = 128
FLAT = 0.05  # a map without relief has no spread; this much is that of slopes of about 6 degrees
INSPECT = """
import json, sys
import bpy

bpy.ops.wm.open_mainfile(filepath=sys.argv[1])

def fed_by(socket):
    return socket.links[0].from_node

def what_is_shown(obj):
    output = obj.active_material.node_tree.get_output_node("CYCLES")
    normal = fed_by(output.inputs["Surface"]).inputs["Normal"]
    if not normal.is_linked:
        return None
    image = fed_by(fed_by(normal).inputs["Color"]).image
    return [fed_by(normal).bl_idname, image.filepath, bpy.path.abspath(image.filepath), *image.size]

terrains = [obj for obj in bpy.data.objects if obj.type == "MESH"]
print(json.dumps({obj.name: what_is_shown(obj) for obj in terrains}))
"""


def run(folder, *arguments):
    """Run this Python in a child process away from the person's settings, and return what it wrote."""
    apart = dict(os.environ, BLENDER_USER_RESOURCES=str(folder / "profile"))
    command = [sys.executable, *map(str, arguments)]
    done = subprocess.run(command, env=apart, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def pixels(path):
    """A picture's colours, (height, width, 3), from 0 to 1."""
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB")) / 255


def contrast(picture):
    """How much a picture changes from one pixel to the next."""
    return np.abs(np.diff(picture, axis=1)).mean()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The folder that the demo has filled, moved since, and what the demo wrote to its standard output."""
    home = tmp_path_factory.mktemp("demo")
    output = run(home, imprint.SCRIPTS / "demo.py", "--size", SIZE, "--quick", "--output", "made")
    return (home / "made").rename(home / "moved"), output


def test_it_says_what_it_did_and_leaves_nothing_else(made):
    folder, output = made
    names = ["low_normal.png", "plane_normal.png", "terrain.blend", "terrain.png"]
    assert sorted(path.name for path in folder.iterdir()) == names
    assert all(str(folder.with_name("made") / name) in output for name in names)
    assert output.count("275,772 triangles onto") == 2
    assert "warning" not in output


def test_the_maps_hold_the_relief(made):
    """And the plane's more of it than that of the low mesh, whose triangles have the large forms already."""
    low, plane = (pixels(made[0] / f"{name}_normal.png") for name in ("low", "plane"))
    assert low.shape == plane.shape == (SIZE, SIZE, 3)
    assert FLAT < low[..., :2].std() < plane[..., :2].std()


def test_in_the_picture_the_map_brings_the_detail_back(made):
    picture = pixels(made[0] / "terrain.png")
    assert picture.shape == (145, 500, 3)
    high, low, mapped, plane = np.split(picture, 4, axis=1)
    assert np.abs(mapped - high).mean() < np.abs(low - high).mean()
    # The plane's relief stands elsewhere in the picture than the high one's, so there its contrast has to do.
    assert contrast(low) < contrast(plane)


def test_the_scene_finds_its_maps_where_the_folder_went(made):
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
