# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the bytes of DDS and KTX2 files against their specifications, read here by hand, and what damaged files end with."""

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from addon.blocks.formats import BC4, BC5, BC6H, BC6H_SIGNED, BC7, FORMATS
from addon.core.errors import BakeError
from addon.core.file_structure import whole_files
from addon.output import containers
from addon.output.containers import Container

NOTE = '[["rock","UVMap",true,17]]'
MODELS = {BC4: 131, BC5: 132, BC6H: 133, BC6H_SIGNED: 133, BC7: 134}
"""Khronos Data Format Specification 1.3, table of color models."""


def some(block_format, size=(24, 12), count=None, **more):
    """Noise in all levels of a picture."""
    generator, count = np.random.default_rng(7), max(size).bit_length() if count is None else count
    sizes = [(max(1, size[0] >> level), max(1, size[1] >> level)) for level in range(count)]
    levels = [
        generator.integers(0, 256, ((height + 3) // 4, (width + 3) // 4, block_format.size), np.uint8)
        for width, height in sizes
    ]
    return Container(size, levels, block_format, **more)


def stored(folder, content, ending):
    path = folder / f"map{ending}"
    containers.write(path, content)
    return path


@pytest.mark.parametrize("ending", [".dds", ".ktx2"])
@pytest.mark.parametrize("block_format", FORMATS, ids=lambda one: one.name)
@pytest.mark.parametrize("note", ["", NOTE])
def test_files_read_back_as_they_were_written(tmp_path, block_format, ending, note):
    has_alpha = block_format is BC7
    content = some(block_format, is_srgb=has_alpha, has_alpha=has_alpha, note=note)
    path = stored(tmp_path, content, ending)
    read, head = containers.read(path), containers.head_of(path)
    for found in (read, head):
        assert (found.size, found.block_format, found.note) == (content.size, block_format, note)
        assert (found.is_srgb, found.has_alpha) == (has_alpha, has_alpha)
    assert all(map(np.array_equal, read.levels, content.levels)) and len(read.levels) == len(content.levels)
    opaque = stored(tmp_path, some(BC7, note=note), ending)
    assert not containers.read(opaque).has_alpha and not containers.read(opaque).is_srgb


@pytest.mark.parametrize("block_format", FORMATS, ids=lambda one: one.name)
def test_dds_has_the_header_of_directx_10(tmp_path, block_format):
    content = some(block_format, note=NOTE)
    data = stored(tmp_path, content, ".dds").read_bytes()
    words = struct.unpack_from("<31I", data, 4)
    assert data[:4] == b"DDS " and words[0] == 124 and words[18] == 32
    assert words[1] & 0x21007 == 0x21007  # capabilities, height, width, pixel format, levels
    assert words[2:4] == (12, 24) and words[6] == len(content.levels) == 5
    assert words[4] == content.levels[0].size and words[1] & 0x80000
    assert words[19] == 4 and data[84:88] == b"DX10" and words[26] == 0x401008
    number, dimension, flags, pictures, alpha = struct.unpack_from("<5I", data, 128)
    assert (number, dimension, flags, pictures) == (block_format.dxgi, 3, 0, 1)
    assert alpha == (3 if block_format is BC7 else 0)
    blocks = b"".join(level.tobytes() for level in content.levels)
    assert data[148:] == blocks + NOTE.encode()
    plain = stored(tmp_path, some(BC7, is_srgb=True), ".dds").read_bytes()
    assert struct.unpack_from("<I", plain, 128) == (99,) and plain[32:76] == bytes(44)
    single = stored(tmp_path, some(BC7, count=1), ".dds").read_bytes()
    assert struct.unpack_from("<I", single, 108) == (0x1000,)


@pytest.mark.parametrize("block_format", FORMATS, ids=lambda one: one.name)
def test_ktx2_has_levels_texts_and_a_descriptor(tmp_path, block_format):
    content = some(block_format, (27, 13), note=NOTE)
    data = stored(tmp_path, content, ".ktx2").read_bytes()
    assert data[:12] == b"\xabKTX 20\xbb\r\n\x1a\n"
    assert struct.unpack_from("<9I", data, 12) == (block_format.vulkan, 1, 27, 13, 0, 0, 1, 5, 0)
    at, length, texts_at, texts_length = struct.unpack_from("<4I", data, 48)
    assert struct.unpack_from("<2Q", data, 64) == (0, 0)
    starts = []
    for level, blocks in enumerate(content.levels):
        start, stored_length, full_length = struct.unpack_from("<3Q", data, 80 + 24 * level)
        assert start % block_format.size == 0 and stored_length == full_length == blocks.size
        assert data[start : start + stored_length] == blocks.tobytes()
        starts.append(start)
    assert starts == sorted(starts, reverse=True) and starts[0] + content.levels[0].size == len(data)
    assert at == 80 + 24 * 5 and struct.unpack_from("<I", data, at) == (length,)
    kind, version, size = struct.unpack_from("<IHH", data, at + 4)
    samples = 2 if block_format is BC5 else 1
    assert (kind, version, size) == (0, 2, 24 + 16 * samples) and size + 4 == length
    assert tuple(data[at + 12 : at + 16]) == (MODELS[block_format], 1, 1, 0)
    assert tuple(data[at + 16 : at + 28]) == (3, 3, 0, 0, block_format.size, 0, 0, 0, 0, 0, 0, 0)
    for sample in range(samples):
        offset, bits, channel, position, low, high = struct.unpack_from("<HBBIII", data, at + 28 + 16 * sample)
        assert (offset, bits, position) == (64 * sample, 63 if block_format in (BC4, BC5) else 127, 0)
        if block_format in (BC6H, BC6H_SIGNED):
            lowest = -1.0 if block_format is BC6H_SIGNED else 0.0
            assert channel == (0xC0 if lowest else 0x80)
            assert struct.pack("<II", low, high) == struct.pack("<ff", lowest, 1.0)
        else:
            assert (channel, low, high) == (sample, 0, 2**32 - 1)
    texts, place = {}, texts_at
    while place < texts_at + texts_length:
        (count,) = struct.unpack_from("<I", data, place)
        key, value = data[place + 4 : place + 4 + count].split(b"\0", 1)
        texts[key.decode()] = value
        place += 4 + (count + 3) // 4 * 4
    assert place == texts_at + texts_length == at + length + texts_length
    assert list(texts) == sorted(texts) and texts["KTXwriter"] == b"Imprint\0" and texts["KTXorientation"] == b"rd\0"
    assert texts["Imprint"] == NOTE.encode() + b"\0"
    assert texts.get("KTXswizzle") == (b"rgb1\0" if block_format is BC7 else None)


def test_ktx2_says_that_colors_are_srgb(tmp_path):
    data = stored(tmp_path, some(BC7, is_srgb=True, has_alpha=True), ".ktx2").read_bytes()
    at = struct.unpack_from("<I", data, 48)[0]
    assert struct.unpack_from("<I", data, 12) == (146,) and data[at + 14] == 2


def test_ktx2_unpacks_levels_of_zlib(tmp_path):
    content = some(BC5, (8, 8), 2)
    data = bytearray(stored(tmp_path, content, ".ktx2").read_bytes())
    struct.pack_into("<I", data, 44, 3)
    for level, blocks in enumerate(content.levels):
        packed = zlib.compress(blocks.tobytes())
        struct.pack_into("<3Q", data, 80 + 24 * level, len(data), len(packed), blocks.size)
        data += packed
    path = tmp_path / "packed.ktx2"
    path.write_bytes(data)
    assert all(map(np.array_equal, containers.read(path).levels, content.levels))
    path.write_bytes(data[:-8] + bytes(8))
    with pytest.raises(BakeError, match="is damaged"):
        containers.read(path)
    short = zlib.compress(bytes(5))
    struct.pack_into("<3Q", data, 80, len(data), len(short), content.levels[0].size)
    path.write_bytes(data + short)
    with pytest.raises(BakeError, match="ends too early"):
        containers.read(path)


def test_pillow_reads_the_dds(tmp_path):
    """One block of known ends: red from 200, green from 40, constant."""
    block = np.array([200, 200, *[0] * 6, 40, 40, *[0] * 6], np.uint8)
    content = Container((8, 4), [np.tile(block, (1, 2, 1))], BC5, note=NOTE)
    with Image.open(stored(tmp_path, content, ".dds")) as picture:
        assert picture.size == (8, 4)
        assert (np.asarray(picture)[..., :2] == (200, 40)).all()


@pytest.mark.parametrize(("name", "block_format"), [(b"ATI1", BC4), (b"BC4U", BC4), (b"ATI2", BC5), (b"BC5U", BC5)])
def test_older_names_of_dds_are_read(tmp_path, name, block_format):
    content = some(block_format, (16, 8), 1)
    data = stored(tmp_path, content, ".dds").read_bytes()
    path = tmp_path / "older.dds"
    path.write_bytes(data[:84] + name + data[88:128] + data[148:])
    read = containers.read(path)
    assert read.block_format is block_format and np.array_equal(read.levels[0], content.levels[0])
    assert not whole_files.problem(str(path), is_image=True)


@pytest.mark.parametrize("ending", [".dds", ".ktx2"])
def test_cut_files_end_with_a_sentence(tmp_path, ending):
    path = stored(tmp_path, some(BC7, (16, 16), note=NOTE), ending)
    data = path.read_bytes()
    assert ending == ".ktx2" or not whole_files.problem(str(path), is_image=True)
    end = len(data) - (len(NOTE) if ending == ".dds" else 0)
    for length in (20, 100, 140, end - 1):
        path.write_bytes(data[:length])
        with pytest.raises(BakeError, match=r"map\.\w+' ends too early: write or copy it again\.$"):
            containers.read(path)
        with pytest.raises(BakeError, match="ends too early"):
            containers.head_of(path)
        if ending == ".dds":  # Blender shows no KTX2
            assert whole_files.problem(str(path), is_image=True) == whole_files.CUT


@pytest.mark.parametrize(
    ("ending", "at", "value", "sentence"),
    [
        (".dds", 128, 71, "holds the format 71"),  # BC1
        (".dds", 84, int.from_bytes(b"DXT1", "little"), "holds the format 'DXT1'"),
        (".dds", 80, 0x40, "holds plain texels"),
        (".dds", 136, 4, "holds several pictures"),
        (".dds", 140, 6, "holds several pictures"),
        (".dds", 12, 1 << 30, "levels of 16 x 1073741824 texels"),
        (".dds", 28, 1 << 31, "2147483648 levels"),
        (".ktx2", 12, 0, "holds a supercompressed format"),
        (".ktx2", 12, 37, "holds the format 37"),
        (".ktx2", 36, 6, "holds several pictures"),
        (".ktx2", 44, 2, "holds the supercompression 2"),
        (".ktx2", 20, 0, "levels of 0 x 16 texels"),
        (".ktx2", 0, 0, "is no DDS or KTX2 file"),
    ],
)
def test_other_content_is_refused(tmp_path, ending, at, value, sentence):
    path = stored(tmp_path, some(BC7, (16, 16)), ending)
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, at, value)
    path.write_bytes(data)
    with pytest.raises(BakeError, match=sentence):
        containers.read(path)
    with pytest.raises(BakeError, match=sentence):
        containers.head_of(path)


def test_sizes_that_programs_do_not_load_are_refused(tmp_path):
    with pytest.raises(
        BakeError, match=r"18 x 16 texels does not load in Direct3D, which takes multiples of 4: .* \.ktx2 file"
    ):
        stored(tmp_path, some(BC5, (18, 16)), ".dds")
    for ending in (".dds", ".ktx2"):
        with pytest.raises(BakeError, match="side above 16,384, which"):
            containers.write(tmp_path / f"map{ending}", Container((16388, 4), [], BC5))
        with pytest.raises(ValueError, match="levels of"):
            containers.write(tmp_path / f"map{ending}", Container((8, 4), [np.zeros((1, 1, 16), np.uint8)], BC5))
    assert not list(tmp_path.iterdir())
    with pytest.raises(BakeError, match="could not be read"):
        containers.read(tmp_path / "none.dds")


def test_padding_repeats_the_border():
    texels = np.arange(5 * 6 * 4, dtype=np.float32).reshape(5, 6, 4)
    wide = containers.padded(texels)
    assert wide.shape == (8, 8, 4) and np.array_equal(wide[:5, :6], texels)
    assert (wide[5:, :6] == texels[4]).all() and (wide[:5, 6:] == texels[:, 5:6]).all()
    assert containers.padded(texels[:4, :4]).shape == (4, 4, 4)
