# SPDX-License-Identifier: GPL-3.0-or-later
"""Binary glTF (Khronos glTF 2.0 specification, section 4.4): Blender's exporter writes it, with the tangents of the bake and
levels of detail put in afterwards."""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.errors import BakeError
from .. import staging
from ..baked_low import FileMesh
from ..staging import Stage, Staged

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


CHANNELS = ("+X", "+Y", "+Z")
"""The axes that normal maps store."""
HAS_TANGENTS = LINKS_LEVELS = True
NAMES_FILES = SHARES_FOLDER = False
LEVELS = "MSFT_lod"
"""The extension whose nodes name others as their coarser levels."""


def check() -> None:
    """Raise BakeError if the exporter is missing."""
    if not hasattr(bpy.types, "EXPORT_SCENE_OT_gltf"):
        raise BakeError("Blender's add-on glTF 2.0 is off: enable it in the preferences.")


def write(stage: Stage, path: Path, *, are_levels: bool) -> list[Path]:
    """Write the staged objects to `path`; as levels of detail, from the finest, if `are_levels`. Returns the files."""
    bpy.ops.export_scene.gltf(
        filepath=str(path),
        check_existing=False,
        export_format="GLB",
        collection=stage.collection.name,
        export_image_format="AUTO",
        export_texcoords=True,
        export_normals=True,
        export_tangents=False,  # they would be of the mesh in triangles, without the quads that the bake had
        export_attributes=True,
        export_materials="EXPORT",
        export_yup=True,
        export_apply=False,
        export_animations=False,
        export_current_frame=True,
        export_skins=False,
        export_morph=False,
        export_extras=False,
        export_cameras=False,
        export_lights=False,
        export_vertex_color="NONE",
        export_draco_mesh_compression_enable=False,
        export_hierarchy_full_collections=False,
        use_mesh_edges=False,
        use_mesh_vertices=False,
        will_save_settings=False,
    )
    glb = Glb.parsed(path.read_bytes())
    for mesh in glb.tree.get("meshes", ()):
        for primitive in mesh["primitives"]:
            attributes = primitive["attributes"]
            attributes["TANGENT"] = attributes.pop(staging.TANGENTS)
    if are_levels:
        _link_levels(glb.tree, [one.name for one in stage.objects])
    path.write_bytes(glb.packed())
    return [path]


def _link_levels(tree: dict[str, Any], names: Sequence[str]) -> None:
    """Make the nodes after the first its coarser levels: the scene shows only the first."""
    first, *others = (_node(tree, name) for name in names)
    tree["nodes"][first].setdefault("extensions", {})[LEVELS] = {"ids": others}
    tree.setdefault("extensionsUsed", []).append(LEVELS)
    for scene in tree["scenes"]:
        scene["nodes"] = [number for number in scene["nodes"] if number not in others]


def _node(tree: dict[str, Any], name: str) -> int:
    found = [number for number, node in enumerate(tree["nodes"]) if node.get("name") == name and "mesh" in node]
    if not found:
        raise BakeError(f"Blender's exporter left out {name!r}.")
    return found[0]


def read(path: Path, one: Staged) -> FileMesh:
    """Read an object back. Raises BakeError."""
    glb = Glb.parsed(path.read_bytes())
    tree = glb.tree
    mesh = tree["meshes"][tree["nodes"][_node(tree, one.name)]["mesh"]]
    parts: dict[str, list[np.ndarray]] = {}
    pictures: list[bytes | None] = []
    for number, primitive in enumerate(mesh["primitives"]):
        indices = glb.accessor(primitive["indices"])[:, 0].reshape(-1, 3)
        texture = tree["materials"][primitive["material"]].get("normalTexture") if "material" in primitive else None
        pictures.append(glb.image(texture["index"]) if texture else None)
        layer = f"TEXCOORD_{texture.get('texCoord', 0) if texture else 0}"
        for name, accessor in primitive["attributes"].items():
            key = "uv" if name == layer else name.lower()
            parts.setdefault(key, []).append(glb.accessor(accessor)[indices])
        parts.setdefault("material", []).append(np.full(len(indices), number))
    found = {name: np.concatenate(values) for name, values in parts.items()}
    uv = found["uv"].copy()
    uv[..., 1] = 1.0 - uv[..., 1]
    has_tangents = len(found.get("tangent", ())) == len(found["position"])
    return FileMesh(
        _z_up(found["position"]),
        _z_up(found["normal"]),
        uv,
        _z_up(found["tangent"]) if has_tangents else None,
        found["material"],
        pictures,
    )


def _z_up(values: np.ndarray) -> np.ndarray:
    """Vectors (..., n) of glTF, where Y is up, in Blender's axes. A fourth component stays."""
    return np.concatenate([values[..., :1], -values[..., 2:3], values[..., 1:2], values[..., 3:]], axis=-1)
