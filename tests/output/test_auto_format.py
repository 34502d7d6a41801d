# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the smallest format within a limit: which one it is, by what other programs read of the files."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from PIL import Image

from addon.blocks.formats import BC7, Purpose
from addon.core.errors import BakeError
from addon.core.map_types import MARGIN, NORMAL, WRITTEN, Labeled
from addon.core.settings import Settings
from addon.jobs import Job, bake_all, bake_pair
from addon.output import auto_format, image_file, map_names, value_encoding
from addon.output.outputs import Outputs
from tests.support import pictures, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 64
LABELS = {labeled: [] for labeled in Labeled}
EQUAL = 1e-4
"""Degrees and steps, relative: our errors are of single precision."""
FLAT = np.full((SIDE, SIDE, 3), (0.5, 0.5, 1.0))


def bumps(height=0.25, noise=0.0, seed=5):
    """Normals (SIDE, SIDE, 3) as they are stored: waves, with noise on them."""
    v, u = np.mgrid[:SIDE, :SIDE] / SIDE * 2.0 * np.pi
    normals = np.dstack([height * np.sin(2 * u), height * np.cos(3 * v), np.ones_like(u)])
    normals[..., :2] += noise * np.random.default_rng(seed).standard_normal((SIDE, SIDE, 2))
    return 0.5 + 0.5 * normals / np.linalg.norm(normals, axis=2, keepdims=True)


def stored(folder, name, normals, others=None, state=None, **values):
    """Store a normal map, and others by name. Returns what Outputs.commit does, and the path of the first file."""
    given = {"width": SIDE, "height": SIDE, "image": "map", "storage": "FILE", "format": "AUTO", "depth": 8}
    settings = Settings(output=str(folder / name), **given | values)
    settings.check()
    drawn = {NORMAL.name: normals, **(others or {})}
    state = np.full((SIDE, SIDE), WRITTEN, np.uint8) if state is None else state
    maps = {key: (np.dstack([each, np.ones((SIDE, SIDE))]).astype(np.float32), state) for key, each in drawn.items()}
    levels = [
        {key: (texels[::step, ::step].copy(), state[::step, ::step]) for key, (texels, _) in maps.items()}
        for step in (SIDE // width for width, _ in settings.mip_sizes)
    ]
    with Outputs(settings) as outputs:
        outputs.add(1001, maps, levels)
        result = outputs.commit(LABELS, [])
    return result, Path(result.paths[0])


def only(formats):
    (how,) = formats.values()
    return how


def by_pillow(path):
    """The values (SIDE, SIDE, 3) from 0 to 1 of a file, row 0 at v = 0."""
    return np.asarray(Image.open(path).convert("RGB"), float)[::-1] / 255.0


def degrees(read, normals):
    """The angles (SIDE, SIDE) between two arrays of stored normals."""
    one, other = ((2.0 * each - 1.0) / np.linalg.norm(2.0 * each - 1.0, axis=2)[..., None] for each in (read, normals))
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(one, other), axis=2), (one * other).sum(axis=2)))


def each_quality(folder, ending, normals, limit):
    """The sizes of the files of each quality that keep a limit, by their quality."""
    sizes = {}
    texels = np.dstack([normals, np.ones((SIDE, SIDE))]).astype(np.float32)
    for quality in auto_format.QUALITIES:
        path = folder / f"{quality}{ending}"
        image_file.write(texels, path, 8, quality=quality)
        if np.percentile(degrees(by_pillow(path), normals), 99) <= limit:
            sizes[quality] = path.stat().st_size
    return sizes


@pytest.mark.parametrize(("name", "label"), [("m.png", "PNG, 8 bits"), ("m.exr", "OpenEXR, 16 bits")])
def test_a_flat_map_takes_the_lowest_depth(tmp_path, name, label):
    result, path = stored(tmp_path, name, FLAT, depth=16)
    how = result.formats[str(path)]
    assert (how["format"], how["bytes"], how["map"]) == (label, path.stat().st_size, "normal")
    assert not result.warnings
    assert image_file.format_of(path).depth == int(label.split()[1])


