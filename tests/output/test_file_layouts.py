# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the bytes of TIFF, Targa and OpenEXR files with readers of their own, written from the specifications."""

import importlib
import re
import struct
import sys
import zlib

import numpy as np
import pytest

from addon.core import file_formats
from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.output import image_file, outputs

SIZES = [(1, 1), (1, 7), (300, 1), (2, 3), (17, 33), (129, 65), (40, 700)]
ZIP_ROWS = 16
"""Rows that OpenEXR packs together."""
has_alpha_or_not = pytest.mark.parametrize("has_alpha", [True, False], ids=["RGBA", "RGB"])
of_sizes = pytest.mark.parametrize("size", SIZES, ids=str)


def texels_of(width, height, seed):
    """Slow waves with a bit of noise, some background, and the values 0 and 1; some are outside by rounding."""
    random = np.random.default_rng(seed)
    u, v = np.meshgrid(np.arange(width) / 40, np.arange(height) / 30)
    result = np.stack([np.sin(u + k) * np.cos(v - k) * 0.5 + 0.5 for k in range(4)], axis=-1).astype(np.float32)
    result += random.normal(0, 1e-4, result.shape).astype(np.float32)
    result[random.random((height, width)) > 0.8] = (0.5, 0.5, 1.0, 0.0)
    result[0, 0], result[-1, -1] = (0.0, 1.0, -1e-6, 1.0 + 1e-6), (1.0, 0.0, 0.5, 0.25)
    return result


def stored(texels, depth, has_alpha):
    """The whole numbers (H, W, C) of `texels`, with the highest row first."""
    most = 2**depth - 1
    exact = texels[::-1, :, : 4 if has_alpha else 3] * np.float32(most) + np.float32(0.5)
    return np.floor(exact).clip(0, most).astype(int)


def file_of(texels, path, depth, has_alpha=True):
    """The bytes of a file that was written. They have no time, which would differ in equal bakes."""
    image_file.write(texels, path, depth, has_alpha=has_alpha)
    data = path.read_bytes()
    assert set(re.findall(rb"\d{4}:\d\d:\d\d \d\d:\d\d:\d\d", data)) <= {b"0000:00:00 00:00:00"}
    return data


def tiff_numbers(data):
    """The numbers (H, W, C) of a TIFF of deflated differences."""
    assert data[:4] == b"II*\0"
    (start,) = struct.unpack_from("<I", data, 4)
    assert start % 2 == 0
    (count,) = struct.unpack_from("<H", data, start)
    tags = {}
    for row in range(count):
        tag, kind, length, value = struct.unpack_from("<HHII", data, start + 2 + 12 * row)
        layout = f"<{length}{ {2: 's', 3: 'H', 4: 'I', 5: 'Q'}[kind] }"
        at = value if struct.calcsize(layout) > 4 else start + 2 + 12 * row + 8
        tags[tag] = struct.unpack_from(layout, data, at)
    assert list(tags) == sorted(tags)
    width, height, channels = (tags[tag][0] for tag in (256, 257, 277))
    assert [tags[tag][0] for tag in (259, 262, 274, 284, 317)] == [8, 2, 1, 1, 2]
    assert tags[282] == tags[283] == (72 | 1 << 32,)  # pixels by inch
    assert tags[296] == (2,)
    assert tags.get(338) == ((2,) if channels == 4 else None)
    assert tags[339] == (1,) * channels
    (depth,) = {*tags[258]}
    strips = (zlib.decompress(data[at : at + size]) for at, size in zip(tags[273], tags[279], strict=True))
    rows = np.frombuffer(b"".join(strips), np.uint8 if depth == 8 else "<u2").reshape(height, width, channels)
    return np.cumsum(rows, axis=1, dtype=rows.dtype).astype(int)


@has_alpha_or_not
@pytest.mark.parametrize("depth", [8, 16])
@of_sizes
def test_a_tiff_has_the_numbers_seed_10(size, depth, has_alpha, tmp_path):
    texels = texels_of(*size, seed=10)
    data = file_of(texels, tmp_path / "map.tif", depth, has_alpha)
    np.testing.assert_array_equal(tiff_numbers(data), stored(texels, depth, has_alpha))


@has_alpha_or_not
@of_sizes
def test_a_targa_has_the_numbers_seed_11(size, has_alpha, tmp_path):
    texels = texels_of(*size, seed=11)
    data = file_of(texels, tmp_path / "map.tga", 8, has_alpha)
    channels = 4 if has_alpha else 3
    assert struct.unpack_from("<2x B9x2HB", data) == (2, *size, 8 * channels)
    assert data[17] & 0xDF == (8 if has_alpha else 0)  # bits of alpha, texels from the left
    count = size[0] * size[1] * channels
    found = np.frombuffer(data, np.uint8, count, 18).reshape(size[1], size[0], channels)
    found = found if data[17] & 0x20 else found[::-1]
    np.testing.assert_array_equal(found[..., [2, 1, 0, 3][:channels]], stored(texels, 8, has_alpha))
    extension, _, end = struct.unpack("<2I18s", data[-26:])
    assert (extension, end) == (18 + count, b"TRUEVISION-XFILE.\0")
    assert (data[extension + 494], len(data)) == (3 if has_alpha else 0, extension + 495 + 26)


