# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests --untrusted with pictures and archives that claim, or unpack to, more than a machine has."""

import base64
import json
import struct
import zipfile

import bpy
import pytest

from tests.support import bombs, untrusted, zoo
from tests.support.untrusted import MESH, bake

pytestmark = untrusted.needs_sandbox
LIMITS = ["--max-memory", "1G", "--timeout", "60"]
FEW = ("cut.png", "whole.exr", "deep.exr", "a.jpg", "a.hdr")
"""Pictures that are tried in each kind of file."""


@pytest.fixture
def root(tmp_path, monkeypatch):
    return untrusted.folder(tmp_path, monkeypatch)


@pytest.fixture
def pictures(root):
    """The names of the pictures in job/."""
    small = root / "small.jpg"
    image = bpy.data.images.new("small", 16, 16)
    image.filepath_raw, image.file_format = str(small), "JPEG"
    image.save()
    found = bombs.pictures(small.read_bytes())
    for name, content in found.items():
        (root / "job" / name).write_bytes(content)
    return list(found)


def bake_all(root, names, **of_scenes):
    """Bake the base color of high meshes, or of scenes, and a good set after them. Each has to end with a sentence."""
    sets = [
        {**({"file": name, **of_scenes} if of_scenes else {**MESH, "high-file": name}), "maps": "base-color"}
        for name in names
    ]
    sets = [{**each, "output": f"out/{name}.png"} for name, each in zip(names, sets, strict=True)]
    found = bake(root, [*sets, {**MESH, "output": "out/good.png"}], *LIMITS)
    assert found.pop(len(found))["state"] == "done"
    for name, entry in zip(names, found.values(), strict=True):
        said = [entry["error"]] if entry["error"] else [line for each in entry["reports"] for line in each["warnings"]]
        assert said and all(len(line.splitlines()) == 1 for line in said), (name, said)
    assert sorted(path.name for path in (root / "outside").iterdir()) == ["secret.txt"]
    return dict(zip(names, found.values(), strict=True))


def with_material(root, name, picture):
    """Write high.obj with a material that shows a picture."""
    job = root / "job"
    (job / f"{name}.mtl").write_text(f"newmtl a\nmap_Kd {picture}\n")
    mesh = (job / "high.obj").read_text()
    mesh = mesh.replace("\no ", f"\nmtllib {name}.mtl\no ").replace("\nf ", "\nusemtl a\nf ", 1)
    (job / f"{name}.obj").write_text(mesh)
    return f"{name}.obj"


@pytest.mark.slow
def test_in_materials_of_obj_files(root, pictures):
    (root / "job" / "whole.png").write_bytes(bombs.png())
    names = [with_material(root, picture, picture) for picture in [*pictures, "whole.png"]]
    found = bake_all(root, names)
    assert {found[f"{name}.obj"]["state"] for name in ("whole.png", "whole.exr", "large.exr", "a.jpg")} == {"failed"}


