# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests bakes of a mesh onto itself, without a high object: its materials and its shape."""

import bpy
import numpy as np
import pytest

from addon import api
from addon.core import progress
from addon.core.errors import BakeError
from addon.core.progress import Pace
from addon.jobs import Job, bake_all
from addon.jobs.sequence import work_on_frames
from addon.output import datablocks
from addon.scene import object_checks
from tests.support import maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 32
OTHERS = ("AO", "BENT_NORMAL", "THICKNESS", "CURVATURE", "POSITION", "MATERIAL_ID", "BASE_COLOR", "ROUGHNESS")


def closed(name="shape"):
    """An icosphere with a dent, unwrapped, with a material whose roughness is 0.25."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3)
    obj = bpy.context.object
    obj.name = obj.data.name = name
    points = np.empty(len(obj.data.vertices) * 3, np.float32)
    obj.data.vertices.foreach_get("co", points)
    points = points.reshape(-1, 3)
    points[:, 2] -= 0.8 * np.exp(-8.0 * (points[:, 0] ** 2 + points[:, 1] ** 2)) * (points[:, 2] > 0.0)
    obj.data.vertices.foreach_set("co", points.ravel())
    material = bpy.data.materials.new("matte")
    material.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.25
    obj.data.materials.append(material)
    return obj


def test_each_map_is_that_of_a_copy_that_is_the_high_object():
    """A copy that was called _high could always be baked."""
    obj = closed()
    copy = bpy.data.objects.new("copy", obj.data)
    bpy.context.scene.collection.objects.link(copy)
    _, own = maps.bake_all_maps(obj, obj, maps=OTHERS)
    report, expected = maps.bake_all_maps(obj, copy, maps=OTHERS, method="FLATTEN")
    assert own.keys() == expected.keys() >= {name.lower() for name in OTHERS}
    for name in expected:
        np.testing.assert_array_equal(own[name], expected[name], err_msg=name)


def test_its_own_shape_is_told_in_no_warning():
    report = scenes.bake(closed(), bpy.context.object, method="AUTO", maps=("AO", "ROUGHNESS"))
    assert report.method == "FLATTEN"
    assert not [text for text in report.warnings if "flat" in text or "high object" in text]


@pytest.mark.parametrize("kinds", [("AO",), ("AO", "BENT_NORMAL")])
def test_hard_edges_without_a_seam_are_told_where_directions_are_baked(kinds):
    bpy.ops.mesh.primitive_cube_add()
    obj = bpy.context.object
    report = scenes.bake(obj, obj, method="AUTO", normal=False, maps=kinds)
    assert any("hard edges" in text for text in report.warnings) == (len(kinds) > 1)


def test_what_is_wrong_with_its_uvs_is_told_once():
    obj = closed()
    for corner in obj.data.uv_layers[0].uv:
        corner.vector[0] += 0.3
    report = scenes.bake(obj, obj, method="AUTO", maps=("AO",))
    assert len([text for text in report.warnings if "reach outside the UV tile" in text]) == 1


def test_a_normal_map_alone_that_is_flat_is_told():
    report = scenes.bake(closed(), bpy.context.object, method="AUTO")
    (warning,) = [text for text in report.warnings if "flat" in text]
    assert "neither modifiers nor materials of 'shape'" in warning


def test_a_dent_is_darker_than_the_rest():
    obj = closed()
    _, found = maps.bake_all_maps(obj, obj, maps=["AO", "POSITION"])
    ao, position = found["ao"][..., 0], found["position"]
    is_low = (position[..., 2] > 0.0) & (np.linalg.norm(position[..., :2], axis=-1) < 0.1) & (position[..., 3] > 0.0)
    assert is_low.any()
    assert ao[is_low].mean() < 0.75
    outside = position[..., 2] < -0.2
    assert ao[outside].min() > 0.99


@pytest.mark.parametrize("kind", ["MIRROR", "SOLIDIFY", "TRIANGULATE", "ARMATURE", "EDGE_SPLIT"])
def test_modifiers_count_and_the_base_mesh_gets_the_map(kind):
    obj = closed()
    obj.modifiers.new("Modifier", kind)
    assert object_checks.is_itself(obj, [obj])
    report = scenes.bake(obj, obj, method="AUTO", maps=("AO",))
    assert report.missed == 0.0
    assert report.coverage > 0.1


def test_an_object_without_uvs_is_told_what_to_press():
    obj = closed()
    obj.data.uv_layers.remove(obj.data.uv_layers[0])
    text = object_checks.problem(bpy.context, obj, [obj])
    assert text == "'shape' has no UV layer: unwrap it first."
    assert object_checks.lacks_uvs(obj)


def test_arrays_are_baked_onto_themselves():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]], float)
    triangles = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])  # a floor and a wall
    uv = np.array([[0.5, 0], [1, 0], [1, 1], [0.5, 1], [0, 1], [0, 0]], float)
    result = api.bake(api.Surface(points, triangles, uv), maps=["ao"], size=32)
    ao = result.maps["ao"][..., 0]
    assert ao[16, 17] < 0.8 < ao[16, 31]  # beside the wall, and far from it


def test_a_second_bake_is_the_same():
    """Maps in the materials that a bake reads would be read by the next one, and its detail be lost."""
    obj = closed()
    tree = obj.data.materials[0].node_tree
    image = bpy.data.images.new("bumps", SIDE, SIDE)
    image.colorspace_settings.name = "Non-Color"
    noise = np.random.default_rng(3).normal(size=(SIDE, SIDE, 3)) * 0.2 + (0.0, 0.0, 1.0)
    noise /= np.linalg.norm(noise, axis=-1, keepdims=True)
    image.pixels.foreach_set(np.dstack([noise * 0.5 + 0.5, np.ones((SIDE, SIDE))]).astype(np.float32).ravel())
    texture, normal_map = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexImage", "NormalMap"))
    texture.image = image
    tree.links.new(texture.outputs["Color"], normal_map.inputs["Color"])
    tree.links.new(normal_map.outputs["Normal"], tree.nodes["Principled BSDF"].inputs["Normal"])
    links = len(tree.links)
    first, second = (maps.bake(obj, obj, maps=("ROUGHNESS",), material=True, connect_maps=True) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert np.ptp(first[..., 0]) > 0.2
    assert len(tree.links) == links


def test_zoo_planes_keep_their_normals():
    """The identity: what a flat normal map of the mesh's own normals is."""
    plane = zoo.plane("lo", 4)
    texels = maps.bake(plane, plane)[..., :3] * 2.0 - 1.0
    assert np.abs(texels - (0.0, 0.0, 1.0)).max() < 1e-6