def exr_attributes(data):
    """The attributes of an OpenEXR file by name, and where the table of its blocks begins."""
    assert data[:8] == b"v/1\x01\x02\0\0\0"
    at, found = 8, {}
    while data[at]:
        name, kind = data[at:].split(b"\0", 2)[:2]
        at += len(name) + len(kind) + 2
        (length,) = struct.unpack_from("<i", data, at)
        found[name.decode()] = data[at + 4 : at + 4 + length]
        at += 4 + length
    return found, at + 1


def exr_numbers(data, kind):
    """The floats (H, W, C) of an OpenEXR file that is packed by ZIP, with its channels in the order of their names."""
    attributes, table = exr_attributes(data)
    assert attributes["compression"] == b"\3"
    assert attributes["lineOrder"] == b"\0"
    assert attributes["dataWindow"] == attributes["displayWindow"]
    left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"])
    assert (left, top) == (0, 0)
    width, height, channels = right + 1, bottom + 1, len(attributes["channels"]) // 18
    number = struct.pack("<i", 1 if kind == "<f2" else 2)
    assert all(part[2:6] == number for part in re.findall(rb"(?s).{18}", attributes["channels"]))
    rows = []
    for block, start in enumerate(struct.unpack_from(f"<{-(-height // ZIP_ROWS)}Q", data, table)):
        y, size = struct.unpack_from("<2i", data, start)
        assert y == block * ZIP_ROWS
        packed = data[start + 8 : start + 8 + size]
        length = min(ZIP_ROWS, height - y) * width * channels * np.dtype(kind).itemsize
        if size < length:
            differences = np.frombuffer(zlib.decompress(packed), np.uint8).astype(int)
            differences[1:] -= 128
            halves = np.cumsum(differences).astype(np.uint8)
            plain = np.empty_like(halves)
            plain[::2], plain[1::2] = np.split(halves, [-(-len(halves) // 2)])
            packed = plain.tobytes()
        rows.append(np.frombuffer(packed, kind).reshape(-1, channels, width))
    return np.concatenate(rows).transpose(0, 2, 1)


@has_alpha_or_not
@pytest.mark.parametrize("depth", [16, 32])
@of_sizes
def test_an_exr_has_the_numbers_seed_12(size, depth, has_alpha, tmp_path):
    texels = texels_of(*size, seed=12) * np.float32(1000.0)
    texels[0, 0, 0], texels[0, 0, 1] = 1e6, -1e6  # more than 16 bits can hold
    data = file_of(texels, tmp_path / "map.exr", depth, has_alpha)
    names = re.findall(rb"(?s)(.)\0.{16}", exr_attributes(data)[0]["channels"])
    assert names == [b"A", b"B", b"G", b"R"][0 if has_alpha else 1 :]
    channels, kind = len(names), {16: "<f2", 32: "<f4"}[depth]
    expected = texels[::-1, :, :channels].clip(*((-65504, 65504) if depth == 16 else (None, None))).astype(kind)
    np.testing.assert_array_equal(exr_numbers(data, kind)[..., ::-1], expected)


def test_an_exr_is_much_smaller_than_its_numbers_seed_3(tmp_path):
    texels = texels_of(512, 512, seed=3)
    texels[...] = np.linspace(0, 1, 512, dtype=np.float32)[:, None]
    assert len(file_of(texels, tmp_path / "map.exr", 16)) < texels.size * 2 / 20


@pytest.mark.filterwarnings("error")
def test_an_exr_keeps_values_that_are_no_numbers(tmp_path):
    texels = np.zeros((2, 3, 4), np.float32)
    texels[0, 0], texels[1, 1, 2] = np.nan, np.inf
    for depth, kind in ((16, "<f2"), (32, "<f4")):
        found = exr_numbers(file_of(texels, tmp_path / "map.exr", depth), kind)[::-1, :, ::-1]
        np.testing.assert_array_equal(found, texels.clip(None, 65504 if depth == 16 else None))


def test_a_blender_without_openimageio_names_it_before_the_bake_and_writes_png(tmp_path, monkeypatch):
    def fail(name):
        raise ModuleNotFoundError(f"No module named {name!r}")

    image_file._library.cache_clear()
    monkeypatch.setattr(importlib, "import_module", fail)
    path = list(sys.path)
    for ending, file_format in file_formats.BY_ENDING.items():
        output, depth = str(tmp_path / f"map{ending}"), file_format.depths[0]
        settings = Settings(storage="FILE", output=output, depth=depth)
        if file_format is file_formats.PNG:
            outputs.check_storage("low", settings)
            continue
        with pytest.raises(BakeError, match="lacks the Python module OpenImageIO, .*: choose PNG, or install"):
            outputs.check_storage("low", settings)
    with pytest.raises(BakeError, match="OpenImageIO"):
        outputs.check_storage("low", Settings(storage="PACK", udim=True, depth=32))
    outputs.check_storage("low", Settings(storage="PACK", udim=True, depth=8))
    assert sys.path == path


def test_the_path_of_modules_stays_as_it_was(tmp_path):
    image_file._library.cache_clear()
    path = list(sys.path)
    image_file.check_format(tmp_path / "map.exr")
    assert sys.path == path