def triangle_glb(picture):
    """A .glb file with a triangle and a picture inside. picture: its bytes, or a text for its URI."""
    points = struct.pack("<9f", 0, 0, 1, 1, 0, 1, 0, 1, 1) + struct.pack("<6f", 0, 0, 1, 0, 0, 1)
    content = points + (picture if isinstance(picture, bytes) else b"")
    content += bytes(-len(content) % 4)
    image = {"uri": picture} if isinstance(picture, str) else {"bufferView": 2, "mimeType": "image/png"}
    views = [{"buffer": 0, "byteOffset": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}]
    if isinstance(picture, bytes):
        views.append({"buffer": 0, "byteOffset": 60, "byteLength": len(picture)})
    corners = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 1], "max": [1, 1, 1]}
    table = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(content)}],
        "bufferViews": views,
        "accessors": [corners, {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"}],
        "images": [image],
        "textures": [{"source": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    text = json.dumps(table).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(content), b"BIN\0") + content
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@pytest.mark.slow
def test_in_glb_files(root, pictures):
    names = []
    for picture in FEW:
        content = (root / "job" / picture).read_bytes()
        data = "data:image/png;base64," + base64.b64encode(content).decode()
        for kind, given in {"beside": picture, "inside": content, "text": data}.items():
            names.append(f"{picture}.{kind}.glb")
            (root / "job" / names[-1]).write_bytes(triangle_glb(given))
    bake_all(root, names)


USD = """#usda 1.0
def Mesh "mesh" (prepend apiSchemas = ["MaterialBindingAPI"]) {
point3f[] points = [(0,1,0),(99,1,0),(0,1,-99)]
int[] faceVertexCounts = [3]
int[] faceVertexIndices = [0,1,2]
texCoord2f[] primvars:st = [(0,0),(1,0),(0,1)] (interpolation = "vertex")
rel material:binding = </material>
}
def Material "material" {
token outputs:surface.connect = </material/surface.outputs:surface>
def Shader "surface" {
uniform token info:id = "UsdPreviewSurface"
color3f inputs:diffuseColor.connect = </material/picture.outputs:rgb>
token outputs:surface
}
def Shader "picture" {
uniform token info:id = "UsdUVTexture"
asset inputs:file = @PICTURE@
float3 outputs:rgb
}
}
"""


@pytest.mark.slow
def test_in_usd_files_and_their_archives(root, pictures):
    job, names = root / "job", []
    for picture in FEW:
        (job / f"{picture}.usda").write_text(USD.replace("PICTURE", picture))
        with zipfile.ZipFile(job / f"{picture}.usdz", "w", zipfile.ZIP_STORED) as archive:
            archive.writestr("a.usda", USD.replace("PICTURE", picture))
            archive.write(job / picture, picture)
        (job / f"{picture}.archive.usda").write_text(f"#usda 1.0\n(subLayers = [@{picture}.usdz@])\n")
        names += [f"{picture}.usda", f"{picture}.usdz", f"{picture}.archive.usda"]
    archives = {
        "packed": bombs.zip_of_zeros("a.usda", 1 << 30),
        "stored": bombs.zip_of_zeros("a.usdc", 2**32 - 2, zipfile.ZIP_STORED),
    }
    for name, content in archives.items():
        (job / f"{name}.usdz").write_bytes(content)
        (job / f"{name}.usda").write_text(f"#usda 1.0\n(subLayers = [@{name}.usdz@])\n")
        names += [f"{name}.usda", f"{name}.usdz"]
    found = bake_all(root, names)
    assert {found[f"{name}.{ending}"]["state"] for name in archives for ending in ("usda", "usdz")} == {"failed"}


@pytest.mark.slow
@pytest.mark.parametrize("is_packed", [False, True], ids=["beside", "packed"])
def test_in_blend_files(root, pictures, is_packed):
    names = []
    for picture in FEW:
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        zoo.plane("lo")
        high = zoo.plane("hi", slope=0.1)
        material = bpy.data.materials.new("a")
        node = material.node_tree.nodes.new("ShaderNodeTexImage")
        node.image = bpy.data.images.new(picture, 1, 1)
        node.image.source = "FILE"
        if is_packed:
            content = (root / "job" / picture).read_bytes()
            node.image.pack(data=content, data_len=len(content))
        node.image.filepath = f"//{picture}"
        material.node_tree.links.new(node.outputs[0], material.node_tree.nodes["Principled BSDF"].inputs[0])
        high.data.materials.append(material)
        names.append(f"{picture}.blend")
        bpy.ops.wm.save_as_mainfile(filepath=str(root / "job" / names[-1]), compress=True)
        if is_packed:
            assert bpy.data.images[picture].packed_file
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    for picture in pictures if is_packed else ():
        (root / "job" / picture).unlink()
    found = bake_all(root, names, low="lo", high="hi")
    assert {found[f"{name}.blend"]["state"] for name in ("whole.exr", "a.jpg")} == {"failed"}
