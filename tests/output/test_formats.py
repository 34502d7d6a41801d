# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests files with other programs' readers, rounding and dithering, and that a file is complete at any moment."""

import ctypes
import ctypes.util
import importlib
import os
import random
import re
import subprocess
import sys
import time

import bpy
import numpy as np
import pytest
from PIL import Image

from addon.blocks.formats import BC4
from addon.core import file_formats
from addon.core.errors import BakeError
from addon.core.file_structure.image_files import tiff_values
from addon.core.progress import Pace
from addon.core.settings import Settings
from addon.jobs import Job, bake_jobs, bake_pair
from addon.output import image_file, outputs, png_writer, value_encoding
from scripts.imprint import ROOT
from tests.support import lanes, pictures, zoo
from tests.support.maps import pixels

WIDTH, HEIGHT = 56, 40
FLAT = (0.5, 0.5, 1.0, 0.0)
KINDS = [
    (f"map{ending}", depth)
    for ending, known in file_formats.BY_ENDING.items()
    for depth in known.depths
    if not (known.is_blocks or known.has_quality)
]
HALFWAY = 1e-4
"""In steps: so close to the middle of two steps, single precision may round either way."""
MEAN = 2e-3
"""Degrees: the error of the mean of 64 x 64 dithered normals. A single normal has an error of 0.2."""
LARGER = 1.1
"""The size of a file, as a multiple of what Blender's writer makes."""
BLOCK = 0.1
"""In steps: the error of the mean over 8 x 8 dithered texels. With independent noise it reaches 0.2."""


def some_texels(seed=1):
    """Noise with some background, and with the values 0 and 1."""
    generator = np.random.default_rng(seed)
    texels = generator.random((HEIGHT, WIDTH, 4), dtype=np.float32)
    texels[..., 3] = 1.0
    texels[generator.random((HEIGHT, WIDTH)) > 0.7] = FLAT
    texels[0, 0], texels[0, 1] = (0.0, 0.0, 0.0, 1.0), 1.0
    return texels


def gradient(size=256):
    """Unit normals (size, size, 3) that change slowly, and their texels."""
    u, v = np.meshgrid(np.linspace(-0.03, 0.03, size), np.linspace(-0.02, 0.04, size))
    normals = np.stack([u, v, np.sqrt(1.0 - u * u - v * v)], axis=-1)
    texels = np.ones((size, size, 4), np.float32)
    texels[..., :3] = normals * 0.5 + 0.5
    return normals, texels


def by_blender(texels, path, depth):
    """Write texels with Blender's own writer, as it is set by default. Returns the path."""
    image = bpy.data.images.new(
        "own", texels.shape[1], texels.shape[0], alpha=True, float_buffer=depth > 8, is_data=True
    )
    image.pixels.foreach_set(texels.ravel())
    settings = bpy.context.scene.render.image_settings
    settings.file_format = {"PNG": "PNG", "TIFF": "TIFF", "Targa": "TARGA_RAW", "OpenEXR": "OPEN_EXR"}[
        file_formats.of(path).label
    ]
    settings.color_mode, settings.color_depth, settings.tiff_codec = "RGBA", str(depth), "LZW"
    image.save_render(str(path), scene=bpy.context.scene)
    bpy.data.images.remove(image)
    return path


def store(texels, **settings):
    """Store a map with the Writer. Returns the image and the loss."""
    height, width = texels.shape[:2]
    settings = Settings(width=width, height=height, **settings)
    settings.check()
    outputs.check_storage("low", settings)
    with outputs.MapWriter("low", settings, is_normal=True) as writer:
        writer.add(1001, texels)
        return writer.commit(), writer.loss


# Other programs


@pytest.mark.parametrize(("name", "depth"), KINDS)
def test_another_program_reads_the_same_values(name, depth, tmp_path):
    """To the last bit, with alpha and the colors where it is 0."""
    texels = some_texels()
    store(texels, storage="FILE", output=str(tmp_path / name), depth=depth)
    found = pictures.read(tmp_path / name)
    if name.endswith(".exr"):
        np.testing.assert_array_equal(found, texels.astype({16: np.float16, 32: np.float32}[depth]), strict=True)
        return
    steps = 2**depth - 1
    assert found.dtype == {8: np.uint8, 16: np.uint16}[depth]
    assert np.abs(found - texels.astype(np.float64) * steps).max() <= 0.5 + (HALFWAY if depth == 8 else 4e-3)
    np.testing.assert_array_equal(pictures.pillow(tmp_path / name)[..., 3], texels[..., 3] * 255)
    if depth == 8:
        np.testing.assert_array_equal(pictures.pillow(tmp_path / name), found)


