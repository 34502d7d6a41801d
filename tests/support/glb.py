# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads a .glb by its specification, without Imprint's code, and draws what an engine's shader makes of it in UV space."""

import json
import struct
from dataclasses import dataclass

import bpy
import numpy as np
import pytest
from mathutils import Quaternion


@dataclass(frozen=True)
class Part:
    """One primitive: values by vertex, indices (T, 3), its material's JSON, and the file of its normal map."""

    attributes: dict
    indices: np.ndarray
    material: dict
    normal_map: bytes


def parse(path):
    """The JSON, and the binary chunk."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    start = 20 + size
    binary_size, kind = struct.unpack_from("<I4s", data, start)
    assert kind == b"BIN\0"
    assert start + 8 + binary_size == length
    return json.loads(data[20:start]), data[start + 8 :]


def values(tree, binary, number):
    """An accessor's values (N, n)."""
    how = tree["accessors"][number]
    view = tree["bufferViews"][how["bufferView"]]
    kind = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}[how["componentType"]]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[how["type"]]
    start = view.get("byteOffset", 0) + how.get("byteOffset", 0)
    return np.frombuffer(binary, kind, how["count"] * width, start).reshape(-1, width)


EXTENSION = "EXT_texture_webp"


def source(texture):
    """The number of a texture's image."""
    return texture.get("extensions", {}).get(EXTENSION, texture)["source"]


def image(tree, binary, texture):
    """The file of a texture's image."""
    view = tree["bufferViews"][tree["images"][source(tree["textures"][texture])]["bufferView"]]
    start = view.get("byteOffset", 0)
    return binary[start : start + view["byteLength"]]


def parts(path, name):
    """The primitives of a node's mesh."""
    tree, binary = parse(path)
    (node,) = (node for node in tree["nodes"] if node["name"] == name)
    result = []
    for primitive in tree["meshes"][node["mesh"]]["primitives"]:
        material = tree["materials"][primitive["material"]]
        result.append(
            Part(
                {key: values(tree, binary, number) for key, number in primitive["attributes"].items()},
                values(tree, binary, primitive["indices"]).reshape(-1, 3),
                material,
                image(tree, binary, material["normalTexture"]["index"]) if "normalTexture" in material else b"",
            )
        )
    return result


def rotation(path, name):
    """The rotation (3, 3) of a node, in Blender's axes. The node must have no scale."""
    tree, _ = parse(path)
    (node,) = (node for node in tree["nodes"] if node["name"] == name)
    assert node.get("scale", [1, 1, 1]) == pytest.approx([1, 1, 1], abs=1e-5)
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    return np.array(Quaternion((w, x, -z, y)).to_matrix())


def texels(data, tmp_path):
    """The texels (H, W, 3) uint8 of a PNG, row 0 at the top, and its channels and bits."""
    path = tmp_path / "picture.png"
    path.write_bytes(data)
    depth, color = data[24], data[25]
    loaded = bpy.data.images.load(str(path), check_existing=False)
    loaded.colorspace_settings.is_data = True
    found = np.empty(loaded.size[0] * loaded.size[1] * 4, np.float32)
    loaded.pixels.foreach_get(found)
    found = found.reshape(loaded.size[1], loaded.size[0], 4)[::-1, :, :3]
    bpy.data.images.remove(loaded)
    return np.round(found * 255.0).astype(np.uint8), {0: 1, 2: 3, 6: 4}[color], depth


def shown(part, picture):
    """The object-space normals (H, W, 3), in Blender's axes and with row 0 at v = 0, that a MikkTSpace engine shows at the
    centers of texels, and which texels (H, W) triangles cover. picture (H, W, 3) uint8, row 0 at the top."""
    height, width = picture.shape[:2]
    layer = part.material["normalTexture"].get("texCoord", 0)
    uv = part.attributes[f"TEXCOORD_{layer}"].astype(np.float64) * [width, height]
    normals = np.zeros((height, width, 3))
    covered = np.zeros((height, width), bool)
    for corners in part.indices:
        a, b, c = uv[corners]
        low = np.maximum(np.floor(np.minimum(np.minimum(a, b), c)).astype(int), 0)
        high = np.minimum(np.ceil(np.maximum(np.maximum(a, b), c)).astype(int), [width, height])
        x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if not x.size or abs(area) < 1e-12:
            continue
        second = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
        third = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
        weights = np.stack([1.0 - second - third, second, third], axis=-1)
        inside = weights.min(axis=-1) > 0.0
        column, row = (x[inside] - 0.5).astype(int), (y[inside] - 0.5).astype(int)
        normal = weights[inside] @ part.attributes["NORMAL"][corners].astype(np.float64)
        tangent = weights[inside] @ part.attributes["TANGENT"][corners].astype(np.float64)
        bitangent = np.sign(tangent[:, 3:]) * np.cross(normal, tangent[:, :3])
        value = picture[row, column] / 255.0 * 2.0 - 1.0
        found = value[:, :1] * tangent[:, :3] + value[:, 1:2] * bitangent + value[:, 2:] * normal
        found /= np.linalg.norm(found, axis=1, keepdims=True)
        normals[row, column] = np.stack([found[:, 0], -found[:, 2], found[:, 1]], axis=1)
        covered[row, column] = True
    return normals[::-1], covered[::-1]
