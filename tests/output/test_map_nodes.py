# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests how maps other than the normal map are connected in materials, and what glTF's exporter makes of it."""

import json

import bpy
import numpy as np
import pytest

from addon.core.map_types import AO, BY_NAME, HEIGHT, METALLIC, ROUGHNESS, VECTOR_DISPLACEMENT, WIDENED_ROUGHNESS
from addon.output import map_nodes, materials
from addon.output.map_nodes import MapImage
from addon.output.tree_editing import MARK
from tests.support import random_cases
from tests.support.shader_nodes import new_node, nodes_and_links

BASE_COLOR, EMISSION, ALPHA = (BY_NAME[name] for name in ("BASE_COLOR", "EMISSION", "ALPHA"))
SIZE = 8


def make_low(*mats):
    mesh = bpy.data.meshes.new("Low")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [], [(0, 1, 2, 3)])
    for name in ("Layout", "Other"):
        mesh.uv_layers.new(name=name).uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    for material in mats:
        mesh.materials.append(material)
    low = bpy.data.objects.new("Low", mesh)
    bpy.context.collection.objects.link(low)
    return low


def make_material():
    material = bpy.data.materials.new("Skin")
    return material, material.node_tree, material.node_tree.nodes["Principled BSDF"]


def make_image(name, color=(0.5, 0.5, 0.5, 1.0), colorspace="Non-Color"):
    image = bpy.data.images.new(name, SIZE, SIZE, alpha=True)
    image.colorspace_settings.name = colorspace
    image.pixels.foreach_set(np.tile(np.float32(color), SIZE * SIZE))
    image.pack()
    return image


def of(map_type, **more):
    """The map in an image of its own."""
    return MapImage(make_image(map_type.suffix), map_type.suffix, map_type.label, **more)


def packed(image, channel, **more):
    return MapImage(image, "packed", "Packed", channel, **more)


def orm(color=(0.9, 0.6, 0.2, 1.0)):
    image = make_image("orm", color)
    channels = {AO.name: "Red", ROUGHNESS.name: "Green", METALLIC.name: "Blue"}
    return {name: packed(image, channel) for name, channel in channels.items()}


def connect(low, images, **values):
    return materials.connect_maps(low, images, **{"uv_layer": "Layout"} | values)


def source(socket, kind):
    """The node connected to the input `socket`, which must be of this kind."""
    assert len(socket.links) == 1, f"{socket.node.name}.{socket.name} has {len(socket.links)} links"
    node = socket.links[0].from_node
    assert node.bl_idname == f"ShaderNode{kind}"
    return node


def output_of(socket):
    return socket.links[0].from_socket.identifier


# Inputs of the Principled BSDF


@pytest.mark.parametrize("map_type", [kind for kind in BY_NAME.values() if kind.socket], ids=lambda kind: kind.name)
def test_a_map_of_a_socket_is_connected_to_it(map_type):
    material, _, principled = make_material()
    images = {map_type.name: of(map_type)}
    assert connect(make_low(material), images) == []
    texture = source(principled.inputs[map_type.socket], "TexImage")
    assert output_of(principled.inputs[map_type.socket]) == "Color"
    assert texture.image == images[map_type.name].image
    assert texture.image[MARK]
    assert texture.label == f"Imprint {map_type.label}"
    assert [socket.name for socket in principled.inputs if socket.is_linked] == [map_type.socket]


def test_maps_without_an_input_add_nothing():
    material, tree, _ = make_material()
    before = nodes_and_links(tree)
    assert connect(make_low(material), {"CURVATURE": of(BY_NAME["CURVATURE"])}) == []
    assert nodes_and_links(tree) == before


@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_emission_has_the_strength_of_the_map(scale):
    material, _, principled = make_material()
    assert connect(make_low(material), {EMISSION.name: of(EMISSION, scale=scale)}) == []
    assert principled.inputs["Emission Strength"].default_value == scale


def test_a_linked_emission_strength_stays_and_gets_a_note():
    material, tree, principled = make_material()
    value = new_node(tree, "ShaderNodeValue")
    tree.links.new(value.outputs[0], principled.inputs["Emission Strength"])
    (note,) = connect(make_low(material), {EMISSION.name: of(EMISSION)})
    assert "Emission Strength" in note
    assert source(principled.inputs["Emission Strength"], "Value") == value


