# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole bakes whose maps go into packed images, attributes and materials, and bakes without a normal map."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest
from PIL import Image

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import Job, bake_all, bake_pair
from addon.output import materials, outputs, value_encoding
from tests.support import scenes, zoo
from tests.support.maps import pixels
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")

RAISED = 0.25
"""The height of the high plane above the low one."""
HALF = {"pack": "CUSTOM", "pack_red": "HEIGHT", "pack_green": "ONE", "pack_blue": "COVERAGE", "pack_alpha": "COVERAGE"}


def planes(name="lo", x=0.0):
    low, high = zoo.plane(name, n=2), zoo.plane(f"{name} high", n=4)
    low.location.x = high.location.x = x
    high.location.z = RAISED
    bpy.context.view_layer.update()
    return low, high


def settings(**values):
    usual = {"method": "CAST", "width": 32, "height": 32, "margin": 4, "storage": "MEMORY", "depth": 32}
    return Settings(**usual | {"extrusion": 0.5, "max_distance": 1.0, "image": "{low}_map"} | values)


def bake(low, high, **values):
    return bake_pair(bpy.context, low, [high], settings(**values))


def attribute(low, name):
    found = low.data.attributes[name]
    values = np.empty(len(found.data), np.float32)
    found.data.foreach_get("value", values)
    return values


def test_maps_reach_images_attributes_and_the_material():
    low, high = planes()
    report = bake(low, high, maps=("HEIGHT",), **HALF, vertex_domain="CORNER", connect_maps=True)
    assert report.image == "lo_map"
    assert set(report.maps) == {"height", "packed"}
    packed = pixels(bpy.data.images["lo_map_packed"])
    np.testing.assert_allclose(packed, np.broadcast_to((RAISED, 1, 1, 1), packed.shape), atol=1e-5)
    assert report.attributes == {"normal": "normal", "height": "height", "coverage": "coverage"}
    np.testing.assert_allclose(attribute(low, "height"), RAISED, atol=1e-5)
    nodes = low.active_material.node_tree.nodes
    assert nodes["Material Output"].inputs["Displacement"].is_linked
    assert nodes["Principled BSDF"].inputs["Normal"].is_linked
    assert any("lo_map_packed: red height, blue coverage, alpha coverage" in line for line in report.summary())
    assert "Attributes of lo: normal, height, coverage" in report.summary()


def test_connecting_needs_no_normal_map_in_the_material():
    low, high = planes()
    bake(low, high, maps=("HEIGHT",), material=False, connect_maps=True)
    nodes = low.active_material.node_tree.nodes
    assert nodes["Material Output"].inputs["Displacement"].is_linked
    assert not nodes["Principled BSDF"].inputs["Normal"].is_linked


def test_without_a_normal_map_there_is_no_image_and_no_link_of_it(tmp_path):
    low, high = planes()
    path = tmp_path / "m.png"
    report = bake(low, high, normal=False, maps=("HEIGHT",), storage="FILE", output=str(path), depth=16)
    assert report.image == "lo_map_height"
    assert [Path(name).name for name in report.output] == ["m_height.png"]
    assert [each.name for each in tmp_path.iterdir()] == ["m_height.png"]
    assert [image.name for image in bpy.data.images] == ["lo_map_height"]
    assert report.coverage == 1.0
    assert len(low.material_slots) == 0


def test_an_atlas_has_them_for_each_object():
    pairs = [planes("a"), planes("b", x=3.0)]
    for number, (low, high) in enumerate(pairs):
        for obj in (low, high):
            layer = obj.data.uv_layers[0].uv
            uv = np.empty(len(layer) * 2, np.float32)
            layer.foreach_get("vector", uv)
            layer.foreach_set("vector", ((uv.reshape(-1, 2) + (number, 0)) * (0.5, 1.0)).astype(np.float32).ravel())
    pairs[1][1].location.z = 2 * RAISED
    bpy.context.view_layer.update()
    jobs = [Job(low, [high]) for low, high in pairs]
    chosen = settings(normal=False, **HALF, vertex_domain="POINT", connect_maps=True, image="atlas")
    reports = bake_all(bpy.context, jobs, chosen, share_image=True)
    assert [report.image for report in reports] == ["atlas_packed"] * 2
    assert [image.name for image in bpy.data.images] == ["atlas_packed"]
    for number, (low, _) in enumerate(pairs):
        np.testing.assert_allclose(attribute(low, "height"), RAISED * (number + 1), atol=1e-5)
        assert low.active_material.node_tree.nodes["Material Output"].inputs["Displacement"].is_linked


