# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests maps in the .glb that the low mesh came from: what changes, and that nothing else does."""

import copy
import json

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.export import binary_gltf, engine_files, primitives, same_file, same_materials
from addon.export.binary_gltf import Glb
from addon.jobs import Job, bake_all
from addon.scene.importing import PLAIN, import_meshes
from tests.support import glb, gltf_characters, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

CHARACTER, CART = gltf_characters.character, gltf_characters.cart
PARTS = len(gltf_characters.PARTS)
ALL = ("BASE_COLOR", "ROUGHNESS", "METALLIC", "EMISSION", "ALPHA")


@pytest.fixture
def source(tmp_path):
    return CHARACTER(tmp_path / "character.glb")


def imported(path, *names):
    """Those of the objects of a file."""
    objects = {obj.name: obj for obj in import_meshes(str(path), PLAIN)}
    return [objects[name] for name in names]


def written(path, lows, *, share_image=False, **settings):
    """The JSON and the bytes of a copy of the file at `path` with the maps of a bake of `lows`, and the warnings."""
    wanted = {"method": "AUTO", "maps": ALL, "normal": False, "depth": 8, "width": 32, "height": 32} | settings
    jobs = [Job(low, [low]) for low in lows]
    reports = bake_all(bpy.context, jobs, scenes.settings(**wanted), share_image=share_image)
    target = path.with_name("written.glb")
    done = engine_files.export_files(bpy.context, [[each] for each in reports], target, source=path)
    return *glb.parse(target), [text for each in done for text in each.warnings]


def figure(path, **settings):
    return written(path, imported(path, "Figure"), uv_layer="UVMap.001", **settings)


def corners(tree, binary, primitive):
    """The values of all attributes and shape keys of a primitive at the corners of its triangles."""
    indices = glb.values(tree, binary, primitive["indices"])[:, 0]
    owners = {"": primitive["attributes"], **{f"{n} ": each for n, each in enumerate(primitive.get("targets", ()))}}
    return {
        before + name: glb.values(tree, binary, number)[indices]
        for before, owner in owners.items()
        for name, number in owner.items()
    }


def assert_same(before, after, *, but=()):
    """All attributes are equal to the bit, but those of these names."""
    old, new = corners(*before), corners(*after)
    assert old.keys() - {*but} == new.keys() - {*but}
    for name in old.keys() - {*but}:
        np.testing.assert_array_equal(old[name], new[name], err_msg=name)


def test_all_but_the_materials_is_as_it_was(source):
    before, old_bytes = glb.parse(source)
    after, new_bytes, warnings = figure(source, one_material=True)
    for key in ("nodes", "scenes", "cameras", "asset"):
        assert after[key] == before[key]
    assert [mesh["name"] for mesh in after["meshes"]] == ["figure", "stone"]
    assert after["meshes"][0]["extras"] == {"targetNames": ["breath"]}
    for old, new in zip(before["meshes"][0]["primitives"], after["meshes"][0]["primitives"], strict=True):
        assert new["extras"] == old["extras"]
        np.testing.assert_array_equal(
            glb.values(after, new_bytes, new["indices"]), glb.values(before, old_bytes, old["indices"])
        )
        assert_same((before, old_bytes, old), (after, new_bytes, new), but=("COLOR_0", "_COLOR_0"))
    for name in ("inverseBindMatrices", "joints"):
        assert name in after["skins"][0]
    sampler = after["animations"][0]["samplers"][0]
    np.testing.assert_array_equal(glb.values(after, new_bytes, sampler["input"])[:, 0], [0.0, 1.0])
    assert warnings == []