def test_other_maps_leave_the_emission_strength():
    material, _, principled = make_material()
    connect(make_low(material), {ROUGHNESS.name: of(ROUGHNESS)})
    assert principled.inputs["Emission Strength"].default_value == 0.0


def test_a_packed_image_is_split_once():
    material, tree, principled = make_material()
    images = orm()
    assert connect(make_low(material), images) == []
    rough, metal = principled.inputs["Roughness"], principled.inputs["Metallic"]
    separate = source(rough, "SeparateColor")
    assert source(metal, "SeparateColor") == separate
    assert (output_of(rough), output_of(metal)) == ("Green", "Blue")
    assert source(separate.inputs["Color"], "TexImage").image == images[AO.name].image
    assert [node.bl_idname for node in tree.nodes].count("ShaderNodeTexImage") == 1


def test_smoothness_in_alpha_is_inverted():
    material, _, principled = make_material()
    image = make_image("mask")
    images = {METALLIC.name: packed(image, "Red"), ROUGHNESS.name: packed(image, "Alpha", is_inverted=True)}
    assert connect(make_low(material), images) == []
    invert = source(principled.inputs["Roughness"], "Math")
    assert (invert.operation, invert.inputs[0].default_value) == ("SUBTRACT", 1.0)
    texture = source(invert.inputs[1], "TexImage")
    assert output_of(invert.inputs[1]) == "Alpha"
    separate = source(principled.inputs["Metallic"], "SeparateColor")
    assert source(separate.inputs["Color"], "TexImage") == texture


def every_map():
    image = make_image("mask")
    return orm() | {
        BASE_COLOR.name: of(BASE_COLOR),
        EMISSION.name: of(EMISSION),
        HEIGHT.name: of(HEIGHT, midlevel=0.5, scale=0.2),
        ROUGHNESS.name: packed(image, "Alpha", is_inverted=True),
    }


def test_connecting_twice_changes_nothing():
    material, tree, _ = make_material()
    low, images = make_low(material), every_map()
    first = connect(low, images)
    before = nodes_and_links(tree)
    assert connect(low, images) == first
    assert nodes_and_links(tree) == before


def test_maps_packed_later_take_the_place_of_separate_ones():
    material, tree, principled = make_material()
    low = make_low(material)
    connect(low, {ROUGHNESS.name: of(ROUGHNESS)})
    images = orm()
    assert connect(low, images) == []
    separate = source(principled.inputs["Roughness"], "SeparateColor")
    assert source(separate.inputs["Color"], "TexImage").image == images[AO.name].image
    again = {ROUGHNESS.name: MapImage(bpy.data.images["roughness"], "roughness", "Roughness")}
    assert connect(low, again) == []
    assert source(principled.inputs["Roughness"], "TexImage").image.name == "roughness"


def test_an_image_of_the_user_stays_in_its_node():
    material, tree, principled = make_material()
    texture = new_node(tree, "ShaderNodeTexImage", image=make_image("Paint"), label="Mine")
    tree.links.new(texture.outputs["Color"], principled.inputs["Base Color"])
    (note,) = connect(make_low(material), {BASE_COLOR.name: of(BASE_COLOR)})
    assert all(name in note for name in ('"Skin"', '"Paint"', '"Mine"', "Base Color"))
    assert source(principled.inputs["Base Color"], "TexImage").image.name == "base_color"
    assert texture.image.name == "Paint"


def test_other_inputs_of_the_same_reroute_keep_the_image_of_the_user():
    material, tree, principled = make_material()
    texture, dot = new_node(tree, "ShaderNodeTexImage", image=make_image("Paint")), new_node(tree, "NodeReroute")
    tree.links.new(texture.outputs["Color"], dot.inputs[0])
    for name in ("Base Color", "Emission Color"):
        tree.links.new(dot.outputs[0], principled.inputs[name])
    connect(make_low(material), {BASE_COLOR.name: of(BASE_COLOR)})
    assert source(principled.inputs["Base Color"], "TexImage").image.name == "base_color"
    assert principled.inputs["Emission Color"].links[0].from_node == dot
    assert dot.inputs[0].links[0].from_node == texture


