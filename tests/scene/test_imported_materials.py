# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of OBJ and glTF files, as Blender's importers make them, are read whole."""

import json
import struct

import bpy
import numpy as np
import pytest

from addon.core.material_feeds import AttributeFeed, ImageFeed, NormalMapFeed
from addon.scene.mesh_elements import attribute_by_corner
from addon.scene.textures import ImageTextures
from tests.support import feeds
from tests.support.shader_nodes import read


def png(path, seed, channels=3):
    values = np.random.default_rng(seed).integers(0, 256, (4, 6, channels)).astype(np.uint8)
    feeds.write_png(path, values)
    return values


def stored(feed) -> np.ndarray:
    """The pixels of a feed's image, as 8 bits if it is data."""
    return ImageTextures().load(feed.image).values[..., :3] * 255


OBJ = """mtllib scan.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl one
f 1/1 2/2 3/3 4/4
usemtl two
f 1/1 3/3 4/4
usemtl three
f 1/1 2/2 4/4
"""
MTL = """newmtl one
Kd 0.8 0.7 0.6
Ke 1 1 1
map_Kd -s 2 3 1 -o 0.25 0.5 0 color.png
map_Bump -bm 0.4 normal.png
map_d alpha.png
map_Ke emission.png
map_Pr rough.png
newmtl two
Kd 0.2 0.3 0.4
Pr 0.3
Pm 1.0
newmtl three
map_Kd gone.png
"""


@pytest.fixture
def scan(tmp_path):
    """The materials of an OBJ file, by name."""
    (tmp_path / "scan.obj").write_text(OBJ)
    (tmp_path / "scan.mtl").write_text(MTL)
    for seed, name in enumerate(("color", "normal", "alpha", "emission", "rough")):
        png(tmp_path / f"{name}.png", seed, 4 if name == "alpha" else 3)
    bpy.ops.wm.obj_import(filepath=str(tmp_path / "scan.obj"))
    return {material.name: read(material) for material in bpy.data.materials}


def test_the_textures_of_an_obj_file(scan):
    found = scan["one"]
    assert found.notes == {}
    images = ("Base Color", "Emission Color", "Roughness", "Alpha")
    assert all(isinstance(found.feeds[name], ImageFeed) for name in images)
    assert len({found.feeds[name].image for name in images}) == 4
    assert found.feeds["Base Color"].mapping == ((2.0, 0.0, 0.25), (0.0, 3.0, 0.5))
    assert found.feeds["Alpha"].channel == 3
    assert isinstance(found.detail, NormalMapFeed)
    assert found.detail.strength == pytest.approx(0.4)


def test_the_numbers_of_an_obj_file(scan):
    found = scan["two"]
    assert found.notes == {}
    assert found.feeds["Base Color"].color[:3] == pytest.approx((0.2, 0.3, 0.4))
    assert found.feeds["Roughness"].color[0] == pytest.approx(0.3)
    assert found.feeds["Metallic"].color[0] == 1.0


def test_a_missing_texture_of_an_obj_file_is_named(scan, tmp_path):
    found = scan["three"]
    assert "Base Color" not in found.feeds
    assert found.notes["Base Color"] == (
        'Material "three": Base Color is left out, because the image "gone.png" has no pixels: '
        f"{tmp_path / 'gone.png'} cannot be read.",
    )


def gltf(tmp_path, material, extensions=(), *, has_colors=False):
    """The material of a glTF file of one triangle with two UV sets, as Blender imports it."""
    positions = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    uv = struct.pack("<6f", 0, 0, 1, 0, 0, 1)
    colors = struct.pack("<12f", *(0.25,) * 12)
    buffer = positions + uv + colors
    (tmp_path / "data.bin").write_bytes(buffer)
    attributes = {"POSITION": 0, "TEXCOORD_0": 1, "TEXCOORD_1": 1} | ({"COLOR_0": 2} if has_colors else {})
    images = ("base", "orm", "normal", "emission")
    for seed, name in enumerate(images):
        png(tmp_path / f"{name}.png", seed, 4 if name == "base" else 3)
    views = [(0, 36), (36, 24), (60, 48)]
    accessors = [("VEC3", {"min": [0, 0, 0], "max": [1, 1, 0]}), ("VEC2", {}), ("VEC4", {})]
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": list(extensions),
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "material": 0}]}],
        "materials": [{"name": "Rust", **material}],
        "textures": [{"source": place} for place in range(len(images))],
        "images": [{"uri": f"{name}.png"} for name in images],
        "buffers": [{"uri": "data.bin", "byteLength": len(buffer)}],
        "bufferViews": [{"buffer": 0, "byteOffset": start, "byteLength": length} for start, length in views],
        "accessors": [
            {"bufferView": place, "componentType": 5126, "count": 3, "type": kind, **limits}
            for place, (kind, limits) in enumerate(accessors)
        ],
    }
    (tmp_path / "scan.gltf").write_text(json.dumps(document))
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "scan.gltf"))
    return read(bpy.data.materials["Rust"])


