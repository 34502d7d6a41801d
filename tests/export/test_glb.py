# SPDX-License-Identifier: GPL-3.0-or-later
"""Exports .glb files, and reads them by the specification: what a target engine shows of them is the object-space map."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon.core import progress
from addon.core.declarations import bases, targets
from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.export import comparison, engine_files
from addon.export.baked_low import FileMesh
from addon.export.comparison import Baked
from addon.jobs import bake_jobs, bake_pair
from addon.jobs.job import Job
from addon.mesh.triangles import unit
from tests.support import angles, cycles, decoders, glb, lanes, maps, scenes, snapshot, zoo
from tests.support.real_meshes import open_pair

pytestmark = pytest.mark.usefixtures("gpu_context")


PAIRS = ["spot_1696_536", "spot_control_vs_subd5", "king_40480_4000", "helmet_23358_6117"]
EIGHT_BITS_P99 = 0.35
"""Degrees that 8 bits cost at the 99th percentile (0.30), and those of the rasterizer."""


def bake(low, *highs, size=64, image="the normal map", **settings):
    values = {"method": "FLATTEN", "depth": 16, "storage": "PACK", "basis": "MIKKTSPACE", "material": False, **settings}
    return bake_pair(bpy.context, low, highs, Settings(image=image, width=size, height=size, **values))


def export(path, *reports):
    return engine_files.export_files(bpy.context, [[report] for report in reports], path)


def bent_pair(**options):
    """A low sheet of bent quads, and a finer high one with waves, on the same UVs."""

    def surface(height):
        return lambda u, v: np.stack([u, v, 0.3 * np.sin(3 * u) * np.cos(5 * v) + height * np.sin(40 * u)], axis=1)

    return zoo.sheet("bent", surface(0.0), 3, 4, **options), zoo.sheet("fine", surface(0.004), 96, 96)


def off(path, name, truth, tmp_path, *, shared=False):
    """Degrees between what a MikkTSpace engine shows of a file and an object-space map, where both have texels. shared (H, W):
    texels that do not count, since the engine shows the last of several triangles there."""
    (part,) = glb.parts(path, name)
    picture, channels, depth = glb.texels(part.normal_map, tmp_path)
    assert (channels, depth) == (3, 8)
    normals, covered = glb.shown(part, picture)
    both = angles.eroded(covered & (truth[..., 3] > 0.0) & ~np.asarray(shared), 1)
    assert both.sum() > 100
    return angles.degrees(normals[both], angles.decode(truth)[both])


def test_the_normals_of_the_file_are_those_of_the_object_space_map(tmp_path):
    low, high = bent_pair()
    truth = maps.bake(low, high, image="truth", space="OBJECT", size=(128, 128))
    report = bake(low, high, size=128)
    (done,) = export(tmp_path / "out.glb", report)
    found = off(tmp_path / "out.glb", "bent", truth, tmp_path)
    assert np.percentile(found, 99) < EIGHT_BITS_P99
    assert done.measured.degrees["MIKKTSPACE"]["percentile_99"] == pytest.approx(np.percentile(found, 99), abs=0.05)
    assert done.measured.has_tangents


@pytest.mark.shared
@pytest.mark.parametrize("name", lanes.slow_but(PAIRS[:1], PAIRS))
def test_real_meshes_and_lows_with_ngons(shared_assets, tmp_path, name):
    low, high = open_pair(shared_assets, name)
    truth = maps.bake(low, high, image="truth", space="OBJECT", size=(512, 512))
    (done,) = export(tmp_path / "out.glb", bake(low, high, size=512))
    found = off(tmp_path / "out.glb", "lo", truth, tmp_path, shared=cycles.shared(low, (512, 512)))
    assert np.percentile(found, 99) < EIGHT_BITS_P99
    assert done.measured.degrees["MIKKTSPACE"]["percentile_99"] < EIGHT_BITS_P99


def test_blender_reads_the_same_surface(tmp_path):
    low, high = bent_pair()
    export(tmp_path / "out.glb", bake(low, high))
    low.name = "before"
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "out.glb"))
    (read,) = (obj for obj in bpy.data.objects if obj.name.startswith("bent"))
    assert len(read.data.polygons) == 24
    normal_map = next(node for node in read.data.materials[0].node_tree.nodes if node.type == "NORMAL_MAP")
    (texture,) = (link.from_node for link in normal_map.inputs["Color"].links)
    assert texture.image.colorspace_settings.name == "Non-Color"
    assert tuple(texture.image.size) == (64, 64)
    positions = np.array([vertex.co for vertex in read.data.vertices])
    own = np.array([vertex.co for vertex in low.data.vertices])
    assert np.abs(positions[:, None] - own[None]).sum(axis=2).min(axis=1).max() < 1e-6


def test_tangents_are_of_the_layer_of_the_map(tmp_path):
    low, high = bent_pair()
    low.data.uv_layers[0].name = "other"
    low.data.uv_layers.new(name=zoo.LAYER)  # the second one, with the same UVs
    turned = low.data.uv_layers["other"]
    for value in turned.uv:
        u, v = value.vector
        value.vector = 1.0 - v, u
    low.data.uv_layers.active = turned
    truth = maps.bake(low, high, image="truth", space="OBJECT", size=(64, 64), uv_layer=zoo.LAYER)
    export(tmp_path / "out.glb", bake(low, high, uv_layer=zoo.LAYER))
    assert np.percentile(off(tmp_path / "out.glb", "bent", truth, tmp_path), 99) < EIGHT_BITS_P99
    (part,) = glb.parts(tmp_path / "out.glb", "bent")
    assert part.material["normalTexture"].get("texCoord", 0) == 0  # engines that know one layer take the first
    assert "TEXCOORD_1" in part.attributes  # other textures may use it


@pytest.mark.parametrize("is_diagonal", [False, True], ids=["as the others", "across the normal"])
def test_each_tangent_has_a_length(tmp_path, is_diagonal):
    """MikkTSpace has none where a corner's normal sees its triangle from the edge. is_diagonal: that of the others, which it
    could take, is its normal."""
    points = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)])
    corners, normals = np.array([(0, 1, 2), (0, 2, 3)]), np.tile((0.0, 0.0, 1.0), (6, 1))
    normals[0] = unit(unit(points[1]) - unit(points[2]))
    axes = np.stack([normals[0], np.cross(normals[1], normals[0])]) if is_diagonal else np.eye(2, 3)
    uv = 0.7 * (points - 0.5) @ axes.T + 0.5
    low, high = zoo.build("flat", points, corners, uv[corners], normals=normals), bent_pair()[1]
    low.data.calc_tangents()
    assert [any(each.tangent) for each in low.data.loops] == [False, *5 * [True]]
    export(tmp_path / "out.glb", bake(low, high))
    (part,) = glb.parts(tmp_path / "out.glb", "flat")
    tangents, normals = part.attributes["TANGENT"][:, :3], part.attributes["NORMAL"]
    assert np.abs(np.linalg.norm(tangents, axis=1) - 1.0).max() < 1e-5
    assert np.abs((tangents * normals).sum(axis=1)).max() < 1e-5


def test_mirrored_halves_keep_the_sign_of_their_bitangent(tmp_path):
    low, high = bent_pair()
    for obj in (low, high):
        for value in obj.data.uv_layers[zoo.LAYER].uv:
            value.vector.x = 1.0 - value.vector.x
    truth = maps.bake(low, high, image="truth", space="OBJECT", size=(64, 64))
    export(tmp_path / "out.glb", bake(low, high))
    (part,) = glb.parts(tmp_path / "out.glb", "bent")
    assert set(part.attributes["TANGENT"][:, 3].tolist()) == {-1.0}
    assert np.percentile(off(tmp_path / "out.glb", "bent", truth, tmp_path), 99) < EIGHT_BITS_P99


@pytest.mark.parametrize("channels", [("+X", "-Y", "+Z"), ("+X", "+Z", "-Y")])
def test_other_channels_are_turned_into_those_of_gltf(tmp_path, channels):
    low, high = bent_pair()
    truth = maps.bake(low, high, image="truth", space="OBJECT", size=(64, 64))
    red, green, blue = channels
    export(tmp_path / "out.glb", bake(low, high, red=red, green=green, blue=blue))
    assert np.percentile(off(tmp_path / "out.glb", "bent", truth, tmp_path), 99) < EIGHT_BITS_P99


def test_nothing_is_left_in_the_file(tmp_path):
    low, high = bent_pair()
    scenes.material("painted", low)
    report = bake(low, high, maps=("AO", "ROUGHNESS"), rays=16)
    bpy.context.view_layer.objects.active = low
    low.select_set(True)
    before = snapshot.snapshot()
    export(tmp_path / "out.glb", report)
    assert snapshot.difference(before, snapshot.snapshot()) == {}
    (part,) = glb.parts(tmp_path / "out.glb", "bent")
    assert part.material["name"] == "painted"


def test_edit_mode_is_kept(tmp_path):
    low, high = bent_pair()
    report = bake(low, high)
    bpy.context.view_layer.objects.active = low
    bpy.ops.object.mode_set(mode="EDIT")
    export(tmp_path / "out.glb", report)
    assert low.mode == "EDIT"


@pytest.mark.parametrize("pack", ["NONE", "GLTF"])
def test_occlusion_roughness_and_metallic_share_an_image(tmp_path, pack):
    low, high = bent_pair()
    material = bpy.data.materials.new("steel")
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    inputs["Roughness"].default_value, inputs["Metallic"].default_value = 0.25, 0.75
    high.data.materials.append(material)
    export(tmp_path / "out.glb", bake(low, high, maps=("AO", "ROUGHNESS", "METALLIC"), rays=16, pack=pack))
    tree, binary = glb.parse(tmp_path / "out.glb")
    (material,) = tree["materials"]
    surface = material["pbrMetallicRoughness"]["metallicRoughnessTexture"]["index"]
    assert tree["textures"][surface]["source"] == tree["textures"][material["occlusionTexture"]["index"]]["source"]
    assert len(tree["images"]) == 2
    picture, channels, bits = glb.texels(glb.image(tree, binary, surface), tmp_path)
    assert (channels, bits) == (3, 8)
    np.testing.assert_allclose(picture[32, 32, 1:], [64, 191], atol=1)


def test_levels_of_detail_hang_on_the_first(tmp_path):
    low, high = bent_pair()
    coarse = zoo.sheet("coarse", lambda u, v: np.stack([u, v, 0 * u], axis=1), 1, 1)
    reports = bake(low, high, image="fine map"), bake(coarse, high, image="coarse map")
    done = engine_files.export_files(
        bpy.context, [[report] for report in reports], tmp_path / "out.glb", are_levels=True
    )
    tree, _ = glb.parse(tmp_path / "out.glb")
    (root,) = tree["scenes"][0]["nodes"]
    (other,) = tree["nodes"][root]["extensions"]["MSFT_lod"]["ids"]
    assert (tree["nodes"][root]["name"], tree["nodes"][other]["name"]) == ("bent", "coarse")
    assert tree["extensionsUsed"] == ["MSFT_lod"]
    assert [one.triangles for one in done] == [24, 2]


def test_levels_in_files_of_their_own_are_written_all_or_none(tmp_path, monkeypatch):
    low, high = bent_pair()
    coarse = zoo.sheet("coarse", lambda u, v: np.stack([u, v, 0 * u], axis=1), 1, 1)
    reports = bake(low, high, image="fine map"), bake(coarse, high, image="coarse map")
    export = engine_files.export_files

    def second_fails(context, bakes, path, **options):
        if bakes[0][0].low == "coarse":
            raise BakeError("The disk is full.")
        return export(context, bakes, path, **options)

    def content():
        return {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def write():
        return engine_files.export_levels(bpy.context, reports, str(tmp_path / "{low}.glb"))

    for is_there in (False, True):
        before = content()
        with monkeypatch.context() as patch:
            patch.setattr(engine_files, "export_files", second_fails)
            with pytest.raises(BakeError, match="disk is full"):
                write()
        assert content() == before
        low.location.z += 1.0  # another file, where there was one
        assert [one.triangles for one in write()] == [24, 2]
        assert set(content()) == {"bent.glb", "coarse.glb"}
        assert is_there == (content().keys() == before.keys())
    assert content()["bent.glb"] != before["bent.glb"]
    assert all("MSFT_lod" not in glb.parse(path)[0].get("extensionsUsed", []) for path in tmp_path.iterdir())


def test_texture_sets_have_a_material_each(tmp_path):
    low, high = bent_pair()
    for name in ("wood", "iron"):
        scenes.material(name, low)
    for face in low.data.polygons[:6]:
        face.material_index = 1
    settings = Settings(
        method="FLATTEN", width=64, height=64, storage="PACK", basis="MIKKTSPACE", texture_sets=True, material=False
    )
    reports = bake_jobs.bake_all(bpy.context, [Job(low, [high])], settings)
    (done,) = engine_files.export_files(bpy.context, [reports], tmp_path / "out.glb")
    found = glb.parts(tmp_path / "out.glb", "bent")
    assert [part.material["name"] for part in found] == ["wood", "iron"]
    assert [len(part.indices) for part in found] == [12, 12]
    assert found[0].normal_map != found[1].normal_map
    assert done.measured.degrees["MIKKTSPACE"]["percentile_99"] < EIGHT_BITS_P99


def test_udim_tiles_become_materials(tmp_path):
    low, high = bent_pair()
    for obj in (low, high):
        for value in obj.data.uv_layers[zoo.LAYER].uv:
            value.vector.x += 1.0
    report = bake(low, high, udim=True)
    (done,) = export(tmp_path / "out.glb", report)
    (part,) = glb.parts(tmp_path / "out.glb", "bent")
    assert part.material["name"] == "bent_1002"
    assert part.attributes["TEXCOORD_0"].min() >= 0.0
    assert part.attributes["TEXCOORD_0"].max() <= 1.0
    assert done.measured.degrees["MIKKTSPACE"]["percentile_99"] < EIGHT_BITS_P99
    assert low.name == "bent"


def test_a_triangle_in_two_tiles_is_refused(tmp_path):
    low, high = bent_pair()
    for obj in (low, high):
        for value in obj.data.uv_layers[zoo.LAYER].uv:
            value.vector.x = value.vector.x * 2.0 + 0.3
    report = bake(low, high, udim=True)
    with pytest.raises(BakeError, match="several UDIM tiles"):
        export(tmp_path / "out.glb", report)
    assert not (tmp_path / "out.glb").exists()


def test_an_object_space_map_is_refused(tmp_path):
    low, high = bent_pair()
    with pytest.raises(BakeError, match="object space"):
        export(tmp_path / "out.glb", bake(low, high, space="OBJECT"))


def test_another_ending_is_refused(tmp_path):
    low, high = bent_pair()
    with pytest.raises(BakeError, match=r"out\.obj' is no file for an engine"):
        export(tmp_path / "out.obj", bake(low, high))


def test_a_failure_leaves_the_old_file_and_nothing_in_the_scene(tmp_path, monkeypatch):
    low, high = bent_pair()
    report = bake(low, high)
    (tmp_path / "out.glb").write_bytes(b"old")
    before = snapshot.snapshot()
    original = engine_files.FORMATS[".glb"].read
    with monkeypatch.context() as patch:

        def wrong(path, one):
            found = original(path, one)
            found.positions[0, 0, 0] += 1.0
            return found

        glb = replace(engine_files.FORMATS[".glb"], read=wrong)
        patch.setattr(engine_files, "FORMATS", {**engine_files.FORMATS, ".glb": glb})
        with pytest.raises(BakeError, match="other triangles"):
            export(tmp_path / "out.glb", report)
    assert (tmp_path / "out.glb").read_bytes() == b"old"
    assert snapshot.difference(before, snapshot.snapshot()) == {}


def test_moved_and_turned_objects_keep_their_place(tmp_path):
    low, high = bent_pair()
    for obj in (low, high):
        obj.location, obj.rotation_euler, obj.scale = (1, 2, 3), (0.3, 0.5, 0.7), (2, 2, 2)
    (done,) = export(tmp_path / "out.glb", bake(low, high))
    assert done.measured.degrees["MIKKTSPACE"]["percentile_99"] < EIGHT_BITS_P99
    own = sorted(tuple(round(x, 4) for x in low.matrix_world @ vertex.co) for vertex in low.data.vertices)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "out.glb"), merge_vertices=True)
    (read,) = (obj for obj in bpy.data.objects if obj.type == "MESH")
    bpy.context.view_layer.update()
    found = {tuple(round(x, 4) for x in read.matrix_world @ vertex.co) for vertex in read.data.vertices}
    np.testing.assert_allclose(sorted(found), sorted(set(own)), atol=2e-4)


@pytest.mark.parametrize("depth", [8, 16, 32])
def test_colors_of_any_depth_become_srgb_of_8_bits(tmp_path, depth):
    low, high = bent_pair()
    material = bpy.data.materials.new("red")
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.5, 0.1, 0.02, 1.0)
    high.data.materials.append(material)
    export(tmp_path / "out.glb", bake(low, high, maps=("BASE_COLOR",), depth=depth))
    tree, binary = glb.parse(tmp_path / "out.glb")
    texture = tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    picture, channels, bits = glb.texels(glb.image(tree, binary, texture["index"]), tmp_path)
    assert (channels, bits) == (3, 8)
    np.testing.assert_allclose(picture[32, 32], [188, 89, 39], atol=1)  # sRGB of these colors


def test_the_base_mesh_of_an_object_with_its_own_detail_is_exported(tmp_path):
    low, _ = bent_pair()
    modifier = low.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = modifier.render_levels = 2
    (done,) = export(tmp_path / "out.glb", bake(low, low))
    assert done.triangles == 24
    assert done.measured.degrees["MIKKTSPACE"]["percentile_99"] < EIGHT_BITS_P99


def test_a_linked_object_with_a_linked_material_is_exported(tmp_path):
    low, high = bent_pair()
    scenes.material("painted", low)
    scenes.save(tmp_path / "library.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, here):
        here.objects = ["bent", "fine"]
    for obj in here.objects:
        bpy.context.scene.collection.objects.link(obj)
    low, high = here.objects
    report = bake(low, high)
    before = snapshot.snapshot()
    (done,) = export(tmp_path / "out.glb", report)
    assert done.measured.degrees["MIKKTSPACE"]["percentile_99"] < EIGHT_BITS_P99
    assert snapshot.difference(before, snapshot.snapshot()) == {}
    (part,) = glb.parts(tmp_path / "out.glb", "bent")
    assert part.material["name"] == "painted"


def test_other_textures_of_the_material_stay(tmp_path):
    low, high = bent_pair()
    material = scenes.material("painted", low)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    texture, place = nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeUVMap")
    texture.image = bpy.data.images.new("paint", 8, 8)
    texture.image.pack()
    place.uv_map = "second"
    low.data.uv_layers.new(name="second")
    links.new(place.outputs["UV"], texture.inputs["Vector"])
    links.new(texture.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    export(tmp_path / "out.glb", bake(low, high))
    (part,) = glb.parts(tmp_path / "out.glb", "bent")
    assert part.material["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] == 1
    assert part.material["normalTexture"].get("texCoord", 0) == 0


def test_an_image_that_is_gone_is_named(tmp_path):
    low, high = bent_pair()
    report = bake(low, high)
    bpy.data.images.remove(bpy.data.images[report.image])
    before = snapshot.snapshot()
    with pytest.raises(BakeError, match="the normal map' was undone"):
        export(tmp_path / "out.glb", report)
    assert snapshot.difference(before, snapshot.snapshot()) == {}


SCALES = {"mirrored": (-1.0, 1.0, 1.0), "uneven": (1.5, 0.7, 1.0), "uneven and mirrored": (1.5, -0.7, 1.0)}


@pytest.mark.parametrize("scale", SCALES.values(), ids=SCALES)
def test_a_scale_that_engines_read_differently_is_applied(scale, tmp_path):
    """The file has no scale, its triangles face outwards, and its normals are those of the scene."""
    low, high = bent_pair()
    for obj in (low, high):
        obj.scale, obj.rotation_euler = scale, (0.3, 0.2, 0.1)
    truth = maps.bake(low, high, image="truth", space="OBJECT", size=(128, 128))
    report = bake(low, high, size=128)
    (done,) = export(tmp_path / "out.glb", report)
    assert (
        done.has_applied_scale and report.with_export(done.to_dict()).exported.count("the scale of bent applied") == 1
    )
    (part,) = glb.parts(tmp_path / "out.glb", "bent")
    picture, *_ = glb.texels(part.normal_map, tmp_path)
    normals, covered = glb.shown(part, picture)
    both = angles.eroded(covered & (truth[..., 3] > 0.0), 1)
    rotation = glb.rotation(tmp_path / "out.glb", "bent")
    to_scene = np.linalg.inv(np.array(low.matrix_world)[:3, :3]).T
    wanted = angles.decode(truth)[both] @ to_scene.T
    wanted /= np.linalg.norm(wanted, axis=-1, keepdims=True)
    assert np.percentile(angles.degrees(normals[both] @ rotation.T, wanted), 99) < EIGHT_BITS_P99
    assert done.measured.degrees["MIKKTSPACE"]["percentile_99"] < EIGHT_BITS_P99
    assert fronts(part) == 1.0


def fronts(part):
    """The share of the triangles of a file that wind around their own normals."""
    positions, normals = (part.attributes[name][part.indices].astype(np.float64) for name in ("POSITION", "NORMAL"))
    a, b, c = np.moveaxis(positions, 1, 0)
    return (np.einsum("ti,ti->t", np.cross(b - a, c - a), normals.mean(axis=1)) > 0.0).mean()


def test_an_even_scale_stays_on_the_object(tmp_path):
    low, high = bent_pair()
    low.scale = high.scale = (2.0, 2.0, 2.0)
    (done,) = export(tmp_path / "out.glb", bake(low, high))
    assert not done.has_applied_scale
    (part,) = glb.parts(tmp_path / "out.glb", "bent")
    assert np.ptp(part.attributes["POSITION"], axis=0).max() == pytest.approx(1.0, abs=1e-5)


def test_a_map_that_only_cycles_can_show_is_refused(tmp_path):
    """Cycles transforms the finished normal: with an uneven scale, no engine shows its map."""
    low, high = bent_pair()
    low.scale = high.scale = SCALES["uneven"]
    report = bake(low, high, basis="CYCLES")
    with pytest.raises(BakeError, match="'bent' is scaled more along one axis"):
        export(tmp_path / "out.glb", report)
    assert not list(tmp_path.iterdir())


# Steps


@pytest.mark.parametrize("ending", [".glb", ".usda", ".fbx"])
def test_the_open_file_is_the_same_at_each_step(tmp_path, ending):
    low, high = bent_pair()
    report = bake(low, high)
    before, shares = snapshot.snapshot(), []
    work = engine_files.work(bpy.context, [[report]], tmp_path / f"out{ending}")
    for step in work:
        shares.append(step.done)
        assert snapshot.difference(before, snapshot.snapshot()) == {}
        assert list(tmp_path.iterdir()) == []
    assert shares == sorted({*shares})
    assert len(shares) > 1
    assert (tmp_path / f"out{ending}").is_file()


def test_an_export_that_is_stopped_leaves_the_file_that_was_there(tmp_path):
    low, high = bent_pair()
    report, path = bake(low, high), tmp_path / "out.glb"
    path.write_bytes(b"before")
    work = engine_files.work(bpy.context, [[report]], path)
    for _ in range(2):
        next(work)
    work.close()
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]
    assert progress.finish(engine_files.work(bpy.context, [[report]], path))
    assert path.read_bytes() != b"before"


def test_what_materials_of_one_object_lack_is_told_of_that_object(tmp_path):
    low, high = bent_pair()
    other = low.copy()
    other.data = low.data.copy()
    other.name = "other"
    bpy.context.scene.collection.objects.link(other)
    for obj in (low, other):
        for number in range(2):
            scenes.material(f"{obj.name} {number}", obj)
        obj.data.polygons[0].material_index = 1
    first, second = (bake(obj, high, image=f"{obj.name} normal") for obj in (low, other))
    done = export(tmp_path / "out.glb", replace(first, slots=[0]), second)
    assert [one.warnings for one in done] == [
        ["The material slot 2 of 'bent' has no maps: bake its texture set as well."],
        [],
    ]


# Comparison


UV = np.array([[[0, 0], [1, 0], [0, 1]], [[1, 0], [1, 1], [0, 1]]], np.float32)
POSITIONS = np.concatenate([UV, np.zeros((2, 3, 1), np.float32)], axis=-1)
NORMALS = np.tile(np.float32([0, 0, 1]), (2, 3, 1))
TANGENTS = np.tile(np.float32([1, 0, 0, 1]), (2, 3, 1))
PAGES = np.zeros(2, np.int32)


def texels(vector, size=8):
    """A map of one normal."""
    return np.tile(np.float32([*(np.array(vector) * 0.5 + 0.5), 1.0]), (size, size, 1))


def baked(vector=(0, 0, 1)):
    return Baked(POSITIONS, NORMALS, TANGENTS, UV, PAGES, bases.MIKKTSPACE, lambda _page: texels(vector))


def found(**other):
    values = {"positions": POSITIONS, "normals": NORMALS, "uv": UV, "tangents": TANGENTS, "materials": PAGES}
    return FileMesh(**{**values, **other}, pictures=[b""])


def test_points_are_centers_of_texels_in_their_triangles():
    triangles, weights, uv = comparison.points(UV, 16, 16)
    assert len(triangles) > 500
    assert set(triangles.tolist()) == {0, 1}
    np.testing.assert_allclose(np.einsum("nc,nck->nk", weights, UV[triangles]), uv, atol=1e-12)
    np.testing.assert_allclose(uv * 16 % 1.0, 0.5)
    assert weights.min() >= 0.0


def test_uvs_without_area_have_no_points():
    assert len(comparison.points(np.zeros((2, 3, 2), np.float32), 16, 16)[0]) == 0


@pytest.mark.parametrize(
    ("other", "stored", "angle"),
    [
        ({}, (0, 0, 1), 0.0),
        ({}, (np.sin(0.1), 0, np.cos(0.1)), np.degrees(0.1)),
        ({"tangents": TANGENTS * np.float32([-1, 1, 1, 1])}, (0, 0, 1), 0.0),
        ({"normals": np.tile(np.float32([0, np.sin(0.2), np.cos(0.2)]), (2, 3, 1))}, (0, 0, 1), np.degrees(0.2)),
    ],
)
def test_angles_of_what_differs(other, stored, angle):
    measured = comparison.measure(baked(), found(**other), lambda _page: texels(stored))
    assert measured.degrees["MIKKTSPACE"]["median"] == pytest.approx(angle, abs=1e-3)
    assert measured.degrees["MIKKTSPACE"]["maximum"] == pytest.approx(angle, abs=1e-3)


def test_a_turned_tangent_turns_what_leans():
    lean = (0.6, 0.0, 0.8)
    turned = found(tangents=TANGENTS * np.float32([-1, 1, 1, 1]))
    measured = comparison.measure(baked(lean), turned, lambda _page: texels(lean))
    assert measured.degrees["MIKKTSPACE"]["median"] == pytest.approx(2.0 * np.degrees(np.arcsin(0.6)), abs=1e-3)


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        ({"positions": POSITIONS[:1]}, "1 triangles of 'low' where 2 were baked"),
        ({"positions": POSITIONS + 0.01}, "other triangles"),
        ({"uv": UV + 0.01}, "other UVs"),
        ({"materials": PAGES + 1}, "other materials"),
    ],
)
def test_another_surface_is_refused(other, reason):
    comparison.check_surface(baked(), found(), "low")
    with pytest.raises(BakeError, match=reason):
        comparison.check_surface(baked(), found(**other), "low")


@pytest.mark.parametrize(
    ("name", "channels", "read"),
    [
        ("three", (), (0.36, 0.48, -0.8)),
        ("unreal", (), (0.36, 0.48, 0.8)),
        ("directx", (), (0.36, 0.48, -0.8)),
        ("three", ("+X", "-Y", "+Z"), (0.36, -0.48, -0.8)),
        ("directx", ("+X", "-Y", "+Z"), (0.36, 0.48, -0.8)),
        ("unreal", ("+X", "+Y", "+Z"), (0.36, -0.48, 0.8)),
        ("three", ("+Z", "-Y", "-X"), (-0.8, -0.48, -0.36)),
    ],
)
def test_programs_read_their_green_and_make_their_z(name, channels, read):
    vector = np.array((0.36, 0.48, -0.8))
    measured = comparison.measure(
        baked(vector), found(), lambda _page: texels(vector), [targets.BY_NAME[name]], channels
    )
    angle = np.degrees(np.arccos(np.clip(vector @ read, -1.0, 1.0)))
    assert measured.targets.keys() == {name}
    assert measured.targets[name]["median"] == pytest.approx(angle, abs=1e-3)
    assert measured.degrees["MIKKTSPACE"]["median"] == pytest.approx(0.0, abs=1e-3)


def test_a_missing_normal_map_is_refused():
    with pytest.raises(BakeError, match="no normal map"):
        comparison.measure(baked(), found(), lambda _page: None)


# Frames


@pytest.mark.parametrize("basis", bases.BASES, ids=lambda basis: basis.name)
def test_each_basis_decodes_as_its_readers_do(basis):
    random = np.random.default_rng(7)
    normals = unit(random.normal(size=(500, 3, 3)) * 0.4 + [0.0, 0.0, 1.0])
    along = unit(np.cross(normals, random.normal(size=3)))
    signs = np.where(random.random(500) < 0.5, -1.0, 1.0)
    tangents = np.concatenate([along, np.broadcast_to(signs[:, None, None], (500, 3, 1))], axis=-1)
    weights = random.dirichlet(np.ones(3), 500)
    values = random.normal(size=(500, 3)) * 0.3 + [0.0, 0.0, 1.0]
    corners = (normals, tangents, decoders.bitangents(normals, tangents))
    interpolated = [np.einsum("nc,nck->nk", weights, part) for part in corners]
    expected = decoders.unit(decoders.decoded(values, basis.name, *interpolated))
    np.testing.assert_allclose(comparison.decoded(basis, values, weights, normals, tangents), expected, atol=1e-12)
