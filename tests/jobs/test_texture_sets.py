# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests texture sets: an image for each material of the low mesh."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import Job, bake_all
from tests.support import scenes, zoo

POINTS = np.array([(x, y, 0.0) for y in (0.1, 0.9) for x in (0.1, 0.5, 0.9)])
COLORS = {"Red": (1.0, 0.0, 0.0), "Green": (0.0, 1.0, 0.0)}
SIZE = 64
pytestmark = pytest.mark.usefixtures("gpu_context")


@pytest.fixture
def pair():
    """A cube with two materials, each of which fills the UVs from 0 to 1, and a copy of it with colors."""
    bpy.ops.mesh.primitive_cube_add(size=2.0)
    low = bpy.context.object
    low.name = "lo"
    for name, color in COLORS.items():
        material = bpy.data.materials.new(name)
        material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (*color, 1.0)
        low.data.materials.append(material)
    for face in low.data.polygons:
        face.material_index = face.index % 2
        for corner, place in zip(face.loop_indices, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
            u, v = 0.05 + 0.9 * np.array(place)
            low.data.uv_layers[0].uv[corner].vector = ((face.index // 2 + u) / 3.0, v)
    high = low.copy()
    high.data, high.name = low.data.copy(), "hi"
    bpy.context.collection.objects.link(high)
    return low, high


def bake(low, high, **settings):
    settings = {"texture_sets": True, "width": SIZE, "height": SIZE, "maps": ("BASE_COLOR",), **settings}
    return bake_all(bpy.context, [Job(low, [high])], Settings(**settings))


@pytest.mark.parametrize("method", ["AUTO", "FLATTEN", "CAST"])
def test_each_material_has_its_own_images_and_nodes(pair, method):
    reports = bake(*pair, method=method)
    assert [(report.material, *report.slots) for report in reports] == [
        (name, number) for number, name in enumerate(COLORS)
    ]
    for report, color in zip(reports, COLORS.values(), strict=True):
        image = bpy.data.images[report.maps["base_color"]["image"]]
        assert (image.name, report.image) == (f"lo_{report.material}_base_color", f"lo_{report.material}_normal")
        texels = np.array(image.pixels).reshape(SIZE, SIZE, 4)
        assert np.allclose(texels[texels[..., 3] > 0.0][:, :3], color, rtol=0, atol=1e-6)
        # Three faces fill a share of 0.9^2 each.
        assert report.coverage == pytest.approx(0.81, abs=0.03)
        assert report.checks["overlap"]["count"] == 0
        nodes = bpy.data.materials[report.material].node_tree.nodes
        assert [node.image.name for node in nodes if node.bl_idname == "ShaderNodeTexImage"] == [report.image]


def test_normals_of_a_set_equal_those_of_a_bake_of_that_material_alone(pair):
    low, high = pair
    whole = bake(low, high, method="CAST", maps=(), texture_sets=True)[1]
    texels = np.array(bpy.data.images[whole.image].pixels)
    import bmesh  # available only after bpy is imported

    for mesh in (low.data, high.data):
        edited = bmesh.new()
        edited.from_mesh(mesh)
        others = [face for face in edited.faces if face.material_index == 0]
        bmesh.ops.delete(edited, geom=others, context="FACES")
        edited.to_mesh(mesh)
        edited.free()
    alone = bake(low, high, method="CAST", maps=(), texture_sets=False, image="alone")[0]
    assert np.allclose(np.array(bpy.data.images[alone.image].pixels), texels, rtol=0, atol=2e-5)


def test_files_are_named_by_material(pair, tmp_path):
    bake(*pair, storage="FILE", output=str(tmp_path / "{low}_{material}.png"))
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        f"lo_{name}{ending}.png" for name in COLORS for ending in ("", "_base_color")
    )


def test_a_file_without_material_in_its_name_is_refused(pair, tmp_path):
    with pytest.raises(BakeError, match=r"\{material\} in the name of the file"):
        bake(*pair, storage="FILE", output=str(tmp_path / "map.png"))
    assert list(tmp_path.iterdir()) == []


def test_an_image_without_material_in_its_name_is_refused(pair, tmp_path):
    with pytest.raises(BakeError, match=r"\{material\} in the name of the image"):
        bake(*pair, image="one")
    with pytest.raises(BakeError, match=r"\{material\} in the name of the image"):
        bake(*pair, image="one", storage="FILE", output=str(tmp_path / "{material}.png"))
    assert not bpy.data.images


def test_faces_of_a_slot_that_is_gone_are_in_the_set_of_the_last_one(pair):
    low, high = pair
    low.data.polygons.foreach_set("material_index", [0, 7, 0, 7, 0, 7])
    reports = bake(low, high)
    assert [report.material for report in reports] == list(COLORS)
    for report in reports:
        assert report.coverage == pytest.approx(0.81, abs=0.03)


def test_material_in_a_name_needs_texture_sets(pair, tmp_path):
    with pytest.raises(BakeError, match="Texture Sets is off"):
        bake(*pair, texture_sets=False, storage="FILE", output=str(tmp_path / "{material}.png"))


def test_faces_without_a_material_are_a_set_too(pair):
    low, high = pair
    low.data.materials[1] = None
    reports = bake(low, high)
    assert [report.material for report in reports] == ["Red", "none"]
    assert low.material_slots[1].material is not None


def test_a_second_bake_does_not_count_the_first_map_as_detail(pair):
    first = [np.array(bpy.data.images[report.image].pixels) for report in bake(*pair)]
    for report, before in zip(bake(*pair), first, strict=True):
        assert np.array_equal(np.array(bpy.data.images[report.image].pixels), before)


@pytest.mark.parametrize("domain", ["CORNER", "POINT"])
def test_each_set_stores_its_own_faces_in_the_attributes(pair, domain):
    low, _ = pair
    reports = bake(*pair, vertex_domain=domain)
    assert [report.attributes["base_color"] for report in reports] == ["base_color"] * 2
    assert not [warning for report in reports for warning in report.warnings if "known texel" in warning]
    attribute = low.data.attributes["base_color"]
    found = np.empty(len(attribute.data) * 4, np.float32)
    attribute.data.foreach_get("color", found)
    found = found.reshape(-1, 4)[:, :3]
    green = COLORS["Green"]
    if domain == "POINT":  # each vertex is on faces of both materials, and the last set is on top
        np.testing.assert_allclose(found, np.broadcast_to(green, found.shape), atol=1e-5)
        return
    for face in low.data.polygons:
        expected = list(COLORS.values())[face.material_index]
        np.testing.assert_allclose(found[list(face.loop_indices)], [expected] * 4, atol=1e-5)


def test_a_set_leaves_vertices_of_another_set_as_they_are():
    """Of two squares side by side, the middle vertices alone are of both sets, and the last one is on top."""
    faces = np.array([(0, 1, 4, 3), (1, 2, 5, 4)])
    low, high = (zoo.build(name, POINTS, faces, POINTS[faces, :2]) for name in ("lo", "hi"))
    for obj in (low, high):
        for name, color in COLORS.items():
            scenes.material(name, obj, Base_Color=(*color, 1.0))
        obj.data.polygons[1].material_index = 1
    reports = bake(low, high, vertex_domain="POINT", width=16, height=16)
    assert [report.material for report in reports] == ["Red", "Green"]
    found = np.empty(6 * 4, np.float32)
    low.data.attributes["base_color"].data.foreach_get("color", found)
    wanted = [COLORS[name] for name in ("Red", "Green", "Green") * 2]
    np.testing.assert_allclose(found.reshape(6, 4)[:, :3], wanted, atol=1e-5)


def test_connected_maps_of_a_set_stay_in_its_material(pair):
    reports = bake(*pair, connect_maps=True)
    for report in reports:
        principled = bpy.data.materials[report.material].node_tree.nodes["Principled BSDF"]
        texture = principled.inputs["Base Color"].links[0].from_node
        assert texture.image.name == report.maps["base_color"]["image"]
