# SPDX-License-Identifier: GPL-3.0-or-later
"""Converts maps between spaces and bases: the result is the map that a bake of the same pair makes."""

import itertools

import bpy
import numpy as np
import pytest

from addon.core.conversion import StoredNormals
from addon.core.declarations import bases
from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import bake_pair
from addon.jobs.convert import Conversion, convert
from tests.support import angles, lanes, zoo
from tests.support.conversions import converted, percentile, picture
from tests.support.maps import bake, pixels

pytestmark = pytest.mark.usefixtures("gpu_context")

EXACT = 0.002
"""Degrees at the 99th percentile, as for bakes."""
EXACT_16 = 0.004
"""The same, with the rounding of 16 bits before and after."""
NAMES = [basis.name for basis in bases.BASES]


@pytest.fixture
def pair():
    """A coarse low mesh and a high one."""
    low, high = zoo.terrain("low", n=9, height=0.3), zoo.terrain("high", n=96, height=0.3)
    for obj in (low, high):
        obj.rotation_euler, obj.scale = (0.3, 0.5, 1.0), (1.0, 2.0, 0.7)
    return low, high


SPACES = ["OBJECT", "WORLD", *NAMES]
PAIRS = ["-".join(two) for two in itertools.permutations(SPACES, 2)]
FAST = ["OBJECT-WORLD", "OBJECT-NORMALIZED", "WORLD-MIKKTSPACE_VERTEX", "CYCLES-OBJECT", "MIKKTSPACE-CYCLES"]
FAST += ["MIKKTSPACE_VERTEX-MIKKTSPACE", "NORMALIZED-CYCLES"]
"""These read and write each space and basis."""


@pytest.mark.parametrize("spaces", lanes.slow_but(FAST, PAIRS))
def test_a_converted_map_is_the_map_that_a_bake_makes(pair, spaces):
    was, now = (("TANGENT", name) if name in NAMES else (name, "CYCLES") for name in spaces.split("-"))
    bake(*pair, space=was[0], basis=was[1], image="before")
    expected = bake(*pair, space=now[0], basis=now[1], image="expected")
    found, _ = converted(pair[0], "before", {"from_space": was[0], "from_basis": was[1]}, space=now[0], basis=now[1])
    assert (found[..., 3] == expected[..., 3]).all()
    assert percentile(found, expected) < EXACT


@pytest.mark.slow
@pytest.mark.shared
def test_a_real_mesh_gets_the_map_that_a_bake_makes(shared_assets):
    bpy.ops.wm.open_mainfile(filepath=str(shared_assets / "pairs" / "king_40480_4000.blend"))
    pair = bpy.data.objects["lo"], bpy.data.objects["hi"]
    for name in NAMES:
        bake(*pair, basis=name, image=name, size=(512, 512))
    off = {}
    for was, now in itertools.permutations(NAMES, 2):
        found, _ = converted(pair[0], was, {"from_basis": was}, basis=now)
        expected = pixels(bpy.data.images[now])
        assert (found[..., 3] == expected[..., 3]).all()
        off[f"{was}-{now}"] = percentile(found, expected)
    print(off)
    assert max(off.values()) < EXACT


def test_settings_of_rays_and_samples_do_not_count(pair):
    bake(*pair, image="map")
    plain, _ = converted(pair[0], "map", space="OBJECT")
    for more in (
        {"samples": 16},
        {"method": "CAST", "extrusion": 3.0, "hit": "OUTERMOST"},
        {"width": 512, "height": 16},
    ):
        assert (converted(pair[0], "map", space="OBJECT", **more)[0] == plain).all()


@pytest.mark.parametrize("path", ["map.png", "folder/../map.png"])
def test_the_file_of_the_map_is_not_replaced(tmp_path, path):
    (tmp_path / "folder").mkdir()
    file = {"storage": "FILE", "depth": 16}
    bake(zoo.sphere("low"), zoo.sphere("high", n=64), image="before", output=str(tmp_path / "map.png"), **file)
    before = (tmp_path / "map.png").read_bytes()
    with pytest.raises(BakeError, match="would replace the file of 'before'"):
        converted(bpy.data.objects["low"], "before", {}, output=str(tmp_path / path), **file)
    assert (tmp_path / "map.png").read_bytes() == before


def test_half_the_normals_of_another_space_point_inwards():
    low = zoo.sphere("low")
    bake(low, zoo.sphere("high", n=64), space="OBJECT", image="object")
    with pytest.raises(BakeError, match="point into 'low' when read in tangent space: choose another From Space"):
        converted(low, "object", {})
    assert "converted" not in bpy.data.images


def test_without_a_name_the_new_image_is_named_after_the_old_one(pair):
    before = bake(*pair, image="map")
    for name in ("", "map"):
        assert converted(pair[0], "map", {}, space="OBJECT", image=name)[1].image == "map_object"
    assert (pixels(bpy.data.images["map"]) == before).all()


