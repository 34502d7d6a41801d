# SPDX-License-Identifier: GPL-3.0-or-later
"""Binary glTF (Khronos glTF 2.0 specification, section 4.4): JSON and bytes, accessors and images, what refers to what."""

import base64
import json
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from ..core.errors import BakeError

MAGIC, VERSION = b"glTF", 2
JSON_CHUNK, BINARY_CHUNK = b"JSON", b"BIN\0"
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
TYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
"""Of components."""


SHORT = 0xFFFF
"""Numbers of vertices below it fit into two bytes."""
JPEG, PNG, WEBP, KTX2 = "image/jpeg", "image/png", "image/webp", "image/ktx2"
"""The formats of images, by their media types."""
EXTENSIONS = {WEBP: "EXT_texture_webp", KTX2: "KHR_texture_basisu"}
"""The extensions by which textures show images, by their formats."""


@dataclass
class Glb:
    """A file: its JSON, and its bytes.

    Attributes:
        tree: The JSON.
        binary: The bytes that its buffer views are parts of.
    """

    tree: dict[str, Any]
    binary: bytearray

    @classmethod
    def parsed(cls, data: bytes) -> "Glb":
        """Parse a file. Raises BakeError if it is not one."""
        if len(data) < 20 or data[:4] != MAGIC or struct.unpack_from("<2I", data, 4) != (VERSION, len(data)):
            raise BakeError("This is no binary glTF 2.0.")
        chunks, place = {}, 12
        while place < len(data):
            size, kind = struct.unpack_from("<I4s", data, place)
            chunks[kind] = data[place + 8 : place + 8 + size]
            place += 8 + size
        return cls(json.loads(chunks[JSON_CHUNK]), bytearray(chunks.get(BINARY_CHUNK, b"")))

    @classmethod
    def read(cls, path: Path) -> "Glb":
        """Read a .glb or .gltf with all files that it names, which are in the result. Raises BakeError."""
        try:
            data = path.read_bytes()
            file = cls.parsed(data) if data[:4] == MAGIC else cls(json.loads(data), bytearray())
            if any("uri" in each for kind in ("buffers", "images") for each in file.tree.get(kind, ())):
                file._take_files(path.parent)
        except (OSError, ValueError, KeyError) as error:
            raise BakeError(f"{str(path)!r} cannot be read: {error}.") from error
        return file

    def _take_files(self, folder: Path) -> None:
        """Put all buffers into one, and the files of images into views."""
        own, begins = bytes(self.binary), []
        self.binary = bytearray()
        for buffer in self.tree.get("buffers", ()):
            begins.append(self._append(_content(buffer["uri"], folder) if "uri" in buffer else own))
        for view in self.tree.get("bufferViews", ()):
            view["byteOffset"] = view.get("byteOffset", 0) + begins[view["buffer"]]
            view["buffer"] = 0
        self.tree["buffers"] = [{}]
        for image in self.tree.get("images", ()):
            if uri := image.pop("uri", ""):
                data = _content(uri, folder)
                image |= {"bufferView": self.add_view(data), "mimeType": _mime_type(data)}

    def _append(self, data: bytes) -> int:
        """Where these bytes begin, which are added."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        self.binary += data
        return len(self.binary) - len(data)

    def packed(self) -> bytes:
        """The file."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        if self.binary:
            self.tree.setdefault("buffers", [{}])[0]["byteLength"] = len(self.binary)
        text = json.dumps(self.tree, separators=(",", ":"), ensure_ascii=False).encode()
        chunks = [
            (JSON_CHUNK, text + b" " * (-len(text) % 4)),
            (BINARY_CHUNK, self.binary),
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
        size = stride * (how["count"] - 1) + kind.itemsize * width
        return np.ndarray(shape, kind.newbyteorder("<"), bytes(self.binary[start : start + size]), 0, strides)

    def image(self, texture: int) -> bytes:
        """The file of the image that a texture shows."""
        return self.view(self.tree["images"][shown_image(self.tree["textures"][texture])]["bufferView"])

    def view(self, number: int) -> bytes:
        """The bytes of a buffer view."""
        view = self.tree["bufferViews"][number]
        start = view.get("byteOffset", 0)
        return bytes(self.binary[start : start + view["byteLength"]])

    def replace_view(self, number: int, data: bytes) -> None:
        """Give a buffer view other bytes. The former ones stay until `pack_buffer`."""
        self.tree["bufferViews"][number] |= {"byteOffset": self._append(data), "byteLength": len(data)}

    def show_image(self, texture: dict[str, Any], image: int) -> None:
        """Have a texture show an image alone, whose format readers of the file must know then if it is one of EXTENSIONS."""
        extension = EXTENSIONS.get(self.tree["images"][image].get("mimeType", ""))
        if extension is None:
            return
        texture.pop("source", None)
        texture.setdefault("extensions", {})[extension] = {"source": image}
        for key in ("extensionsUsed", "extensionsRequired"):
            names = self.tree.setdefault(key, [])
            if extension not in names:
                names.append(extension)

    def whole(self, number: int) -> np.ndarray:
        """As `accessor`, in an array of its own, also of values that are all 0, or stored where they are not."""
        how = self.tree["accessors"][number]
        if "bufferView" in how:
            values = self.accessor(number).copy()
        else:
            values = np.zeros((how["count"], WIDTHS[how["type"]]), TYPES[how["componentType"]])
        if "sparse" in how:
            sparse = how["sparse"]
            places = self._part(sparse["indices"], sparse["indices"]["componentType"], sparse["count"], 1)[:, 0]
            values[places] = self._part(sparse["values"], how["componentType"], sparse["count"], values.shape[1])
        return values

    def _part(self, how: dict[str, Any], kind: int, count: int, width: int) -> np.ndarray:
        start = self.tree["bufferViews"][how["bufferView"]].get("byteOffset", 0) + how.get("byteOffset", 0)
        dtype = np.dtype(TYPES[kind]).newbyteorder("<")
        data = bytes(self.binary[start : start + count * width * dtype.itemsize])
        return np.frombuffer(data, dtype).reshape(count, width)

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """The number of a new entry of the JSON."""
        self.tree.setdefault(kind, []).append(entry)
        return len(self.tree[kind]) - 1

    def add_view(self, data: bytes) -> int:
        """The number of a new buffer view with these bytes."""
        view = {"buffer": 0, "byteOffset": self._append(data), "byteLength": len(data)}
        return self.add("bufferViews", view)

    def add_accessor(self, values: np.ndarray, **like: Any) -> int:
        """The number of a new accessor of `values` (N, n), of one of TYPES. like: more of it, as its bounds."""
        kind = next(number for number, each in TYPES.items() if values.dtype == each)
        step = -values.shape[1] * values.itemsize % 4  # each row begins at a multiple of 4 bytes
        rows = np.pad(np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1), ((0, 0), (0, step)))
        view = self.add_view(rows.tobytes())
        if step:
            self.tree["bufferViews"][view]["byteStride"] = rows.shape[1]
        width = next(name for name, number in WIDTHS.items() if number == values.shape[1])
        return self.add(
            "accessors", {"bufferView": view, "componentType": kind, "count": len(values), "type": width, **like}
        )

    def add_indices(self, numbers: np.ndarray) -> int:
        """The number of a new accessor of the vertices (N,) int of triangles."""
        kind = 5123 if numbers.max(initial=0) < SHORT else 5125
        view = self.add_view(numbers.astype(TYPES[kind]).tobytes())
        return self.add(
            "accessors", {"bufferView": view, "componentType": kind, "count": len(numbers), "type": "SCALAR"}
        )

    def pack_buffer(self) -> None:
        """Leave out the bytes of no buffer view."""
        old, self.binary = bytes(self.binary), bytearray()
        for view in self.tree.get("bufferViews", ()):
            start = view.get("byteOffset", 0)
            view["byteOffset"] = self._append(old[start : start + view["byteLength"]])


