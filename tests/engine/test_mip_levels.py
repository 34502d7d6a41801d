# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of mip levels, compared with the means of the whole map in float64."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import Job, bake_all, bake_pair
from addon.output import outputs
from tests.engine.test_slope_maps import SLOPE, roof, widened
from tests.support import scenes, zoo
from tests.support.maps import pixels

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 32
EXACT = 1e-5
MIXED = ("HEIGHT", "OBJECT_ID", "COVERAGE")


def bake(low, high, folder, *, name="rock_normal.exr", size=(SIZE, SIZE), maps=(), **settings):
    """The report of a bake into files with mip levels."""
    width, height = size
    values = {"method": "FLATTEN", "margin": 0, "depth": 32, "storage": "FILE", "material": False, "mip_files": True}
    output = str(folder / name)
    return bake_pair(
        bpy.context,
        low,
        [high],
        Settings(output=output, width=width, height=height, maps=tuple(maps), **(values | settings)),
    )


def read(path):
    """The texels (H, W, 4) of a file."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    image.alpha_mode = "CHANNEL_PACKED"
    return pixels(image).astype(np.float64)


def chain(folder, stem, ending=".exr"):
    """All levels of a map."""
    return [read(folder / f"{stem}{level}{ending}") for level in ("", *(f"_mip{i}" for i in range(1, 6)))]


def blocks(values, level):
    """The sums of blocks of 2^level texels a side."""
    n = 2**level
    height, width = values.shape[0] // n, values.shape[1] // n
    return values.reshape(height, n, width, n, *values.shape[2:]).sum(axis=(1, 3))


def test_normals_are_means_of_what_is_covered(tmp_path):
    """Of two islands with a gap between them: the background counts nowhere, and borders have the mean of their own part."""
    low, high = zoo.two_islands("low", gap=0.3), zoo.two_islands("high", gap=0.3)
    high.data.shade_smooth()
    bake(low, high, tmp_path, space="OBJECT")
    first, *levels = chain(tmp_path, "rock_normal")
    covered = first[..., 3]
    assert 0.1 < covered.mean() < 0.9
    for number, found in enumerate(levels, start=1):
        assert found.shape == (SIZE >> number, SIZE >> number, 4)
        sums, counts = blocks((2.0 * first[..., :3] - 1.0) * covered[..., None], number), blocks(covered, number)
        is_known = counts > 0
        assert np.array_equal(found[..., 3] > 0.0, is_known)
        truth = sums[is_known] / np.linalg.norm(sums[is_known], axis=-1, keepdims=True)
        assert np.abs(2.0 * found[is_known][:, :3] - 1.0 - truth).max() < EXACT


@pytest.mark.parametrize("channels", [{}, {"red": "+X", "green": "-Y"}, {"red": "-Z", "green": "+X", "blue": "-Y"}])
def test_channels_are_those_of_the_map(tmp_path, channels):
    bake(zoo.plane("low"), zoo.terrain("high", waves=1), tmp_path, **channels)
    first, *levels = chain(tmp_path, "rock_normal")
    for number, found in enumerate(levels, start=1):
        sums = blocks(2.0 * first[..., :3] - 1.0, number)
        truth = sums / np.linalg.norm(sums, axis=-1, keepdims=True)
        assert np.abs(2.0 * found[..., :3] - 1.0 - truth).max() < EXACT


@pytest.mark.parametrize("margin_type", ["EXTEND", "ADJACENT_FACES"])
def test_each_level_has_a_margin_of_its_own(tmp_path, margin_type):
    low, high = zoo.two_islands("low", gap=0.5), zoo.two_islands("high", gap=0.5)
    report = bake(low, high, tmp_path, margin=1, margin_type=margin_type)
    assert report.mip_files["normal"] == [str(tmp_path / f"rock_normal_mip{level}.exr") for level in range(1, 6)]
    assert any("Mip levels: 5 files" in line for line in report.summary())
    first, second = (read(path) for path in (tmp_path / "rock_normal.exr", report.mip_files["normal"][0]))
    bake(low, high, tmp_path, name="bare.exr", margin=0)
    bare = read(tmp_path / "bare.exr")[..., 3], read(tmp_path / "bare_mip1.exr")[..., 3]
    for with_margin, covered in zip((first, second), bare, strict=True):
        padded = np.pad(covered, 1)
        grown = np.maximum.reduce(
            [padded[i : i + len(covered), j : j + len(covered)] for i in range(3) for j in range(3)]
        )
        assert np.array_equal(with_margin[..., 3], grown)


def test_other_maps_have_levels_and_labels_have_none(tmp_path):
    """With 8 bits, heights of all levels are decoded with the scale of the whole map."""
    report = bake(zoo.plane("low"), zoo.terrain("high", waves=1), tmp_path, name="rock_normal.png", depth=8, maps=MIXED)
    assert sorted(report.mip_files) == ["coverage", "height", "normal"]
    assert {tuple(image.size) for image in bpy.data.images if image.source == "FILE"} == {(SIZE, SIZE)}
    assert len(bpy.data.images) == 1 + len(MIXED)
    assert not list(tmp_path.glob("*object_id_mip*"))
    first, *levels = chain(tmp_path, "rock_height", ".png")
    for number, found in enumerate(levels, start=1):
        assert np.abs(found[..., 0] - blocks(first[..., 0], number) / 4**number).max() < 1.01 / 255.0


def test_a_packed_image_has_levels(tmp_path):
    report = bake(
        zoo.plane("low"), roof(0.4), tmp_path, name="rock.png", depth=8, pack="GLTF", maps=("WIDENED_ROUGHNESS",)
    )
    (first, *levels) = chain(tmp_path, "rock_orm", ".png")
    assert len(report.mip_files["packed"]) == 5
    alone = chain(tmp_path, "rock_widened_roughness", ".png")[1:]
    assert all(np.array_equal(one[..., 1], other[..., 0]) for one, other in zip(levels, alone, strict=True))


def test_a_map_of_any_size_ends_with_one_texel(tmp_path):
    report = bake(zoo.plane("low"), zoo.plane("high", slope=0.5), tmp_path, size=(40, 17))
    sizes = [read(path).shape[:2] for path in report.mip_files["normal"]]
    assert sizes == [(8, 20), (4, 10), (2, 5), (1, 2), (1, 1)]
    flat = read(tmp_path / "rock_normal.exr")[0, 0]
    assert all(np.abs(read(path) - flat).max() < EXACT for path in report.mip_files["normal"])


def test_tiles_have_levels_of_their_own(tmp_path):
    low, high = zoo.plane("low"), zoo.terrain("high", waves=1)
    report = bake(low, high, tmp_path, name="rock_normal.<UDIM>.exr", udim=True, tiles=(1001,))
    assert report.mip_files["normal"][0] == str(tmp_path / "rock_normal_mip1.1001.exr")
    assert all(Path(path).is_file() for path in report.mip_files["normal"])


def test_an_atlas_has_levels(tmp_path):
    pairs = [(zoo.plane(f"{i}_low"), zoo.plane(f"{i}_high", slope=0.5 * i)) for i in range(2)]
    for number, objects in enumerate(pairs):
        for obj in objects:
            uv = obj.data.uv_layers[0].uv
            values = np.empty(2 * len(uv), np.float32)
            uv.foreach_get("vector", values)
            values[::2] = 0.5 * values[::2] + 0.5 * number
            uv.foreach_set("vector", values)
    settings = Settings(
        method="FLATTEN", storage="FILE", output=str(tmp_path / "a.exr"), width=32, height=32, depth=32, mip_files=True
    )
    reports = bake_all(bpy.context, [Job(low, [high]) for low, high in pairs], settings, share_image=True)
    assert all(len(report.mip_files["normal"]) == 5 for report in reports)
    first, small = read(tmp_path / "a.exr"), read(tmp_path / "a_mip4.exr")
    assert np.abs(small[0, :, :3] - first[16, [8, 24], :3]).max() < EXACT


def test_a_level_is_not_written_over_another_map(tmp_path):
    objects = [zoo.plane("a"), zoo.plane("a_high"), zoo.plane("a_mip1"), zoo.plane("b_high")]
    settings = Settings(storage="FILE", output=str(tmp_path / "{low}.png"), mip_files=True, width=32, height=32)
    jobs = [Job(objects[0], [objects[1]]), Job(objects[2], [objects[3]])]
    with pytest.raises(Exception, match="a_mip1.png"):
        bake_all(bpy.context, jobs, settings)
    assert list(tmp_path.iterdir()) == []


def test_levels_are_files_alone(tmp_path):
    """Images inside Blender have none, and no image datablock shows a level."""
    bake(zoo.plane("low"), zoo.plane("high"), tmp_path)
    assert not [image.name for image in bpy.data.images if "_mip" in image.name]
    assert Settings(storage="PACK", mip_files=True).mip_sizes == []


@pytest.mark.parametrize("samples", [1, 16])
@pytest.mark.parametrize("space", ["TANGENT", "OBJECT"])
def test_roughness_keeps_what_the_mean_of_normals_loses(tmp_path, samples, space):
    """Of a roof, level 2 is as rough, whether the slopes were lost in a texel or in the mean of texels."""
    periods = SIZE // 2 if samples == 1 else 2 * SIZE
    bake(
        zoo.plane("low"), roof(0.4, periods=periods), tmp_path, samples=samples, space=space, maps=["WIDENED_ROUGHNESS"]
    )
    first, second, *levels = chain(tmp_path, "rock_widened_roughness")
    assert np.abs(first[..., 0] - (0.4 if samples == 1 else widened(0.4))).max() < 1e-3
    assert all(np.abs(found[..., 0] - widened(0.4, SLOPE)).max() < 1e-3 for found in (second, *levels))


@pytest.mark.parametrize("alpha", [True, False])
def test_misses_stay_misses(tmp_path, alpha):
    """Rays hit in one half of the map: a texel of a level is a miss only if all below it are."""
    high = zoo.plane("high", slope=0.2)
    high.scale[0], high.location = 0.55, (-0.45, 0.0, 0.1)
    bake(
        zoo.plane("low"), high, tmp_path, method="CAST", missed=(1.0, 0.0, 1.0), alpha=alpha, maps=["WIDENED_ROUGHNESS"]
    )
    for name in ("rock_normal", "rock_widened_roughness"):
        first, *levels = chain(tmp_path, name)
        missed = (read(tmp_path / "rock_normal.exr")[..., :3] == (1.0, 0.0, 1.0)).all(axis=-1)
        assert 0.3 < missed.mean() < 0.7
        for number, found in enumerate(levels, start=1):
            is_missed = blocks(missed, number) == 4**number
            if alpha:
                assert np.array_equal(found[..., 3] == 0.0, is_missed)
            if name == "rock_normal":
                assert np.array_equal((found[..., :3] == (1.0, 0.0, 1.0)).all(axis=-1), is_missed)


def test_a_bake_that_fails_leaves_no_levels(tmp_path, monkeypatch):
    def fail(_writers):
        raise BakeError("stopped")

    monkeypatch.setattr(outputs, "commit_all", fail)
    with pytest.raises(BakeError, match="stopped"):
        bake(zoo.plane("low"), zoo.plane("high"), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_tiles_that_are_not_baked_get_no_levels(tmp_path):
    """An image keeps its other tiles. A level is no place for them."""
    objects = zoo.plane("low", 2), zoo.plane("high", 2)
    for obj in objects:
        uv = obj.data.uv_layers[0].uv
        values = np.empty(2 * len(uv), np.float32)
        uv.foreach_get("vector", values)
        values[::2] *= 2.0
        uv.foreach_set("vector", values)
    names = {"name": "rock.<UDIM>.exr", "udim": True}
    assert bake(*objects, tmp_path, **names, mip_files=False).tiles == [1001, 1002]
    bake(*objects, tmp_path, **names, tiles=(1001,))
    assert (tmp_path / "rock.1002.exr").is_file()
    assert (tmp_path / "rock_mip1.1001.exr").is_file()
    assert not list(tmp_path.glob("*_mip*1002*"))


def test_colors_have_the_mean_of_light(tmp_path):
    """Half of a field is black, half is white: sRGB has 188 of 255 steps for half of the light."""
    high = zoo.plane("high")
    y, x = np.indices((SIZE, SIZE))
    shown = scenes.image("checker", np.repeat((x + y)[..., None] % 2.0, 3, axis=2))
    material = bpy.data.materials.new("checker")
    node = scenes.texture(material, shown, interpolation="Closest")
    scenes.set_inputs(material, Base_Color=node.outputs["Color"])
    high.data.materials.append(material)
    bake(zoo.plane("low"), high, tmp_path, name="rock.png", depth=8, maps=["BASE_COLOR"])
    first, *levels = chain(tmp_path, "rock_base_color", ".png")
    assert sorted(set(first[..., 0].ravel())) == [0.0, 1.0]
    assert all(
        np.array_equal(np.rint(found[..., :3] * 255.0), np.full(found[..., :3].shape, 188.0)) for found in levels
    )