def test_reroutes_are_followed():
    material, tree, principled = make_material()
    dot = new_node(tree, "NodeReroute")
    tree.links.new(dot.outputs[0], principled.inputs["Base Color"])
    connect(make_low(material), {BASE_COLOR.name: of(BASE_COLOR)})
    assert principled.inputs["Base Color"].links[0].from_node == dot
    assert source(dot.inputs[0], "TexImage").image.name == "base_color"


def test_other_nodes_at_an_input_do_not_change():
    material, tree, principled = make_material()
    ramp = new_node(tree, "ShaderNodeValToRGB")
    texture = new_node(tree, "ShaderNodeTexImage", mute=True)
    invert = new_node(tree, "ShaderNodeMath")  # without a mark, it is not known to be 1 - value
    tree.links.new(new_node(tree, "ShaderNodeTexImage").outputs["Color"], invert.inputs[1])
    tree.links.new(ramp.outputs["Color"], principled.inputs["Base Color"])
    tree.links.new(texture.outputs["Color"], principled.inputs["Metallic"])
    tree.links.new(invert.outputs["Value"], principled.inputs["Roughness"])
    before = nodes_and_links(tree)
    images = {kind.name: of(kind) for kind in (BASE_COLOR, METALLIC, ROUGHNESS)}
    notes = connect(make_low(material), images)
    assert len(notes) == 3
    assert all(any(f'"{node.name}"' in note for note in notes) for node in (ramp, texture, invert))
    assert nodes_and_links(tree) == before