def _content(uri: str, folder: Path) -> bytes:
    """What a URI of a .gltf names: a file, or data in itself."""
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2])
    return (folder / unquote(uri)).read_bytes()


def _mime_type(image: bytes) -> str:
    return JPEG if image[:2] == b"\xff\xd8" else WEBP if image[8:12] == b"WEBP" else PNG


def shown_image(texture: Mapping[str, Any]) -> int:
    """The number of the image that a texture shows where EXTENSIONS are known."""
    extensions = texture.get("extensions", {})
    return next((extensions[each] for each in EXTENSIONS.values() if each in extensions), texture)["source"]


KINDS = ("materials", "textures", "samplers", "images", "accessors", "bufferViews")
"""What the parts of a file refer to by numbers, each before those that it refers to."""
FOLLOWED = {
    *(
        "KHR_texture_transform",
        "KHR_mesh_quantization",
        "KHR_materials_variants",
        *EXTENSIONS.values(),
    ),
    *("KHR_lights_punctual", "KHR_node_visibility", "EXT_mesh_manifold"),
}
"""Extensions whose references `references` knows, beside those of materials."""
OF_MATERIALS = "KHR_materials_"


def references(tree: Mapping[str, Any]) -> Iterator[tuple[str, dict, str]]:
    """What refers to one of KINDS: the kind, and the owner and the key of the number."""
    for mesh in tree.get("meshes", ()):
        for primitive in mesh["primitives"]:
            yield from _of_primitive(primitive)
    for material in tree.get("materials", ()):
        yield from _of_textures(material)
    for texture in tree.get("textures", ()):
        for owner in (texture, *texture.get("extensions", {}).values()):
            yield from (("images", owner, key) for key in ("source",) if key in owner)
        yield from (("samplers", texture, key) for key in ("sampler",) if key in texture)
    for image in tree.get("images", ()):
        yield from (("bufferViews", image, key) for key in ("bufferView",) if key in image)
    for skin in tree.get("skins", ()):
        yield from (("accessors", skin, key) for key in ("inverseBindMatrices",) if key in skin)
    for animation in tree.get("animations", ()):
        for sampler in animation["samplers"]:
            yield from (("accessors", sampler, key) for key in ("input", "output"))
    for accessor in tree.get("accessors", ()):
        sparse = accessor.get("sparse", {})
        for owner in (accessor, sparse.get("indices", {}), sparse.get("values", {})):
            yield from (("bufferViews", owner, key) for key in ("bufferView",) if key in owner)


