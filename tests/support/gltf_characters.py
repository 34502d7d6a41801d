# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes .glb files with many materials by the specification, without Imprint's code and Blender's: a character of eleven
materials, with a skin, a shape key, an animation and extras, and a cart of several objects without textures."""

import json
import struct
from pathlib import Path

import numpy as np

from scripts.dev.in_engines import drawing

KINDS = {"f": (np.float32, 5126), "I": (np.uint32, 5125), "H": (np.uint16, 5123), "B": (np.uint8, 5121)}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Writer:
    """A file that is made: its JSON and its bytes."""

    def __init__(self):
        self.binary = b""
        self.tree = {"asset": {"version": "2.0", "generator": "a test"}, "scene": 0, "scenes": [{"nodes": []}]}

    def add(self, key, entry):
        """The number of a new entry of the JSON."""
        self.tree.setdefault(key, []).append(entry)
        return len(self.tree[key]) - 1

    def view(self, data):
        self.binary += bytes(-len(self.binary) % 4)
        self.binary += data
        return self.add(
            "bufferViews", {"buffer": 0, "byteOffset": len(self.binary) - len(data), "byteLength": len(data)}
        )

    def accessor(self, values, kind="f", **more):
        values = np.ascontiguousarray(values, KINDS[kind][0])
        values = values.reshape(len(values), -1)
        width = values.shape[1]
        entry = {"bufferView": self.view(values.tobytes()), "componentType": KINDS[kind][1], "count": len(values)}
        if more.pop("has_bounds", False):
            more |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        return self.add("accessors", entry | {"type": TYPES[width]} | more)

    def texture(self, colors):
        """The number of a texture of colors (height, width, 3 or 4) uint8, row 0 at the top."""
        png = drawing.png_of(colors[::-1]) if colors.shape[2] == 3 else _png_with_alpha(colors)
        image = self.add("images", {"bufferView": self.view(png), "mimeType": "image/png", "name": f"paint {len(png)}"})
        sampler = self.add("samplers", {"wrapS": 10497, "wrapT": 10497, "magFilter": 9729, "minFilter": 9987})
        return self.add("textures", {"source": image, "sampler": sampler})

    def save(self, path: Path) -> Path:
        self.tree["buffers"] = [{"byteLength": len(self.binary)}]
        text = json.dumps(self.tree).encode()
        text += b" " * (-len(text) % 4)
        data = self.binary + bytes(-len(self.binary) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
        return path


def _png_with_alpha(colors):
    import zlib

    height, width = colors.shape[:2]
    rows = np.zeros((height, 1 + width * 4), np.uint8)
    rows[:, 1:] = colors.reshape(height, -1)
    head = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    parts = ((b"IHDR", head), (b"IDAT", zlib.compress(rows.tobytes(), 6)), (b"IEND", b""))
    chunks = [
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in parts
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def waves(random, size=64, *, alpha=False):
    """A smooth texture (size, size, 3 or 4) uint8 that repeats. alpha: with clear spots."""
    at = np.arange(size) / size * 2.0 * np.pi
    x, y = np.meshgrid(at, at)
    channels = []
    for _ in range(4 if alpha else 3):
        a, b = random.integers(1, 3, 2)
        phases = random.uniform(0.0, 6.0, 2)
        channels.append(0.5 + 0.22 * np.sin(a * x + phases[0]) + 0.22 * np.sin(b * y + phases[1]))
    values = np.stack(channels, axis=-1)
    if alpha:
        values[..., 3] = np.where(values[..., 3] > 0.35, 1.0, 0.0)
    return np.round(values * 255.0).astype(np.uint8)


def ellipsoid(center, radii, rows=8, columns=12):
    """Positions, normals, UVs (V, n) in glTF's axes, and corners (T, 3) of an ellipsoid whose UVs fill the square."""
    v, u = np.meshgrid(np.linspace(0.0, 1.0, rows + 1), np.linspace(0.0, 1.0, columns + 1), indexing="ij")
    height, around = (v - 0.5) * np.pi * 0.96, u * 2.0 * np.pi
    unit = np.stack([np.cos(height) * np.sin(around), np.sin(height), np.cos(height) * np.cos(around)], axis=-1)
    unit = unit.reshape(-1, 3)
    normals = unit / np.array(radii)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1)
    step = columns + 1
    corners = np.concatenate(
        [
            np.stack([first, first + 1, first + step + 1], axis=1),
            np.stack([first, first + step + 1, first + step], axis=1),
        ]
    )
    return unit * radii + center, normals, np.stack([u, 1.0 - v], axis=-1).reshape(-1, 2), corners


