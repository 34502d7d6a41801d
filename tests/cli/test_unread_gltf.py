# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole glTF files that Blender cannot read say what they need, and damaged ones that they are damaged."""

import json
import struct
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.scene.importing import PLAIN, import_file

POINTS = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]).tobytes()


def gltf(folder, *, required=(), used=(), ending=".glb", primitive=None, view=None, binary=POINTS):
    """A file of one triangle."""
    table = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}} | (primitive or {})]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 36} | (view or {})],
        "buffers": [{"byteLength": len(POINTS)} | ({} if ending == ".glb" else {"uri": "a.bin"})],
        "extensionsUsed": [*required, *used],
        "extensionsRequired": list(required),
    }
    text = json.dumps(table).encode()
    text += b" " * (-len(text) % 4)
    path = Path(folder, f"a{ending}")
    if ending == ".gltf":
        path.write_bytes(text)
        path.with_name("a.bin").write_bytes(binary)
        return path
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


def message(path):
    with pytest.raises(BakeError) as caught:
        import_file(path, PLAIN)
    return str(caught.value)


DRACO = {"primitive": {"extensions": {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}}}


def meshopt(name):
    how = {"buffer": 0, "byteLength": 36, "byteStride": 12, "count": 3, "mode": "ATTRIBUTES"}
    return {"view": {"byteStride": 12, "extensions": {name: how}}}


COMPRESSED = {
    "KHR_draco_mesh_compression": ("Draco", DRACO),
    "EXT_meshopt_compression": ("meshopt", meshopt("EXT_meshopt_compression")),
    "KHR_meshopt_compression": ("meshopt", meshopt("KHR_meshopt_compression")),
}


@pytest.mark.parametrize("ending", [".glb", ".gltf"])
@pytest.mark.parametrize("name", COMPRESSED)
def test_a_compressed_file_says_what_is_missing_and_where_it_is(tmp_path, name, ending, monkeypatch):
    title, how = COMPRESSED[name]
    path = gltf(tmp_path, required=[name], ending=ending, **how)
    said = message(path)
    assert f"compressed with {title}" in said and "installed Blender" in said and "damaged" not in said
    monkeypatch.setattr("addon.scene.importing.bpy", WholeBlender())  # where it is there, something else is wrong
    assert f"compressed with {title}" not in message(path)


class WholeBlender:
    """bpy, as a Blender that is installed as a whole has it."""

    class app:  # noqa: N801
        module = False

    def __getattr__(self, name):
        return getattr(bpy, name)


@pytest.mark.parametrize("name", ["MSFT_texture_dds", "VENDOR_sparse_cows"])
def test_a_file_that_needs_more_than_blender_reads_names_it(tmp_path, name):
    said = message(gltf(tmp_path, required=["KHR_mesh_quantization", name]))
    assert f"it needs {name} of glTF" in said and "damaged" not in said and "quantization" not in said


@pytest.mark.parametrize("names", [(), ("KHR_texture_basisu",), ("KHR_draco_mesh_compression",), ("EXT_texture_webp",)])
def test_what_is_used_and_not_needed_is_read(tmp_path, names):
    assert len(import_file(gltf(tmp_path, used=names), PLAIN)) == 1


def test_a_damaged_file_is_called_that(tmp_path):
    path = gltf(tmp_path)
    path.write_bytes(path.read_bytes().replace(b'"nodes": [0]', b'"nodes": [9]'))
    assert "damaged" in message(path)
