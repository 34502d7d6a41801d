# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests maps that replace all materials of low objects by one."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.jobs import Job, bake_all, one_material
from addon.jobs.one_material import Shown
from tests.support import scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

MAPS = ("BASE_COLOR", "ROUGHNESS")
COLORS = ((0.8, 0.1, 0.1), (0.1, 0.8, 0.1), (0.1, 0.1, 0.8))


def material(name, color, **inputs):
    result = bpy.data.materials.new(name)
    shader = result.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*color, 1.0)
    for socket, value in inputs.items():
        shader.inputs[socket.replace("_", " ")].default_value = value
    return result


def striped(name="shape", **inputs):
    """A plane of 4 x 4 faces with three materials, a vertex group, a shape key, a second UV map and a modifier."""
    obj = zoo.plane(name, 4)
    for number, color in enumerate(COLORS):
        obj.data.materials.append(material(f"{name} {number}", color, Roughness=0.25 * (number + 1), **inputs))
    obj.data.polygons.foreach_set("material_index", np.arange(len(obj.data.polygons), dtype=np.int32) % 3)
    obj.vertex_groups.new(name="arm").add([0, 1], 0.5, "REPLACE")
    obj.shape_key_add(name="Basis")
    obj.shape_key_add(name="smile").points[0].co.z = 1.0
    obj.data.uv_layers.new(name="other")
    obj.modifiers.new("Triangulate", "TRIANGULATE")
    return obj


def bake(obj, **settings):
    return scenes.bake(obj, obj, method="AUTO", **{"maps": MAPS, "one_material": True} | settings)


def shader_of(obj):
    return next(node for node in obj.data.materials[0].node_tree.nodes if node.type == "BSDF_PRINCIPLED")


def fed_by(shader, socket):
    return shader.inputs[socket].links[0].from_node.image.name


def test_all_else_of_the_object_stays():
    obj = striped(IOR=1.8, Metallic=0.5)
    obj.data.materials[1].node_tree.nodes["Principled BSDF"].inputs["Coat Roughness"].default_value = 0.9  # of no coat
    mesh, old = obj.data, list(obj.data.materials)
    points = [tuple(vertex.co) for vertex in mesh.vertices]
    report = bake(obj)
    (only,) = obj.material_slots
    assert only.material.name == "shape"
    assert {polygon.material_index for polygon in mesh.polygons} == {0}
    shader = shader_of(obj)
    assert fed_by(shader, "Base Color") == report.maps["base_color"]["image"]
    assert fed_by(shader, "Roughness") == report.maps["roughness"]["image"]
    assert shader.inputs["Normal"].links[0].from_node.uv_map == report.uv_layer
    np.testing.assert_allclose([shader.inputs[name].default_value for name in ("IOR", "Metallic")], [1.8, 0.5])
    assert obj.data == mesh
    assert [tuple(vertex.co) for vertex in mesh.vertices] == points
    assert list(obj.vertex_groups.keys()) == ["arm"]
    assert mesh.shape_keys.key_blocks.keys() == ["Basis", "smile"]
    assert [layer.name for layer in mesh.uv_layers] == [report.uv_layer, "other"]
    assert [modifier.type for modifier in obj.modifiers] == ["TRIANGULATE"]
    assert all(each.name in bpy.data.materials and not each.use_fake_user for each in old)
    assert not [text for text in report.warnings if "material" in text.lower()]


def test_without_the_setting_the_materials_stay():
    obj = striped()
    old = list(obj.data.materials)
    bake(obj, one_material=False)
    assert list(obj.data.materials) == old
    assert len({polygon.material_index for polygon in obj.data.polygons}) == 3


def test_the_baked_uv_map_is_that_of_the_material():
    """Materials that read another one no longer count."""
    obj = striped()
    layers = obj.data.uv_layers
    uv = np.empty(2 * len(obj.data.loops), np.float32)
    layers[0].uv.foreach_get("vector", uv)
    layers["other"].uv.foreach_set("vector", 1.0 - uv)
    layers.active = layers["other"]
    report = bake(obj, uv_layer="other")
    assert report.uv_layer == "other"
    assert layers["other"].active_render
    assert not shader_of(obj).inputs["Base Color"].links[0].from_node.inputs["Vector"].links
    assert shader_of(obj).inputs["Normal"].links[0].from_node.uv_map == "other"


