# SPDX-License-Identifier: GPL-3.0-or-later
"""Exports skinned low meshes and shape keys: in a .glb read by the specification, and in other files by Blender's importers."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from addon.core.settings import Settings
from addon.export import engine_files
from addon.jobs import bake_pair
from tests.support import glb, scenes, snapshot, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

EIGHT_BITS_P99 = 0.35
"""Degrees, as in test_glb."""


def surface(height):
    return lambda u, v: np.stack([u, v, 0.3 * np.sin(3 * u) * np.cos(5 * v) + height * np.sin(40 * u)], axis=1)


def character(*, keys=("smile", "frown"), turned=False):
    """A low sheet with two bones and shape keys, and its high one. turned: whether mesh and armature are elsewhere."""
    low, high = zoo.sheet("body", surface(0.0), 6, 8), zoo.sheet("fine", surface(0.004), 96, 96)
    data = bpy.data.armatures.new("bones")
    rig = scenes.link(bpy.data.objects.new("rig", data))
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for name, tail, is_deforming in (("root", 0.5, True), ("tip", 1.0, True), ("control", 2.0, False)):
        bone = data.edit_bones.new(name)
        bone.head, bone.tail = (0.5, tail - 0.5, 0.0), (0.5, tail, 0.0)
        bone.use_deform = is_deforming
        bone.parent = data.edit_bones.get("root") if name == "tip" else None
    bpy.ops.object.mode_set(mode="OBJECT")
    points = np.array([vertex.co for vertex in low.data.vertices])
    shares = np.clip(points[:, 1], 0.0, 1.0)
    scenes.weigh(low, "root", 1.0 - shares)
    scenes.weigh(low, "tip", shares)
    low.modifiers.new("Armature", "ARMATURE").object = rig
    for number, name in enumerate(keys):
        if number == 0:
            low.shape_key_add(name="Basis")
        key = low.shape_key_add(name=name)
        moved = points + (number + 1) * np.stack([0 * shares, 0 * shares, 0.2 * np.sin(4 * points[:, 0])], axis=1)
        key.points.foreach_set("co", moved.astype(np.float32).reshape(-1))
        key.value = 0.0
    if turned:
        rig.matrix_world = Matrix.LocRotScale((1, 2, 3), Matrix.Rotation(0.4, 3, "X").to_quaternion(), (0.5,) * 3)
        for obj in (low, high):
            obj.matrix_world = Matrix.LocRotScale((3, 1, 0), Matrix.Rotation(0.7, 3, "Z").to_quaternion(), (2,) * 3)
    return low, high, rig


def bake(low, high, size=64):
    values = {"method": "FLATTEN", "depth": 16, "storage": "PACK", "basis": "MIKKTSPACE", "material": False}
    return bake_pair(bpy.context, low, [high], Settings(image="map", width=size, height=size, **values))


def export(path, report):
    (done,) = engine_files.export_files(bpy.context, [[report]], path)
    return done


def skinned(path, name):
    """What a .glb has of a skinned mesh, by the specification: the tree, the attributes of its vertices, their weights by bone,
    and the offsets of positions and normals by target."""
    tree, binary = glb.parse(path)
    (node,) = (node for node in tree["nodes"] if node["name"] == name and "mesh" in node)
    mesh = tree["meshes"][node["mesh"]]
    (primitive,) = mesh["primitives"]
    found = {key: glb.values(tree, binary, number) for key, number in primitive["attributes"].items()}
    bones = (
        [tree["nodes"][number]["name"] for number in tree["skins"][node["skin"]]["joints"]] if "skin" in node else []
    )
    weights = {
        bone: np.where(found["JOINTS_0"] == number, found["WEIGHTS_0"], 0.0).sum(axis=1)
        for number, bone in enumerate(bones)
    }
    targets = [
        {key: glb.values(tree, binary, number) for key, number in target.items()}
        for target in primitive.get("targets", ())
    ]
    return tree, found, weights, dict(zip(mesh.get("extras", {}).get("targetNames", ()), targets, strict=True))


def z_up(values):
    return np.stack([values[:, 0], -values[:, 2], values[:, 1]], axis=1)


@pytest.mark.parametrize("turned", [False, True])
def test_a_glb_has_the_bones_weights_and_shape_keys(tmp_path, turned):
    low, high, _ = character(turned=turned)
    before = snapshot.snapshot()
    done = export(tmp_path / "out.glb", bake(low, high))
    bpy.data.images.remove(bpy.data.images["map"])
    assert snapshot.difference(before, snapshot.snapshot()) == {}
    assert done.warnings == []
    assert done.measured.degrees["MIKKTSPACE"]["percentile_99"] < EIGHT_BITS_P99
    _, found, weights, targets = skinned(tmp_path / "out.glb", "body")
    assert set(weights) == {"root", "tip"}
    to_scene = np.array(low.matrix_world)
    own = np.linalg.inv(to_scene) @ np.c_[z_up(found["POSITION"]), np.ones(len(found["POSITION"]))].T
    np.testing.assert_allclose(weights["tip"], np.clip(own[1], 0.0, 1.0), atol=1e-5)
    np.testing.assert_allclose(weights["root"] + weights["tip"], 1.0, atol=1e-5)
    assert list(targets) == ["smile", "frown"]
    for number, target in enumerate(targets.values()):
        offset = z_up(target["POSITION"]) @ np.linalg.inv(to_scene[:3, :3]).T
        np.testing.assert_allclose(offset[:, 2], (number + 1) * 0.2 * np.sin(4 * own[0]), atol=1e-5)
        np.testing.assert_allclose(offset[:, :2], 0.0, atol=1e-5)


@pytest.mark.parametrize("turned", [False, True])
def test_normals_of_a_pose_are_those_of_the_posed_mesh(tmp_path, turned):
    """The file's normals, moved as an engine does by weights and targets, against those of Blender's posed low mesh."""
    low, high, rig = character(turned=turned)
    low.data.polygons.foreach_set("use_smooth", np.ones(len(low.data.polygons), bool))
    edges = np.zeros(len(low.data.edges), bool)
    edges[::7] = True
    low.data.edges.foreach_set("use_edge_sharp", edges)
    export(tmp_path / "out.glb", bake(low, high))
    _, found, _, targets = skinned(tmp_path / "out.glb", "body")
    key = low.data.shape_keys.key_blocks["frown"]
    key.value = 1.0
    low.modifiers["Armature"].show_viewport = False
    evaluated = low.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    to_scene = np.array(low.matrix_world)[:3, :3]
    normals = (
        np.array([corner.vector for corner in evaluated.corner_normals]) @ to_scene.T / np.linalg.norm(to_scene[0])
    )
    points = np.array([low.matrix_world @ vertex.co for vertex in evaluated.vertices])
    corners = np.array([loop.vertex_index for loop in evaluated.loops])
    moved = found["NORMAL"] + targets["frown"]["NORMAL"]
    place = z_up(found["POSITION"] + targets["frown"]["POSITION"])
    nearest = np.linalg.norm(points[corners][None] - place[:, None], axis=-1)
    away = np.linalg.norm(normals[None] - z_up(moved)[:, None], axis=-1)
    assert nearest.min(axis=1).max() < 1e-5
    assert np.where(nearest < 1e-5, away, 9.0).min(axis=1).max() < 1e-3


def test_a_pose_is_told_and_the_file_is_at_rest(tmp_path):
    low, high, rig = character()
    report = bake(low, high)
    export(tmp_path / "rest.glb", report)
    rig.pose.bones["tip"].rotation_euler = (0.0, 0.0, 0.0)
    rig.pose.bones["tip"].location = (0.0, 0.0, 0.5)
    low.data.shape_keys.key_blocks["smile"].value = 1.0
    done = export(tmp_path / "posed.glb", report)
    assert any("'body' is posed" in warning for warning in done.warnings)
    (tree, rest, *_), (other, posed, *_) = (skinned(tmp_path / f"{name}.glb", "body") for name in ("rest", "posed"))
    np.testing.assert_allclose(posed["POSITION"], rest["POSITION"], atol=1e-6)
    assert tree["nodes"] == other["nodes"]
    assert tree["meshes"][0].get("weights", [0, 0]) == other["meshes"][0].get("weights", [0, 0]) == [0, 0]


def test_a_modifier_that_keeps_the_points_keeps_the_keys(tmp_path):
    low, high, _ = character()
    modifier = low.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = modifier.render_levels = 1
    low.modifiers.move(1, 0)
    done = export(tmp_path / "out.glb", bake(low, high))
    assert done.triangles == 4 * 48 * 2
    _, found, weights, targets = skinned(tmp_path / "out.glb", "body")
    np.testing.assert_allclose(weights["root"] + weights["tip"], 1.0, atol=1e-5)
    assert len(np.unique(np.round(weights["tip"], 4))) > 9  # subdivided ones lie between those of the base mesh
    assert np.abs(targets["frown"]["POSITION"]).max() > 0.3


def test_keys_that_a_modifier_makes_another_mesh_of_are_named(tmp_path):
    low, high, _ = character(keys=("flat",))
    low.data.shape_keys.key_blocks["flat"].points.foreach_set("co", np.zeros(3 * len(low.data.vertices), np.float32))
    low.modifiers.new("Weld", "WELD").merge_threshold = 1e-4
    low.modifiers.move(1, 0)
    done = export(tmp_path / "out.glb", bake(low, high))
    assert any("makes another mesh of 'flat'" in warning for warning in done.warnings)


def test_an_uneven_armature_is_left_out_and_told(tmp_path):
    low, high, rig = character()
    rig.scale = (1.0, 2.0, 1.0)
    done = export(tmp_path / "out.glb", bake(low, high))
    assert any("The armature 'rig' is mirrored" in warning for warning in done.warnings)
    tree, *_ = skinned(tmp_path / "out.glb", "body")
    assert "skins" not in tree


def test_a_mirrored_low_keeps_its_shape_keys(tmp_path):
    low, high, _ = character()
    low.modifiers.clear()
    low.scale = high.scale = (-1.0, 1.0, 1.0)
    export(tmp_path / "out.glb", bake(low, high))
    _, found, _, targets = skinned(tmp_path / "out.glb", "body")
    rotation = glb.rotation(tmp_path / "out.glb", "body")
    own = z_up(found["POSITION"]) @ rotation.T
    assert own[:, 0].max() < 1e-6
    np.testing.assert_allclose(
        (z_up(targets["smile"]["POSITION"]) @ rotation.T)[:, 2], 0.2 * np.sin(-4 * own[:, 0]), atol=1e-5
    )
    lengths = np.linalg.norm(found["NORMAL"] + targets["smile"]["NORMAL"], axis=1)
    np.testing.assert_allclose(lengths, 1.0, atol=1e-3)


@pytest.mark.parametrize("ending", [".usda", ".fbx"])
@pytest.mark.parametrize("turned", [False, True])
def test_other_files_have_bones_weights_and_shape_keys(tmp_path, ending, turned):
    low, high, rig = character(turned=turned)
    bpy.context.view_layer.update()
    own = np.array([low.matrix_world @ vertex.co for vertex in low.data.vertices])
    done = export(tmp_path / f"out{ending}", bake(low, high))
    assert done.measured.degrees["MIKKTSPACE"]["percentile_99"] < 2.5  # the tangents of triangles, not of quads
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if ending == ".fbx":
        bpy.ops.wm.fbx_import(filepath=str(tmp_path / "out.fbx"))
    else:
        bpy.ops.wm.usd_import(filepath=str(tmp_path / "out.usda"))
    (obj,) = (obj for obj in bpy.data.objects if obj.type == "MESH" and obj.name.startswith("body"))
    (found,) = (obj for obj in bpy.data.objects if obj.type == "ARMATURE")
    assert {bone.name for bone in found.data.bones} >= {"root", "tip"}
    assert "control" not in found.data.bones
    assert [key.name for key in obj.data.shape_keys.key_blocks[1:]] == ["smile", "frown"]
    weights = np.zeros(len(obj.data.vertices))
    for vertex in obj.data.vertices:
        weights[vertex.index] = sum(one.weight for one in vertex.groups if obj.vertex_groups[one.group].name == "tip")
    bpy.context.view_layer.update()
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    places = np.array([obj.matrix_world @ vertex.co for vertex in evaluated.data.vertices])
    near = np.linalg.norm(own[:, None] - places[None], axis=-1)
    assert near.min(axis=1).max() < 1e-4
    expected = np.linspace(0.0, 1.0, 9)
    np.testing.assert_allclose(np.unique(np.round(weights, 5)), expected, atol=1e-4)
