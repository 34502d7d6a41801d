# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel Maps: a switch for each map, the settings of those that are chosen, and the names of the images."""

import bpy
import pytest

from addon.core import map_types
from addon.ui import bake_results, declared_properties
from tests.support import zoo
from tests.support.panel import use
from tests.support.panel_layout import draw

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")


@pytest.fixture
def settings():
    """The settings of the scene, with a low and a high object in the slots, and small maps."""
    low, high = zoo.plane("lo", 2), zoo.plane("hi", 2)
    high.location.z = 0.2
    return use(low, high, size=16, method="CAST", material=False)


def test_a_switch_adds_and_removes_its_map(settings):
    for name in map_types.NAMES:
        settings.maps = {"POSITION", "AO"} - {name}
        for is_on in (True, False):
            setattr(settings, declared_properties.map_switch(name), is_on)
            assert settings.maps == {"POSITION", "AO"} - {name} | ({name} if is_on else set())
            assert getattr(settings, declared_properties.map_switch(name)) == is_on


def test_adaptive_samples_look_off_where_they_have_no_effect(settings):
    settings.samples = "16"
    assert "adaptive" not in draw().dim
    settings.maps = {"AO"}
    assert "adaptive" in draw().dim
    settings.maps = set()
    settings.samples = "1"
    assert "adaptive" in draw().dim
    settings.samples, settings.method = "16", "FLATTEN"
    assert "adaptive" in draw().dim
    settings.method = "CAST"
    material = bpy.data.materials.new("own normals")
    material.use_nodes = True
    material.node_tree.nodes.new("ShaderNodeNormalMap")
    bpy.data.objects["hi"].data.materials.append(material)
    assert "adaptive" in draw().dim
    settings.detail_maps = False
    assert "adaptive" not in draw().dim


@pytest.mark.parametrize(
    ("family", "reach", "limited"),
    [
        ("AO", "ao_distance", "ao_limited"),
        ("THICKNESS", "thickness_distance", "thickness_limited"),
        ("CURVATURE", "curvature_radius", "curvature_limited"),
    ],
)
def test_a_distance_in_scene_units_is_a_length(settings, family, reach, limited):
    settings.maps = {family}
    setattr(settings, limited, True)
    setattr(settings, reach, 0.25)
    length = declared_properties.length_name(reach)
    assert reach in draw().properties
    settings.distance_unit = "SCENE"
    drawn = draw()
    assert length in drawn.properties
    assert reach not in drawn.properties
    assert settings.bl_rna.properties[length].unit == "LENGTH"
    assert settings.bl_rna.properties[reach].unit == "NONE"
    assert getattr(settings, length) == 0.25
    setattr(settings, length, 0.5)
    assert settings.to_settings().flat()[reach] == 0.5


def test_the_panel_names_all_images(settings):
    settings.maps, settings.pack, settings.mask = {"AO", "BASE_COLOR"}, "GLTF", True
    drawn = draw()
    assert "into a new image 'lo_normal'." in drawn.text
    assert "Images of this bake: 5" in drawn.labels
    for name in ("lo_normal", "lo_missed", "lo_ao", "lo_base_color", "lo_orm"):
        assert name in drawn.labels
        assert drawn.icons[drawn.labels.index(name)] == "IMAGE_DATA"
    bpy.data.images.new("lo_ao", 4, 4)
    drawn = draw()
    assert drawn.icons[drawn.labels.index("lo_ao")] == "FILE_REFRESH"
    settings.storage, settings.output = "FILE", "maps/{low}.png"
    drawn = draw(width=2000)
    assert {"maps/", "lo_ao.png", "lo_normal (lo.png)"} <= set(drawn.labels)
    assert "to the file 'maps/lo.png'." in drawn.text