@pytest.mark.parametrize("name", ["map.png", "map.tif"])
def test_files_of_16_bits_have_65536_steps(name, tmp_path):
    """A file that really has 8 bits would have 256."""
    texels = np.ones((256, 256, 4), np.float32)
    texels[..., 0] = (np.arange(65536) / 65535).reshape(256, 256)
    store(texels, storage="FILE", output=str(tmp_path / name), depth=16)
    np.testing.assert_array_equal(pictures.read(tmp_path / name)[..., 0].ravel(), np.arange(65536))


@pytest.mark.parametrize(("name", "depth"), KINDS)
def test_values_are_those_that_blender_writes(name, depth, tmp_path):
    """Rounded to the same step, also beside the middle of two."""
    texels = np.ones((256, 256, 4), np.float32)
    middles = ((np.arange(65536) + 0.5) / (2**depth - 1)).reshape(256, 256)
    texels[..., 0] = np.nextafter(middles.astype(np.float32), np.float32(0.0)).clip(0.0, 1.0)
    texels[..., 1] = np.nextafter(middles.astype(np.float32), np.float32(1.0)).clip(0.0, 1.0)
    texels[..., 2] = np.random.default_rng(3).random((256, 256))
    store(texels, storage="FILE", output=str(tmp_path / name), depth=depth)
    own = by_blender(texels, tmp_path / f"own_{name}", depth)
    np.testing.assert_array_equal(pictures.read(tmp_path / name), pictures.read(own))


@pytest.mark.parametrize("alpha", [True, False])
@pytest.mark.parametrize(("name", "depth"), [("map.png", 8), ("map.png", 16), ("map.tif", 8), ("map.tif", 16)])
def test_blender_reads_noise_that_cannot_be_deflated(name, depth, alpha, tmp_path):
    texels = np.random.default_rng(11).random((256, 200, 4), np.float32)
    store(texels, storage="FILE", output=str(tmp_path / name), depth=depth, alpha=alpha)
    image = bpy.data.images.load(str(tmp_path / name))
    image.colorspace_settings.name, image.alpha_mode = "Non-Color", "CHANNEL_PACKED"
    found = np.array(image.pixels[:], np.float32).reshape(texels.shape)
    kept = slice(4 if alpha else 3)
    assert np.abs(found - texels)[..., kept].max() <= 0.51 / (2**depth - 1)


def kinds_of_maps(size=640):
    """Maps as bakes make them: waves of normals with background, gray, dithered, a mask, flat, noise. By name."""
    u, v = np.meshgrid(np.linspace(0, 9, size), np.linspace(0, 7, size))
    waviness = np.sin(3 * u) * np.cos(5 * v) + 0.2 * np.sin(41 * u + 17 * v)
    normals = np.stack([np.gradient(waviness, axis=1), np.gradient(waviness, axis=0), np.full_like(u, 0.2)], axis=-1)
    waves = np.ones((size, size, 4), np.float32)
    waves[..., :3] = normals / np.linalg.norm(normals, axis=-1, keepdims=True) * 0.5 + 0.5
    waves[np.hypot(u - 4, v - 3) > 3.5] = FLAT
    gray = np.ones((size, size, 4), np.float32)
    gray[..., :3] = (np.round(waviness * 16) / 64 + 0.5)[..., None]  # as few rays make it
    heights = np.ones((size, size, 4), np.float32)
    heights[..., :3] = (waviness * 0.2 + 0.5)[..., None]
    mask = outputs.black_and_white(np.hypot(u - 4, v - 3) > 2)
    flat = np.full((size, size, 4), FLAT, np.float32)
    noise = np.random.default_rng(8).random((size, size, 4), np.float32)
    noise[..., 3] = 1.0  # Blender divides by alpha
    return {
        "waves": waves, "dithered": value_encoding.dithered(waves), "gray": gray, "heights": heights, "mask": mask,
        "flat": flat, "noise": noise,
    }  # fmt: skip


