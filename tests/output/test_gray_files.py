# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps of single numbers are gray files: other programs read the same values, of a quarter or half of the channels."""

import struct

import bpy
import numpy as np
import pytest
from PIL import Image

from addon.core.settings import Settings
from addon.jobs import bake_pair
from addon.output import image_file
from tests.support import maps, pictures, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

MAPS = ("AO", "CURVATURE", "HEIGHT", "ROUGHNESS")


def bake(folder, ending=".png", **settings):
    """The report of a bake with files."""
    low, high = zoo.terrain("lo", 8), zoo.terrain("hi", 24, height=0.15)
    scenes.material("rough", high, Roughness=0.25)
    values = {"method": "CAST", "width": 64, "height": 64, "storage": "FILE", "rays": 16, "maps": MAPS}
    values |= {"output": str(folder / f"map{ending}"), **settings}
    return bake_pair(bpy.context, low, [high], Settings(**values))


def channels(path):
    """Of a .png, by its header."""
    return {0: 1, 2: 3, 4: 2, 6: 4}[struct.unpack_from(">2I5B", path.read_bytes(), 16)[3]]


@pytest.mark.parametrize("alpha", [False, True])
@pytest.mark.parametrize("depth", [8, 16])
def test_numbers_are_gray_and_colors_and_normals_are_not(alpha, depth, tmp_path):
    bake(tmp_path, depth=depth, alpha=alpha, maps=(*MAPS, "BASE_COLOR", "POSITION"), mask=True)
    found = {path.stem: channels(path) for path in tmp_path.iterdir()}
    colored, gray = (4, 2) if alpha else (3, 1)
    colors = dict.fromkeys(("map", "map_base_color", "map_position"), colored)
    numbers = ("map_ao", "map_curvature", "map_height", "map_roughness", "map_missed")
    assert found == colors | dict.fromkeys(numbers, gray)


@pytest.mark.parametrize("ending", [".png", ".tif"])
@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("alpha", [False, True])
def test_other_programs_and_blender_read_the_values_of_the_map(ending, depth, alpha, tmp_path):
    packed = bake(tmp_path, storage="PACK", depth=16, output="", image="packed")
    truth = {name: maps.pixels(bpy.data.images[packed.maps[name]["image"]]) for name in ("ao", "roughness")}
    report = bake(tmp_path, ending, depth=depth, alpha=alpha, image="files")
    for name, wanted in truth.items():
        path = tmp_path / f"map_{name}{ending}"
        step = 1.01 / (2**depth - 1)
        shown = maps.pixels(bpy.data.images[report.maps[name]["image"]])
        np.testing.assert_allclose(shown[..., :3], wanted[..., :3], atol=step)
        np.testing.assert_allclose(shown[..., 3], wanted[..., 3] if alpha else 1.0, atol=step)
        read = pictures.read(path).astype(np.float64) / (2**depth - 1)
        np.testing.assert_allclose(read[..., 0], wanted[..., 0], atol=step)
        if alpha:
            np.testing.assert_allclose(read[..., -1], wanted[..., 3], atol=step)
        with Image.open(path) as image:
            gray = ("LA",) if alpha and ending == ".png" else ("L", "I;16", "I;16B") if not alpha else ("RGBA",)
            assert image.mode in gray or (depth == 16 and alpha)


def test_a_gray_file_is_much_smaller(tmp_path):
    """Equal channels compress well, so it is not a third."""
    bake(tmp_path, depth=16, alpha=False, width=256, height=256)
    with_colors = tmp_path / "colors.png"
    image = bpy.data.images.load(str(tmp_path / "map_ao.png"))
    image.colorspace_settings.is_data = True
    image_file.write(maps.pixels(image), with_colors, 16, has_alpha=False)
    assert (tmp_path / "map_ao.png").stat().st_size < 0.7 * with_colors.stat().st_size


def test_a_packed_image_and_udim_tiles_keep_their_channels(tmp_path):
    bake(tmp_path, depth=8, alpha=False, pack="GLTF", maps=("AO", "ROUGHNESS", "METALLIC"))
    assert channels(tmp_path / "map_orm.png") == 3
    report = bake(tmp_path, depth=8, storage="PACK", output="", udim=True, image="tiles")
    tiles = bpy.data.images[report.maps["ao"]["image"]]
    assert tiles.source == "TILED"
