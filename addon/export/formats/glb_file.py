# SPDX-License-Identifier: GPL-3.0-or-later
"""The container of binary glTF (Khronos glTF 2.0 specification, section 4.4), its accessors and its images."""

import json
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.errors import BakeError

MAGIC, VERSION = b"glTF", 2
JSON_CHUNK, BINARY_CHUNK = b"JSON", b"BIN\0"
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
"""Of components, without the signed ones, which Blender's exporter does not write."""


@dataclass
class Glb:
    """A file: its JSON, and its bytes."""

    tree: dict[str, Any]
    binary: bytes

    @classmethod
    def parsed(cls, data: bytes) -> "Glb":
        """Parse a file. Raises BakeError if it is not one."""
        if len(data) < 20 or data[:4] != MAGIC or struct.unpack_from("<2I", data, 4) != (VERSION, len(data)):
            raise BakeError("What Blender's exporter wrote is no binary glTF 2.0.")
        chunks, place = {}, 12
        while place < len(data):
            size, kind = struct.unpack_from("<I4s", data, place)
            chunks[kind] = data[place + 8 : place + 8 + size]
            place += 8 + size
        return cls(json.loads(chunks[JSON_CHUNK]), chunks.get(BINARY_CHUNK, b""))

    def packed(self) -> bytes:
        """The file."""
        text = json.dumps(self.tree, separators=(",", ":"), ensure_ascii=False).encode()
        chunks = [
            (JSON_CHUNK, text + b" " * (-len(text) % 4)),
            (BINARY_CHUNK, self.binary + b"\0" * (-len(self.binary) % 4)),
        ]
        body = b"".join(struct.pack("<I4s", len(data), kind) + data for kind, data in chunks if data)
        return struct.pack("<4s2I", MAGIC, VERSION, 12 + len(body)) + body

    def accessor(self, number: int) -> np.ndarray:
        """The values (N, n) of an accessor."""
        how = self.tree["accessors"][number]
        view = self.tree["bufferViews"][how["bufferView"]]
        kind, width = np.dtype(TYPES[how["componentType"]]), WIDTHS[how["type"]]
        start = view.get("byteOffset", 0) + how.get("byteOffset", 0)
        stride = view.get("byteStride", kind.itemsize * width)
        shape, strides = (how["count"], width), (stride, kind.itemsize)
        return np.ndarray(shape, kind.newbyteorder("<"), self.binary, start, strides)

    def image(self, texture: int) -> bytes:
        """The file of the image that a texture shows."""
        image = self.tree["images"][self.tree["textures"][texture]["source"]]
        view = self.tree["bufferViews"][image["bufferView"]]
        start = view.get("byteOffset", 0)
        return self.binary[start : start + view["byteLength"]]
