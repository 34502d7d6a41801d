# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of reading sizes from the headers of image files. tests/scene/test_textures.py reads files that Blender wrote."""

import io
import random
import struct

import pytest

from addon.core.file_structure.whole_files import image_size

PNG = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 300, 200)


def segment(marker, body=b""):
    return struct.pack(">BBH", 0xFF, marker, 2 + len(body)) + body


FRAME = struct.pack(">BHHB", 8, 200, 300, 3)
TABLES = segment(0xE0, b"JFIF") + segment(0xC4, b"tables") + segment(0xDB, b"\xff\xc0" * 9)


@pytest.mark.parametrize("frame", [0xC0, 0xC2, 0xCF])
def test_jpeg(frame):
    """The Huffman tables have a marker among those of frames."""
    assert image_size(io.BytesIO(b"\xff\xd8" + TABLES + b"\xff\xff" + segment(frame, FRAME))) == (300, 200)


def test_png():
    assert image_size(io.BytesIO(PNG)) == (300, 200)


@pytest.mark.parametrize("order", ["<", ">"])
def test_tiff(order):
    mark = b"II*\0" if order == "<" else b"MM\0*"
    entries = [(256, 3, 1, 300), (257, 4, 1, 200)]
    body = b"".join(
        struct.pack(order + "HHI", *entry[:3]) + struct.pack(order + ("H2x" if entry[1] == 3 else "I"), entry[3])
        for entry in entries
    )
    assert image_size(io.BytesIO(mark + struct.pack(order + "IH", 8, 2) + body + bytes(4))) == (300, 200)


@pytest.mark.parametrize("length", range(len(PNG)))
def test_files_that_end_early_are_not_known(length):
    assert image_size(io.BytesIO(PNG[:length])) is None


def test_other_files_are_not_known():
    jpeg = b"\xff\xd8" + TABLES + segment(0xC0, FRAME)
    for end in range(3, len(jpeg) - 1):
        assert image_size(io.BytesIO(jpeg[:end])) is None
    assert image_size(io.BytesIO(b"\xff\xd8\xff\xe0\0\x02no marker")) is None
    assert image_size(io.BytesIO(b"BM and more bytes than a header has")) is None


def test_random_bytes_raise_nothing_seed_7():

    source = random.Random(7)
    for start in (b"\xff\xd8\xff", b"II*\0", b"MM\0*", b"\x89PNG\r\n\x1a\n", b""):
        for _ in range(300):
            image_size(io.BytesIO(start + source.randbytes(source.randrange(60))))