@pytest.mark.parametrize(("name", "depth"), [("map.png", 8), ("map.tif", 16)])
def test_files_are_not_much_larger_than_those_that_blender_writes(name, depth, tmp_path):
    ratios = {}
    for kind, texels in kinds_of_maps().items():
        store(texels, storage="FILE", output=str(tmp_path / name), depth=depth)
        own = by_blender(texels, tmp_path / f"own_{name}", depth)
        ratios[kind] = (tmp_path / name).stat().st_size / own.stat().st_size
    assert {kind: ratio for kind, ratio in ratios.items() if ratio > LARGER} == {}


def test_a_png_of_colors_declares_the_color_space_as_blender_does(tmp_path):
    texels = some_texels()
    image_file.write(texels, tmp_path / "map.png", 8, is_color=True)
    own = by_blender(texels, tmp_path / "own.png", 8)
    ours, theirs = (
        [Image.open(path).info[key] for key in ("srgb", "gamma", "chromaticity")]
        for path in (tmp_path / "map.png", own)
    )
    assert ours == theirs


def test_an_exr_names_the_color_space_as_blender_does(tmp_path):
    texels = some_texels()
    store(texels, storage="FILE", output=str(tmp_path / "map.exr"), depth=16)
    for path in (tmp_path / "map.exr", by_blender(texels, tmp_path / "own.exr", 16)):
        assert b"colorInteropID\0string\0\x10\0\0\0lin_rec709_scene" in path.read_bytes()


@pytest.mark.parametrize("depth", [8, 16])
def test_a_tiff_is_marked_as_not_multiplied_with_alpha(depth, tmp_path):
    """Otherwise a reader would divide by alpha, and lose the colors where it is 0."""
    texels = some_texels()
    store(texels, storage="FILE", output=str(tmp_path / "map.tif"), depth=depth)
    with (tmp_path / "map.tif").open("rb") as file:
        assert tiff_values(file, {338})[338] == (2,)  # ExtraSamples: unassociated alpha
    found = pictures.pillow(tmp_path / "map.tif")
    np.testing.assert_allclose(
        found[texels[..., 3] == 0][:, :3], [(127.5, 127.5, 255)] * (texels[..., 3] == 0).sum(), atol=0.5
    )


# Eight bits


@pytest.mark.parametrize("dither", [False, True], ids=["rounded", "dithered"])
def test_images_of_8_bits_are_the_same_in_every_storage(dither, tmp_path):
    texels = some_texels()
    found = []
    files = [str(tmp_path / name) for name, depth in KINDS if depth == 8]
    for storage, output in (("MEMORY", ""), ("PACK", ""), *(("FILE", path) for path in files)):
        image, _ = store(texels, storage=storage, output=output, depth=8, dither=dither)
        found.append(np.round(pixels(image) * 255).astype(np.uint8))
        if output:
            np.testing.assert_array_equal(pictures.read(output), found[-1])
    assert len(files) >= 4
    for other in found[1:]:
        np.testing.assert_array_equal(other, found[0])
    expected = value_encoding.dithered(texels) if dither else value_encoding.rounded(texels, 8)
    np.testing.assert_array_equal(found[0], np.round(expected * 255))


def test_values_are_rounded_to_the_nearest_step():
    texels = some_texels()
    steps = value_encoding.rounded(texels, 8).astype(np.float64) * 255
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-4)
    assert np.abs(steps - texels.astype(np.float64) * 255).max() <= 0.5 + HALFWAY


def test_dithering_rounds_up_or_down_and_keeps_exact_values():
    texels = some_texels()
    texels[5:20, 5:20, :3] = (np.random.default_rng(2).integers(0, 256, (15, 15, 3)) / 255).astype(np.float32)
    texels[5:20, 5:20, 3] = 1.0
    before = texels.copy()
    steps = value_encoding.dithered(texels).astype(np.float64) * 255
    np.testing.assert_array_equal(texels, before)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-4)
    assert np.abs(steps - texels.astype(np.float64) * 255).max() < 1.0
    assert not np.array_equal(np.round(steps), np.round(value_encoding.rounded(texels, 8) * 255))
    np.testing.assert_allclose(steps[5:20, 5:20], texels[5:20, 5:20] * 255.0, atol=1e-4)
    np.testing.assert_array_equal(steps[..., 3], texels[..., 3] * 255.0)
    background = texels[..., 3] == 0.0
    np.testing.assert_allclose(steps[background][:, :3], [(128, 128, 255)] * background.sum(), atol=1e-4)


