# SPDX-License-Identifier: GPL-3.0-or-later
"""Exports .usd and .fbx files, and reads them with Blender's importers: surface, maps and materials are those of the bake."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.export import engine_files, formats
from addon.scene import mesh_reader
from tests.export.test_glb import EIGHT_BITS_P99, bake, bent_pair, export
from tests.support import maps, scenes, snapshot, zoo
from tests.support.real_meshes import open_pair

pytestmark = pytest.mark.usefixtures("gpu_context")

FORMATS = [".usda", ".usd", ".usdc", ".fbx"]
QUADS_P99 = 1.5
"""Degrees that tangents of triangles differ at least from those of the quads that were baked."""


def imported(path):
    """The mesh of a file, in a file of its own."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if path.suffix == ".fbx":
        bpy.ops.wm.fbx_import(filepath=str(path))
    elif path.suffix == ".glb":
        bpy.ops.import_scene.gltf(filepath=str(path))
    else:
        bpy.ops.wm.usd_import(filepath=str(path))
    (obj,) = (obj for obj in bpy.data.objects if obj.type == "MESH")
    return obj


def normal_map(obj, slot=0):
    """The texels of the image that the Normal Map node of a material shows."""
    nodes = obj.material_slots[slot].material.node_tree.nodes
    texture = next(node for node in nodes if node.bl_idname == "ShaderNodeTexImage")
    assert any(node.bl_idname == "ShaderNodeNormalMap" for node in nodes)
    texture.image.colorspace_settings.is_data = True
    return maps.pixels(texture.image)


def triangulated(low):
    """Cut all faces into triangles, as Blender draws them."""
    modifier = low.modifiers.new("Triangulate", "TRIANGULATE")
    modifier.quad_method = "FIXED"
    with bpy.context.temp_override(object=low, active_object=low):
        bpy.ops.object.modifier_apply(modifier=modifier.name)


@pytest.mark.parametrize("ending", FORMATS)
def test_surface_and_map_are_those_of_the_bake(tmp_path, ending):
    low, high = bent_pair()
    triangulated(low)
    report = bake(low, high)
    baked = maps.pixels(bpy.data.images[report.image])
    (done,) = export(tmp_path / f"out{ending}", report)
    own = mesh_reader.with_tangents(low.data, zoo.LAYER, "low", mesh_reader.matrix(low))
    assert done.measured.degrees["MIKKTSPACE"]["percentile_99"] < EIGHT_BITS_P99
    assert not done.measured.has_tangents
    assert done.warnings == []
    obj = imported(tmp_path / f"out{ending}")
    read = mesh_reader.with_tangents(obj.data, obj.data.uv_layers[0].name, "low", mesh_reader.matrix(obj))
    corners = own.triangles, read.triangles
    points = [mesh.positions[mesh.vertices][which] for mesh, which in zip((own, read), corners, strict=True)]
    np.testing.assert_allclose(*points, atol=1e-6)
    np.testing.assert_allclose(own.uv[corners[0]], read.uv[corners[1]], atol=1e-6)
    np.testing.assert_allclose(own.normals[corners[0]], read.normals[corners[1]], atol=1e-3)
    np.testing.assert_allclose(own.tangents[corners[0]], read.tangents[corners[1]], atol=2e-3)
    np.testing.assert_allclose(normal_map(obj)[..., :3], baked[..., :3], atol=0.6 / 255.0)


@pytest.mark.parametrize("ending", [".usda", ".fbx"])
def test_programs_that_are_named_are_measured_too(tmp_path, ending):
    low, high = bent_pair()
    triangulated(low)
    report = bake(low, high, targets=("three", "unreal"))
    (done,) = export(tmp_path / f"out{ending}", report)
    found = done.to_dict()["targets"]
    assert found["three"] == done.measured.degrees["NORMALIZED"]
    assert (found["unreal"]["percentile_99"] > 1.0) is (ending == ".fbx")  # which does not say what green is
    summary = report.with_export(done.to_dict()).exported
    assert f"; three.js is off by {found['three']['median']:.2g} (median)" in summary
    assert "Unreal Engine is off by" in summary


@pytest.mark.parametrize("ending", [".usda", ".fbx"])
def test_quads_differ_without_the_tangents_of_the_bake_and_this_is_told(tmp_path, ending):
    low, high = bent_pair()
    report = bake(low, high, size=128)
    (done,) = export(tmp_path / f"out{ending}", report)
    assert QUADS_P99 < done.measured.degrees["MIKKTSPACE"]["percentile_99"] < 3.0
    (warning,) = done.warnings
    assert "baked with quads" in warning
    (exact,) = export(tmp_path / "out.glb", report)
    assert exact.measured.degrees["MIKKTSPACE"]["percentile_99"] < EIGHT_BITS_P99
    assert exact.warnings == []


@pytest.mark.shared
@pytest.mark.parametrize(("name", "ending"), [("spot_1696_536", ".usda"), ("spot_control_vs_subd5", ".fbx")])
def test_real_meshes(shared_assets, tmp_path, name, ending):
    low, high = open_pair(shared_assets, name)
    (done,) = export(tmp_path / f"out{ending}", bake(low, high, size=256))
    assert done.measured.degrees["MIKKTSPACE"]["percentile_99"] < EIGHT_BITS_P99


def test_usd_turns_channels_and_fbx_keeps_them(tmp_path):
    low, high = bent_pair()
    triangulated(low)
    report = bake(low, high, green="-Y")
    baked = maps.pixels(bpy.data.images[report.image])
    for ending in (".usda", ".fbx"):
        export(tmp_path / f"out{ending}", report)
    kept = normal_map(imported(tmp_path / "out.fbx"))
    np.testing.assert_allclose(kept[..., :3], baked[..., :3], atol=0.6 / 255.0)
    turned = normal_map(imported(tmp_path / "out.usda"))
    np.testing.assert_allclose(turned[..., 1], 1.0 - baked[..., 1], atol=0.6 / 255.0)