def test_eleven_materials_become_one(source):
    after, data, _ = figure(source, one_material=True)
    used = {primitive["material"] for primitive in after["meshes"][0]["primitives"]}
    assert len(used) == 1
    assert {each["name"] for each in after["materials"]} == {"Figure", "gray"}
    material = after["materials"][used.pop()]
    assert material["alphaMode"] == "MASK"
    assert material["doubleSided"] is True
    assert material["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] == 1
    assert [len(after[name]) for name in ("images", "textures")] == [3, 3]
    assert after["buffers"][0]["byteLength"] == len(data)
    colors = [
        number for number, each in enumerate(after["meshes"][0]["primitives"]) if "_COLOR_0" in each["attributes"]
    ]
    assert colors == [1, 9]
    assert not any("COLOR_0" in each["attributes"] for each in after["meshes"][0]["primitives"])


def test_occlusion_goes_into_each_material(source):
    before, old_bytes = glb.parse(source)
    after, new_bytes, _ = figure(source, maps=("AO",), rays=16)
    assert len(after["materials"]) == len(before["materials"])
    for old, new in zip(before["meshes"][0]["primitives"], after["meshes"][0]["primitives"], strict=True):
        assert_same((before, old_bytes, old), (after, new_bytes, new))
        was, now = before["materials"][old["material"]], dict(after["materials"][new["material"]])
        assert now.pop("occlusionTexture")["texCoord"] == 1
        assert {**now, "pbrMetallicRoughness": 0} == {**was, "pbrMetallicRoughness": 0}
        textures = [each["pbrMetallicRoughness"].pop("baseColorTexture", None) for each in (was, now)]
        assert was == now
        if textures[0]:
            assert {**textures[0], "index": 0} == {**textures[1], "index": 0}
            assert glb.image(before, old_bytes, textures[0]["index"]) == glb.image(
                after, new_bytes, textures[1]["index"]
            )
    (gray,) = [each for each in after["materials"] if each["name"] == "gray"]
    assert "occlusionTexture" not in gray


def test_maps_of_materials_go_into_each_of_them(source):
    data = Glb.parsed(source.read_bytes())
    glow = next(each for each in data.tree["materials"] if each["name"] == "shoes")
    glow |= {
        "emissiveFactor": [1.0, 0.5, 0.0],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 3.0}},
    }
    source.write_bytes(data.packed())
    after, _, _ = figure(source)
    by_name = {each["name"]: each for each in after["materials"]}
    assert len(by_name) == PARTS + 1
    for name, *_ in gltf_characters.PARTS:
        surface = by_name[name]["pbrMetallicRoughness"]
        textures = surface["baseColorTexture"], surface["metallicRoughnessTexture"], by_name[name]["emissiveTexture"]
        assert [each["texCoord"] for each in textures] == [1, 1, 1]
        assert not {"baseColorFactor", "metallicFactor", "roughnessFactor"} & surface.keys()
        strength = by_name[name]["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
        assert strength * max(by_name[name]["emissiveFactor"]) == pytest.approx(3.0, abs=0.05)
    assert by_name["hair"]["alphaMode"] == "MASK"
    assert "normalTexture" in by_name["body"]
    assert "texCoord" not in by_name["body"]["normalTexture"]
    assert "emissiveTexture" not in by_name["gray"]


def test_variants_of_other_materials_stay(source):
    """They name materials by numbers, which change."""
    data = Glb.parsed(source.read_bytes())
    data.tree["extensionsUsed"].append(same_materials.VARIANTS)
    data.tree["extensions"] = {same_materials.VARIANTS: {"variants": [{"name": "night"}]}}
    mapping = {"mappings": [{"material": 11, "variants": [0]}]}
    data.tree["meshes"][1]["primitives"][0]["extensions"] = {same_materials.VARIANTS: mapping}
    source.write_bytes(data.packed())
    after, _, _ = figure(source, one_material=True)
    (mapping,) = after["meshes"][1]["primitives"][0]["extensions"][same_materials.VARIANTS]["mappings"]
    assert after["materials"][mapping["material"]]["name"] == "gray"


def test_one_channel_of_a_texture_leaves_the_factor_of_the_other(source, tmp_path):
    after, data, warnings = figure(source, maps=("ROUGHNESS",))
    (body,) = [each for each in after["materials"] if each["name"] == "body"]
    surface = body["pbrMetallicRoughness"]
    assert surface["metallicFactor"] == 0.7
    assert "roughnessFactor" not in surface
    picture, *_ = glb.texels(glb.image(after, data, surface["metallicRoughnessTexture"]["index"]), tmp_path)
    assert picture[..., 2].min() == 255
    assert warnings == []


def test_what_is_in_one_image_with_a_baked_map_is_told(source):
    data = Glb.parsed(source.read_bytes())
    body = data.tree["materials"][0]
    body["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {"index": 0}
    source.write_bytes(data.packed())
    _, _, warnings = figure(source, maps=("ROUGHNESS", "BASE_COLOR"))
    assert [text.split(", which")[0] for text in warnings] == [
        "Material 'body' loses the texture of its metallic",
        "Material 'hair' loses the texture of its alpha",
    ]


def test_new_uvs_repeat_vertices_behind_the_others(source):
    """Each triangle by itself, as a light map has it."""
    (obj,) = imported(source, "Figure")
    layer = obj.data.uv_layers.new(name="apart")
    uv = np.random.default_rng(5).random((len(obj.data.loops), 2)).astype(np.float32)
    layer.uv.foreach_set("vector", uv.reshape(-1))
    before, old_bytes = glb.parse(source)
    after, new_bytes, _ = written(source, [obj], uv_layer="apart", one_material=True)
    begin = 0
    for number, (old, new) in enumerate(
        zip(before["meshes"][0]["primitives"], after["meshes"][0]["primitives"], strict=True)
    ):
        assert_same((before, old_bytes, old), (after, new_bytes, new), but=("COLOR_0", "_COLOR_0", "TEXCOORD_2"))
        found = corners(after, new_bytes, new)["TEXCOORD_2"].reshape(-1, 3, 2)
        if number == 5:  # Blender left out its fifth triangle
            found = np.delete(found, 4, axis=0)
        expected = uv.reshape(-1, 3, 2)[begin : begin + len(found)] * [1.0, -1.0] + [0.0, 1.0]
        begin += len(found)
        np.testing.assert_allclose(found, expected, atol=1e-6)
        count = before["accessors"][old["attributes"]["POSITION"]]["count"]
        for name in ("POSITION", "JOINTS_0"):
            first = glb.values(after, new_bytes, new["attributes"][name])[:count]
            np.testing.assert_array_equal(first, glb.values(before, old_bytes, old["attributes"][name]))
    assert begin == len(obj.data.polygons)
    assert after["materials"][-1]["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] == 2


def test_objects_with_new_uvs_share_one_material(source):
    """Also if they have had other numbers of UV sets."""
    lows = imported(source, "Figure", "stone")
    for number, obj in enumerate(lows):
        uv = np.random.default_rng(number).random((len(obj.data.loops), 2)).astype(np.float32) * 0.4 + 0.5 * number
        obj.data.uv_layers.new(name="Atlas").uv.foreach_set("vector", uv.reshape(-1))
    after, data, _ = written(source, lows, uv_layer="Atlas", share_image=True, one_material=True, image="both")
    (only,) = after["materials"]
    assert only["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] == 2
    (stone,) = after["meshes"][1]["primitives"]
    found = corners(after, data, stone)
    np.testing.assert_array_equal(found["TEXCOORD_1"], found["TEXCOORD_2"])


def test_tangents_come_with_a_normal_map(source):
    (obj,) = imported(source, "Figure")
    after, data, _ = written(source, [obj], uv_layer="UVMap.001", normal=True, maps=(), one_material=True)
    obj.data.calc_tangents(uvmap="UVMap.001")
    expected = np.array([(*loop.tangent, loop.bitangent_sign) for loop in obj.data.loops]).reshape(-1, 3, 4)
    begin = 0
    for number, primitive in enumerate(after["meshes"][0]["primitives"]):
        x, y, z, w = corners(after, data, primitive)["TANGENT"].reshape(-1, 3, 4).transpose(2, 0, 1)
        found = np.stack([x, -z, y, w], axis=-1)
        if number == 5:
            found = np.delete(found, 4, axis=0)
        np.testing.assert_allclose(found, expected[begin : begin + len(found)], atol=2e-5)
        begin += len(found)


def test_objects_of_one_image_share_the_material_and_a_mesh_is_written_once(tmp_path):
    path = CART(tmp_path / "cart.glb")
    lows = imported(path, "box", "wheel left", "wheel right")
    after, _, warnings = written(path, lows, share_image=True, one_material=True, image="both")
    assert [material["name"] for material in after["materials"]] == ["atlas"]
    assert not {"alphaMode", "doubleSided"} & after["materials"][0].keys()
    assert len(after["meshes"]) == 2
    assert [node.get("mesh") for node in after["nodes"]] == [0, 0, 1]
    assert warnings == []


def test_a_flat_normal_map_is_left_out(tmp_path):
    """Without detail, it is the shape itself."""
    path = CART(tmp_path / "cart.glb")
    after, _, _ = written(path, imported(path, "box"), normal=True, maps=("AO",), rays=16)
    assert not any("normalTexture" in material for material in after["materials"])
    assert not any("TANGENT" in each["attributes"] for mesh in after["meshes"] for each in mesh["primitives"])


def test_a_mesh_that_others_show_is_copied(tmp_path):
    path = CART(tmp_path / "cart.glb")
    before, _ = glb.parse(path)
    after, _, _ = written(path, imported(path, "wheel left"), one_material=True)
    wheels = {node["name"]: node["mesh"] for node in after["nodes"]}
    assert wheels["wheel left"] == 2
    old = [primitive["material"] for primitive in before["meshes"][0]["primitives"]]
    names = [
        after["materials"][each["material"]]["name"] for each in after["meshes"][wheels["wheel right"]]["primitives"]
    ]
    assert names == [before["materials"][number]["name"] for number in old]
    assert len({each["material"] for each in after["meshes"][2]["primitives"]}) == 1


def test_where_nodes_cannot_be_told_apart_others_show_the_maps_too(tmp_path):
    path = CART(tmp_path / "cart.glb")
    (low,) = imported(path, "wheel left")
    low.name = "renamed"
    after, _, warnings = written(path, [low], one_material=True)
    assert warnings == [
        "In the file, 'wheel left', 'wheel right' have the mesh of 'renamed', and all of them show its maps."
    ]
    assert len(after["meshes"]) == 2


def test_a_mesh_without_normals_gets_those_of_its_faces(source):
    """Engines ignore tangents without them."""
    data = Glb.parsed(source.read_bytes())
    for primitive in data.tree["meshes"][0]["primitives"]:
        del primitive["attributes"]["NORMAL"]
    source.write_bytes(data.packed())
    after, binary, _ = figure(source, normal=True, maps=(), one_material=True)
    found = corners(after, binary, after["meshes"][0]["primitives"][0])
    a, b, c = found["POSITION"].reshape(-1, 3, 3).transpose(1, 0, 2).astype(np.float64)
    expected = np.cross(b - a, c - a)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(found["NORMAL"].reshape(-1, 3, 3), expected[:, None].repeat(3, axis=1), atol=1e-4)
    assert "TANGENT" in found


def test_other_faces_are_refused(source):
    (obj,) = imported(source, "Figure")
    obj.data = zoo.plane("other").data
    obj.data.uv_layers[0].name = "UVMap.001"
    with pytest.raises(BakeError, match=r"'Figure' has other faces than in 'character.glb'"):
        written(source, [obj], uv_layer="UVMap.001")
    assert not source.with_name("written.glb").exists()


@pytest.mark.parametrize("differs_in", ["name", "number", "place"])
def test_of_meshes_with_the_same_faces_the_right_one_changes(source, differs_in):
    data = Glb.parsed(source.read_bytes())
    tree = data.tree
    stone = copy.deepcopy(tree["meshes"][1])
    if differs_in != "place":
        stone["name"] = {"name": "pebble", "number": "stone.001"}[differs_in]
    else:
        moved = data.whole(stone["primitives"][0]["attributes"]["POSITION"]) + np.float32(1.0)
        bounds = {"min": moved.min(axis=0).tolist(), "max": moved.max(axis=0).tolist()}
        stone["primitives"][0]["attributes"]["POSITION"] = data.add_accessor(moved, **bounds)
    tree["nodes"].append({"name": "pebble", "mesh": data.add("meshes", stone)})
    tree["scenes"][0]["nodes"].append(len(tree["nodes"]) - 1)
    tree["buffers"][0]["byteLength"] = len(data.binary)
    source.write_bytes(data.packed())
    (low,) = imported(source, "pebble")
    low.name = "renamed"
    after, _, _ = written(source, [low], one_material=True)
    names = [after["materials"][mesh["primitives"][0]["material"]]["name"] for mesh in after["meshes"][1:]]
    assert names == ["gray", "renamed"]


def test_names_of_nodes_come_before_those_of_meshes(source):
    """Blender numbers meshes of one name, and the number may be that of another one."""
    data = Glb.parsed(source.read_bytes())
    tree = data.tree
    names = ("stone", "stone", "stone.001", "stone.001")
    tree["meshes"][1:] = [copy.deepcopy(tree["meshes"][1]) | {"name": name} for name in names]
    tree["nodes"] += [{"name": f"{number}", "mesh": number} for number in range(2, 5)]
    tree["scenes"][0]["nodes"] += list(range(len(tree["nodes"]) - 3, len(tree["nodes"])))
    source.write_bytes(data.packed())
    for number in range(2, 5):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        after, _, _ = written(source, imported(source, f"{number}"), one_material=True)
        names = [after["materials"][mesh["primitives"][0]["material"]]["name"] for mesh in after["meshes"]]
        assert [place for place, name in enumerate(names) if name == f"{number}"] == [number]


def test_a_mesh_without_materials_gets_one(tmp_path):
    path = CART(tmp_path / "cart.glb")
    data = Glb.parsed(path.read_bytes())
    del data.tree["materials"]
    for primitive in data.tree["meshes"][0]["primitives"]:
        del primitive["material"]
    data.tree["meshes"], data.tree["nodes"] = data.tree["meshes"][:1], [{"name": "wheel", "mesh": 0}]
    data.tree["scenes"][0]["nodes"] = [0]
    path.write_bytes(data.packed())
    after, _, _ = written(path, imported(path, "wheel"), maps=("AO",), rays=16)
    assert [list(material) for material in after["materials"]] == [["occlusionTexture"]] * len(after["materials"])


def test_variants_of_one_material_are_told(source):
    data = Glb.parsed(source.read_bytes())
    data.tree["extensionsUsed"].append(same_materials.VARIANTS)
    data.tree["extensions"] = {same_materials.VARIANTS: {"variants": [{"name": "night"}]}}
    mapping = {"mappings": [{"material": 3, "variants": [0]}]}
    data.tree["meshes"][0]["primitives"][0]["extensions"] = {same_materials.VARIANTS: mapping}
    source.write_bytes(data.packed())
    after, _, warnings = figure(source, one_material=True)
    assert "extensions" not in after["meshes"][0]["primitives"][0]
    assert warnings == ["'Figure' has one material, and no variants of it any more."]


@pytest.mark.parametrize("shares_vertices", [False, True])
def test_primitives_alike_become_one(source, shares_vertices):
    data = Glb.parsed(source.read_bytes())
    primitives = data.tree["meshes"][0]["primitives"] = data.tree["meshes"][0]["primitives"][:6]
    for primitive in primitives:
        del primitive["extras"]
        primitive["attributes"].pop("COLOR_0", None)
        if shares_vertices:
            primitive |= {key: primitives[0][key] for key in ("attributes", "targets")}
    source.write_bytes(data.packed())
    before, old_bytes = glb.parse(source)
    after, new_bytes, _ = figure(source, one_material=True)
    (only,) = after["meshes"][0]["primitives"]
    olds = [corners(before, old_bytes, each) for each in before["meshes"][0]["primitives"]]
    for name, found in corners(after, new_bytes, only).items():
        np.testing.assert_array_equal(found, np.concatenate([old[name] for old in olds]), err_msg=name)
    how = after["accessors"][only["attributes"]["POSITION"]]
    assert how["count"] == 117 * (1 if shares_vertices else 6)
    points = glb.values(after, new_bytes, only["attributes"]["POSITION"])
    np.testing.assert_array_equal([how["min"], how["max"]], [points.min(axis=0), points.max(axis=0)])


def test_a_gltf_with_files_beside_it_becomes_one_file(source):
    """Its images stay as they are to the byte."""
    tree, binary = glb.parse(source)
    folder = source.parent
    (folder / "the data.bin").write_bytes(binary)
    (folder / "first.bin").write_bytes(bytes(6))
    tree["buffers"] = [
        {"byteLength": 6, "uri": "first.bin"},
        {"byteLength": len(binary), "uri": "the%20data.bin"},
    ]
    for each in tree["bufferViews"]:
        each["buffer"] = 1
    paint = tree["images"][0]
    view = tree["bufferViews"][paint.pop("bufferView")]
    (folder / "paint.png").write_bytes(binary[view["byteOffset"] :][: view["byteLength"]])
    paint["uri"] = "paint.png"
    path = folder / "character.gltf"
    path.write_text(json.dumps(tree))
    after, data, _ = figure(path, maps=("AO",), rays=16)
    before, old_bytes = glb.parse(source)
    pictures = [
        {glb.image(t, b, n) for n in range(len(t["textures"]))} for t, b in ((before, old_bytes), (after, data))
    ]
    assert pictures[0] < pictures[1]
    assert not any("uri" in each for each in (*after["images"], *after["buffers"]))


@pytest.mark.parametrize(("mode", "indices"), [(5, [0, 1, 2, 3, 4, 5]), (6, [0, 1, 2, 3, 4]), (4, [0, 1, 2, 2, 1, 3])])
def test_strips_and_fans_are_read_as_blender_reads_them(tmp_path, mode, indices):
    file = gltf_characters.Writer()
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0.5), (0, 2, 0), (1, 2, 0)], float)
    attributes = {"POSITION": file.accessor(points, has_bounds=True), "TEXCOORD_0": file.accessor(points[:, :2] / 2.0)}
    primitive = {"attributes": attributes, "indices": file.accessor(np.array(indices), "H"), "mode": mode}
    file.tree["scenes"][0]["nodes"] = [
        file.add("nodes", {"name": "strip", "mesh": file.add("meshes", {"name": "strip", "primitives": [primitive]})})
    ]
    path = file.save(tmp_path / "strip.glb")
    (obj,) = imported(path, "strip")
    parts = primitives.parts_of(Glb.parsed(path.read_bytes()), 0)
    assert primitives.faces_kept(primitives.as_imported(parts), obj.data).all()


def test_sparse_and_missing_values_are_read():
    file = Glb({"accessors": [], "bufferViews": [], "buffers": [{"byteLength": 0}]}, b"")
    places, values = (
        file.add_view(np.array([1, 3], "<u2").tobytes()),
        file.add_view(np.array([[5.0], [7.0]], "<f4").tobytes()),
    )
    sparse = {"count": 2, "indices": {"bufferView": places, "componentType": 5123}, "values": {"bufferView": values}}
    number = file.add("accessors", {"componentType": 5126, "count": 4, "type": "SCALAR", "sparse": sparse})
    np.testing.assert_array_equal(file.whole(number)[:, 0], [0.0, 5.0, 0.0, 7.0])


def test_large_numbers_of_vertices_take_four_bytes():
    file = Glb({"buffers": [{"byteLength": 0}]}, bytearray())
    for largest in (0xFFFE, 0xFFFF, 70_000):
        number = file.add_indices(np.array([0, largest]))
        assert file.whole(number)[:, 0].tolist() == [0, largest]
    assert [each["componentType"] for each in file.tree["accessors"]] == [5123, 5125, 5125]


def test_rows_of_few_bytes_begin_at_multiples_of_four():
    file = Glb({"buffers": [{"byteLength": 0}]}, b"")
    values = np.arange(9, dtype=np.uint8).reshape(3, 3)
    number = file.add_accessor(values)
    assert file.tree["bufferViews"][0]["byteStride"] == 4
    np.testing.assert_array_equal(file.whole(number), values)


def test_what_was_unused_before_stays(source):
    data = Glb.parsed(source.read_bytes())
    data.tree["materials"].append({"name": "spare"})
    source.write_bytes(data.packed())
    after, _, _ = figure(source, one_material=True)
    assert {each["name"] for each in after["materials"]} == {"Figure", "gray", "spare"}


def test_a_file_with_unknown_extensions_loses_nothing(source):
    data = Glb.parsed(source.read_bytes())
    data.tree["extensionsUsed"].append("EXT_of_someone")
    source.write_bytes(data.packed())
    after, _, _ = figure(source, one_material=True)
    assert len(after["materials"]) == PARTS + 2
    assert binary_gltf.unused(after)["materials"] == set(range(PARTS))


def test_images_beside_a_glb_come_into_it(source):
    data = Glb.parsed(source.read_bytes())
    paint = data.tree["images"][0]
    (source.parent / "paint.png").write_bytes(data.image(0))
    del paint["bufferView"], paint["mimeType"]
    paint["uri"] = "paint.png"
    source.write_bytes(data.packed())
    after, binary, _ = figure(source, maps=("AO",), rays=16)
    assert not any("uri" in each for each in after["images"])
    assert (source.parent / "paint.png").read_bytes() in {
        glb.image(after, binary, number) for number in range(len(after["textures"]))
    }


def test_a_compressed_file_is_named(source):
    lows = imported(source, "stone")
    data = Glb.parsed(source.read_bytes())
    data.tree["extensionsUsed"].append("KHR_draco_mesh_compression")
    source.write_bytes(data.packed())
    with pytest.raises(
        BakeError, match=r"The meshes of 'character.glb' are compressed with Draco: save it without that."
    ):
        written(source, lows)


def test_each_of_many_meshes_is_found(tmp_path):
    """Blender leaves out some of their faces."""
    file = gltf_characters.Writer()
    rng = np.random.default_rng(0)
    for number in range(60):
        points = rng.random((300, 3))
        indices = rng.integers(0, 300, 900)
        attributes = {"POSITION": file.accessor(points, has_bounds=True), "TEXCOORD_0": file.accessor(points[:, :2])}
        primitive = {"attributes": attributes, "indices": file.accessor(indices, "H")}
        file.add("nodes", {"name": f"{number}", "mesh": file.add("meshes", {"primitives": [primitive]})})
    file.tree["scenes"][0]["nodes"] = list(range(60))
    path = file.save(tmp_path / "city.glb")
    parsed = Glb.read(path)
    triangles = [primitives.as_imported(primitives.parts_of(parsed, number)) for number in range(60)]
    for obj in import_meshes(str(path), PLAIN):
        assert same_file._mesh_of(parsed, triangles, obj, (), path) == int(obj.name)


SQUARE = np.array([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], float)


def square(file, name, *, turn=None, color=None, **material):
    """The number of a mesh of two triangles. turn: a rotation (3, 3) of it. color: of its vertices."""
    turn = np.eye(3) if turn is None else turn
    uv = np.array([(0, 1), (0, 0), (1, 0), (1, 1)], float)
    attributes = {
        "POSITION": file.accessor(SQUARE @ turn.T, has_bounds=True),
        "NORMAL": file.accessor(np.tile([0.0, 1.0, 0.0], (4, 1)) @ turn.T),
        "TEXCOORD_0": file.accessor(uv),
    }
    if color is not None:
        attributes["COLOR_0"] = file.accessor(np.tile(color, (4, 1)))
    primitive = {"attributes": attributes, "indices": file.accessor(np.array([0, 1, 2, 0, 2, 3]), "H")}
    primitive["material"] = file.add("materials", {"name": f"{name} look", **material})
    return file.add("meshes", {"name": name, "primitives": [primitive]})


def add_node(file, **node):
    file.tree["scenes"][0]["nodes"].append(file.add("nodes", node))


def bumped(obj):
    """The object, whose last material has noise for its normals."""
    tree = obj.data.materials[-1].node_tree
    bump, noise = tree.nodes.new("ShaderNodeBump"), tree.nodes.new("ShaderNodeTexNoise")
    bump.inputs["Distance"].default_value = 1.0
    tree.links.new(noise.outputs[0], bump.inputs["Height"])
    tree.links.new(bump.outputs[0], tree.nodes["Principled BSDF"].inputs["Normal"])
    return obj


def test_tangents_of_skinned_meshes_are_those_of_the_file(tmp_path):
    """The importer moves one of two meshes whose joint has two inverse bind matrices."""
    file = gltf_characters.Writer()
    add_node(file, name="joint")
    upright = np.array([(1, 0, 0), (0, 0, 1), (0, -1, 0)], float)
    for name, turn in (("first", np.eye(3)), ("second", upright)):
        inverse = np.eye(4)
        inverse[:3, :3] = turn.T
        mesh = square(file, name, turn=turn)
        attributes = file.tree["meshes"][mesh]["primitives"][0]["attributes"]
        attributes["JOINTS_0"] = file.accessor(np.zeros((4, 4)), "B")
        attributes["WEIGHTS_0"] = file.accessor(np.tile([1.0, 0.0, 0.0, 0.0], (4, 1)))
        skin = {"joints": [0], "inverseBindMatrices": file.accessor(inverse.T.reshape(1, 16))}
        add_node(file, name=name, mesh=mesh, skin=file.add("skins", skin))
    path = file.save(tmp_path / "two.glb")
    lows = [bumped(obj) for obj in imported(path, "first", "second")]
    after, data, _ = written(path, lows, normal=True, maps=())
    for mesh in after["meshes"]:
        found = corners(after, data, mesh["primitives"][0])
        along_u = found["POSITION"][5] - found["POSITION"][0]
        np.testing.assert_allclose(found["TANGENT"][:, :3], np.tile(along_u / 2.0, (6, 1)), atol=1e-5)


@pytest.mark.parametrize("bakes_alpha", [False, True])
def test_opacity_stays_where_alpha_is_not_baked(tmp_path, bakes_alpha):
    file = gltf_characters.Writer()
    surface = {"baseColorFactor": [0.2, 0.4, 0.6, 0.7]}
    add_node(file, name="factor", mesh=square(file, "factor", alphaMode="BLEND", pbrMetallicRoughness=surface))
    add_node(file, name="colors", mesh=square(file, "colors", alphaMode="BLEND", color=(1.0, 0.5, 0.5, 0.8)))
    path = file.save(tmp_path / "glass.glb")
    lows = imported(path, "factor", "colors")
    after, data, _ = written(path, lows, maps=("BASE_COLOR", "ALPHA") if bakes_alpha else ("BASE_COLOR",))
    by_name = {mesh["name"]: mesh["primitives"][0] for mesh in after["meshes"]}
    material = after["materials"][by_name["factor"]["material"]]
    assert material["alphaMode"] == "BLEND"
    color = material["pbrMetallicRoughness"].get("baseColorFactor")
    assert color == (None if bakes_alpha else [1.0, 1.0, 1.0, 0.7])
    colors = corners(after, data, by_name["colors"])
    np.testing.assert_allclose(colors["_COLOR_0"], np.tile((1.0, 0.5, 0.5, 0.8), (6, 1)))
    assert ("COLOR_0" in colors) is not bakes_alpha
    if not bakes_alpha:
        np.testing.assert_allclose(colors["COLOR_0"], np.tile((1.0, 1.0, 1.0, 0.8), (6, 1)))


def test_one_material_without_alpha_is_told(tmp_path):
    file = gltf_characters.Writer()
    add_node(file, name="pane", mesh=square(file, "pane", alphaMode="BLEND"))
    path = file.save(tmp_path / "pane.glb")
    after, _, warnings = written(path, imported(path, "pane"), maps=("BASE_COLOR",), one_material=True)
    assert "alphaMode" not in after["materials"][0]
    assert warnings == ["Material 'pane' is opaque, and one before it was not: bake the alpha map as well."]


@pytest.mark.parametrize("number", [0, 1, 2])
def test_of_equal_meshes_and_nodes_the_number_tells(tmp_path, number):
    """The importer goes from roots to children."""
    file = gltf_characters.Writer()
    meshes = [square(file, "M", doubleSided=bool(place % 2)) for place in range(3)]
    children = [file.add("nodes", {"name": "N", "mesh": meshes[place]}) for place in (2, 0)]
    add_node(file, name="N", mesh=meshes[1])
    add_node(file, name="group", children=children[::-1])
    path = file.save(tmp_path / "twins.glb")
    names = ["N", "N.001", "N.002"]
    after, _, _ = written(path, imported(path, names[number]), maps=("BASE_COLOR",))
    textured = ["baseColorTexture" in each.get("pbrMetallicRoughness", {}) for each in after["materials"]]
    changed = [textured[mesh["primitives"][0]["material"]] for mesh in after["meshes"]]
    assert changed.index(True) == [1, 0, 2][number]
    assert changed.count(True) == 1


def test_equal_meshes_without_their_names_are_refused(tmp_path):
    file = gltf_characters.Writer()
    for _ in range(2):
        add_node(file, name="N", mesh=square(file, "M"))
    path = file.save(tmp_path / "twins.glb")
    (low,) = imported(path, "N")
    low.name = low.data.name = "renamed"
    with pytest.raises(
        BakeError, match=r"'twins.glb' has several meshes like that of 'renamed', and none has its name"
    ):
        written(path, [low], maps=("BASE_COLOR",))


def test_a_primitive_without_points_stays(tmp_path):
    file = gltf_characters.Writer()
    mesh = square(file, "pane")
    file.tree["meshes"][mesh]["primitives"].insert(0, {"attributes": {"NORMAL": 1}})
    add_node(file, name="pane", mesh=mesh)
    path = file.save(tmp_path / "pane.glb")
    after, _, _ = written(path, imported(path, "pane"), maps=("BASE_COLOR",))
    empty, whole = after["meshes"][0]["primitives"]
    assert list(empty) == ["attributes"]
    assert "baseColorTexture" in after["materials"][whole["material"]]["pbrMetallicRoughness"]


def test_lines_before_triangles_have_vertices_of_their_own(tmp_path):
    file = gltf_characters.Writer()
    mesh = square(file, "pane")
    primitives_of = file.tree["meshes"][mesh]["primitives"]
    ends = file.accessor(np.array([0, 2]), "H")
    lines = {"attributes": {"POSITION": primitives_of[0]["attributes"]["POSITION"]}, "mode": 1, "indices": ends}
    primitives_of.insert(0, lines)
    add_node(file, name="pane", mesh=mesh)
    path = file.save(tmp_path / "pane.glb")
    after, data, _ = written(path, [bumped(*imported(path, "pane"))], maps=("BASE_COLOR",), normal=True)
    kept, surface = after["meshes"][0]["primitives"]
    assert kept.keys() == lines.keys()
    assert "TANGENT" in corners(after, data, surface)
    assert "baseColorTexture" in after["materials"][surface["material"]]["pbrMetallicRoughness"]


def test_maps_of_webp_stand_beside_the_textures_of_the_file(source):
    before, _ = glb.parse(source)
    after, data, _ = figure(source, maps=("ROUGHNESS", "METALLIC"), export_webp=True)
    assert after["extensionsRequired"] == ["EXT_texture_webp"]
    counts = {kind: sum(each["mimeType"] == kind for each in after["images"]) for kind in ("image/png", "image/webp")}
    assert counts == {"image/png": len(before["images"]), "image/webp": 1}
    used = set()
    for texture, image in ((each, after["images"][glb.source(each)]) for each in after["textures"]):
        view = after["bufferViews"][image["bufferView"]]
        start = data[view["byteOffset"] :]
        used.add(image["mimeType"])
        assert start.startswith(b"\x89PNG") == (image["mimeType"] == "image/png") == ("source" in texture)
        assert (start[8:12] == b"WEBP") == (image["mimeType"] == "image/webp")
    assert len(used) == 2


def test_a_map_with_clear_texels_stays_png(source):
    after, data, _ = figure(source, maps=("BASE_COLOR", "ALPHA", "EMISSION"), one_material=True, export_webp=True)
    material = after["materials"][after["meshes"][0]["primitives"][0]["material"]]
    color = material["pbrMetallicRoughness"]["baseColorTexture"]["index"]
    assert glb.image(after, data, color).startswith(b"\x89PNG")
    assert glb.image(after, data, material["emissiveTexture"]["index"])[8:12] == b"WEBP"