def test_materials_of_the_object_and_not_of_its_mesh():
    obj = striped()
    for slot in obj.material_slots:
        slot.link = "OBJECT"
        slot.material = material("own", (0.0, 0.0, 1.0), Roughness=0.5)
    bake(obj)
    (slot,) = obj.material_slots
    assert slot.material == obj.data.materials[0]
    assert slot.material.name == "shape"


def test_a_mesh_in_edit_mode_stays_in_it():
    obj = striped()
    scenes.select(obj)
    bpy.ops.object.mode_set(mode="EDIT")
    bake(obj)
    assert obj.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert [slot.material.name for slot in obj.material_slots] == ["shape"]
    assert {polygon.material_index for polygon in obj.data.polygons} == {0}


def test_materials_on_the_same_texels_are_told():
    obj = striped()
    for corner in obj.data.uv_layers[0].uv:
        corner.vector = corner.vector[0] % 0.5, corner.vector[1]
    assert any("belong to faces of different materials" in text for text in bake(obj).warnings)


def test_glass_is_a_map_of_its_own():
    obj = striped()
    glass = obj.data.materials[1]
    glass.node_tree.nodes["Principled BSDF"].inputs["Transmission Weight"].default_value = 1.0
    glass.use_raytrace_refraction = True
    report = bake(obj, maps=(*MAPS, "TRANSMISSION"))
    assert fed_by(shader_of(obj), "Transmission Weight") == report.maps["transmission"]["image"]
    assert obj.data.materials[0].use_raytrace_refraction  # or EEVEE shows no glass
    assert not [text for text in report.warnings if "differ" in text]


def test_what_no_map_holds_is_told():
    obj = striped(Coat_Weight=0.5)
    obj.data.materials[1].node_tree.nodes["Principled BSDF"].inputs["Transmission Weight"].default_value = 1.0
    obj.data.materials[2].node_tree.nodes["Principled BSDF"].inputs["Coat Roughness"].default_value = 0.9
    (warning,) = [text for text in bake(obj, maps=["BASE_COLOR"]).warnings if "differ" in text]
    assert "differ in Roughness, Transmission, Coat Roughness, " in warning
    assert shader_of(obj).inputs["Coat Weight"].default_value == 0.5


def test_a_second_bake_uses_the_same_material():
    obj = striped()
    bake(obj)
    only, nodes = obj.data.materials[0], len(obj.data.materials[0].node_tree.nodes)
    report = bake(obj)
    assert list(obj.data.materials) == [only]
    assert len(only.node_tree.nodes) == nodes
    assert report.maps["base_color"]["image"] == fed_by(shader_of(obj), "Base Color")


def apart(*objects):
    """Move the UVs of objects side by side."""
    for number, obj in enumerate(objects):
        for corner in obj.data.uv_layers[0].uv:
            corner.vector[0] = (corner.vector[0] + number) / len(objects)
    return objects


def baked_together(objects, **settings):
    wanted = {"method": "AUTO", "maps": MAPS, "one_material": True, "image": "both"} | settings
    jobs = [Job(obj, [obj]) for obj in objects]
    return bake_all(bpy.context, jobs, scenes.settings(**wanted), share_image=True)


def test_objects_in_one_image_share_the_material():
    first, second = apart(striped("a"), striped("b"))
    second.data.uv_layers[0].name = "of its own"
    baked_together([first, second])
    (only,) = {slot.material for obj in (first, second) for slot in obj.material_slots}
    assert shader_of(first).inputs["Normal"].links[0].from_node.uv_map == ""
    assert only.name == "atlas"


@pytest.mark.parametrize("single_user", [False, True])
def test_a_mesh_of_two_objects(single_user):
    obj = striped()
    other = bpy.data.objects.new("twin", obj.data)
    bpy.context.scene.collection.objects.link(other)
    report = bake(obj, single_user=single_user)
    is_told = any("'twin'" in text for text in report.warnings)
    assert is_told is not single_user
    assert len(other.material_slots) == (3 if single_user else 1)
    assert len(obj.material_slots) == 1