def test_dithering_is_the_same_each_time():
    np.testing.assert_array_equal(value_encoding.dithered(some_texels()), value_encoding.dithered(some_texels()))


def test_the_mean_of_dithered_normals_is_unbiased():
    normals, texels = gradient()
    error = value_encoding.dithered(texels)[..., :3].astype(np.float64) * 2.0 - 1.0 - normals
    blocks = np.abs(error.reshape(32, 8, 32, 8, 3).mean(axis=(1, 3))) / (2.0 / 255)
    assert blocks.max() < BLOCK
    means = error.reshape(4, 64, 4, 64, 3).mean(axis=(1, 3))  # small enough to be angles in radians
    assert np.degrees(np.abs(means)).max() < MEAN
    rounded = value_encoding.rounded(texels, 8)[..., :3].astype(np.float64) * 2.0 - 1.0 - normals
    assert np.abs(rounded.reshape(32, 8, 32, 8, 3).mean(axis=(1, 3))).max() / (2.0 / 255) > 3 * BLOCK


@pytest.mark.parametrize(("depth", "output"), [(8, ""), (8, "map.tga"), (16, "map.png"), (16, "map.tiff")])
def test_the_loss_is_the_angle_between_baked_and_stored_normals(depth, output, tmp_path):
    normals, texels = gradient()
    texels[:9] = FLAT  # does not count
    storage = "FILE" if output else "PACK"
    output = output and str(tmp_path / output)
    image, loss = store(texels, storage=storage, output=output, depth=depth)
    stored = pictures.read(output).astype(np.float64) / (2**depth - 1) if output else pixels(image).astype(np.float64)
    stored = stored[..., :3] * 2.0 - 1.0
    cross = np.linalg.norm(np.cross(normals, stored), axis=-1)
    angles = np.degrees(np.arctan2(cross, (normals * stored).sum(axis=-1)))[9:]
    assert loss["median"] == pytest.approx(np.median(angles), rel=0.01)
    assert loss["maximum"] == pytest.approx(angles.max(), rel=0.01)


def test_dithering_has_more_loss_than_rounding_and_floats_have_none(tmp_path):
    _, texels = gradient()
    rounded, dithered = (store(texels, depth=8, dither=dither)[1] for dither in (False, True))
    assert rounded["median"] < dithered["median"] < 2.0 * rounded["median"]
    assert store(texels, depth=16)[1] == {}
    assert store(texels, storage="FILE", output=str(tmp_path / "map.exr"), depth=16)[1] == {}


@pytest.mark.usefixtures("gpu_context")
def test_the_report_has_the_loss():
    low, high = zoo.plane("low"), zoo.terrain("high")
    settings = Settings(method="FLATTEN", width=64, height=64, depth=8, mask=True)
    report = bake_pair(bpy.context, low, [high], settings)
    assert 0.05 < report.loss["median"] < report.loss["maximum"] < 0.5
    assert sum(f"{report.loss['median']:.2g} degrees" in line for line in report.summary()) == 1
    floats = bake_pair(bpy.context, low, [high], Settings(method="FLATTEN", width=64, height=64))
    assert floats.loss == {}
    assert not any("degrees" in line for line in floats.summary())


# Files are complete: the old one or the new one


def test_discard_removes_all_temporary_files(tmp_path):
    path = tmp_path / "map.png"
    path.write_bytes(b"an old picture")
    settings = Settings(storage="FILE", output=str(path))
    writer = outputs.MapWriter("low", settings)
    writer.add(1001, some_texels())
    assert len(list(tmp_path.glob("*.png"))) == 2
    writer.discard()
    writer.discard()
    assert path.read_bytes() == b"an old picture"
    assert os.listdir(tmp_path) == ["map.png"]
    assert not bpy.data.images


