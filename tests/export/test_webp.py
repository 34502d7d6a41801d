# SPDX-License-Identifier: GPL-3.0-or-later
"""Exports .glb files with WebP textures: the texels of PNG ones where nothing may be lost, in fewer bytes."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.export import engine_files, webp_pictures
from addon.output import image_file
from tests.export.test_glb import bake, bent_pair, export
from tests.support import angles, glb, scenes
from tests.support.glb import EXTENSION

pytestmark = pytest.mark.usefixtures("gpu_context")

ROUGHNESS, METALLIC = 0.25, 0.75


def colored(high):
    """Give an object a material with a picture of noise as its base color."""
    material = bpy.data.materials.new("painted")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    inputs = nodes["Principled BSDF"].inputs
    inputs["Roughness"].default_value, inputs["Metallic"].default_value = ROUGHNESS, METALLIC
    links.new(nodes.new("ShaderNodeTexNoise").outputs["Color"], inputs["Base Color"])
    high.data.materials.append(material)


def pictures(path, tmp_path):
    """The texels of the images of a file, and the bytes of all, by what shows them in its only material."""
    tree, binary = glb.parse(path)
    (material,) = tree["materials"]
    surface = material["pbrMetallicRoughness"]
    infos = {"normal": material["normalTexture"], "occlusion": material["occlusionTexture"]}
    infos |= {"color": surface["baseColorTexture"], "surface": surface["metallicRoughnessTexture"]}
    found = {}
    for name, info in infos.items():
        texture = tree["textures"][info["index"]]
        image = tree["images"][glb.source(texture)]
        data = glb.image(tree, binary, info["index"])
        ending = {"image/webp": ".webp", "image/jpeg": ".jpg"}.get(image["mimeType"], ".png")
        (tmp_path / f"{name}{ending}").write_bytes(data)
        found[name] = image_file.read(tmp_path / f"{name}{ending}")
    size = sum(tree["bufferViews"][image["bufferView"]]["byteLength"] for image in tree["images"])
    return tree, found, size


@pytest.fixture
def baked():
    low, high = bent_pair()
    colored(high)
    return lambda **values: bake(low, high, maps=("AO", "BASE_COLOR", "ROUGHNESS", "METALLIC"), rays=16, **values)


def test_webp_keeps_the_texels_and_has_fewer_bytes(tmp_path, baked):
    export(tmp_path / "png.glb", baked())
    (done,) = export(tmp_path / "webp.glb", baked(export_webp=True))
    _, expected, png = pictures(tmp_path / "png.glb", tmp_path)
    tree, found, webp = pictures(tmp_path / "webp.glb", tmp_path)
    for name, texels in expected.items():
        np.testing.assert_array_equal(found[name], texels, err_msg=name)
    assert webp < png
    assert {image["mimeType"] for image in tree["images"]} == {"image/webp"}
    assert all(texture.keys() <= {"extensions", "sampler"} for texture in tree["textures"])
    assert EXTENSION in tree["extensionsUsed"]
    assert EXTENSION in tree["extensionsRequired"]
    assert done.measured.degrees["MIKKTSPACE"]["percentile_99"] < 0.35
    # Nothing of the PNG files is left.
    assert (tmp_path / "webp.glb").stat().st_size < (tmp_path / "png.glb").stat().st_size - 0.9 * (png - webp)


@pytest.mark.parametrize("has_lossy_normals", [False, True])
def test_quality_is_for_colors_and_for_normals_only_if_asked(tmp_path, baked, has_lossy_normals):
    export(tmp_path / "png.glb", baked())
    values = {"quality": 50, "lossy_normals": has_lossy_normals}
    (done,) = export(tmp_path / "webp.glb", baked(export_webp=True, **values))
    _, expected, _ = pictures(tmp_path / "png.glb", tmp_path)
    _, found, _ = pictures(tmp_path / "webp.glb", tmp_path)
    assert 0.0 < np.abs(found["color"] - expected["color"]).max() < 0.5
    assert np.array_equal(found["normal"], expected["normal"]) != has_lossy_normals
    off = done.measured.degrees["MIKKTSPACE"]["percentile_99"]
    assert (off > 1.0) == has_lossy_normals  # the report tells what the losses cost


@pytest.mark.parametrize("has_webp", [False, True])
def test_auto_keeps_limits_in_fewer_bytes(tmp_path, baked, has_webp):
    """Beside the bake in floats, also where the map lost something before."""
    export(tmp_path / "png.glb", baked(export_webp=has_webp))
    _, exact, before = pictures(tmp_path / "png.glb", tmp_path)
    values = {
        "storage": "FILE",
        "output": str(tmp_path / "m_normal.png"),
        "depth": 8,
        "format": "AUTO",
        "most_steps": 6.0,
    }
    floats = tmp_path / "m_normal.exr"
    baked(storage="FILE", output=str(floats), depth=32)
    truth = image_file.read(floats)
    is_covered = truth[..., 3] > 0.0
    for most in (1.5, 1.0):
        export(tmp_path / "auto.glb", baked(export_webp=has_webp, most_degrees=most, **values))
        tree, found, size = pictures(tmp_path / "auto.glb", tmp_path)
        assert size < 0.85 * before
        off = angles.degrees(*(angles.decode(each[is_covered]) for each in (found["normal"], truth)))
        assert np.percentile(off, 99) <= 1.02 * most
        assert (EXTENSION in tree.get("extensionsRequired", ())) == has_webp
        for name in ("occlusion", "color", "surface"):
            off = np.abs(found[name] - exact[name])[..., :3].max(axis=2) * 255.0
            assert np.percentile(off, 99) <= 6.5, name


def test_auto_changes_no_image_that_has_no_bytes_to_lose(tmp_path, baked):
    values = {
        "storage": "FILE",
        "output": str(tmp_path / "m_normal.png"),
        "depth": 8,
        "format": "AUTO",
        "most_degrees": 0.01,
    }
    export(tmp_path / "png.glb", baked())
    export(tmp_path / "auto.glb", baked(most_steps=0.1, **values))
    _, exact, _ = pictures(tmp_path / "png.glb", tmp_path)
    _, found, _ = pictures(tmp_path / "auto.glb", tmp_path)
    np.testing.assert_array_equal(found["normal"], exact["normal"])


def test_blender_reads_the_maps(tmp_path, baked):
    export(tmp_path / "webp.glb", baked(export_webp=True))
    before = set(bpy.data.images)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "webp.glb"))
    assert {image.file_format for image in set(bpy.data.images) - before} == {"WEBP"}


def test_other_textures_stay(tmp_path):
    low, high = bent_pair()
    colored(high)
    material = scenes.material("own", low)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    picture = bpy.data.images.new("own picture", 8, 8)
    picture.filepath_raw, picture.file_format = str(tmp_path / "own.png"), "PNG"
    picture.save()
    node = nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.load(str(tmp_path / "own.png"))
    links.new(node.outputs["Color"], nodes["Principled BSDF"].inputs["Emission Color"])
    nodes["Principled BSDF"].inputs["Emission Strength"].default_value = 1.0
    export(tmp_path / "out.glb", bake(low, high, export_webp=True))
    tree, binary = glb.parse(tmp_path / "out.glb")
    (material,) = tree["materials"]
    own = material["emissiveTexture"]["index"]
    assert glb.image(tree, binary, own) == (tmp_path / "own.png").read_bytes()
    assert EXTENSION in tree["textures"][material["normalTexture"]["index"]]["extensions"]
    assert "extensions" not in tree["textures"][own]


def test_what_is_larger_than_webp_can_be_stays_png(tmp_path, monkeypatch):
    low, high = bent_pair()
    report = bake(low, high, export_webp=True)  # of 64 texels
    for most, kind in ((64, "image/webp"), (63, "image/png")):
        monkeypatch.setattr(webp_pictures, "LONGEST_SIDE", most)
        export(tmp_path / "out.glb", report)
        assert glb.parse(tmp_path / "out.glb")[0]["images"][0]["mimeType"] == kind


def test_other_formats_have_png(tmp_path):
    low, high = bent_pair()
    export(tmp_path / "out.usda", bake(low, high, export_webp=True))
    assert {path.suffix for path in (tmp_path / "textures").iterdir()} == {".png"}


def test_a_blender_that_writes_no_webp_says_so(tmp_path, monkeypatch):
    low, high = bent_pair()
    report = bake(low, high, export_webp=True)

    def missing(path):
        raise BakeError("no WebP")

    monkeypatch.setattr(image_file, "check_format", missing)
    with pytest.raises(BakeError, match="no WebP"):
        export(tmp_path / "out.glb", report)
    assert not (tmp_path / "out.glb").exists()


def test_the_settings_of_the_panel_are_taken_where_they_are_given(tmp_path):
    low, high = bent_pair()
    given = {"export_webp": True, "quality": 100, "lossy_normals": False}
    list(engine_files.work(bpy.context, [[bake(low, high)]], tmp_path / "out.glb", settings=given))
    assert glb.parse(tmp_path / "out.glb")[0]["extensionsRequired"] == [EXTENSION]