def test_what_a_library_has_is_refused_before_the_bake(monkeypatch, tmp_path):
    obj = striped()
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {obj.data})
    with bpy.data.libraries.load(path, link=True) as (there, here):
        here.meshes = there.meshes
    obj.data = here.meshes[0]
    with pytest.raises(BakeError, match="cannot get one material: its mesh comes from a library. Make it local first"):
        bake(obj)
    assert not bpy.data.images


def test_texture_sets_exclude_it():
    with pytest.raises(BakeError, match="Texture sets have an image for each material"):
        bake(striped(), texture_sets=True, image="{low}_{material}")


def shown(reports):
    return list(map(Shown.of, reports))


def test_copies_leave_the_objects_as_they_are():
    objects = apart(striped("a"), striped("b"))
    reports = baked_together(objects, one_material=False)
    settings = scenes.settings(maps=MAPS)
    one_material.put_checked(bpy.context, shown(reports), settings, on_copies=True, is_joined=True)
    (joined,) = [obj for obj in bpy.data.objects if obj not in objects]
    assert [len(obj.material_slots) for obj in objects] == [3, 3]
    assert all(obj.hide_get() for obj in objects)
    assert len(joined.data.polygons) == 32
    assert len(joined.material_slots) == 1
    assert {slot.material.name for slot in joined.material_slots} == {"atlas"}
    assert joined.data.shape_keys.key_blocks.keys() == ["Basis", "smile"]
    assert [layer.name for layer in joined.data.uv_layers] == [layer.name for layer in objects[0].data.uv_layers]


def test_objects_that_are_not_baked_keep_the_material():
    first, second = apart(striped("a"), striped("b"))
    baked_together([first, second])
    atlas = fed_by(shader_of(second), "Base Color")
    report = bake(first)
    assert fed_by(shader_of(first), "Base Color") == report.maps["base_color"]["image"] != atlas
    assert fed_by(shader_of(second), "Base Color") == atlas
    assert any("'atlas' is also on 'b': 'a' now shows the copy 'a" in text for text in report.warnings)
    material = first.data.materials[0]
    bake(first)
    assert list(first.data.materials) == [material]


def test_one_of_the_objects_in_an_image_keeps_their_material():
    """It shows the same images after a bake of one alone."""
    first, second = apart(striped("a"), striped("b"))
    baked_together([first, second])
    (report,) = baked_together([first])
    (only,) = {slot.material for obj in (first, second) for slot in obj.material_slots}
    assert fed_by(shader_of(second), "Base Color") == report.maps["base_color"]["image"]
    assert not [text for text in report.warnings if "copy" in text]
    (report,) = baked_together([first], maps=(*MAPS, "METALLIC"))
    assert first.data.materials[0] != only == second.data.materials[0]
    assert any("'atlas' is also on 'b'" in text for text in report.warnings)


def twin_of(obj):
    """Another object with the same mesh."""
    twin = bpy.data.objects.new("twin", obj.data)
    bpy.context.scene.collection.objects.link(twin)
    twin.location.x = 5.0
    return twin


def test_a_mesh_of_two_objects_gets_no_two_materials():
    obj = striped()
    jobs = [Job(each, [each]) for each in (obj, twin_of(obj))]
    wanted = {"method": "AUTO", "maps": MAPS, "one_material": True}
    with pytest.raises(BakeError, match="'shape' and 'twin' have the same mesh, and cannot get a material each"):
        bake_all(bpy.context, jobs, scenes.settings(**wanted))
    assert not bpy.data.images
    first, second = bake_all(bpy.context, jobs, scenes.settings(**wanted, single_user=True))
    for job, report in zip(jobs, (first, second), strict=True):
        assert fed_by(shader_of(job.low), "Base Color") == report.maps["base_color"]["image"]


def test_materials_of_another_object_on_the_mesh_stay():
    obj = striped()
    twin = twin_of(obj)
    own = [material("own", color) for color in COLORS]
    for slot, each in zip(twin.material_slots, own, strict=True):
        slot.link = "OBJECT"
        slot.material = each
    report = bake(obj)
    assert [(slot.link, slot.material) for slot in twin.material_slots] == [("OBJECT", each) for each in own]
    assert {slot.material.name for slot in obj.material_slots} == {"shape"}
    assert not [text for text in report.warnings if "'twin'" in text]


