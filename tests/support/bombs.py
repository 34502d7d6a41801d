# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures and archives of a few bytes that claim or unpack to very many. They are made by the definitions of their formats."""

import io
import struct
import zipfile
import zlib

SIDE = 60_000
"""Texels. As four channels of 32 bits, the square of it has 57.6 GB."""
EXR_NONE, EXR_ZIP, EXR_HALF, EXR_FLOAT = 0, 3, 1, 2
DEEP = 0x800
"""The flag of an OpenEXR file with any number of samples in a texel."""


def png(bits=1, *, is_cut=False):
    """A black picture of gray with so many bits. is_cut: whether it ends where the rows begin."""

    def chunk(kind, data):
        return len(data).to_bytes(4) + kind + data + zlib.crc32(kind + data).to_bytes(4)

    packer, row = zlib.compressobj(9), bytes(SIDE * bits // 8 + 2)
    rows = 0 if is_cut else SIDE
    packed = b"".join(packer.compress(row) for _ in range(rows)) + packer.flush()
    head = SIDE.to_bytes(4) * 2 + bytes([bits, 0, 0, 0, 0])
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


def exr_head(side=SIDE, channels="R", kind=EXR_HALF, *, packing=EXR_ZIP, version=2, more=b""):
    """The header of an OpenEXR picture. channels: their names."""

    def attribute(name, of, value):
        return b"%s\0%s\0%s%s" % (name, of, struct.pack("<i", len(value)), value)

    listed = b"".join(name.encode() + struct.pack("<xiBxxxii", kind, 0, 1, 1) for name in sorted(channels)) + b"\0"
    window = struct.pack("<4i", 0, 0, side - 1, side - 1)
    parts = [
        attribute(b"channels", b"chlist", listed),
        attribute(b"compression", b"compression", bytes([packing])),
        attribute(b"dataWindow", b"box2i", window),
        attribute(b"displayWindow", b"box2i", window),
        attribute(b"lineOrder", b"lineOrder", b"\0"),
        attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1.0)),
        attribute(b"screenWindowCenter", b"v2f", bytes(8)),
        attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1.0)),
        more,
    ]
    return struct.pack("<II", 20000630, version) + b"".join(parts) + b"\0"


def deep_exr():
    """The header of a deep picture with as many samples in a texel as can be."""
    attributes = (
        (b"type", b"string", b"deepscanline"),
        (b"name", b"string", b"a"),
        (b"version", b"int", struct.pack("<i", 1)),
        (b"maxSamplesPerPixel", b"int", struct.pack("<i", 2**31 - 1)),
        (b"chunkCount", b"int", struct.pack("<i", SIDE)),
    )
    more = b"".join(
        b"%s\0%s\0%s%s" % (name, of, struct.pack("<i", len(value)), value) for name, of, value in attributes
    )
    return exr_head(packing=EXR_NONE, version=2 | DEEP, more=more) + bytes(64)


def whole_exr(side=SIDE):
    """A complete black picture of one channel."""
    rows = 16
    chunks = -(-side // rows)
    head, chunk_at, offsets, chunks_of = exr_head(side), 0, [], []
    for number in range(chunks):
        count = 2 * side * min(rows, side - number * rows)
        if number in (0, chunks - 1):  # differences of equal bytes are stored as 128
            packed = zlib.compress(b"\0" + b"\x80" * (count - 1), 9)
        chunks_of.append(struct.pack("<ii", number * rows, len(packed)) + packed)
        offsets.append(len(head) + 8 * chunks + chunk_at)
        chunk_at += len(chunks_of[-1])
    return head + struct.pack(f"<{chunks}Q", *offsets) + b"".join(chunks_of)


def jpeg(small):
    """A JPEG picture whose header says more than it has. small: the bytes of one."""
    content = bytearray(small)
    at = content.index(b"\xff\xc0")
    content[at + 5 : at + 9] = struct.pack(">HH", SIDE, SIDE)
    return bytes(content)


def tiff(samples=4):
    """A TIFF picture without most of its texels. samples: in a texel, of 32 bits."""
    fields = [(256, 4, SIDE), (257, 4, SIDE), (258, 3, 32), (259, 3, 8), (262, 3, 2), (273, 4, 8), (277, 3, samples)]
    fields += [(278, 4, SIDE), (279, 4, 16), (339, 3, 3)]
    directory = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in fields) + bytes(4)
    return b"II*\0" + struct.pack("<I16sH", 24, zlib.compress(b""), len(fields)) + directory


def hdr():
    """A complete black picture of Radiance: a texel, and how often it comes again, of each row."""
    row = bytes(4) + bytes([1, 1, 1, (SIDE - 1) & 255, 1, 1, 1, (SIDE - 1) >> 8])
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (SIDE, SIDE) + row * SIDE


def pictures(small_jpeg):
    """All pictures, by the names of their files. small_jpeg: as in `jpeg`."""
    return {
        "cut.png": png(16, is_cut=True),
        "whole.exr": whole_exr(),
        "large.exr": whole_exr(20_000),
        "head.exr": exr_head() + bytes(64),
        "most.exr": exr_head(2**31 - 2, "RGBA", EXR_FLOAT) + bytes(64),
        "channels.exr": exr_head(channels=[f"layer{number}.R" for number in range(500)]) + bytes(64),
        "deep.exr": deep_exr(),
        "a.jpg": jpeg(small_jpeg),
        "a.tif": tiff(),
        "samples.tif": tiff(4000),
        "a.hdr": hdr(),
    }


def zip_of_zeros(name, size, packing=zipfile.ZIP_DEFLATED):
    """An archive with a file of zeros. With ZIP_STORED it has only the file's head, which says its size."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", packing) as archive:
        archive.writestr(name, bytes(size if packing == zipfile.ZIP_DEFLATED else 64))
    if packing == zipfile.ZIP_DEFLATED:
        return content.getvalue()
    return content.getvalue().replace(struct.pack("<II", 64, 64), struct.pack("<II", size, size))
