# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts in WebP files, in their XMP metadata, by Google's "WebP Container Specification": OpenImageIO stores none there."""

import html
import re
import struct
from pathlib import Path

_EXTENDED, _LOSSLESS, _TEXT = b"VP8X", b"VP8L", b"XMP "
_HAS_TEXT, _HAS_ALPHA = 0x04, 0x10
_LONGEST = 1 << 20
"""Bytes of a text that are read at most."""
_PACKET = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description rdf:about="" xmlns:imprint="https://imprint.invalid/" imprint:note="{}"/></rdf:RDF></x:xmpmeta>'
)
_NOTE = re.compile(r'imprint:note="([^"]*)"')


def add(path: Path, note: str) -> None:
    """Add a text to a WebP file that has none, and no other metadata."""
    data = path.read_bytes()
    if data[12:16] == _EXTENDED:
        head, rest = bytes([data[20] | _HAS_TEXT]) + data[21:30], data[30:]
    else:
        sides = b"".join((side - 1).to_bytes(3, "little") for side in _size(data))
        head, rest = bytes([_HAS_TEXT | _has_alpha(data) * _HAS_ALPHA, 0, 0, 0]) + sides, data[12:]
    body = b"WEBP" + _chunk(_EXTENDED, head) + rest + _chunk(_TEXT, _PACKET.format(html.escape(note)).encode())
    path.write_bytes(b"RIFF" + struct.pack("<I", len(body)) + body)


def read(path: str | Path) -> str:
    """The text in a file; empty if it has none, or is no WebP file. Raises OSError."""
    with open(path, "rb") as file:
        start = file.read(12)
        if start[:4] != b"RIFF" or start[8:] != b"WEBP":
            return ""
        while len(head := file.read(8)) == 8:
            name, length = struct.unpack("<4sI", head)
            if name == _TEXT:
                match = _NOTE.search(file.read(min(length, _LONGEST)).decode(errors="replace"))
                return html.unescape(match[1]) if match else ""
            file.seek(length + length % 2, 1)
    return ""


def _chunk(name: bytes, data: bytes) -> bytes:
    return name + struct.pack("<I", len(data)) + data + bytes(len(data) % 2)


def _size(data: bytes) -> tuple[int, int]:
    """Width and height of a file without the head of an extended one."""
    if data[12:16] == _LOSSLESS:
        (bits,) = struct.unpack_from("<I", data, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    width, height = struct.unpack_from("<HH", data, 26)
    return width & 0x3FFF, height & 0x3FFF


def _has_alpha(data: bytes) -> bool:
    return data[12:16] == _LOSSLESS and bool(struct.unpack_from("<I", data, 21)[0] >> 28 & 1)