PARTS = (
    ("body", (0, 1.0, 0), (0.35, 0.5, 0.22)),
    ("head", (0, 1.75, 0), (0.2, 0.25, 0.22)),
    ("hair", (0, 1.9, -0.05), (0.24, 0.16, 0.24)),
    ("left eye", (0.08, 1.78, 0.2), (0.04, 0.04, 0.03)),
    ("right eye", (-0.08, 1.78, 0.2), (0.04, 0.04, 0.03)),
    ("left arm", (0.5, 1.1, 0), (0.1, 0.4, 0.1)),
    ("right arm", (-0.5, 1.1, 0), (0.1, 0.4, 0.1)),
    ("left leg", (0.17, 0.2, 0), (0.13, 0.5, 0.13)),
    ("right leg", (-0.17, 0.2, 0), (0.13, 0.5, 0.13)),
    ("skirt", (0, 0.65, 0), (0.45, 0.15, 0.3)),
    ("shoes", (0, -0.3, 0.06), (0.35, 0.06, 0.18)),
)
COLUMNS, ROWS, BORDER = 4, 3, 0.06


def cell(uv, number):
    """UVs in one of the cells of the second UV set, with a border around it."""
    column, row = number % COLUMNS, number // COLUMNS
    return (np.array([column, row]) + BORDER + (1.0 - 2.0 * BORDER) * uv) / [COLUMNS, ROWS]