def _of_primitive(primitive: dict) -> Iterator[tuple[str, dict, str]]:
    for owner in (primitive["attributes"], *primitive.get("targets", ())):
        yield from (("accessors", owner, key) for key in owner)
    yield from (("accessors", primitive, key) for key in ("indices",) if key in primitive)
    mappings = primitive.get("extensions", {}).get("KHR_materials_variants", {}).get("mappings", ())
    for owner in (primitive, *mappings):
        yield from (("materials", owner, key) for key in ("material",) if key in owner)


def textures_of(part: dict) -> Iterator[dict]:
    """The entries of a material that name a texture, by its number "index"."""
    for key, value in part.items():
        if key != "extras" and isinstance(value, dict):
            if key.endswith("Texture") and "index" in value:
                yield value
            else:
                yield from textures_of(value)


def _of_textures(material: dict) -> Iterator[tuple[str, dict, str]]:
    yield from (("textures", info, "index") for info in textures_of(material))


def unused(tree: Mapping[str, Any]) -> dict[str, set[int]]:
    """The numbers of each of KINDS to which nothing refers."""
    found = {kind: set(range(len(tree.get(kind, ())))) for kind in KINDS}
    for kind, owner, key in references(tree):
        found[kind].discard(owner[key])
    return found


def drop_unused(file: Glb, staying: Mapping[str, set[int]]) -> None:
    """Leave out what nothing refers to any more, unless the file has extensions that may refer to more.

    staying: what stays all the same, as `unused` returned it of the file as it came.
    """
    tree = file.tree
    names = {*tree.get("extensionsUsed", ()), *tree.get("extensions", {})}
    if (
        any(name not in FOLLOWED and not name.startswith(OF_MATERIALS) for name in names)
        or len(tree.get("buffers", ())) > 1
    ):
        return
    for kind in KINDS:
        owners = [(owner, key) for each, owner, key in references(tree) if each == kind]
        needed = {owner[key] for owner, key in owners} | staying[kind]
        new = {number: place for place, number in enumerate(sorted(needed))}
        for owner, key in owners:
            owner[key] = new[owner[key]]
        if kind in tree:
            tree[kind] = [tree[kind][number] for number in new]
            if not tree[kind]:
                del tree[kind]
    file.pack_buffer()