def test_discard_after_commit_changes_nothing(tmp_path):
    texels, path = some_texels(), tmp_path / "map.tga"
    store(texels, storage="FILE", output=str(path), depth=8)
    np.testing.assert_array_equal(pictures.read(path), np.round(value_encoding.rounded(texels, 8) * 255))


@pytest.mark.usefixtures("gpu_context")
def test_a_stopped_bake_leaves_no_files(tmp_path):
    """At every step, also between writing a file and moving it into place."""
    low, high = zoo.plane("low"), zoo.terrain("high")
    path = tmp_path / "map.tif"
    path.write_bytes(b"an old picture")
    settings = Settings(method="FLATTEN", width=64, height=64, storage="FILE", output=str(path), mask=True)
    seen, stops = set(), 0
    while True:
        work = bake_jobs.work(bpy.context, [Job(low, [high])], settings, Pace(0.001))
        steps = [next(work, None) for _ in range(stops + 1)]
        seen |= {name.partition(".partial")[2] for name in os.listdir(tmp_path) if "partial" in name}
        work.close()
        if steps[-1].report is not None:  # the maps are in their places
            break
        assert os.listdir(tmp_path) == ["map.tif"]
        assert path.read_bytes() == b"an old picture"
        stops += 1
    assert seen == {"", ".tif"}  # the guard of a temporary file, and the file
    assert sorted(os.listdir(tmp_path)) == ["map.tif", "map_missed.tif"]