def test_all_textures_of_a_gltf_file(tmp_path):
    found = gltf(
        tmp_path,
        {
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": 0},
                "metallicRoughnessTexture": {"index": 1, "texCoord": 1},
            },
            "normalTexture": {"index": 2, "scale": 0.7},
            "occlusionTexture": {"index": 1, "texCoord": 1},
            "emissiveTexture": {"index": 3},
            "emissiveFactor": [1, 1, 1],
            "alphaMode": "BLEND",
        },
    )
    assert found.notes == {}
    assert (found.feeds["Roughness"].channel, found.feeds["Metallic"].channel) == (1, 2)
    assert found.feeds["Roughness"].image == found.feeds["Metallic"].image
    assert found.feeds["Roughness"].uv_layer == "UVMap.001"
    assert found.feeds["Base Color"].image == found.feeds["Alpha"].image
    assert found.feeds["Alpha"].channel == 3
    assert isinstance(found.feeds["Emission Color"], ImageFeed)
    assert isinstance(found.detail, NormalMapFeed)
    assert found.detail.strength == pytest.approx(0.7)
    orm = np.random.default_rng(1).integers(0, 256, (4, 6, 3))
    assert np.abs(stored(found.feeds["Roughness"]) - orm).max() < 0.01


def test_factors_of_a_gltf_file(tmp_path):
    found = gltf(
        tmp_path,
        {
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": 0},
                "baseColorFactor": [0.5, 0.25, 1.0, 0.5],
                "metallicRoughnessTexture": {"index": 1},
                "roughnessFactor": 0.4,
                "metallicFactor": 0.6,
            },
            "emissiveTexture": {"index": 3},
            "emissiveFactor": [1.0, 0.5, 0.25],
            "alphaMode": "BLEND",
        },
    )
    assert found.notes == {}
    assert found.feeds["Base Color"].scale == pytest.approx((0.5, 0.25, 1.0))
    assert found.feeds["Alpha"].scale[0] == pytest.approx(0.5)
    assert found.feeds["Roughness"].scale[0] == pytest.approx(0.4)
    assert found.feeds["Metallic"].scale[0] == pytest.approx(0.6)
    assert found.feeds["Emission Color"].scale == pytest.approx((1.0, 0.5, 0.25))


def test_a_moved_texture_of_a_gltf_file(tmp_path):
    """The extension turns about the upper left corner; the images of glTF begin there."""
    moved = {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.5, "scale": [2.0, 3.0]}}
    found = gltf(
        tmp_path,
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": moved}}},
        moved,
    ).feeds["Base Color"]
    cos, sin = np.cos(0.5), np.sin(0.5)
    # The extension's matrix, on (u, 1 - v), and 1 - v of the result.
    matrix = np.array([[2.0 * cos, 3.0 * sin, 0.1], [-2.0 * sin, 3.0 * cos, 0.2], [0.0, 0.0, 1.0]])
    over = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]])
    assert np.array(found.mapping) == pytest.approx((over @ matrix @ over)[:2], abs=1e-5)


def test_a_cut_off_alpha_of_a_gltf_file_is_named(tmp_path):
    found = gltf(
        tmp_path,
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "alphaMode": "MASK", "alphaCutoff": 0.3},
    )
    alpha = found.feeds["Alpha"]
    assert (alpha.channel, alpha.scale[0], alpha.offset[0]) == (3, 1.0, 0.0)
    assert set(found.notes) == {"Alpha"}
    (note,) = found.notes["Alpha"]
    assert note.endswith("makes steps of a texture, of which the map has the values.")


def test_vertex_colors_of_a_gltf_file(tmp_path):
    found = gltf(tmp_path, {"pbrMetallicRoughness": {"baseColorFactor": [1.0, 0.5, 1.0, 1.0]}}, has_colors=True)
    assert found.notes == {}
    assert isinstance(found.feeds["Base Color"], AttributeFeed)
    assert found.feeds["Base Color"].scale == pytest.approx((1.0, 0.5, 1.0))


def test_a_product_of_texture_and_vertex_colors_is_named(tmp_path):
    found = gltf(tmp_path, {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}, has_colors=True)
    assert isinstance(found.feeds["Base Color"], ImageFeed)
    (note,) = found.notes["Base Color"]
    assert note.endswith("multiplies two textures, of which the map has the image.")


def test_an_unlit_material_of_a_gltf_file(tmp_path):
    """Scans often have it: its color is in the texture, and no light belongs to it."""
    found = gltf(
        tmp_path,
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "extensions": {"KHR_materials_unlit": {}}},
        ["KHR_materials_unlit"],
    )
    assert isinstance(found.feeds["Base Color"], ImageFeed)
    assert found.feeds["Base Color"] == found.feeds["Emission Color"]


def test_ply_vertex_colors(tmp_path):
    lines = ["ply", "format ascii 1.0", "element vertex 3", *(f"property float {axis}" for axis in "xyz")]
    lines += [*(f"property uchar {name}" for name in ("red", "green", "blue")), "element face 1"]
    lines += ["property list uchar int vertex_indices", "end_header"]
    lines += ["0 0 0 255 0 0", "1 0 0 0 255 0", "0 1 0 0 0 255", "3 0 1 2"]
    (tmp_path / "scan.ply").write_text("\n".join(lines) + "\n")
    bpy.ops.wm.ply_import(filepath=str(tmp_path / "scan.ply"))
    colors = attribute_by_corner(bpy.context.object.data, "")
    assert np.abs(colors[:, :3] - np.eye(3)).max() < 1e-6