def test_a_failure_leaves_attributes_and_materials_as_they_were(monkeypatch):
    low, high = planes()

    def fail(_):
        raise BakeError("no room")

    monkeypatch.setattr(outputs, "commit_all", fail)
    before = snapshot()
    with pytest.raises(BakeError, match="no room"):
        bake(low, high, maps=("HEIGHT",), vertex_domain="CORNER", connect_maps=True)
    assert difference(before, snapshot()) == {}


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"vertex_domain": "CORNER"}, "cannot be given attributes"),
        ({"maps": ("HEIGHT",), "connect_maps": True}, "its materials cannot be set"),
    ],
)
def test_linked_objects_are_refused_before_the_bake(tmp_path, chosen, message):
    planes()
    path = str(tmp_path / "library.blend")
    scenes.save(path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(path, link=True) as (_, data):
        data.objects = ["lo", "lo high"]
    for obj in bpy.data.objects:
        bpy.context.collection.objects.link(obj)
    low, high = bpy.data.objects["lo"], bpy.data.objects["lo high"]
    with pytest.raises(BakeError, match=message):
        bake(low, high, material=False, **chosen)
    # Without a normal map, nothing goes into the material.
    bake(low, high, normal=False, maps=("HEIGHT",), material=True)


@pytest.mark.parametrize("is_shared", [True, False])
def test_a_map_that_was_connected_to_a_material_of_both_objects_is_named(is_shared):
    low, high = planes()
    material = bpy.data.materials.new("Clay")
    scenes.set_inputs(
        material, Base_Color=scenes.texture(material, scenes.image("clay", np.ones((4, 4, 3)))).outputs[0]
    )
    high.data.materials.append(material)
    low.data.materials.append(material if is_shared else bpy.data.materials.new("own"))
    sentence = 'Material "Clay": Base Color shows a map that Imprint has baked'
    for number in range(2):
        report = bake(low, high, maps=("BASE_COLOR",), connect_maps=True)
        assert any(warning.startswith(sentence) for warning in report.warnings) == (is_shared and number == 1)


# glTF


def test_gltf_has_the_colors_of_the_high_mesh_with_the_usual_settings(tmp_path):
    low, high = planes()
    material = bpy.data.materials.new("Clay")
    principled = material.node_tree.nodes["Principled BSDF"]
    color, roughness, metallic = (0.5, 0.2, 0.05), 0.3, 0.7
    principled.inputs["Base Color"].default_value = (*color, 1.0)
    principled.inputs["Roughness"].default_value, principled.inputs["Metallic"].default_value = roughness, metallic
    high.data.materials.append(material)
    usual = {"storage": Settings().storing.storage, "depth": Settings().storing.depth}
    bake(low, high, maps=("BASE_COLOR",), pack="GLTF", connect_maps=True, **usual)
    bpy.data.objects.remove(high)
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "low.gltf"), export_format="GLTF_SEPARATE")
    gltf = json.loads((tmp_path / "low.gltf").read_text(encoding="utf-8"))
    surface = gltf["materials"][0]["pbrMetallicRoughness"]
    expected = {
        "baseColorTexture": value_encoding.to_srgb(np.float32(color)),
        "metallicRoughnessTexture": (1.0, roughness, metallic),
    }
    for name, values in expected.items():
        uri = gltf["images"][gltf["textures"][surface[name]["index"]]["source"]]["uri"]
        with Image.open(tmp_path / uri) as image:
            found = np.asarray(image.convert("RGB"))[16, 16] / 255
        np.testing.assert_allclose(found, values, atol=1.1 / 255)  # the exporter cuts off instead of rounding


# Renders

WAVE, STEEP = 0.05, 6.0
"""The height and the wave number of a sine on the high plane."""
SHADE = 0.002
"""The error of the rendered light: texels and subdivision are finite. Counted twice, the detail leaves 0.07."""


def brightness(path):
    """The light on the plane (64, 64) that Cycles renders from above."""
    render = bpy.context.scene.render
    render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    found = pixels(image)[4:-4, 4:-4, 0].copy()
    bpy.data.images.remove(image)
    return found


@pytest.mark.parametrize("method", ["BUMP", "DISPLACEMENT", "BOTH"])
def test_detail_that_is_in_the_normal_map_and_in_the_heights_counts_once(tmp_path, method):
    low, high = zoo.plane("lo", n=2), zoo.plane("hi", n=60)
    points = np.empty(len(high.data.vertices) * 3, np.float32)
    high.data.vertices.foreach_get("co", points)
    points = points.reshape(-1, 3)
    points[:, 2] = WAVE * np.sin(points[:, 0] * STEEP)
    high.data.vertices.foreach_set("co", points.ravel())
    high.data.shade_smooth()
    low.modifiers.new("Dice", "SUBSURF").subdivision_type = "SIMPLE"
    low.modifiers[0].render_levels = 6 if method != "BUMP" else 0
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 4, False
    scene.cycles.max_bounces = 0
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.view_settings.view_transform = "Raw"
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", float(np.ptp(points[:, 0]))
    scene.camera.location = (*points.mean(axis=0)[:2], 5.0)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.data.angle, sun.rotation_euler = 3.0, 0.0, (0.0, 0.7, 0.0)
    for obj in (scene.camera, sun):
        scene.collection.objects.link(obj)
    bpy.context.view_layer.update()
    report = bake(low, high, maps=("HEIGHT",), width=256, height=256, margin=16)
    high.hide_render = True
    material = low.active_material
    principled = material.node_tree.nodes["Principled BSDF"]
    principled.inputs["Specular IOR Level"].default_value, principled.inputs["Roughness"].default_value = 0.0, 1.0
    before = brightness(tmp_path / "before.exr")
    material.displacement_method = method
    assert (
        materials.connect_maps_of_report(low, report.maps, report.uv_layer, space="TANGENT", single_user=False)[1:]
        == []
    )
    after = brightness(tmp_path / "after.exr")
    assert np.ptp(before) > 0.2
    assert np.abs(after - before).mean() < SHADE