@pytest.mark.parametrize("ending", [".usda", ".fbx"])
def test_materials_of_tiles_keep_their_maps(tmp_path, ending):
    low, high = bent_pair()
    triangulated(low)
    for obj in (low, high):
        scenes.material("skin", obj)
        for face in obj.data.polygons:
            corners = range(face.loop_start, face.loop_start + face.loop_total)
            uvs = obj.data.uv_layers[zoo.LAYER].uv
            if sum(uvs[corner].vector.y for corner in corners) / len(corners) > 0.5:
                for corner in corners:
                    uvs[corner].vector.x += 1.0
                    uvs[corner].vector.y -= 0.25  # tangents of one tile must not go on in the other
    report = bake(low, high, udim=True)
    assert report.tiles == [1001, 1002]
    (done,) = export(tmp_path / f"out{ending}", report)
    assert done.measured.degrees["MIKKTSPACE"]["percentile_99"] < EIGHT_BITS_P99
    obj = imported(tmp_path / f"out{ending}")
    assert sorted(slot.material.name for slot in obj.material_slots) == ["skin_1001", "skin_1002"]
    assert not np.array_equal(normal_map(obj, 0), normal_map(obj, 1))


@pytest.mark.parametrize("ending", [".usda", ".fbx"])
def test_nothing_is_left_in_the_file(tmp_path, ending):
    low, high = bent_pair()
    scenes.material("painted", low)
    report = bake(low, high, maps=("AO",), rays=16)
    bpy.context.view_layer.objects.active = low
    low.select_set(True)
    before = snapshot.snapshot()
    export(tmp_path / f"out{ending}", report)
    assert snapshot.difference(before, snapshot.snapshot()) == {}


@pytest.mark.parametrize("folder", ["textures", "textures/../textures"])
def test_a_map_of_the_bake_is_not_replaced(tmp_path, folder):
    low, high = bent_pair()
    (tmp_path / "textures").mkdir()
    path = tmp_path / folder / "out_the normal map.png"
    report = bake(low, high, storage="FILE", output=str(path))
    before = path.read_bytes()
    with pytest.raises(BakeError, match="a map of the bake"):
        export(tmp_path / "out.usda", report)
    assert path.read_bytes() == before
    assert not (tmp_path / "out.usda").exists()


def test_files_in_one_folder_keep_their_own_maps(tmp_path):
    low, high = bent_pair()
    for name, basis in (("one", "MIKKTSPACE"), ("two", "NORMALIZED")):
        report = bake(low, high, basis=basis)
        export(tmp_path / f"{name}.usda", report)
    first = normal_map(imported(tmp_path / "one.usda"))
    assert not np.array_equal(first, normal_map(imported(tmp_path / "two.usda")))


@pytest.mark.parametrize(
    ("ending", "kind"),
    [(".usda", "file"), (".usda", "generated"), (".fbx", "packed"), (".fbx", "file"), (".glb", "packed")],
)
def test_textures_of_the_same_name_stay_apart(tmp_path, ending, kind):
    low, high = bent_pair()
    colors = {"oak": (1.0, 0.0, 0.0), "ash": (0.0, 1.0, 0.0)}
    for name, color in colors.items():
        texture = bpy.data.images.new("wood:" if name == "oak" else "Wood?", 8, 8)
        texture.generated_color = *color, 1.0
        if kind != "generated":
            path = tmp_path / name / "wood.png"
            path.parent.mkdir()
            texture.save(filepath=str(path))
            texture = bpy.data.images.load(str(path))
        if kind == "packed":
            texture.pack()
        scenes.material(name, low)
        tree = low.data.materials[-1].node_tree
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = texture
        tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    for face in low.data.polygons[:6]:
        face.material_index = 1
    report = bake(low, high)
    before = snapshot.snapshot()
    export(tmp_path / f"out{ending}", report)
    assert snapshot.difference(before, snapshot.snapshot()) == {}
    if ending == ".usda":
        assert len({path.name.casefold() for path in (tmp_path / "textures").iterdir()}) == 3
    obj = imported(tmp_path / f"out{ending}")
    assert sorted(slot.material.name for slot in obj.material_slots) == ["ash", "oak"]
    for slot in obj.material_slots:
        (link,) = slot.material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].links
        assert tuple(link.from_node.image.pixels[:3]) == colors[slot.material.name]
        assert link.from_node.image.colorspace_settings.name == "sRGB"


def test_only_glb_holds_levels(tmp_path):
    low, high = bent_pair()
    report = bake(low, high)
    with pytest.raises(BakeError, match="cannot hold levels"):
        engine_files.export_files(bpy.context, [[report]], tmp_path / "out.fbx", are_levels=True)


@pytest.mark.parametrize("ending", [".glb", ".usd", ".fbx"])
def test_blenders_without_an_exporter_say_so(tmp_path, monkeypatch, ending):
    low, high = bent_pair()
    report = bake(low, high)
    before = snapshot.snapshot()

    class Types:
        """No operator of add-ons."""

    class Operators:
        """No operator of Blender's own."""

        wm = ()

    monkeypatch.setattr(formats, "bpy", type("Blender", (), {"types": Types, "ops": Operators}))
    with pytest.raises(BakeError, match=r"is off: enable it|without USD"):
        export(tmp_path / f"out{ending}", report)
    assert snapshot.difference(before, snapshot.snapshot()) == {}