FOREVER = """
import os, sys
import numpy as np
from addon.output import outputs
from addon.core.settings import Settings

texels = np.ones((128, 128, 4), np.float32)
turn = 0
while True:
    for name in sys.argv[1:]:
        texels[..., :3] = np.random.default_rng(turn % 2).random((128, 128, 3))
        with outputs.MapWriter("low", Settings(storage="FILE", output=name, depth=8)) as writer:
            writer.add(1001, texels)
            writer.commit()
    turn += 1
    if turn == 2:
        print("ready", flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
@pytest.mark.parametrize("seed", lanes.slow_but(range(2), range(10)), ids=lambda seed: f"seed {seed}")
def test_a_process_that_is_killed_leaves_the_old_file_or_the_new_one(seed, tmp_path):
    paths = [tmp_path / f"map{ending}" for ending in (".png", ".tif", ".tga")]
    stored = [np.random.default_rng(turn).random((128, 128, 3)) * 255 for turn in range(2)]
    command = [sys.executable, "-c", FOREVER, *map(str, paths)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment, cwd=tmp_path) as process:
        try:
            while process.stdout.readline() not in {"ready\n", ""}:
                pass
            time.sleep(random.Random(seed).uniform(0.0, 0.2))
        finally:
            process.kill()
    for path in paths:
        found = pictures.pillow(path)[..., :3]
        assert any(np.abs(found - wanted).max() < 0.51 for wanted in stored), path


def test_thresholds_of_the_dither_differ_by_channel():
    """Otherwise equal channels would get gray noise."""
    texels = np.full((64, 64, 4), 0.5, np.float32)
    texels[..., 3] = 1.0
    red, green, blue, alpha = np.moveaxis(value_encoding.dithered(texels), -1, 0)
    for first, second in ((red, green), (green, blue), (blue, red)):
        assert (first == second).mean() < 0.95
    assert (alpha == 1.0).all()


# File layouts


@pytest.mark.filterwarnings("error")
def test_an_exr_keeps_values_that_are_no_numbers(tmp_path):
    texels = np.zeros((2, 3, 4), np.float32)
    texels[0, 0], texels[1, 1, 2] = np.nan, np.inf
    for depth in (16, 32):
        image_file.write(texels, tmp_path / "map.exr", depth)
        most = 65504 if depth == 16 else None  # a half float holds no more
        np.testing.assert_array_equal(pictures.read(tmp_path / "map.exr"), texels.clip(None, most))


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("ending", sorted(file_formats.BY_ENDING))
def test_files_have_no_time_which_would_differ_in_equal_bakes(ending, tmp_path):
    path, depth = tmp_path / f"map{ending}", file_formats.BY_ENDING[ending].depths[0]
    image = image_file.content(np.ones((4, 8, 4), np.float32), path, depth, blocks=image_file.Blocks(BC4))
    image.write(path, (part() for part in image.parts))
    found = re.findall(rb"\d{4}:\d\d:\d\d \d\d:\d\d:\d\d", path.read_bytes())
    assert set(found) <= {b"0000:00:00 00:00:00"}


@pytest.fixture
def without_openimageio(monkeypatch):
    def fail(name):
        raise ModuleNotFoundError(f"No module named {name!r}")

    image_file._library.cache_clear()
    monkeypatch.setattr(importlib, "import_module", fail)


@pytest.mark.parametrize("depth", file_formats.PNG.depths)
@pytest.mark.parametrize("how", ["is_color", "is_gray", "has_alpha", ""])
def test_a_blender_without_openimageio_reads_the_same_from_png(tmp_path, request, how, depth):
    """Whatever alpha is, and whatever color space the file declares."""
    path = tmp_path / "map.png"
    part = image_file.content(some_texels(), path, depth, **({how: how != "has_alpha"} if how else {}))
    part.write(path, (each() for each in part.parts))
    stored, texels = image_file.format_of(path), image_file.read(path)
    request.getfixturevalue("without_openimageio")
    assert image_file.format_of(path) == stored
    np.testing.assert_array_equal(image_file.read(path), texels)
    assert not bpy.data.images


@pytest.mark.parametrize(
    "content",
    [b"", b"no picture, but long enough for a head", png_writer.SIGNATURE + bytes(30)],
    ids=["empty", "text", "cut"],
)
def test_a_blender_without_openimageio_refuses_a_spoiled_png(tmp_path, without_openimageio, content):
    path = tmp_path / "map.png"
    path.write_bytes(content)
    with pytest.raises(BakeError, match="could not be read"):
        image_file.read(path)
    assert not bpy.data.images


def test_a_blender_without_openimageio_names_it_before_the_bake_and_writes_png(tmp_path, without_openimageio):
    path = list(sys.path)
    for ending, file_format in file_formats.BY_ENDING.items():
        output, depth = str(tmp_path / f"map{ending}"), file_format.depths[0]
        settings = Settings(storage="FILE", output=output, depth=depth)
        if file_format is file_formats.PNG or file_format.is_blocks:
            outputs.check_storage("low", settings)
            continue
        with pytest.raises(BakeError, match="lacks the Python module OpenImageIO, .*: choose PNG, or install"):
            outputs.check_storage("low", settings)
    with pytest.raises(BakeError, match="OpenImageIO: set Depth to 8, or Store to File with a PNG file"):
        outputs.check_storage("low", Settings(storage="PACK", udim=True, depth=32))
    outputs.check_storage("low", Settings(storage="PACK", udim=True, depth=8))
    assert sys.path == path


# Libpng


class _Simple(ctypes.Structure):
    """png_image of libpng's simplified interface."""

    _fields_ = (
        ("opaque", ctypes.c_void_p),
        *((name, ctypes.c_uint32) for name in ("version", "width", "height", "format", "flags", "colormap")),
        ("warning", ctypes.c_uint32),
        ("message", ctypes.c_char * 64),
    )


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (300, 1), (17, 33), (700, 500)], ids=str)
def test_libpng_reads_the_bytes_seed_7(size, tmp_path):
    name = ctypes.util.find_library("png16")
    if name is None:
        pytest.skip("libpng is not installed")
    library = ctypes.CDLL(name)
    width, height = size
    texels = np.random.default_rng(7).random((height, width, 4), np.float32)
    made = png_writer.content(texels, 8, has_alpha=True)
    made.write(tmp_path / "map.png", (part() for part in made.parts))
    data = (tmp_path / "map.png").read_bytes()
    image = _Simple(version=1)
    assert library.png_image_begin_read_from_memory(ctypes.byref(image), data, ctypes.c_size_t(len(data)))
    image.format = 3  # red, green, blue and alpha of 8 bits
    found = np.zeros((height, width, 4), np.uint8)
    end_read = library.png_image_finish_read
    assert end_read(ctypes.byref(image), None, found.ctypes.data_as(ctypes.c_void_p), ctypes.c_int32(0), None)
    assert (image.width, image.height, image.message) == (*size, b"")
    np.testing.assert_array_equal(found, np.floor(texels[::-1] * np.float32(255) + np.float32(0.5)))