@pytest.mark.parametrize("ending", [".webp", ".jpg"])
def test_a_flat_map_takes_the_smallest_file(tmp_path, ending):
    result, path = stored(tmp_path, f"m{ending}", FLAT)
    least = min(each_quality(tmp_path, ending, FLAT, 1.0).values())
    with_note = path.stat().st_size
    assert only(result.formats)["bytes"] == with_note < least + 200  # a .webp has a note of the map's objects


@pytest.mark.parametrize(
    ("ending", "limit"), [(".webp", 0.6), (".webp", 1.5), (".webp", 4.0), (".jpg", 1.5), (".jpg", 3.0), (".jpg", 6.0)]
)
def test_the_lowest_quality_within_the_limit(tmp_path, ending, limit):
    normals = bumps(noise=0.004)
    result, path = stored(tmp_path, f"m{ending}", normals, most_degrees=limit)
    how = only(result.formats)
    off = degrees(by_pillow(path), normals)
    assert how["percentile_99"] == pytest.approx(np.percentile(off, 99), rel=0.01)
    assert how["mean"] == pytest.approx(off.mean(), rel=0.01)
    assert np.percentile(off, 99) <= limit * 1.001
    assert how["limit"] == limit
    sizes = {f"quality {each}": size for each, size in each_quality(tmp_path, ending, normals, limit).items()}
    if ending == ".webp":
        sizes["lossless"] = sizes.pop("quality 100")
        sizes |= each_step(tmp_path, normals, limit)
    assert how["format"].endswith(min(sizes, key=sizes.get))


def each_step(folder, normals, limit):
    """The sizes of .webp files without losses of values that are rounded and keep a limit, by how they are named."""
    sizes = {}
    for step in auto_format.ROUNDINGS:
        rounded = (128 + step * np.round((normals * 255 - 128) / step)).clip(0, 255) / 255
        if np.percentile(degrees(rounded, normals), 99) <= limit:
            path = folder / f"steps {step}.webp"
            image_file.write(np.dstack([rounded, np.ones((SIDE, SIDE))]).astype(np.float32), path, 8)
            sizes[f"steps of {step}"] = path.stat().st_size
    return sizes


def test_steps_hold_what_flat_maps_have():
    values = np.random.default_rng(1).random((8, 8, 4), np.float32)
    values[0, 0], values[0, 1] = 1.0, 0.0
    for step in auto_format.ROUNDINGS:
        rounded = value_encoding.in_steps(values, step)
        assert (rounded[0, :2, :3] == [[1.0], [0.0]]).all()
        assert np.abs(rounded - values)[..., :3].max() <= step / 510 + 1e-6
        assert (rounded[..., 3] == values[..., 3]).all()
        flat = value_encoding.in_steps(
            np.full((1, 1, 4), 127.6 / 255, np.float32), step, is_normal=True, with_alpha=True
        )
        assert np.rint(flat * 255) == pytest.approx(128)


def test_maps_that_are_dithered_have_all_steps(tmp_path):
    how = [
        only(stored(tmp_path, "m.webp", bumps(noise=0.01), dither=each, most_degrees=2.0)[0].formats)
        for each in (True, False)
    ]
    assert ["steps of" in each["format"] for each in how] == [False, True]


def test_an_open_ending_takes_the_smallest_of_all(tmp_path):
    """Heights have no limit, and stay PNG of all bits. Levels get the ending of their map."""
    height = np.repeat(bumps()[..., :1], 3, axis=2)
    others = {"HEIGHT": height, "AO": height}
    values = {"maps": ("HEIGHT", "AO"), "depth": 16, "mip_files": True, "mips": 2, "targets": ("three",)}
    result, path = stored(tmp_path, "m_normal", bumps(noise=0.01), others, **values)
    sizes = {}
    for ending in (".png", ".webp"):
        one, _ = stored(tmp_path / "fixed", f"m_normal{ending}", bumps(noise=0.01), others, **values | {"depth": 8})
        sizes[ending] = {how["map"]: how["bytes"] for how in one.formats.values()}
    assert {how["map"]: how["bytes"] for how in result.formats.values()} == {
        name: min(each[name] for each in sizes.values()) for name in ("normal", "ao")
    }
    assert path.name == "m_normal.webp"
    height_file = next(Path(each) for each in result.paths if "height" in each)
    assert (height_file.suffix, image_file.format_of(height_file).depth) == (".png", 16)
    assert {Path(each).suffix for each in result.mip_files["normal"]} == {".webp"}
    assert all(Path(each).is_file() for each in result.mip_files["normal"])


