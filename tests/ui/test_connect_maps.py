# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the button that puts the maps of the last bake into the low object's material."""

import bpy
import pytest

from addon.ui.bake_results import results
from tests.support import zoo
from tests.support.panel import use
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")


@pytest.fixture
def low():
    """A low object in its slot, with a high one."""
    low, high = zoo.plane("lo"), zoo.plane("hi")
    high.location.z = 0.2
    use(low, size=16, method="CAST", material=False)
    return low


def bake(**settings):
    for name, value in settings.items():
        setattr(bpy.context.scene.imprint, name, value)
    assert bpy.ops.imprint.bake(low="lo", high=[{"name": "hi"}]) == {"FINISHED"}


def displacement(low):
    return low.active_material.node_tree.nodes["Material Output"].inputs["Displacement"]


def test_the_button_needs_a_map_that_a_material_takes(low):
    assert not bpy.ops.imprint.connect_maps.poll()
    bake(maps={"DISTANCE"})
    assert not bpy.ops.imprint.connect_maps.poll()
    bake(maps={"HEIGHT"})
    assert bpy.ops.imprint.connect_maps.poll()


def test_a_bake_leaves_the_material_to_the_button(low):
    bake(maps={"HEIGHT"})
    assert len(low.material_slots) == 0
    assert bpy.ops.imprint.connect_maps() == {"FINISHED"}
    assert displacement(low).is_linked


def test_a_shared_material_is_copied_as_the_setting_says(low):
    material = bpy.data.materials.new("Skin")
    for obj in (low, bpy.data.objects["hi"]):
        obj.data.materials.append(material)
    bake(maps={"HEIGHT"}, single_user=True)
    assert bpy.ops.imprint.connect_maps() == {"FINISHED"}
    assert low.active_material.name == "Skin.001"
    assert displacement(low).is_linked
    assert not displacement(bpy.data.objects["hi"]).is_linked


def test_an_image_that_is_gone_is_a_warning(low):
    bake(maps={"HEIGHT"})
    bpy.data.images.remove(bpy.data.images["lo_height"])
    assert bpy.ops.imprint.connect_maps() == {"FINISHED"}
    assert len(low.material_slots) == 0


@pytest.mark.parametrize("pack", ["NONE", "CUSTOM"])
def test_a_map_without_a_value_is_a_warning(low, pack):
    material = bpy.data.materials.new("Noisy")
    tree = material.node_tree
    noise = tree.nodes.new("ShaderNodeTexNoise").outputs[0]
    shader = tree.nodes["Principled BSDF"]
    for name in ("Base Color", "Metallic"):
        tree.links.new(noise, shader.inputs[name])
    bpy.data.objects["hi"].data.materials.append(material)
    bake(maps={"BASE_COLOR", "METALLIC", "ROUGHNESS"}, pack=pack, pack_red="METALLIC", connect_maps=True)
    found = low.active_material.node_tree.nodes["Principled BSDF"].inputs
    assert [name for name in ("Base Color", "Metallic", "Roughness") if found[name].is_linked] == ["Roughness"]
    (report,) = results.all_of(bpy.context)
    assert "Maps without a value are not connected: Base Color, Metallic." in report.warnings
    assert [name for name, how in report.maps.items() if how.get("empty")] == ["base_color", "metallic"]


def test_undo_takes_attributes_and_links_away_in_one_step(low):
    settings = bpy.context.scene.imprint
    settings.maps, settings.vertex_domain, settings.connect_maps = {"HEIGHT"}, "CORNER", True
    bpy.ops.ed.undo_push(message="before")
    before = snapshot()
    bpy.ops.imprint.bake("EXEC_DEFAULT", True, low="lo", high=[{"name": "hi"}])
    assert "height" in low.data.attributes
    assert displacement(low).is_linked
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert difference(before, snapshot()) == {}


def test_undo_of_the_button_leaves_the_images(low):
    bake(maps={"HEIGHT"})
    bpy.ops.ed.undo_push(message="before")
    before = snapshot()
    assert bpy.ops.imprint.connect_maps("EXEC_DEFAULT", True) == {"FINISHED"}
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert difference(before, snapshot()) == {}
    assert "lo_height" in bpy.data.images


def test_the_button_connects_each_texture_set_with_its_own_material(low):
    low.data = zoo.plane("finer", n=2).data
    low.data.materials.append(bpy.data.materials.new("First"))
    low.data.materials.append(bpy.data.materials.new("Second"))
    low.data.polygons.foreach_set("material_index", [number % 2 for number in range(len(low.data.polygons))])
    bake(maps={"HEIGHT"}, texture_sets=True)
    assert bpy.ops.imprint.connect_maps() == {"FINISHED"}
    images = []
    for name in ("First", "Second"):
        node = bpy.data.materials[name].node_tree.nodes["Material Output"].inputs["Displacement"].links[0].from_node
        images.append(node.inputs["Height"].links[0].from_node.image.name)
    assert images == ["lo_First_height", "lo_Second_height"]
