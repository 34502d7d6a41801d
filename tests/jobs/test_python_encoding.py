# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the Python door to blocks: known values of levels, files that others read, sentences for wrong values."""

import bpy
import numpy as np
import pytest
from PIL import Image

from addon import api
from addon.api import BakeError
from addon.output import image_file
from tests.support import snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")

STEP = 1.0 / 255.0
SLOW = pytest.mark.slow
"""Drivers in software take seconds to compile the encoder of BC7."""


def flat(*color, side=8):
    return np.full((side, side, len(color)), color, np.float32)


def last(found):
    """The texel of the last level."""
    content = api.encoding.Container(
        (1, 1), found.levels[-1:], api.BY_NAME[found.format], has_alpha=found.format == "bc7"
    )
    return api.encoding.shown(content)[0, 0]


@pytest.mark.parametrize("name", ["bc4", "BC5", pytest.param("bc7", marks=SLOW), "bc6h", "bc6h-signed", "bc6h_signed"])
def test_one_value_is_kept_in_all_formats(name):
    before = snapshot.snapshot()
    found = api.encode(flat(0.5, 0.25, 1.0), name, mips=np.bool_(True))
    assert snapshot.difference(before, snapshot.snapshot()) == {}
    assert [level.shape[:2] for level in found.levels] == [(2, 2), (1, 1), (1, 1), (1, 1)]
    stored = {"bc4": 1, "bc5": 2}.get(found.format, 3)
    assert np.abs(found.texels[..., :stored] - [0.5, 0.25, 1.0][:stored]).max() < STEP
    assert np.abs(last(found)[:stored] - [0.5, 0.25, 1.0][:stored]).max() < STEP
    assert found.size == (8, 8) and found.files == []


@SLOW
def test_levels_of_colors_are_means_of_linear_values():
    checker = np.indices((8, 8)).sum(axis=0) % 2
    found = api.encode(np.repeat(0.2 + 0.6 * checker[..., None], 3, axis=2), "bc7", purpose="color")
    # The mean of the linear values 0.0331 and 0.6038, as sRGB (IEC 61966-2-1).
    assert np.abs(last(found)[:3] - 0.5999).max() < STEP


@pytest.mark.parametrize(("name", "value"), [("bc6h", 4.0), ("bc6h-signed", -2.0)])
def test_levels_of_floats_are_means_without_a_range(name, value):
    found = api.encode(np.where(np.indices((8, 8))[0][..., None] % 2, np.full(3, value), 0.0), name, purpose="color")
    assert np.allclose(last(found)[:3], value / 2, rtol=0.01)
    texels = flat(value, value, value, 1.0)
    texels[:, ::2] = 0.0  # alpha 0: nothing covers them
    assert np.allclose(last(api.encode(texels, name, purpose="color"))[:3], value, rtol=0.01)


def test_levels_of_values_are_their_means():
    found = api.encode((np.indices((8, 8)).sum(axis=0) % 2).astype(np.float64), "bc4")
    assert abs(last(found)[0] - 0.5) < STEP


def test_levels_of_normals_have_length_one():
    angle = 1.2
    normals = np.zeros((8, 8, 3), np.float32)
    normals[..., 0], normals[..., 2] = np.sin(angle), np.cos(angle)
    normals[:4] = [0.0, 0.0, 1.0]
    for name in ("bc5", "bc6h"):
        found = last(api.encode(0.5 + 0.5 * normals, name, purpose="normal"))
        assert np.abs(2.0 * found[:2] - 1.0 - [np.sin(angle / 2), 0.0]).max() < 2.5 * STEP
    opposite = np.where(np.indices((8, 8))[0][..., None] % 2, [1.0, 0.5, 0.5], [0.0, 0.5, 0.5])
    found = api.encode(opposite, "bc5", purpose="normal")
    assert np.abs(last(found)[:2] - 0.5).max() < STEP  # points nowhere: flat


@SLOW
def test_texels_that_nothing_covers_do_not_count_in_levels():
    texels = flat(1.0, 0.0, 0.0, 1.0)
    texels[:, ::2] = [0.0, 1.0, 0.0, 0.0]
    found = last(api.encode(texels, "bc7", purpose="color"))
    assert np.abs(found - [1.0, 0.0, 0.0, 0.5]).max() < 1.5 * STEP  # the nearest linear, where black is fine


@pytest.mark.parametrize(("purpose", "red"), [("data", 0.5), ("normal", 1.0), ("color", 1.0)])
def test_alpha_of_data_weighs_nothing(purpose, red):
    texels = flat(1.0, 0.5, 0.5, 1.0)  # as metal in red, and smoothness in alpha
    texels[:, ::2] = [0.0, 0.5, 0.5, 0.0]
    *_, level = api.encoding._levels(texels, api.Purpose[purpose.upper()], is_srgb=purpose == "color")
    assert abs(level[0, 0, 0] - red) < 1e-4 and level[0, 0, 3] == 0.5


def test_data_counts_where_alpha_is_0():
    texels = np.random.default_rng(7).random((4, 4, 4)).astype(np.float32)
    texels[::2, :, 3] = 0.0
    opaque = np.concatenate([texels[..., :3], np.ones((4, 4, 1))], axis=2)
    assert np.array_equal(api.encode(texels, "bc4").levels[0], api.encode(opaque, "bc4").levels[0])