OPEN_ENDINGS = [
    ({}, ["m.png", "m.webp"]),
    ({"output": "m."}, ["m.png", "m.webp"]),
    ({"targets": ("unity",)}, ["m.png"]),
    ({"targets": ("godot", "three")}, ["m.png", "m.webp"]),
    ({"alpha": False}, ["m.png", "m.webp", "m.jpg"]),
    ({"width": 16384}, ["m.png"]),
    ({"pack": "URP", "normal": False}, ["m_metallic_smoothness.png"]),
]


@pytest.mark.parametrize(("values", "files"), OPEN_ENDINGS)
def test_endings_that_all_engines_read(values, files):
    settings = Settings(**{"width": 16, "height": 16, "storage": "FILE", "format": "AUTO", "output": "m"} | values)
    assert list(settings.problems()) == []
    assert [path for path, _ in map_names.planned_files(settings)] == files


def test_all_tiles_get_the_ending_of_the_first(tmp_path, monkeypatch):
    seen, smallest = [], auto_format.smallest
    monkeypatch.setattr(
        auto_format, "smallest", lambda *a, endings: seen.append(endings) or smallest(*a, endings=endings)
    )
    settings = Settings(
        width=SIDE, height=SIDE, image="map", storage="FILE", format="AUTO", udim=True, output=str(tmp_path / "m")
    )
    texels = np.dstack([bumps(noise=0.01), np.ones((SIDE, SIDE))]).astype(np.float32)
    with Outputs(settings) as outputs:
        for tile in (1001, 1002):
            outputs.add(tile, {NORMAL.name: (texels.copy(), np.full((SIDE, SIDE), WRITTEN, np.uint8))})
        paths = outputs.commit(LABELS, []).paths
    assert [Path(each).name for each in paths] == ["m.1001.webp", "m.1002.webp"]
    assert seen == [[".png", ".webp"], [".webp"]]


def test_fixed_formats_need_an_ending():
    settings = Settings(storage="FILE", output="m")
    assert any("does not end in one of" in text for text in settings.problems())


def test_noise_within_hundredths_takes_all_bits(tmp_path):
    normals = bumps(noise=0.3)
    result, path = stored(tmp_path, "m.png", normals, most_degrees=0.01)
    assert only(result.formats)["format"] == "PNG, 16 bits"
    read = pictures.read(path)[..., :3] / 65535.0
    assert np.percentile(degrees(read, normals), 99) < 0.01
    assert not result.warnings


@pytest.mark.parametrize(("name", "label"), [("m.webp", "WebP, lossless"), ("m.jpg", "JPEG, quality 100")])
def test_one_warning_where_none_keeps_the_limits(tmp_path, name, label):
    colors = np.random.default_rng(2).random((SIDE, SIDE, 3))
    limits = {"most_degrees": 0.01, "most_steps": 0.1}
    result, _ = stored(tmp_path, name, bumps(noise=0.3), {"BASE_COLOR": colors}, maps=("BASE_COLOR",), **limits)
    assert {how["format"] for how in result.formats.values()} == {label}
    (text,) = (text for text in result.warnings if "keeps the limits" in text)
    for how in result.formats.values():
        assert f"{how['percentile_99']:.2g} {how['unit']}" in text


def test_colors_keep_steps_of_what_is_shown(tmp_path):
    generator = np.random.default_rng(3)
    linear = np.repeat(np.repeat(generator.random((8, 8, 3)), 8, axis=0), 8, axis=1) ** 3
    result, _ = stored(tmp_path, "m.jpg", FLAT, {"BASE_COLOR": linear}, maps=("BASE_COLOR",), most_steps=3.0)
    path, how = next((path, how) for path, how in result.formats.items() if how["map"] == "base_color")
    shown = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    off = np.abs(by_pillow(path) - shown).max(axis=2) * 255.0
    assert how["unit"] == "steps"
    assert how["percentile_99"] == pytest.approx(np.percentile(off, 99), abs=0.02)
    assert 1.0 < np.percentile(off, 99) <= 3.001