def character(path: Path, seed=1) -> Path:
    """A character of eleven parts in one mesh, each with a material of its own.

    UV set 0 overlaps; set 1 is an atlas. There are textures, factors, KHR_texture_transform, vertex colors, a mask with holes,
    a texture of the second set, a skin, a shape key, an animation, extras, a camera and an object that is not baked.
    """
    file, random = Writer(), np.random.default_rng(seed)
    tree = file.tree
    primitives = []
    for number, (name, center, radii) in enumerate(PARTS):
        positions, normals, uv, corners = ellipsoid(np.array(center, float), np.array(radii, float))
        if number == 5:  # Blender leaves out a face without an area
            corners = np.concatenate([corners[:4], [[7, 7, 8]], corners[4:]])
        attributes = {
            "POSITION": file.accessor(positions, has_bounds=True),
            "NORMAL": file.accessor(normals),
            "TEXCOORD_0": file.accessor(uv),
            "TEXCOORD_1": file.accessor(cell(uv, number)),
            "JOINTS_0": file.accessor(np.tile([int(center[1] > 1.5), 0, 0, 0], (len(positions), 1)), "B"),
            "WEIGHTS_0": file.accessor(np.tile([1.0, 0.0, 0.0, 0.0], (len(positions), 1))),
        }
        if number in (1, 9):
            colors = 0.5 + 0.5 * np.cos(positions * 4.0 + [0.0, 1.0, 2.0]) * 0.9
            attributes["COLOR_0"] = file.accessor(colors)
        primitives.append(
            {
                "attributes": attributes,
                "indices": file.accessor(corners.reshape(-1), "H"),
                "material": file.add("materials", _material(file, random, number, name)),
                "targets": [
                    {
                        "POSITION": file.accessor(
                            np.outer(np.sin(positions[:, 1] * 9.0) * 0.02, [0, 0, 1.0]), has_bounds=True
                        )
                    }
                ],
                "extras": {"part": name},
            }
        )
    mesh = file.add(
        "meshes", {"name": "figure", "primitives": primitives, "weights": [0.0], "extras": {"targetNames": ["breath"]}}
    )
    hips = file.add("nodes", {"name": "hips", "children": [1]})
    head = file.add("nodes", {"name": "neck", "translation": [0.0, 1.5, 0.0]})
    skin = file.add(
        "skins",
        {
            "joints": [hips, head],
            "inverseBindMatrices": file.accessor(np.stack([np.eye(4), _moved(0, -1.5, 0)]).reshape(2, 16)),
        },
    )
    figure = file.add("nodes", {"name": "Figure", "mesh": mesh, "skin": skin, "extras": {"owner": "someone"}})
    stone = file.add("nodes", {"name": "stone", "mesh": _stone(file), "translation": [1.5, 0.0, 0.0]})
    lens = {"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}
    eye = file.add("nodes", {"name": "eye", "camera": file.add("cameras", lens), "translation": [0.0, 1.0, 5.0]})
    tree["scenes"][0] |= {"name": "stage", "nodes": [hips, figure, stone, eye], "extras": {"shot": 7}}
    times, turns = file.accessor([0.0, 1.0], has_bounds=True), file.accessor([[0, 0, 0, 1], [0, 0.38, 0, 0.92]])
    channel = {"sampler": 0, "target": {"node": head, "path": "rotation"}}
    file.add("animations", {"name": "nod", "channels": [channel], "samplers": [{"input": times, "output": turns}]})
    tree["extensionsUsed"] = ["KHR_texture_transform", "KHR_materials_emissive_strength"]
    return file.save(path)


def _moved(x, y, z):
    matrix = np.eye(4)
    matrix[3, :3] = x, y, z  # by columns
    return matrix


def _material(file, random, number, name):
    pbr = {"metallicFactor": 0.0 if number % 3 else 0.7, "roughnessFactor": 0.2 + 0.07 * number}
    result = {"name": name, "pbrMetallicRoughness": pbr}
    factor = [*np.round(random.uniform(0.3, 1.0, 3), 3).tolist(), 1.0]
    if number in (3, 4):
        pbr["baseColorFactor"] = factor
        return result
    texture = {"index": file.texture(waves(random, alpha=number == 2))}
    if number == 6:
        offset = {"offset": [0.25, 0.1], "scale": [2.0, 1.5], "rotation": 0.4}
        texture["extensions"] = {"KHR_texture_transform": offset}
    if number == 8:
        texture["texCoord"] = 1
    if number in (0, 7, 9):
        pbr["baseColorFactor"] = factor
    if number == 2:
        result |= {"alphaMode": "MASK", "alphaCutoff": 0.5, "doubleSided": True}
    if number in (0, 7):
        normals = 0.5 + 0.5 * np.array([0.0, 0.0, 1.0]) + (waves(random) / 255.0 - 0.5) * [0.4, 0.4, 0.0]
        result["normalTexture"] = {"index": file.texture(np.round(normals.clip(0.0, 1.0) * 255.0).astype(np.uint8))}
    if number == 10:
        result["emissiveFactor"] = [0.1, 0.05, 0.0]
    pbr["baseColorTexture"] = texture
    return result


def _stone(file):
    positions, normals, uv, corners = ellipsoid(np.zeros(3), np.full(3, 0.3), 4, 6)
    gray = {"name": "gray", "pbrMetallicRoughness": {"baseColorFactor": [0.4, 0.4, 0.4, 1.0]}}
    attributes = {
        "POSITION": file.accessor(positions, has_bounds=True),
        "NORMAL": file.accessor(normals),
        "TEXCOORD_0": file.accessor(uv),
    }
    primitive = {"attributes": attributes, "indices": file.accessor(corners.reshape(-1), "H")}
    return file.add("meshes", {"name": "stone", "primitives": [primitive | {"material": file.add("materials", gray)}]})


def cart(path: Path, seed=2) -> Path:
    """A cart of four objects, with vertex colors and factors, without textures: parents, scales, and a mesh of two wheels.

    Their only UV sets lie side by side.
    """
    file, random = Writer(), np.random.default_rng(seed)
    wood = file.add("materials", {"name": "wood", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.3, 0.1, 1.0]}})
    paint = file.add("materials", {"name": "paint", "pbrMetallicRoughness": {"metallicFactor": 0.0}})
    iron = file.add("materials", {"name": "iron", "pbrMetallicRoughness": {"baseColorFactor": [0.3, 0.3, 0.35, 1.0]}})

    def part(number, center, radii, material, *, colored):
        positions, normals, uv, corners = ellipsoid(np.array(center), np.array(radii), 6, 10)
        attributes = {
            "POSITION": file.accessor(positions, has_bounds=True),
            "NORMAL": file.accessor(normals),
            "TEXCOORD_0": file.accessor(cell(uv, number)),
        }
        if colored:
            values = np.round(random.uniform(0.2, 1.0, (1, 4)) * (0.7 + 0.3 * np.cos(3.0 * positions[:, :1])) * 65535)
            attributes["COLOR_0"] = file.accessor(values.clip(0, 65535), "H", normalized=True)
        return {"attributes": attributes, "indices": file.accessor(corners.reshape(-1), "H"), "material": material}

    box = [
        part(0, (0, 0, 0), (1.0, 0.3, 0.5), wood, colored=True),
        part(1, (0, 0.3, 0), (0.9, 0.1, 0.4), paint, colored=True),
    ]
    wheel = [
        part(2, (0, 0, 0), (0.4, 0.4, 0.1), iron, colored=False),
        part(3, (0, 0, 0.1), (0.1, 0.1, 0.1), paint, colored=True),
    ]
    of_wheel = file.add("meshes", {"name": "wheel", "primitives": wheel})
    children = [
        file.add("nodes", {"name": "wheel left", "mesh": of_wheel, "translation": [0.6, -0.4, 0.5]}),
        file.add(
            "nodes", {"name": "wheel right", "mesh": of_wheel, "translation": [-0.6, -0.4, 0.5], "scale": [1.2] * 3}
        ),
    ]
    root = file.add(
        "nodes",
        {"name": "box", "mesh": file.add("meshes", {"name": "box", "primitives": box}), "children": children}
        | {"rotation": [0.0, 0.3826834, 0.0, 0.9238795]},
    )
    file.tree["scenes"][0]["nodes"] = [root]
    return file.save(path)