@SLOW
@pytest.mark.parametrize("ending", ["dds", "ktx2"])
def test_files_are_read_by_others(tmp_path, ending):
    texels = np.linspace(0, 255, 64).astype(np.uint8).reshape(8, 8)
    path = tmp_path / f"map.{ending}"
    path.write_bytes(b"earlier")
    found = api.encode(np.repeat(texels[..., None], 3, axis=2), "bc7", output=path)
    assert found.files == [str(path)] and sorted(tmp_path.iterdir()) == [path]
    head = path.read_bytes()[:12]
    assert head.startswith(b"DDS " if ending == "dds" else b"\xabKTX 20\xbb\r\n\x1a\n")
    if ending == "dds":
        with Image.open(path) as picture:
            read = np.asarray(picture.convert("RGB"), np.float32)[::-1] / 255.0
        assert np.abs(read - found.texels[..., :3]).max() < STEP
        assert np.abs(read[..., 0] - texels / 255.0).max() < 8 * STEP
    read, has_alpha = api.encoding.read(str(path))
    assert np.array_equal(read, found.texels) and not has_alpha
    again = api.encode(path, "bc4", mips=False)
    assert len(again.levels) == 1 and np.abs(again.texels[..., 0] - read[..., 0]).max() < 8 * STEP


WRONG = [
    ({"texels": None}, "None are no numbers"),
    ({"texels": flat(0.5, 0.5)}, "shape"),
    ({"texels": [[1.0, 2.0], [3.0]]}, "no numbers"),
    ({"texels": np.zeros((0, 4))}, "no numbers"),
    ({"texels": np.zeros((1, 20_000))}, "20,000"),
    ({"texels": flat(np.nan, 0.0, 0.0)}, "finite"),
    ({"texels": "nowhere.png"}, "no file"),
    ({"texels": __file__}, r"test_python_encoding\.py"),
    ({"texels": np.full((4, 4), 200)}, "int64 does not say"),
    ({"output": "//map.dds"}, "never saved"),
    ({"format": "bc9"}, "format: 'bc9' is not one of bc4"),
    ({"format": 7}, "format: 7"),
    ({"purpose": "colour"}, "purpose: 'colour'"),
    ({"mips": 3}, "mips: 3"),
    ({"output": "map.png"}, r"\.dds or \.ktx2"),
    ({"output": 3}, "output"),
    ({"texels": flat(0.5, side=6), "output": "map.dds"}, "multiples of 4"),
]


@pytest.mark.parametrize(("given", "said"), WRONG)
def test_wrong_values_are_sentences(given, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BakeError, match=said) as caught:
        api.encode(**{"texels": flat(0.5, 0.5, 1.0)} | given)
    assert str(caught.value).endswith(".") and not list(tmp_path.iterdir())


def written(path, names, values, kind="float", size=(4, 4)):
    """An image whose channels, of these names, have one value each."""
    library = image_file._library()
    spec = library.ImageSpec(*size, len(names), kind)
    spec.channelnames = tuple(names)
    output = library.ImageOutput.create(str(path))
    assert output.open(str(path), spec)
    assert output.write_image(np.full((size[1], size[0], len(names)), values, np.float32))
    output.close()
    return path


@pytest.mark.parametrize(
    ("names", "read", "has_alpha"),
    [
        ("R", [0.125, 0.125, 0.125, 1.0], False),
        ("Z", [0.125, 0.125, 0.125, 1.0], False),
        ("RG", [0.125, 0.25, 0.0, 1.0], False),
        ("YA", [0.125, 0.125, 0.125, 0.25], True),
        ("RGA", [0.125, 0.25, 0.0, 0.375], True),
        ("XYZ", [0.125, 0.25, 0.375, 1.0], False),
        ("RGBA", [0.125, 0.25, 0.375, 0.5], True),
    ],
)
def test_channels_of_files_are_those_of_their_names(names, read, has_alpha, tmp_path):
    path = written(tmp_path / "map.exr", names, [0.125, 0.25, 0.375, 0.5][: len(names)])
    texels, found = api.encoding.read(str(path))
    assert np.array_equal(texels, np.broadcast_to(np.float32(read), (4, 4, 4))) and found == has_alpha


@pytest.mark.parametrize(
    ("file", "names", "value", "said"),
    [
        ("map.exr", "RGBAZ", 0.5, "the channels R, G, B, A, Z: give"),
        ("map.tif", "RGBAV", 0.5, "the channels R, G, B, A, .*: give"),
        ("map.exr", "RGBZ", 0.5, "the channels R, G, B, Z: give"),
        ("map.exr", "RGB", np.nan, "finite"),
        ("map.exr", "RGB", np.inf, "finite"),
        ("long.png", "RGB", 0.0, "side of 16,388"),
    ],
)
def test_wrong_files_are_sentences(file, names, value, said, tmp_path):
    size, kind = ((16_388, 4) if file == "long.png" else (4, 4)), "float" if file.endswith(".exr") else "uint8"
    path = written(tmp_path / file, names, value, kind, size)
    with pytest.raises(BakeError, match=said) as caught:
        api.encode(path, "bc4", mips=False)
    assert str(caught.value).endswith(".")


def test_words_count_from_0_to_65535():
    found = api.encode(np.full((4, 4), 0x8000, np.uint16), "bc4", mips=False)
    assert abs(found.texels[0, 0, 0] - 0.5) < STEP


def test_two_slashes_are_the_folder_of_the_open_file(tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    found = api.encode(flat(0.5, 0.5, 0.5), "bc4", output="//map.dds")
    assert found.files == [str(tmp_path / "map.dds")] and (tmp_path / "map.dds").exists()


def test_sides_that_fill_no_blocks_are_padded(tmp_path):
    texels = np.random.default_rng(3).random((5, 7, 3))
    found = api.encode(texels, "bc6h", output=tmp_path / "map.ktx2")
    assert found.size == (7, 5) and found.texels.shape == (5, 7, 4)
    assert [level.shape[:2] for level in found.levels] == [(2, 2), (1, 1), (1, 1)]