def test_texels_of_the_margin_do_not_count(tmp_path):
    normals, state = FLAT.copy(), np.full((SIDE, SIDE), WRITTEN, np.uint8)
    normals[SIDE // 2 :] = bumps(noise=0.5)[SIDE // 2 :]
    state[SIDE // 2 :] = MARGIN
    rough = stored(tmp_path, "all.jpg", normals, most_degrees=2.0)[0]
    smooth = stored(tmp_path, "some.jpg", normals, state=state, most_degrees=2.0)[0]
    assert only(smooth.formats)["bytes"] < 0.8 * only(rough.formats)["bytes"]


def test_normals_that_point_down_take_bc7(tmp_path):
    normals = bumps()
    normals[::3, ::3] = 0.5 + 0.5 * np.array((0.6, 0.0, -0.8))
    how = {
        name: only(stored(tmp_path, f"{name}.dds", each)[0].formats)
        for name, each in (("up", bumps()), ("down", normals))
    }
    assert how["up"]["format"] == "DDS, BC5"
    assert how["down"]["format"] == "DDS, BC7"


@pytest.mark.parametrize(("engine", "label"), [("unreal", "KTX2, BC5"), ("three", "KTX2, BC7")])
def test_engines_that_read_blue_get_it(tmp_path, engine, label):
    result, _ = stored(tmp_path, "m.ktx2", bumps(), targets=(engine,), most_degrees=9.0)
    assert only(result.formats)["format"] == label


def test_engines_of_8_bits_get_no_more(tmp_path):
    result, _ = stored(tmp_path, "m.png", bumps(), targets=("three",), most_degrees=0.01)
    assert only(result.formats)["format"] == "PNG, 8 bits"
    assert any("keeps the limits" in text for text in result.warnings)


def test_blocks_as_openimageio_reads_them(tmp_path):
    """BC4 for gray; BC7 keeps all channels of a packed map."""
    gray = np.repeat(bumps()[..., :1], 3, axis=2)
    others = {"AO": gray, "ROUGHNESS": bumps()[..., :1].repeat(3, axis=2), "METALLIC": 1 - gray}
    result, _ = stored(tmp_path, "m.dds", FLAT, others, maps=("AO",), pack="GLTF", normal=False)
    found = {how["map"]: (path, how) for path, how in result.formats.items()}
    assert found["ao"][1]["format"] == "DDS, BC4"
    assert found["packed"][1]["format"] == "DDS, BC7"
    path, how = found["packed"]
    wanted = np.dstack([others[name][..., 0] for name in ("AO", "ROUGHNESS", "METALLIC")])
    off = np.abs(pictures.as_stored(path)[::-1, :, :3] / 255.0 - wanted).max(axis=2) * 255.0
    assert how["percentile_99"] == pytest.approx(np.percentile(off, 99), abs=0.02)
    assert how["bytes"] == Path(path).stat().st_size


def test_heights_and_fixed_formats_stay(tmp_path):
    height = np.repeat(bumps()[..., :1], 3, axis=2)
    result, _ = stored(tmp_path, "m.png", FLAT, {"HEIGHT": height}, maps=("HEIGHT",), depth=16)
    assert [image_file.format_of(path).depth for path in result.paths] == [8, 16]
    assert len(result.formats) == 1
    result, path = stored(tmp_path, "fixed.png", FLAT, format="FIXED", depth=16)
    assert image_file.format_of(path).depth == 16
    assert not result.formats


def test_files_of_mip_levels_are_stored_as_the_map(tmp_path):
    low, high = zoo.plane("low"), zoo.terrain("high")
    values = {"width": 32, "height": 32, "storage": "FILE", "material": False, "format": "AUTO", "mip_files": True}
    report = bake_pair(bpy.context, low, [high], Settings(output=str(tmp_path / "m.png"), depth=16, mips=3, **values))
    files = [*report.output, *report.mip_files["normal"]]
    assert len(files) > 1
    assert {image_file.format_of(path).depth for path in files} == {8}


def test_a_bake_measures_the_format_that_it_chose(tmp_path):
    low, high = zoo.plane("low"), zoo.terrain("high")
    values = {"width": SIDE, "height": SIDE, "storage": "FILE", "material": False, "targets": ("babylon",), "depth": 8}
    settings = Settings(output=str(tmp_path / "m.webp"), format="AUTO", most_degrees=2.0, **values)
    report = bake_pair(bpy.context, low, [high], settings)
    how = only(report.formats)
    assert how["bytes"] == (tmp_path / "m.webp").stat().st_size
    assert how["percentile_99"] <= 2.0
    assert report.targets["babylon"]["percentile_99"] == pytest.approx(how["percentile_99"], rel=0.02)
    assert any(line.startswith(f"m.webp: {how['format']}, {how['bytes']:,} bytes") for line in report.summary())


def test_maps_of_others_are_not_stored_again(tmp_path):
    lows = [zoo.plane(name) for name in ("a", "b")]
    for low, shift in zip(lows, (0.0, 0.5), strict=True):
        for item in low.data.uv_layers[0].uv:
            item.vector = (item.vector[0] * 0.4 + shift, item.vector[1])
    values = {"width": SIDE, "height": SIDE, "storage": "FILE", "material": False, "image": "all", "format": "AUTO"}
    high, settings = zoo.terrain("high"), Settings(output=str(tmp_path / "m.png"), depth=8, method="CAST", **values)
    reports = bake_all(bpy.context, [Job(low, [high]) for low in lows], settings, share_image=True)
    assert only(reports[0].formats) == only(reports[1].formats)
    with pytest.raises(BakeError, match="chosen for all texels"):
        bake_pair(bpy.context, lows[0], [high], settings)


@pytest.mark.parametrize("name", ["m.png", "m.exr"])
def test_the_steps_that_a_compressor_costs_colors(tmp_path, name):
    """By our encoder, in a file that OpenImageIO decodes. Only covered texels count, and flat colors lose at most a step."""
    linear = np.random.default_rng(4).random((SIDE, SIDE, 3)) ** 2
    shown = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    state = np.full((SIDE, SIDE), WRITTEN, np.uint8)
    state[: SIDE // 2] = MARGIN
    others = {"BASE_COLOR": linear, "AO": np.full((SIDE, SIDE, 3), 0.4)}
    values = {"maps": ("BASE_COLOR", "AO"), "targets": ("three", "unreal"), "format": "FIXED", "depth": 16}
    result, _ = stored(tmp_path, name, FLAT, others, state, **values)
    texels = np.dstack([np.round(shown * 255) / 255, np.ones((SIDE, SIDE))]).astype(np.float32)
    how = image_file.Blocks(BC7, Purpose.DATA, has_map_in_alpha=True)
    path = tmp_path / "by_hand.dds"
    how.content(texels, path, has_alpha=True, is_color=False, note="").write(path, iter(()))
    off = np.abs(pictures.as_stored(path)[::-1, :, :3] / 255.0 - shown).max(axis=2)[SIDE // 2 :] * 255.0
    found = result.compressed["base_color"]
    assert found["format"] == "BC7"
    assert found["mean"] == pytest.approx(off.mean(), rel=2e-3)
    assert found["percentile_99"] == pytest.approx(np.percentile(off, 99), rel=2e-3)
    assert result.compressed["ao"]["percentile_99"] <= 1.0
    assert "normal" not in result.compressed


@pytest.mark.parametrize("values", [{"targets": ("three",)}, {"targets": ("unreal",), "name": "m.dds"}])
def test_no_steps_where_nothing_compresses(tmp_path, values):
    name = values.pop("name", "m.png")
    result, _ = stored(tmp_path, name, FLAT, {"AO": FLAT}, maps=("AO",), format="FIXED", **values)
    assert result.compressed == {}