def test_an_empty_list_of_high_meshes_is_told():
    """A caller whose filter matched nothing must not get a flat map."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0]], float)
    with pytest.raises(api.BakeError, match="the list is empty"):
        api.bake(api.Surface(points, np.array([[0, 1, 2]]), points[:, :2]), [], size=16)


@pytest.mark.parametrize("first", [0, 1])
def test_in_an_image_of_several_only_its_own_materials_stay(first):
    """The others get the map into theirs, whichever comes first."""
    alone, low, high = closed("alone"), zoo.plane("lo"), zoo.plane("hi", 4)
    for layer, at in ((alone.data.uv_layers[0], 0.0), (low.data.uv_layers[0], 0.5)):
        for corner in layer.uv:
            corner.vector[0] = at + 0.5 * corner.vector[0]
    jobs = [Job(alone, [alone]), Job(low, [high])]
    settings = scenes.settings(method="AUTO", material=True, image="both")
    bake_all(bpy.context, [jobs[first], jobs[1 - first]], settings, share_image=True)
    assert not alone.data.materials[0].node_tree.nodes.get("Normal Map")
    assert [node.image.name for node in low.data.materials[0].node_tree.nodes if node.type == "TEX_IMAGE"] == ["both"]


def test_a_sequence_leaves_its_materials_and_maps_of_others(tmp_path):
    low, high = closed("lo"), zoo.plane("hi")
    files = {"storage": "FILE", "output": str(tmp_path / "#.png"), "depth": 8}
    settings = scenes.settings(method="FLATTEN", image="seq", material=True, **files)
    progress.finish(work_on_frames(bpy.context, Job(low, [low]), settings, [1, 2], Pace(None)))
    assert [node.type for node in low.data.materials[0].node_tree.nodes if node.type == "TEX_IMAGE"] == []
    datablocks.set_source_objects(bpy.data.images["seq"], [high.name])
    with pytest.raises(BakeError, match="holds a map of 'hi'"):
        progress.finish(work_on_frames(bpy.context, Job(low, [low]), settings, [1], Pace(None)))


def test_a_mesh_that_was_renamed_is_baked_again_into_its_image():
    obj = closed()
    first = maps.bake(obj, obj, maps=("AO",), image="texture")
    obj.name = "other"
    np.testing.assert_array_equal(maps.bake(obj, obj, maps=("AO",), image="texture"), first)


def test_a_texture_that_a_material_shows_is_not_filled():
    """The next bake could not read it any more. What a bake made may be filled again, and a node alone shows nothing."""
    obj = closed()
    tree = obj.data.materials[0].node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images.new("shape_base_color", SIDE, SIDE)
    texture.image.pixels.foreach_set(np.full(4 * SIDE * SIDE, 0.25, np.float32))
    link = tree.links.new(texture.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    with pytest.raises(
        BakeError, match="material 'matte' of 'shape' shows the image 'shape_base_color', which this bake"
    ):
        scenes.bake(obj, obj, method="AUTO", normal=False, maps=("BASE_COLOR",))
    assert texture.image.pixels[0] == pytest.approx(0.25, abs=1 / 255)
    report = scenes.bake(obj, obj, method="AUTO", normal=False, maps=("BASE_COLOR",), image="baked")
    first = np.array(bpy.data.images[report.maps["base_color"]["image"]].pixels)
    texture.image = bpy.data.images[report.maps["base_color"]["image"]]
    report = scenes.bake(obj, obj, method="AUTO", normal=False, maps=("BASE_COLOR",), image="baked")
    assert any("Base Color shows a map that Imprint has baked" in text for text in report.warnings)
    np.testing.assert_allclose(
        np.array(bpy.data.images[report.maps["base_color"]["image"]].pixels), first, atol=1 / 255
    )
    texture.image = bpy.data.images["shape_base_color"]
    tree.links.remove(link)
    scenes.bake(obj, obj, method="AUTO", normal=False, maps=("BASE_COLOR",))


def twins():
    """Two objects of one mesh, side by side."""
    obj = closed("left")
    twin = bpy.data.objects.new("right", obj.data)
    twin.location.x = 4.0
    bpy.context.scene.collection.objects.link(twin)
    return obj, twin


def test_objects_that_share_a_mesh_get_a_map_each():
    settings = scenes.settings(method="AUTO", normal=False, maps=("AO", "POSITION"), space="WORLD")
    reports = bake_all(bpy.context, [Job(obj, [obj]) for obj in twins()], settings)
    ao, position = (
        [np.array(bpy.data.images[report.maps[name]["image"]].pixels) for report in reports]
        for name in ("ao", "position")
    )
    np.testing.assert_array_equal(*ao)
    assert not [text for report in reports for text in report.warnings if "overlap" in text]


def test_objects_that_share_a_mesh_and_an_image_are_told():
    settings = scenes.settings(method="AUTO", normal=False, maps=("AO",), image="both")
    reports = bake_all(bpy.context, [Job(obj, [obj]) for obj in twins()], settings, share_image=True)
    (warning,) = [text for text in reports[1].warnings if "overlap" in text]
    assert "of 'right' overlap texels of 'left', which have the same mesh: make it a single user and pack" in warning


def test_materials_on_the_same_texels_are_named():
    """Each face of a cube fills the map, as after Blender's Reset."""
    bpy.ops.mesh.primitive_cube_add()
    obj = bpy.context.object
    obj.name = "box"
    for name, color in (("red", (1.0, 0.0, 0.0, 1.0)), ("blue", (0.0, 0.0, 1.0, 1.0))):
        obj.data.materials.append(bpy.data.materials.new(name))
        obj.data.materials[-1].node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = color
    for polygon in obj.data.polygons:
        polygon.material_index = polygon.index % 2
        for corner, place in zip(polygon.loop_indices, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
            obj.data.uv_layers[0].uv[corner].vector = place
    report = scenes.bake(obj, obj, method="AUTO", maps=("BASE_COLOR",))
    (warning,) = [text for text in report.warnings if "belong to faces of different materials" in text]
    assert "('red', 'blue')" in warning
    assert "Unwrap gives each face a place of its own" in warning


@pytest.mark.parametrize(("socket", "value"), [("Transmission Weight", 1.0), ("Alpha", 0.0)])
def test_glass_and_what_is_invisible_have_the_shape_of_the_mesh(socket, value):
    """Its own occlusion is that of the same mesh of another material: nothing of it is cut out."""
    obj = closed()
    kinds = ("AO", "THICKNESS", "POSITION")
    _, expected = maps.bake_all_maps(obj, obj, maps=kinds)
    obj.data.materials[0].node_tree.nodes["Principled BSDF"].inputs[socket].default_value = value
    _, found = maps.bake_all_maps(obj, obj, maps=kinds)
    for name in expected:
        np.testing.assert_array_equal(found[name], expected[name], err_msg=name)