def test_a_photo_is_refused():
    low = zoo.plane("low")
    picture("photo", np.random.default_rng(5).uniform(0.0, 1.0, (32, 32, 4)) ** 0.2)
    with pytest.raises(BakeError, match="'photo' is no normal map of 'low': only"):
        converted(low, "photo", {})


def test_an_image_without_pixels_is_refused():
    bpy.data.images.new("gone", 16, 16).source = "FILE"
    with pytest.raises(BakeError, match="No normal map can be read"):
        converted(zoo.plane("low"), "gone", {})


def test_a_low_object_without_uvs_is_refused():
    low = zoo.plane("low")
    low.data.uv_layers.remove(low.data.uv_layers[0])
    picture("map", np.full((16, 16, 4), (0.5, 0.5, 1.0, 1.0)))
    with pytest.raises(BakeError, match="'low' has no UV layer: unwrap it first"):
        converted(low, "map", {})


def test_gray_and_black_texels_are_filled_from_their_neighbors_and_alpha_0_stays():
    values = np.full((16, 16, 4), (0.5, 0.5, 1.0, 1.0))
    values[3, 4], values[3, 8] = (0.0, 0.0, 0.0, 1.0), (0.5, 0.5, 0.5, 1.0)
    values[8, 8, 3] = 0.0
    picture("map", values)
    found, report = converted(zoo.plane("low"), "map", {}, margin=2)
    assert np.argwhere(found[..., 3] == 0.0).tolist() == [[8, 8]]
    hit = found[found[..., 3] > 0.0]
    assert np.allclose(hit[:, :3], (0.5, 0.5, 1.0), atol=1e-6)
    assert report.warnings == []


def test_the_rounding_of_8_bits_is_measured(pair):
    """The report has what rounding costs at most and in the median, as a comparison with the unrounded map has it."""
    bake(*pair, image="exact")
    exact = pixels(bpy.data.images["exact"])
    picture("bytes", np.rint(exact * 255) / 255)
    _, report = converted(pair[0], "bytes", {})
    off = angles.degrees(angles.decode(exact), angles.decode(np.rint(exact * 255) / 255))
    assert report.source_depth == 8
    assert report.source_loss["median"] == pytest.approx(np.median(off), rel=0.1)
    assert report.source_loss["maximum"] == pytest.approx(off.max(), rel=0.2)
    assert converted(pair[0], "exact", {})[1].source_loss == {}


def test_colors_count_as_the_file_stores_them(pair, tmp_path):
    """Neither the color space nor the alpha mode of the image changes what is read."""
    expected = bake(*pair, basis="CYCLES", image="expected")
    bake(*pair, image="stored", storage="FILE", output=str(tmp_path / "map.png"), depth=16, basis="MIKKTSPACE")
    image = bpy.data.images.load(str(tmp_path / "map.png"))
    for space, mode in (("sRGB", "STRAIGHT"), ("Linear Rec.709", "PREMUL"), ("Non-Color", "CHANNEL_PACKED")):
        image.colorspace_settings.name, image.alpha_mode = space, mode
        found, _ = converted(pair[0], image.name, {}, basis="CYCLES")
        assert percentile(found, expected) < EXACT_16
        assert image.colorspace_settings.name == space
    assert not [other for other in bpy.data.images if other.name.startswith("Imprint")]


def test_tiles_are_converted_to_tiles(tmp_path):
    low, high = zoo.terrain("low", n=9, height=0.3), zoo.terrain("high", n=64, height=0.3)
    for obj in (low, high):
        uv = obj.data.uv_layers[0].uv
        places = np.empty((len(uv), 2), np.float32)
        uv.foreach_get("vector", places.ravel())
        uv.foreach_set("vector", (places * (2.0, 1.0)).astype(np.float32).ravel())
    paths = {}
    for space in ("TANGENT", "OBJECT"):
        path = tmp_path / f"{space}.<UDIM>.png"
        common = {"storage": "FILE", "depth": 16, "udim": True, "basis": "CYCLES"}
        settings = Settings(
            space=space, image=space, output=str(path), width=32, height=32, margin=0, method="FLATTEN", **common
        )
        bake_pair(bpy.context, low, [high], settings)
        paths[space] = path
    before = Conversion(low, bpy.data.images["TANGENT"], StoredNormals(from_basis="CYCLES"))
    output = str(tmp_path / "new.<UDIM>.png")
    settings = Settings(space="OBJECT", storage="FILE", output=output, udim=True, margin=0, depth=16, material=False)
    report = convert(bpy.context, before, settings)
    assert report.tiles == [1001, 1002]
    for tile in report.tiles:
        found, expected = (
            pixels(bpy.data.images.load(str(path).replace("<UDIM>", str(tile)))) for path in (output, paths["OBJECT"])
        )
        assert percentile(found, expected) < 0.1
