# SPDX-License-Identifier: GPL-3.0-or-later
"""Binary glTF files as the engines take them: read without Blender, and written again with other maps and with cameras."""

import json
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

MAGIC, JSON, BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
NUMBERS = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
CAMERA = "view"
"""The names of the cameras begin with it."""


@dataclass(frozen=True)
class Surface:
    """The triangles of a file by corner, in world space, float64.

    position, normal: (T, 3, 3), normals not normalized. tangent: (T, 3, 4), the last number is the bitangent's sign; None
    if a part has none. uv: (T, 3, 2), with v down, as glTF has it.
    """

    position: np.ndarray
    normal: np.ndarray
    tangent: np.ndarray | None
    uv: np.ndarray


class Glb:
    """The JSON and the binary part of a .glb. Raises ValueError for a file that is none."""

    def __init__(self, content: bytes):
        if len(content) < 20 or struct.unpack_from("<I", content)[0] != MAGIC:
            raise ValueError("this is not a .glb file")
        self.document, self.binary = {}, b""
        at = 12
        while at < len(content):
            length, kind = struct.unpack_from("<II", content, at)
            chunk = content[at + 8 : at + 8 + length]
            if kind == JSON:
                self.document = json.loads(chunk)
            elif kind == BINARY:
                self.binary = chunk
            at += 8 + length

    @classmethod
    def read(cls, path: Path) -> "Glb":
        return cls(path.read_bytes())

    def content(self) -> bytes:
        """The bytes of the file."""
        self.document["buffers"] = [{"byteLength": len(self.binary)}]
        text = json.dumps(self.document).encode()
        text += b" " * (-len(text) % 4)
        data = self.binary + bytes(-len(self.binary) % 4)
        parts = struct.pack("<II", len(text), JSON) + text + struct.pack("<II", len(data), BINARY) + data
        return struct.pack("<III", MAGIC, 2, 12 + len(parts)) + parts

    def copy(self) -> "Glb":
        return Glb(self.content())

    def accessor(self, index: int) -> np.ndarray:
        """The values (N, columns) of an accessor."""
        about = self.document["accessors"][index]
        view = self.document["bufferViews"][about["bufferView"]]
        kind, columns = np.dtype(NUMBERS[about["componentType"]]), COLUMNS[about["type"]]
        start = view.get("byteOffset", 0) + about.get("byteOffset", 0)
        stride = view.get("byteStride", kind.itemsize * columns)
        rows = np.ndarray((about["count"], columns), kind, self.binary, start, (stride, kind.itemsize))
        values = rows.astype(np.float64) if kind == np.float32 else rows.astype(np.int64)
        return values / np.iinfo(kind).max if about.get("normalized") else values

    def surface(self) -> Surface:
        """All triangles of the scene."""
        found = [part for root in self.roots() for part in self._parts(root, np.eye(4))]
        columns = list(zip(*found, strict=True))
        tangents = None if any(one is None for one in columns[2]) else np.concatenate(columns[2])
        return Surface(np.concatenate(columns[0]), np.concatenate(columns[1]), tangents, np.concatenate(columns[3]))

    def roots(self) -> list[int]:
        return self.document["scenes"][self.document.get("scene", 0)]["nodes"]

    def _parts(self, index: int, parent: np.ndarray):
        node = self.document["nodes"][index]
        matrix = parent @ node_matrix(node)
        if "mesh" in node:
            for part in self.document["meshes"][node["mesh"]]["primitives"]:
                yield self._corners(part, matrix)
        for child in node.get("children", ()):
            yield from self._parts(child, matrix)

    def _corners(self, part: dict, matrix: np.ndarray) -> tuple:
        values = {name: self.accessor(index) for name, index in part["attributes"].items()}
        corners = self.accessor(part["indices"]).reshape(-1, 3)
        position = values["POSITION"] @ matrix[:3, :3].T + matrix[:3, 3]
        normal = unit(values["NORMAL"] @ np.linalg.inv(matrix[:3, :3]))
        tangent = values.get("TANGENT")
        if tangent is not None:
            tangent = np.concatenate([unit(tangent[:, :3] @ matrix[:3, :3].T), tangent[:, 3:]], axis=1)[corners]
        return position[corners], normal[corners], tangent, values["TEXCOORD_0"][corners]

    def normal_texture(self) -> int:
        """The index of the image of the normal map. Raises ValueError if the materials have none, or several."""
        textures = {
            one["normalTexture"]["index"] for one in self.document.get("materials", ()) if "normalTexture" in one
        }
        if len(textures) != 1:
            raise ValueError(f"the file has {len(textures)} normal maps, and not one")
        return self.document["textures"][textures.pop()]["source"]

    def image(self, index: int) -> bytes:
        """The content of an image."""
        view = self.document["bufferViews"][self.document["images"][index]["bufferView"]]
        return self.binary[view.get("byteOffset", 0) :][: view["byteLength"]]

    def set_image(self, index: int, png: bytes) -> None:
        """Put other content into an image. The old content stays in the file, without use."""
        self.binary += bytes(-len(self.binary) % 4)
        self.document["bufferViews"].append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(png)})
        self.binary += png
        name = self.document["images"][index].get("name", "map")
        view = len(self.document["bufferViews"]) - 1
        self.document["images"][index] = {"name": name, "mimeType": "image/png", "bufferView": view}

    def without_normal_map(self) -> "Glb":
        """A copy whose materials have no normal map."""
        bare = self.copy()
        for one in bare.document["materials"]:
            one.pop("normalTexture", None)
        return bare

    def without_tangents(self) -> "Glb":
        """A copy whose meshes have no tangents."""
        bare = self.copy()
        for mesh in bare.document["meshes"]:
            for part in mesh["primitives"]:
                part["attributes"].pop("TANGENT", None)
        return bare

    def with_map_as_surface(self) -> "Glb":
        """A copy with the image of its normal map as clear coat, roughness and metallic: from its red, green and blue."""
        shown = self.copy()
        for one in shown.document["materials"]:
            texture = one.pop("normalTexture")
            coat = {"clearcoatFactor": 1.0, "clearcoatTexture": dict(texture)}
            one.setdefault("extensions", {})["KHR_materials_clearcoat"] = coat
            one["pbrMetallicRoughness"] = {"metallicRoughnessTexture": dict(texture)}
        shown.document["extensionsUsed"] = sorted(
            {*shown.document.get("extensionsUsed", ()), "KHR_materials_clearcoat"}
        )
        return shown

    def set_cameras(self, views: list[np.ndarray], angle: float, near: float, far: float) -> None:
        """Add square perspective cameras with these view matrices (4, 4) and this field of view in degrees."""
        lens = {"yfov": float(np.radians(angle)), "aspectRatio": 1.0, "znear": near, "zfar": far}
        self.document["cameras"] = [
            {"name": f"{CAMERA}{index}", "type": "perspective", "perspective": lens} for index in range(len(views))
        ]
        for index, view in enumerate(views):
            matrix = np.linalg.inv(view).T.ravel().tolist()
            self.document["nodes"].append({"name": f"{CAMERA}{index}", "camera": index, "matrix": matrix})
            self.roots().append(len(self.document["nodes"]) - 1)


def node_matrix(node: dict) -> np.ndarray:
    """The matrix (4, 4) of a node of the scene."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def unit(vectors: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(lengths > 0.0, lengths, 1.0)