def test_a_surface_without_a_principled_bsdf_gets_a_note():
    material, tree, principled = make_material()
    tree.links.new(new_node(tree, "ShaderNodeBsdfDiffuse").outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    before = nodes_and_links(tree)
    (note,) = connect(make_low(material), {ROUGHNESS.name: of(ROUGHNESS)})
    assert "Principled BSDF" in note
    assert nodes_and_links(tree) == before


def test_another_uv_layer_gets_one_uv_map_node():
    material, tree, principled = make_material()
    low = make_low(material)
    connect(low, {kind.name: of(kind) for kind in (BASE_COLOR, ROUGHNESS)}, uv_layer="Other")
    nodes = {
        source(source(principled.inputs[name], "TexImage").inputs["Vector"], "UVMap")
        for name in ("Base Color", "Roughness")
    }
    assert [node.uv_map for node in nodes] == ["Other"]


def test_several_materials_and_single_users():
    shared, tree, principled = make_material()
    other = make_low(shared)
    low = make_low(shared, bpy.data.materials.new("Second"))
    notes = connect(low, {ROUGHNESS.name: of(ROUGHNESS)}, single_user=True)
    assert len(notes) == 1
    assert '"Skin.001"' in notes[0]
    assert not principled.inputs["Roughness"].is_linked
    assert other.material_slots[0].material == shared
    for slot in low.material_slots:
        source(slot.material.node_tree.nodes["Principled BSDF"].inputs["Roughness"], "TexImage")


def test_a_reroute_that_leads_to_two_inputs_does_not_lead_a_map_to_the_wrong_one():
    material, tree, principled = make_material()
    dot = new_node(tree, "NodeReroute")
    for name in ("Metallic", "Roughness"):
        tree.links.new(dot.outputs[0], principled.inputs[name])
    connect(make_low(material), {kind.name: of(kind) for kind in (ROUGHNESS, METALLIC)})
    assert source(principled.inputs["Roughness"], "TexImage").image.name == "roughness"
    assert principled.inputs["Metallic"].links[0].from_node == dot
    assert source(dot.inputs[0], "TexImage").image.name == "metallic"


# Displacement


@pytest.mark.parametrize(
    ("map_type", "kind", "entry"),
    [(HEIGHT, "Displacement", "Height"), (VECTOR_DISPLACEMENT, "VectorDisplacement", "Vector")],
)
@pytest.mark.parametrize("space", ["TANGENT", "WORLD"])
def test_heights_and_vectors_displace_as_reported(map_type, kind, entry, space):
    material, tree, _ = make_material()
    image = of(map_type, midlevel=0.5, scale=0.25, space=space)
    (note,) = connect(make_low(material), {map_type.name: image})
    assert all(word in note for word in ('"Bump Only"', '"Displacement Only"'))
    node = source(tree.nodes["Material Output"].inputs["Displacement"], kind)
    assert source(node.inputs[entry], "TexImage").image == image.image
    assert (node.inputs["Midlevel"].default_value, node.inputs["Scale"].default_value) == (0.5, 0.25)
    assert node.space == ("WORLD" if map_type is HEIGHT or space == "WORLD" else "OBJECT")


def test_vectors_in_tangent_space_move_along_the_surface():
    material, tree, _ = make_material()
    image = of(VECTOR_DISPLACEMENT, is_tangent=True)
    connect(make_low(material), {VECTOR_DISPLACEMENT.name: image})
    node = source(tree.nodes["Material Output"].inputs["Displacement"], "VectorDisplacement")
    assert node.space == "TANGENT"


@pytest.mark.parametrize("method", ["DISPLACEMENT", "BOTH"])
def test_no_note_where_the_surface_moves(method):
    material, *_ = make_material()
    material.displacement_method = method
    assert connect(make_low(material), {HEIGHT.name: of(HEIGHT)}) == []


def hook_up(low, image):
    materials.hook_up(low, image, space="TANGENT", uv_layer="Layout", channels=("+X", "+Y", "+Z"))


def normal_map_of(principled):
    return source(principled.inputs["Normal"], "NormalMap")


@pytest.mark.parametrize("is_normal_first", [True, False])
def test_a_normal_map_counts_from_the_surface_without_its_displacement(is_normal_first):
    material, _, principled = make_material()
    low = make_low(material)
    steps = [lambda: hook_up(low, make_image("normal")), lambda: connect(low, {HEIGHT.name: of(HEIGHT)})]
    for step in steps if is_normal_first else steps[::-1]:
        step()
    assert normal_map_of(principled).base == "ORIGINAL"


def test_other_maps_leave_the_base_of_the_normal_map():
    material, _, principled = make_material()
    low = make_low(material)
    hook_up(low, make_image("normal"))
    connect(low, {ROUGHNESS.name: of(ROUGHNESS)})
    assert normal_map_of(principled).base == "DISPLACED"


def test_the_displacement_of_the_user_leaves_the_base_of_the_normal_map():
    material, tree, principled = make_material()
    node = new_node(tree, "ShaderNodeDisplacement")
    texture = new_node(tree, "ShaderNodeTexImage", image=make_image("Waves"))
    tree.links.new(texture.outputs["Color"], node.inputs["Height"])
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Displacement"])
    hook_up(make_low(material), make_image("normal"))
    assert normal_map_of(principled).base == "DISPLACED"


def test_a_normal_map_of_the_user_keeps_its_base():
    material, tree, principled = make_material()
    node, texture = (
        new_node(tree, "ShaderNodeNormalMap"),
        new_node(tree, "ShaderNodeTexImage", image=make_image("Pores")),
    )
    tree.links.new(texture.outputs["Color"], node.inputs["Color"])
    tree.links.new(node.outputs[0], principled.inputs["Normal"])
    connect(make_low(material), {HEIGHT.name: of(HEIGHT)})
    assert node.base == "DISPLACED"


def test_vectors_after_heights_take_their_place():
    material, tree, _ = make_material()
    low = make_low(material)
    connect(low, {HEIGHT.name: of(HEIGHT)})
    connect(low, {VECTOR_DISPLACEMENT.name: of(VECTOR_DISPLACEMENT)})
    source(tree.nodes["Material Output"].inputs["Displacement"], "VectorDisplacement")


def test_other_nodes_at_the_displacement_do_not_change():
    material, tree, _ = make_material()
    tree.links.new(
        new_node(tree, "ShaderNodeVectorMath").outputs[0], tree.nodes["Material Output"].inputs["Displacement"]
    )
    before = nodes_and_links(tree)
    (note,) = connect(make_low(material), {HEIGHT.name: of(HEIGHT)})
    assert "Displacement" in note
    assert nodes_and_links(tree) == before


# glTF


def export(folder):
    bpy.context.view_layer.update()
    bpy.ops.export_scene.gltf(filepath=str(folder / "low.gltf"), export_format="GLTF_SEPARATE")
    return json.loads((folder / "low.gltf").read_text(encoding="utf-8"))


def stored(gltf, texture, folder):
    """The red, green and blue of a texture's first pixel."""
    from PIL import Image

    uri = gltf["images"][gltf["textures"][texture["index"]]["source"]]["uri"]
    with Image.open(folder / uri) as image:
        return np.array(image.convert("RGB"))[0, 0] / 255


def test_gltf_has_every_texture_and_one_image_for_orm(tmp_path):
    material, *_ = make_material()
    low = make_low(material)
    images = orm() | {BASE_COLOR.name: of(BASE_COLOR), EMISSION.name: of(EMISSION)}
    materials.hook_up(
        low, make_image("normal"), space="TANGENT", uv_layer="Layout", channels=("+X", "+Y", "+Z"), single_user=False
    )
    assert connect(low, images) == []
    gltf = export(tmp_path)
    (made,) = gltf["materials"]
    surface = made["pbrMetallicRoughness"]
    assert {"occlusionTexture", "normalTexture", "emissiveTexture"} <= made.keys()
    assert {"metallicRoughnessTexture", "baseColorTexture"} <= surface.keys()
    assert made["occlusionTexture"]["index"] == surface["metallicRoughnessTexture"]["index"]
    assert len(gltf["images"]) == 4
    np.testing.assert_allclose(stored(gltf, made["occlusionTexture"], tmp_path), (0.9, 0.6, 0.2), atol=0.5 / 255)


def test_gltf_joins_separate_maps(tmp_path):
    material, *_ = make_material()
    low = make_low(material)
    values = {AO: 0.9, ROUGHNESS: 0.6, METALLIC: 0.2}
    images = {
        kind.name: MapImage(make_image(kind.suffix, (value, value, value, 1.0)), kind.suffix, kind.label)
        for kind, value in values.items()
    }
    assert connect(low, images) == []
    gltf = export(tmp_path)
    np.testing.assert_allclose(
        stored(gltf, gltf["materials"][0]["occlusionTexture"], tmp_path), (0.9, 0.6, 0.2), atol=0.5 / 255
    )


def test_the_exporters_own_group_is_used_where_there_is_one():
    material, tree, _ = make_material()
    group = bpy.data.node_groups.new("glTF Settings", "ShaderNodeTree")
    group.interface.new_socket("Occlusion", in_out="INPUT", socket_type="NodeSocketFloat")
    node = new_node(tree, "ShaderNodeGroup", node_tree=group)
    connect(make_low(material), {AO.name: of(AO)})
    source(node.inputs["Occlusion"], "TexImage")
    assert list(bpy.data.node_groups) == [group]


def test_the_group_has_the_inputs_that_the_exporters_own_has():
    from io_scene_gltf2.blender.com import material_helpers

    material, *_ = make_material()
    connect(make_low(material), {AO.name: of(AO)})
    own = bpy.data.node_groups[map_nodes.GLTF_GROUP]
    assert material_helpers.get_gltf_node_name() == map_nodes.GLTF_GROUP
    assert material_helpers.get_gltf_node_old_name() == map_nodes.OLDER_GLTF_GROUP
    theirs = material_helpers.create_settings_group("theirs")
    inputs = [
        [(item.name, item.default_value) for item in group.interface.items_tree if item.in_out == "INPUT"]
        for group in (own, theirs)
    ]
    assert inputs[0] == inputs[1]


# Renders


def rendered(low, kind, **options):
    """The mean color of Cycles' bake of this type onto the low object."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 1, False
    image = bpy.data.images.new("rendered", SIZE, SIZE, float_buffer=True, is_data=True)
    tree = low.active_material.node_tree
    tree.nodes.active = new_node(tree, "ShaderNodeTexImage", image=image)
    bpy.context.view_layer.objects.active = low
    low.select_set(True)
    bpy.ops.object.bake(type=kind, margin=0, **options)
    texels = np.empty(SIZE * SIZE * 4, np.float32)
    image.pixels.foreach_get(texels)
    bpy.data.images.remove(image)
    return texels.reshape(-1, 4)[:, :3].mean(axis=0)


def test_cycles_shows_the_values_of_the_maps():
    material, _, principled = make_material()
    low = make_low(material)
    image = make_image("mask", (0.0, 0.0, 0.0, 0.25))
    base = MapImage(make_image("base", (0.5, 0.25, 0.75, 1.0), "sRGB"), "base_color", "Base Color")
    glow = MapImage(make_image("glow", (0.5, 0.25, 1.0, 1.0)), "emission", "Emission", scale=3.0)
    images = {
        BASE_COLOR.name: base,
        EMISSION.name: glow,
        METALLIC.name: packed(image, "Red"),
        ROUGHNESS.name: packed(image, "Alpha", is_inverted=True),
    }
    assert connect(low, images) == []
    step = 0.5 / 255
    linear = ((np.array((0.5, 0.25, 0.75)) + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(rendered(low, "ROUGHNESS"), 0.75, atol=step)
    np.testing.assert_allclose(rendered(low, "EMIT"), np.array((0.5, 0.25, 1.0)) * 3.0, atol=3.0 * step)
    principled.inputs["Specular IOR Level"].default_value = 0.0  # a specular layer takes light from the color
    np.testing.assert_allclose(rendered(low, "DIFFUSE", pass_filter={"COLOR"}), linear, atol=2.3 * step)


# Random trees

KINDS = [
    *(
        f"ShaderNode{kind}"
        for kind in ("BsdfPrincipled", "BsdfDiffuse", "MixShader", "AddShader", "Emission", "TexImage")
    ),
    *(f"ShaderNode{kind}" for kind in ("NormalMap", "Bump", "SeparateColor", "Math", "Mix", "Displacement", "UVMap")),
    *(f"ShaderNode{kind}" for kind in ("VectorDisplacement", "OutputMaterial", "TexCoord", "RGB", "ValToRGB", "Group")),
    *("ShaderNodeShaderToRGB", "ShaderNodeInvert", "NodeReroute", "NodeFrame"),
]


def random_tree(random):
    material, tree, _ = make_material()
    images = [make_image("Paint"), make_image("Old"), None]
    images[1][MARK] = True
    group = bpy.data.node_groups.new(str(random.choice(["Varnish", "glTF Material Output"])), "ShaderNodeTree")
    group.interface.new_socket("Occlusion", in_out="INPUT", socket_type="NodeSocketFloat")
    for kind in random.choice(KINDS, 20):
        node = new_node(tree, str(kind), mute=bool(random.random() < 0.1))
        if kind == "ShaderNodeTexImage":
            node.image = images[random.integers(3)]
        if kind == "ShaderNodeGroup" and random.random() < 0.7:
            node.node_tree = group
        if random.random() < 0.2:
            node[MARK] = [True, 3][random.integers(2)]
    for _ in range(40):  # Blender makes some sockets again when links change
        outputs = [socket for node in tree.nodes for socket in node.outputs]
        inputs = [socket for node in tree.nodes for socket in node.inputs]
        link = tree.links.new(outputs[random.integers(len(outputs))], inputs[random.integers(len(inputs))])
        if link is not None:
            link.is_muted = bool(random.random() < 0.1)
    return material, tree


@random_cases.seeds(30, fast=2)
def test_random_trees_lose_no_node_and_change_once(seed):
    material, tree = random_tree(np.random.default_rng(seed))
    low, images = make_low(material), every_map()
    before = {node.as_pointer() for node in tree.nodes}
    textures = {node.as_pointer(): node.image for node in tree.nodes if node.bl_idname == "ShaderNodeTexImage"}
    first = connect(low, images)
    nodes, links = nodes_and_links(tree)
    assert before <= nodes
    for node in tree.nodes:
        image = textures.get(node.as_pointer())
        assert image is None or image.name != "Paint" or node.image == image
    again = connect(low, images)
    assert nodes_and_links(tree) == (nodes, links)
    # In a tree with circles, Blender marks some links as invalid that are in none of them.
    assert {note for note in again if "circle" not in note} <= set(first)


@pytest.mark.parametrize("is_last", [True, False])
def test_widened_roughness_replaces_roughness(is_last):
    material, _, shader = make_material()
    images = {one.name: of(one) for one in (ROUGHNESS, WIDENED_ROUGHNESS)[:: 1 if is_last else -1]}
    assert connect(make_low(material), images) == []
    assert source(shader.inputs["Roughness"], "TexImage").image == images[WIDENED_ROUGHNESS.name].image
