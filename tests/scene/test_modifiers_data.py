# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that materials and UV maps are those of the mesh with its modifiers, which may make and change them."""

import bpy
import numpy as np
import pytest

from addon.core.settings import Settings
from addon.jobs import Job, bake_all, temporary
from addon.jobs.simplify.decimation import read_original
from addon.scene import dependencies
from tests.support import geometry_nodes, scenes, zoo

RED, BLUE = (0.5, 0.1, 0.05), (0.02, 0.02, 0.4)
EXACT = 1e-6
"""Constants of materials are not rounded in float maps."""
pytestmark = pytest.mark.usefixtures("gpu_context")


def painted(name, color):
    return scenes.material(name, Base_Color=color)


def share(report, color):
    """The share of the covered texels of the map of base color that have a color."""
    image = bpy.data.images[report.maps["base_color"]["image"]]
    texels = np.array(image.pixels[:]).reshape(-1, 4)
    texels = texels[texels[:, 3] > 0.0, :3]
    return float((np.abs(texels - color).max(axis=1) < EXACT).mean())


def all_faces(high):
    geometry_nodes.set_material(high, painted("red", RED))
    return 1.0


def half_of_the_faces(high):
    geometry_nodes.set_material(high, painted("red", RED), first=2)
    return 0.5


def joined_parts(high):
    """The right half belongs to another object with materials of its own, of which it uses the second."""
    part = zoo.plane("part", 2)
    part.data.materials.append(painted("green", (0.0, 0.3, 0.0)))
    part.data.materials.append(painted("red", RED))
    part.data.polygons.foreach_set("material_index", [1] * 4)
    part.location.x = 1.0
    tree = geometry_nodes.Tree(high)
    shown = tree.add("GeometryNodeObjectInfo", {"Object": part}, transform_space="RELATIVE").node.outputs["Geometry"]
    raised = tree.add("GeometryNodeTransform", {"Geometry": shown, "Translation": (0.0, 0.0, 0.04)})
    tree.end(tree.add("GeometryNodeJoinGeometry", {"Geometry": [raised, tree.geometry]}))
    bpy.context.scene.collection.objects.unlink(part)
    return 0.5


def of_a_boolean(high):
    """The operand gives its material to its faces: a box that covers the right half."""
    bpy.ops.mesh.primitive_cube_add(size=2.0, location=(1.0, 0.0, -0.9))
    box = bpy.context.object
    box.data.materials.append(painted("red", RED))
    box.scale = (1.0, 2.0, 1.0)
    boolean = high.modifiers.new("Boolean", "BOOLEAN")
    boolean.object, boolean.operation, boolean.material_mode, boolean.solver = box, "UNION", "TRANSFER", "EXACT"
    bpy.context.scene.collection.objects.unlink(box)
    return 0.5


def in_a_slot_of_the_object(high):
    """The first slot belongs to the object, and the nodes add a second one."""
    high.data.materials.append(None)
    high.material_slots[0].link = "OBJECT"
    high.material_slots[0].material = painted("red", RED)
    geometry_nodes.set_material(high, painted("blue", BLUE), first=2)
    return 0.5


@pytest.mark.parametrize(
    ("make", "has_own", "method"),
    [
        (all_faces, False, "CAST"),
        (all_faces, True, "FLATTEN"),
        (half_of_the_faces, False, "FLATTEN"),
        (half_of_the_faces, True, "CAST"),
        (joined_parts, False, "CAST"),
        (joined_parts, True, "CAST"),
        (of_a_boolean, False, "CAST"),
        (of_a_boolean, True, "CAST"),
        (in_a_slot_of_the_object, False, "CAST"),
    ],
)
def test_materials_of_modifiers_are_baked(make, has_own, method):
    low, high = scenes.planes("low", "high", height=0.02, n=2)
    if has_own:
        high.data.materials.append(painted("own", BLUE))
    expected = make(high)
    report = scenes.bake(low, high, method=method, size=16, maps=("BASE_COLOR",), extrusion=0.3)
    assert share(report, RED) == pytest.approx(expected, abs=0.05)  # a column of 16 at the border