def test_a_mesh_of_a_library_is_copied_for_a_single_user(tmp_path):
    obj = striped()
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {obj.data})
    with bpy.data.libraries.load(path, link=True) as (there, here):
        here.meshes = there.meshes
    obj.data = here.meshes[0]
    report = bake(obj, single_user=True)
    assert obj.data.library is None
    assert fed_by(shader_of(obj), "Base Color") == report.maps["base_color"]["image"]


def test_copies_of_what_cannot_be_hidden_are_refused():
    objects = apart(striped("a"), striped("b"))
    reports = baked_together(objects, one_material=False)
    collection = bpy.data.collections.new("excluded")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(objects[1])
    bpy.context.scene.collection.objects.unlink(objects[1])
    bpy.context.view_layer.layer_collection.children["excluded"].exclude = True
    with pytest.raises(BakeError, match="'b' is in a hidden or excluded collection"):
        one_material.put_checked(
            bpy.context, shown(reports), scenes.settings(maps=MAPS), on_copies=True, is_joined=False
        )
    assert len(bpy.data.objects) == 2
    assert not objects[0].hide_get()


def child_of(obj):
    child = bpy.data.objects.new("child", None)
    bpy.context.scene.collection.objects.link(child)
    child.parent = obj


def follow(obj):
    follower = bpy.data.objects.new("follower", None)
    bpy.context.scene.collection.objects.link(follower)
    follower.constraints.new("COPY_LOCATION").target = obj


LOST = {
    "uv": (lambda first, second: setattr(second.data.uv_layers[0], "name", "of its own"), "UV maps of several names"),
    "modifier": (lambda first, second: second.modifiers.new("Weld", "WELD"), "has other modifiers"),
    "setting": (
        lambda first, second: setattr(second.modifiers[0], "quad_method", "FIXED"),
        "has other modifiers than 'a', or other settings",
    ),
    "curve": (
        lambda first, second: [
            each.modifiers.new("Bevel", "BEVEL").custom_profile.points.add(0.2, share)
            for each, share in ((first, 0.3), (second, 0.6))
        ],
        "has other modifiers than 'a', or other settings",
    ),
    "mirrored": (lambda first, second: setattr(second.scale, "x", -1.0), "mirrors either 'b' or 'a'"),
    "child": (lambda first, second: child_of(second), "'child' depends on 'b'"),
    "constraint": (lambda first, second: follow(second), "'follower' depends on 'b'"),
    "parent": (lambda first, second: setattr(first, "parent", second), "'a' depends on 'b'"),
    "mesh": (lambda first, second: twin_of(first), "mesh of 'a' is also that of 'twin', which would get all faces"),
}
"""What joining would lose or change, by what makes it so."""


@pytest.mark.parametrize("what", LOST)
def test_what_joining_would_lose_is_refused(what):
    change, message = LOST[what]
    objects = apart(striped("a"), striped("b"))
    change(*objects)
    reports = baked_together(objects, one_material=False)
    with pytest.raises(BakeError, match=message):
        one_material.put_checked(
            bpy.context, shown(reports), scenes.settings(maps=MAPS), on_copies=False, is_joined=True
        )
    assert [len(obj.material_slots) for obj in objects] == [3, 3]


@pytest.mark.parametrize("what", ["child", "constraint", "parent", "mesh"])
def test_copies_are_joined_beside_what_depends_on_the_objects(what):
    objects = apart(striped("a"), striped("b"))
    LOST[what][0](*objects)
    count = len(bpy.data.objects)
    reports = baked_together(objects, one_material=False)
    one_material.put_checked(bpy.context, shown(reports), scenes.settings(maps=MAPS), on_copies=True, is_joined=True)
    assert len(bpy.data.objects) == count + 1
    assert [len(obj.data.polygons) for obj in objects] == [16, 16]


def test_a_mesh_of_two_objects_is_joined_for_a_single_user():
    objects = apart(striped("a"), striped("b"))
    twin = twin_of(objects[0])
    reports = baked_together(objects, one_material=False)
    settings = scenes.settings(maps=MAPS, single_user=True)
    one_material.put_checked(bpy.context, shown(reports), settings, on_copies=False, is_joined=True)
    assert (len(objects[0].data.polygons), len(twin.data.polygons)) == (32, 16)