def test_a_bake_takes_the_settings_of_its_arguments():
    low, high = zoo.plane("lo"), zoo.plane("hi")
    high.location.z = 0.2
    arguments = {
        "maps": {"AO", "THICKNESS"},
        "normal": False,
        "rays": 16,
        "distance_unit": "SCENE",
        "ao_distance": 0.5,
        "ao_fade": "SMOOTH",
        "occluders": "ALL",
        "floor": True,
        "two_sided": True,
        "bias_angle": 10,
        "thickness_distance": 0.25,
        "pack": "CUSTOM",
        "pack_red": "CURVATURE",
        "pack_green": "SMOOTHNESS",
        "pack_blue": "AO",
        "pack_alpha": "ZERO",
        "curvature_radius": 0.125,
        "detail_maps": False,
        "vertex_domain": "CORNER",
    }
    low_size = {"method": "CAST", "width": 16, "height": 16, "material": False}
    assert bpy.ops.imprint.bake(low="lo", high=[{"name": "hi"}], **low_size, **arguments) == {"FINISHED"}
    assert {image.name for image in bpy.data.images} == {"lo_ao", "lo_thickness", "lo_packed"}
    assert {"ao", "thickness"} <= set(low.data.attributes.keys())
    assert bpy.context.scene.imprint.maps == set()  # the panel keeps its own


def test_undo_removes_the_images_of_a_bake(settings):
    settings.maps = {"AO", "HEIGHT"}
    settings.rays = 16
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="bake")
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert not [image.name for image in bpy.data.images if image.name.startswith("lo_")]
    assert bpy.context.scene.imprint.maps == {"AO", "HEIGHT"}


# After a bake


def open_editor():
    """An Image Editor in place of the first area of the screen."""
    area = bpy.context.window.screen.areas[0]
    area.type = "IMAGE_EDITOR"
    return area.spaces.active


def buttons(drawn):
    """How many buttons of Results show a map. View has another one, for the map on the mesh."""
    return len([given for name, given in drawn.given if name == "imprint.show_map" and hasattr(given, "image")]) - 1


def test_each_image_of_a_bake_has_a_button(settings):
    assert not bpy.ops.imprint.show_map.poll()
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    assert buttons(draw()) == 1
    settings.maps, settings.pack, settings.rays = {"AO", "HEIGHT"}, "GLTF", 16
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    assert buttons(draw()) == 4
    editor = open_editor()
    assert bpy.ops.imprint.show_map(image="lo_height") == {"FINISHED"}
    assert editor.image == bpy.data.images["lo_height"]
    assert bake_results.is_image_open(editor.image)
    assert not bake_results.is_image_open(bpy.data.images["lo_normal"])
    assert bpy.ops.imprint.show_map() == {"FINISHED"}
    assert editor.image == bpy.data.images["lo_normal"]


def test_an_image_that_is_gone_is_not_shown(settings):
    settings.maps = {"HEIGHT"}
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    bpy.data.images.remove(bpy.data.images["lo_height"])
    assert ("imprint.show_map", False) in draw().buttons
    with pytest.raises(RuntimeError, match="was undone, renamed or deleted"):
        bpy.ops.imprint.show_map(image="lo_height")


def test_texture_sets_show_the_images_of_each_material(settings):
    materials = [bpy.data.materials.new(name) for name in ("skin", "cloth")]
    for material in materials:
        settings.low.data.materials.append(material)
    half = len(settings.low.data.polygons) // 2
    settings.low.data.polygons.foreach_set(
        "material_index", [number < half for number in range(len(settings.low.data.polygons))]
    )
    settings.maps, settings.texture_sets, settings.image = {"HEIGHT"}, True, "lo"
    drawn = draw()
    assert "Texture sets need {material} in the name of the image" in drawn.text
    assert not dict(drawn.buttons)["imprint.bake"]
    settings.image = "{low}_{material}"
    names = ["lo_skin", "lo_skin_height", "lo_cloth", "lo_cloth_height"]
    drawn = draw()
    assert "into a new image 'lo_skin'." in drawn.text
    assert [name for name in names if name in drawn.labels] == names
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    assert {image.name for image in bpy.data.images} == {*names}
    assert buttons(draw()) == 4
    assert bpy.ops.imprint.connect_maps() == {"FINISHED"}
    for material in materials:
        found = [node.image.name for node in material.node_tree.nodes if node.type == "TEX_IMAGE"]
        assert found == [f"lo_{material.name}_height"]