def test_instances_show_the_materials_of_nodes():
    low, high = scenes.planes("low", "high", height=0.02, n=1)
    tree = geometry_nodes.Tree(high)
    point = tree.add("GeometryNodeMeshLine", {"Count": 1})
    grid = tree.add("GeometryNodeMeshGrid", {"Size X": 2.0, "Size Y": 2.0})
    shown = tree.add("GeometryNodeSetMaterial", {"Geometry": grid, "Material": painted("red", RED)})
    tree.end(tree.add("GeometryNodeInstanceOnPoints", {"Points": point, "Instance": shown}))
    report = scenes.bake(low, high, method="CAST", size=16, maps=("BASE_COLOR",))
    assert share(report, RED) == 1.0


def test_a_bake_reads_the_images_of_materials_that_nodes_set(tmp_path):
    low, high = scenes.planes("low", "high", n=2)
    path = scenes.image_file(tmp_path / "bark.png")
    shown = scenes.material("bark")
    node = scenes.texture(shown, bpy.data.images.load(str(path)))
    scenes.set_inputs(shown, Base_Color=node.outputs["Color"])
    geometry_nodes.set_material(high, shown)
    assert str(path) in {each.path for each in dependencies.of([low], [high])}
    assert str(path) in {each.path for each in dependencies.not_to_replace([(low, [high], [])])}


def test_a_map_of_an_earlier_bake_in_a_material_that_nodes_set_may_be_replaced(tmp_path):
    low, high = scenes.planes("low", "high", height=0.02, n=2)
    shown = scenes.material("shared", high)
    geometry_nodes.set_material(low, shown)
    path = tmp_path / "map.png"
    for _ in range(2):
        report = scenes.bake(
            low, high, method="CAST", size=16, storage="FILE", output=str(path), material=True, depth=8
        )
    assert [node.image.name for node in shown.node_tree.nodes if node.type == "TEX_IMAGE"] == [report.image]


def test_texture_sets_are_those_of_the_modifiers():
    low, high = scenes.planes("low", "high", height=0.02, n=2)
    low = zoo.plane("parts", 2)
    own, other = painted("own", BLUE), painted("red", RED)
    low.data.materials.append(own)
    geometry_nodes.set_material(low, other, first=2)
    settings = Settings(width=16, height=16, method="CAST", texture_sets=True)
    reports = bake_all(bpy.context, [Job(low, [high])], settings)
    assert [report.material for report in reports] == ["own", "red"]
    for report, material in zip(reports, (own, other), strict=True):
        assert report.coverage == pytest.approx(0.5, abs=0.05)
        nodes = material.node_tree.nodes
        assert [node.image.name for node in nodes if node.type == "TEX_IMAGE"] == [report.image]


def test_the_map_is_shown_by_the_material_that_is_seen():
    low, high = scenes.planes("low", "high", height=0.02, n=2)
    seen = painted("seen", RED)
    geometry_nodes.set_material(low, seen)
    report = scenes.bake(low, high, method="CAST", size=16, material=True)
    assert [node.image.name for node in seen.node_tree.nodes if node.type == "TEX_IMAGE"] == [report.image]
    assert not low.data.materials
    assert len(bpy.data.materials) == 1


@pytest.mark.parametrize("method", ["AUTO", "CAST", "FLATTEN"])
@pytest.mark.parametrize("who", ["low", "high"])
def test_the_only_uv_map_may_be_made_by_modifiers(who, method):
    low, high = zoo.plane("low", 4), zoo.terrain("high", 16, height=0.05)
    made = {"low": low, "high": high}[who]
    expected = scenes.bake(low, high, method=method, size=16)
    before = np.array(bpy.data.images[expected.image].pixels[:])
    made.data.uv_layers.remove(made.data.uv_layers[0])
    geometry_nodes.uv_from_above(made, "UVMap" if made is low else "of nodes")
    report = scenes.bake(low, high, method=method, size=16)
    assert (report.uv_layer, report.method) == (expected.uv_layer, expected.method)
    assert np.allclose(np.array(bpy.data.images[report.image].pixels[:]), before, rtol=0, atol=1e-4)  # UVs are rounded


def test_levels_of_a_mesh_whose_uv_map_modifiers_make():
    obj = zoo.plane("low", 4)
    obj.data.uv_layers.remove(obj.data.uv_layers[0])
    geometry_nodes.uv_from_above(obj, "made")
    with temporary.meshes():
        assert read_original(bpy.context, obj, "", "RENDER").layer == "made"
