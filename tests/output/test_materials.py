# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests how a map is connected in many kinds of node trees."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.output import materials, tree_editing
from tests.support import scenes
from tests.support.shader_nodes import new_node, nodes_and_links
from tests.support.snapshot import difference, snapshot

# Scenes


def make_low(*mats, faces=1, name="Low"):
    """A row of unit squares with two UV layers, of which "Layout" is the render-active one."""
    mesh = bpy.data.meshes.new(name)
    corners = [(x, y, 0) for x in range(faces + 1) for y in (0, 1)]
    mesh.from_pydata(corners, [], [(2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1) for i in range(faces)])
    for layer in ("Layout", "Other"):
        mesh.uv_layers.new(name=layer)
    for material in mats:
        mesh.materials.append(material)
    return scenes.link(bpy.data.objects.new(name, mesh))


def make_material(name="Skin"):
    """A material as Blender makes it, with its Principled BSDF."""
    material = bpy.data.materials.new(name)
    return material, material.node_tree, material.node_tree.nodes["Principled BSDF"]


def make_image(name="Map"):
    return bpy.data.images.new(name, 8, 8, float_buffer=True, is_data=True)


def hook_up(low, image, **values):
    return materials.hook_up(
        low, image, **{"space": "TANGENT", "uv_layer": "Layout", "channels": ("+X", "+Y", "+Z")} | values
    )


# The content of a tree


def source(socket, kind):
    """The node connected to the input `socket`, which must be of this kind."""
    assert len(socket.links) == 1, f"{socket.node.name}.{socket.name} has {len(socket.links)} links"
    node = socket.links[0].from_node
    assert node.bl_idname == kind
    return node


def shown(socket):
    """The Normal Map and the Image Texture connected to a Normal input."""
    normal_map = source(socket, "ShaderNodeNormalMap")
    assert socket.links[0].from_socket.identifier == "Normal"
    texture = source(normal_map.inputs["Color"], "ShaderNodeTexImage")
    assert normal_map.inputs["Color"].links[0].from_socket.identifier == "Color"
    return normal_map, texture


def kinds(tree):
    return sorted(node.bl_idname.removeprefix("ShaderNode") for node in tree.nodes)


# Slots


def test_a_mesh_without_material_gets_one_named_after_it():
    low, image = make_low(name="Rock"), make_image()
    assert hook_up(low, image) == []
    assert [slot.material.name for slot in low.material_slots] == ["Rock"]
    tree = low.active_material.node_tree
    normal_map, texture = shown(tree.nodes["Principled BSDF"].inputs["Normal"])
    assert texture.image == image
    assert (normal_map.space, normal_map.uv_map, normal_map.convention) == ("TANGENT", "Layout", "OPENGL")
    assert kinds(tree) == ["BsdfPrincipled", "NormalMap", "OutputMaterial", "TexImage"]
    assert image[tree_editing.MARK]


def test_empty_slots_are_filled_where_faces_use_them():
    skin, *_ = make_material()
    low, image = make_low(None, skin, None, None, faces=3), make_image()
    low.data.polygons.foreach_set("material_index", [1, 2, 9])  # 9 is past the end: Blender shows the last slot
    assert hook_up(low, image) == []
    names = [slot.material and slot.material.name for slot in low.material_slots]
    assert names == [None, "Skin", "Low", "Low"]
    for material in (skin, bpy.data.materials["Low"]):
        assert shown(material.node_tree.nodes["Principled BSDF"].inputs["Normal"])[1].image == image


def test_a_mesh_without_faces_gets_no_note():
    low = bpy.data.objects.new("Low", bpy.data.meshes.new("Low"))
    assert hook_up(low, make_image()) == []


# Shaders


def test_new_nodes_are_placed_beside_others_and_nothing_else_changes():
    material, tree, principled = make_material()
    tree.nodes.active = principled
    selected = {node.name for node in tree.nodes if node.select}
    frame = new_node(tree, "NodeFrame", location=(-400, -100))  # a frame does not take the place of a node
    frame.select = False
    principled.parent = frame
    crowd = new_node(tree, "ShaderNodeRGB", select=False)  # in the first place for the Normal Map
    crowd.location_absolute = principled.location_absolute.x - 200, principled.location_absolute.y
    assert hook_up(make_low(material), make_image()) == []
    normal_map, texture = shown(principled.inputs["Normal"])
    assert tree.nodes.active == principled
    assert {node.name for node in tree.nodes if node.select} == selected
    assert normal_map.parent == texture.parent == frame
    for node, taker in ((normal_map, principled), (texture, normal_map)):
        assert node[tree_editing.MARK]
        assert node.label.startswith("Imprint")
        assert node.location_absolute.x + node.width < taker.location_absolute.x
        assert node.location_absolute.x > taker.location_absolute.x - 400
    assert normal_map.location_absolute.y == crowd.location_absolute.y - tree_editing.NODE_HEIGHT
    assert abs(texture.location_absolute.y - normal_map.location_absolute.y) < 1


def test_two_mixed_shaders_share_one_normal_map():
    material, tree, principled = make_material()
    glass = new_node(tree, "ShaderNodeBsdfGlass")
    mix, plus, glow = (new_node(tree, f"ShaderNode{kind}") for kind in ("MixShader", "AddShader", "Emission"))
    loose = new_node(tree, "ShaderNodeBsdfDiffuse")
    glass.inputs["Normal"].hide = True  # as Ctrl+H leaves it
    for output, target in (
        (principled.outputs[0], mix.inputs[1]),
        (plus.outputs[0], mix.inputs[2]),
        (glass.outputs[0], plus.inputs[0]),
        (glow.outputs[0], plus.inputs[1]),
        (mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"]),
    ):
        tree.links.new(output, target)
    assert hook_up(make_low(material), make_image()) == []
    assert shown(principled.inputs["Normal"]) == shown(glass.inputs["Normal"])
    assert not glass.inputs["Normal"].hide
    assert not loose.inputs["Normal"].is_linked
    assert not principled.inputs["Coat Normal"].is_linked


def test_shaders_behind_a_muted_mix_and_shader_to_rgb_are_found():
    material, tree, principled = make_material()
    to_rgb, mix = new_node(tree, "ShaderNodeShaderToRGB"), new_node(tree, "ShaderNodeMixShader", mute=True)
    glow = new_node(tree, "ShaderNodeEmission")
    tree.links.new(principled.outputs[0], to_rgb.inputs[0])
    tree.links.new(to_rgb.outputs[0], glow.inputs["Color"])
    tree.links.new(glow.outputs[0], mix.inputs[1])
    tree.links.new(mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    assert hook_up(make_low(material), make_image()) == []
    shown(principled.inputs["Normal"])


def test_outputs_of_both_engines_are_followed():
    material, tree, principled = make_material()
    tree.nodes["Material Output"].target = "CYCLES"
    diffuse, output = (
        new_node(tree, "ShaderNodeBsdfDiffuse"),
        new_node(tree, "ShaderNodeOutputMaterial", target="EEVEE"),
    )
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    assert hook_up(make_low(material), make_image()) == []
    assert shown(principled.inputs["Normal"]) == shown(diffuse.inputs["Normal"])


def make_group(with_normal):
    group = bpy.data.node_groups.new("Varnish", "ShaderNodeTree")
    group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    for name, kind in (("Offset", "Vector"), ("Coat Normal", "Vector"), ("Normal", "Float")):
        group.interface.new_socket(name, in_out="INPUT", socket_type=f"NodeSocket{kind}")
    if with_normal:
        group.interface.new_socket("Normal", in_out="INPUT", socket_type="NodeSocketVector")
    return group


@pytest.mark.parametrize("with_normal", [True, False])
def test_a_group_with_a_normal_input_is_a_shader(with_normal):
    material, tree, _ = make_material()
    node = new_node(tree, "ShaderNodeGroup", node_tree=make_group(with_normal))
    tree.links.new(node.outputs["Shader"], tree.nodes["Material Output"].inputs["Surface"])
    before = nodes_and_links(tree)
    notes = hook_up(make_low(material), make_image())
    if with_normal:
        assert notes == []
        assert [socket.name for socket in node.inputs if socket.is_linked] == ["Normal"]
        shown(node.inputs[-1])
    else:
        assert len(notes) == 2
        assert all('"Skin"' in note for note in notes)
        assert f'"{node.name}"' in notes[0]
        assert nodes_and_links(tree) == before


def test_a_material_without_output_gets_one():
    material, tree, old = make_material()
    tree.nodes.remove(tree.nodes["Material Output"])
    old.location = 500, 100
    (note,) = hook_up(make_low(material), make_image())
    assert "Skin" in note
    assert "Material Output" in note
    output = tree.get_output_node("ALL")
    new = source(output.inputs["Surface"], "ShaderNodeBsdfPrincipled")
    shown(new.inputs["Normal"])
    assert old.location.x + old.width < new.location.x < new.location.x + new.width < output.location.x


def test_a_disabled_normal_input_is_ignored():
    material, tree, principled = make_material()
    principled.inputs["Normal"].enabled = False
    before = nodes_and_links(tree)
    assert len(hook_up(make_low(material), make_image())) == 1
    assert nodes_and_links(tree) == before


def test_a_surface_without_a_normal_input_gets_a_note():
    material, tree, _ = make_material()
    tree.links.new(new_node(tree, "ShaderNodeEmission").outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    before = nodes_and_links(tree)
    (note,) = hook_up(make_low(material), make_image())
    assert "Skin" in note
    assert nodes_and_links(tree) == before


# Nodes connected to the Normal input


def test_the_map_is_connected_below_bump_nodes():
    material, tree, principled = make_material()
    upper, lower = new_node(tree, "ShaderNodeBump"), new_node(tree, "ShaderNodeBump")
    diffuse, mix = new_node(tree, "ShaderNodeBsdfDiffuse"), new_node(tree, "ShaderNodeMixShader")
    tree.links.new(lower.outputs["Normal"], upper.inputs["Normal"])
    tree.links.new(upper.outputs["Normal"], principled.inputs["Normal"])
    tree.links.new(upper.outputs["Normal"], diffuse.inputs["Normal"])
    tree.links.new(principled.outputs[0], mix.inputs[1])
    tree.links.new(diffuse.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    assert hook_up(make_low(material), make_image()) == []
    shown(lower.inputs["Normal"])
    assert source(upper.inputs["Normal"], "ShaderNodeBump") == lower
    assert source(principled.inputs["Normal"], "ShaderNodeBump") == upper
    assert source(diffuse.inputs["Normal"], "ShaderNodeBump") == upper


@pytest.mark.parametrize("color", ["nothing", "no image", "the image", "an older map"])
def test_an_existing_normal_map_without_another_image_is_used(color):
    material, tree, principled = make_material()
    image = make_image()
    normal_map = new_node(tree, "ShaderNodeNormalMap", space="WORLD", convention="DIRECTX", uv_map="Other")
    tree.links.new(normal_map.outputs[0], principled.inputs["Normal"])
    if color != "nothing":
        texture = new_node(tree, "ShaderNodeTexImage")
        tree.links.new(texture.outputs["Color"], normal_map.inputs["Color"])
        if color == "the image":
            texture.image = image
        elif color == "an older map":
            texture.image = make_image("Older")
            texture.image[tree_editing.MARK] = True
    before = nodes_and_links(tree)
    assert hook_up(make_low(material), image) == []
    assert shown(principled.inputs["Normal"])[0] == normal_map
    assert shown(principled.inputs["Normal"])[1].image == image
    assert (normal_map.space, normal_map.uv_map, normal_map.convention) == ("TANGENT", "Layout", "OPENGL")
    if color != "nothing":
        assert nodes_and_links(tree) == before


def test_an_image_of_the_user_stays_in_its_node():
    material, tree, principled = make_material()
    normal_map, texture = new_node(tree, "ShaderNodeNormalMap"), new_node(tree, "ShaderNodeTexImage")
    dot = new_node(tree, "NodeReroute")
    texture.image = foreign = make_image("Scan")
    texture.label = "Pores"
    tree.links.new(texture.outputs["Color"], dot.inputs[0])
    tree.links.new(dot.outputs[0], normal_map.inputs["Color"])
    tree.links.new(dot.outputs[0], principled.inputs["Base Color"])
    tree.links.new(normal_map.outputs[0], principled.inputs["Normal"])
    image = make_image()
    (note,) = hook_up(make_low(material), image)
    assert all(name in note for name in ('"Skin"', f'"{normal_map.name}"', '"Pores"', '"Scan"'))
    assert shown(principled.inputs["Normal"])[0] == normal_map
    assert shown(principled.inputs["Normal"])[1].image == image
    assert texture.image == foreign
    assert source(principled.inputs["Base Color"], "NodeReroute") == dot  # its other links do not change
    assert source(dot.inputs[0], "ShaderNodeTexImage") == texture


@pytest.mark.parametrize("kind", ["Bevel", "VectorMath", "NormalMap muted", "Bump muted", "wire muted"])
def test_other_nodes_at_the_normal_input_do_not_change(kind):
    material, tree, principled = make_material()
    node = new_node(tree, "ShaderNode" + ("NormalMap" if kind == "wire muted" else kind.split()[0]))
    node.mute = kind.endswith("p muted")
    link = tree.links.new(node.outputs[0], principled.inputs["Normal"])
    link.is_muted = kind == "wire muted"
    before = nodes_and_links(tree)
    (note,) = hook_up(make_low(material), make_image())
    assert '"Skin"' in note
    assert f'"{node.name}"' in note
    assert nodes_and_links(tree) == before


def test_other_nodes_below_a_bump_node_do_not_change():
    material, tree, principled = make_material()
    bump, bevel = new_node(tree, "ShaderNodeBump"), new_node(tree, "ShaderNodeBevel")
    tree.links.new(bevel.outputs[0], bump.inputs["Normal"])
    tree.links.new(bump.outputs[0], principled.inputs["Normal"])
    before = nodes_and_links(tree)
    (note,) = hook_up(make_low(material), make_image())
    assert f'"{bevel.name}"' in note
    assert nodes_and_links(tree) == before


@pytest.mark.parametrize("feed", ["RGB", "alpha", "texture muted"])
def test_other_nodes_at_the_color_input_do_not_change(feed):
    material, tree, principled = make_material()
    normal_map = new_node(tree, "ShaderNodeNormalMap", space="WORLD")
    node = new_node(tree, "ShaderNodeRGB" if feed == "RGB" else "ShaderNodeTexImage")
    node.mute = feed.endswith("muted")
    tree.links.new(node.outputs["Alpha" if feed == "alpha" else "Color"], normal_map.inputs["Color"])
    tree.links.new(normal_map.outputs[0], principled.inputs["Normal"])
    before = nodes_and_links(tree)
    (note,) = hook_up(make_low(material), make_image())
    assert all(name in note for name in ('"Skin"', f'"{normal_map.name}"', f'"{node.name}"'))
    assert nodes_and_links(tree) == before
    assert normal_map.space == "WORLD"  # it does not show the map


def test_reroutes_are_followed():
    material, tree, principled = make_material()
    surface, normal, dangling = (new_node(tree, "NodeReroute") for _ in range(3))
    bump = new_node(tree, "ShaderNodeBump")
    tree.links.new(principled.outputs[0], surface.inputs[0])
    tree.links.new(surface.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    tree.links.new(bump.outputs[0], normal.inputs[0])
    tree.links.new(normal.outputs[0], principled.inputs["Normal"])
    tree.links.new(dangling.outputs[0], bump.inputs["Normal"])
    assert hook_up(make_low(material), make_image()) == []
    assert source(bump.inputs["Normal"], "NodeReroute") == dangling
    shown(dangling.inputs[0])


@pytest.mark.parametrize("kind", ["NodeReroute", "ShaderNodeBump"])
@pytest.mark.parametrize("count", [1, 3])
def test_a_circle_of_links_does_not_change(kind, count):
    material, tree, principled = make_material()
    nodes = [new_node(tree, kind) for _ in range(count)]
    for node, after in zip(nodes, nodes[1:] + nodes[:1], strict=True):
        tree.links.new(node.outputs[0], after.inputs[-1])
    tree.links.new(nodes[0].outputs[0], principled.inputs["Normal"])
    before = nodes_and_links(tree)
    (note,) = hook_up(make_low(material), make_image())
    assert '"Skin"' in note
    assert "circle" in note
    assert nodes_and_links(tree) == before


def test_shaders_in_a_circle_are_visited_once():
    material, tree, principled = make_material()
    first, second = new_node(tree, "ShaderNodeAddShader"), new_node(tree, "ShaderNodeAddShader")
    tree.links.new(first.outputs[0], second.inputs[0])
    tree.links.new(second.outputs[0], first.inputs[0])
    tree.links.new(principled.outputs[0], first.inputs[1])
    tree.links.new(second.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    assert hook_up(make_low(material), make_image()) == []
    shown(principled.inputs["Normal"])


# Settings


@pytest.mark.parametrize("space", ["TANGENT", "OBJECT", "WORLD"])
@pytest.mark.parametrize(("green", "convention"), [("+Y", "OPENGL"), ("-Y", "DIRECTX")])
def test_the_normal_map_has_the_space_and_convention(space, green, convention):
    material, _, principled = make_material()
    hook_up(make_low(material), make_image(), space=space, channels=("+X", green, "+Z"))
    normal_map, _ = shown(principled.inputs["Normal"])
    uv_map = "Layout" if space == "TANGENT" else ""
    assert (normal_map.space, normal_map.convention, normal_map.uv_map) == (space, convention, uv_map)


def test_another_uv_layer_gets_one_uv_map_node():
    material, tree, principled = make_material()
    low, image = make_low(material), make_image()
    hook_up(low, image)
    texture = shown(principled.inputs["Normal"])[1]
    assert not texture.inputs["Vector"].is_linked

    assert hook_up(low, image, uv_layer="Other") == []
    uv_map = source(texture.inputs["Vector"], "ShaderNodeUVMap")
    assert uv_map.uv_map == shown(principled.inputs["Normal"])[0].uv_map == "Other"

    before = nodes_and_links(tree)
    assert hook_up(low, image) == []
    assert uv_map.uv_map == shown(principled.inputs["Normal"])[0].uv_map == "Layout"
    assert nodes_and_links(tree) == before


def test_the_default_layer_is_the_render_active_one_not_the_active_one():
    material, _, principled = make_material()
    low, image = make_low(material), make_image()
    low.data.uv_layers.active = low.data.uv_layers["Other"]
    assert low.data.uv_layers["Layout"].active_render
    hook_up(low, image)
    vector = shown(principled.inputs["Normal"])[1].inputs["Vector"]
    assert not vector.is_linked
    hook_up(low, image, uv_layer="Other")
    assert source(vector, "ShaderNodeUVMap").uv_map == "Other"


@pytest.mark.parametrize("uv_map", ["Layout", "", "Other"])
def test_a_uv_map_node_of_the_user_is_used_if_it_has_the_layer(uv_map):
    material, tree, principled = make_material()
    normal_map, texture = new_node(tree, "ShaderNodeNormalMap"), new_node(tree, "ShaderNodeTexImage")
    existing = new_node(tree, "ShaderNodeUVMap", uv_map=uv_map)
    tree.links.new(existing.outputs[0], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], normal_map.inputs["Color"])
    tree.links.new(normal_map.outputs[0], principled.inputs["Normal"])
    notes = hook_up(make_low(material), make_image())
    assert existing.uv_map == uv_map
    if uv_map == "Other":
        (note,) = notes
        assert all(name in note for name in ('"Skin"', '"Other"', f'"{existing.name}"'))
        assert source(texture.inputs["Vector"], "ShaderNodeUVMap").uv_map == "Layout"
    else:
        assert notes == []
        assert source(texture.inputs["Vector"], "ShaderNodeUVMap") == existing


@pytest.mark.parametrize(
    ("output", "layer", "plain"), [("UV", "Layout", 1), ("UV", "Other", 0), ("Object", "Layout", 0)]
)
def test_other_texture_coordinates_do_not_change(output, layer, plain):
    material, tree, principled = make_material()
    normal_map, texture = new_node(tree, "ShaderNodeNormalMap"), new_node(tree, "ShaderNodeTexImage")
    coordinates = new_node(tree, "ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs[output], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], normal_map.inputs["Color"])
    tree.links.new(normal_map.outputs[0], principled.inputs["Normal"])
    before = nodes_and_links(tree)
    notes = hook_up(make_low(material), make_image(), uv_layer=layer)
    assert nodes_and_links(tree) == before
    assert len(notes) == ((output, layer) != ("UV", "Layout"))
    assert all(f'"{coordinates.name}"' in note for note in notes)


# Baking again


def test_baking_again_changes_no_link():
    material, tree, principled = make_material()
    diffuse, mix, bump = (new_node(tree, f"ShaderNode{kind}") for kind in ("BsdfDiffuse", "MixShader", "Bump"))
    tree.links.new(principled.outputs[0], mix.inputs[1])
    tree.links.new(diffuse.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    tree.links.new(bump.outputs[0], diffuse.inputs["Normal"])
    low = make_low(material)
    hook_up(low, make_image("First"), uv_layer="Other")
    before = nodes_and_links(tree)
    for name in ("Second", "Third"):
        assert hook_up(low, make_image(name), uv_layer="Other", space="OBJECT") == []
        assert nodes_and_links(tree) == before
        assert shown(principled.inputs["Normal"])[1].image.name == name
        assert shown(bump.inputs["Normal"])[0].space == "OBJECT"


def test_baking_again_into_the_same_image_leaves_the_material_untouched():
    """An update, even one that changes nothing, would make the viewport compile the material again."""
    low, image = make_low(), make_image()
    hook_up(low, image, uv_layer="Other")
    bpy.context.view_layer.update()
    touched = []

    def note_materials(_, depsgraph):
        touched.extend(update.id.name for update in depsgraph.updates if isinstance(update.id, bpy.types.Material))

    bpy.app.handlers.depsgraph_update_post.append(note_materials)
    hook_up(low, image, uv_layer="Other")
    bpy.context.view_layer.update()
    assert touched == []
    hook_up(low, image, uv_layer="Layout")
    bpy.context.view_layer.update()
    bpy.app.handlers.depsgraph_update_post.remove(note_materials)
    assert touched == ["Low"]


def test_a_muted_node_of_imprint_is_not_used_elsewhere():
    material, tree, principled = make_material()
    low = make_low(material)
    hook_up(low, make_image())
    muted, texture = shown(principled.inputs["Normal"])
    muted.mute = True
    diffuse = new_node(tree, "ShaderNodeBsdfDiffuse")
    plus = new_node(tree, "ShaderNodeAddShader")
    tree.links.new(principled.outputs[0], plus.inputs[0])
    tree.links.new(diffuse.outputs[0], plus.inputs[1])
    tree.links.new(plus.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    (note,) = hook_up(low, make_image())
    assert f'"{muted.label}", muted' in note
    normal_map, used = shown(diffuse.inputs["Normal"])
    assert normal_map != muted
    assert used == texture


def test_removed_links_are_restored_with_the_existing_nodes():
    material, tree, principled = make_material()
    low, image = make_low(material), make_image()
    hook_up(low, image, uv_layer="Other")
    nodes, _ = nodes_and_links(tree)
    for socket in [link.to_socket for link in tree.links if link.to_socket.name in ("Normal", "Color", "Vector")]:
        tree.links.remove(socket.links[0])
    assert hook_up(low, image, uv_layer="Other") == []
    assert nodes_and_links(tree)[0] == nodes
    shown(principled.inputs["Normal"])


def test_an_image_that_the_user_puts_into_imprints_node_stays():
    material, tree, principled = make_material()
    low, image = make_low(material), make_image()
    hook_up(low, image)
    texture = shown(principled.inputs["Normal"])[1]
    texture.image = existing = make_image("Scan")
    (note,) = hook_up(low, image)
    assert '"Scan"' in note
    assert texture.image == existing
    assert shown(principled.inputs["Normal"])[1].image == image
    assert kinds(tree).count("TexImage") == 2


# Materials of other objects


def test_a_shared_material_gets_a_note():
    material, *_ = make_material()
    low = make_low(material)
    for name in "ABCD":
        make_low(material, name=name)
    deleted = make_low(material, name="E")
    bpy.context.collection.objects.unlink(deleted)
    (note,) = hook_up(low, make_image())
    assert low.active_material == material
    assert all(name in note for name in ('"Skin"', '"A"', '"B"', '"C"', "4 other objects"))
    assert '"D"' not in note
    assert '"Low"' not in note


def test_single_user_copies_a_shared_material_once():
    material, tree, _ = make_material()
    coat, *_ = make_material("Coat")
    low, other = make_low(material, coat, material), make_low(material, material, name="Other")
    before = nodes_and_links(tree)
    (note,) = hook_up(low, make_image(), single_user=True)
    copy = low.material_slots[0].material
    assert copy != material
    assert [slot.material for slot in low.material_slots] == [copy, coat, copy]
    assert other.active_material == material
    assert nodes_and_links(tree) == before
    assert f'"{copy.name}"' in note
    assert "1 other object (" in note
    assert '"Other"' in note
    shown(copy.node_tree.nodes["Principled BSDF"].inputs["Normal"])
    assert {slot.link for slot in low.material_slots} == {"DATA"}  # no other object uses the mesh

    assert hook_up(low, make_image(), single_user=True) == []
    assert low.active_material == copy


def test_single_user_on_a_shared_mesh_moves_the_slot_to_the_object():
    material, *_ = make_material()
    low = make_low(material)
    twin = scenes.link(bpy.data.objects.new("Twin", low.data))
    (note,) = hook_up(low, make_image(), single_user=True)
    assert '"Twin"' in note
    assert low.material_slots[0].link == "OBJECT"
    assert low.material_slots[0].material != material
    assert twin.material_slots[0].material == material == low.data.materials[0]


@pytest.mark.parametrize("slots", [0, 1])
@pytest.mark.parametrize("single_user", [False, True])
def test_a_new_material_on_a_shared_mesh(single_user, slots):
    low = make_low(*[None] * slots)
    twin = scenes.link(bpy.data.objects.new("Twin", low.data))
    notes = hook_up(low, make_image(), single_user=single_user)
    assert low.material_slots[0].material
    if single_user:
        assert notes == []
        assert twin.material_slots[0].material is None
    else:
        assert '"Twin"' in notes[0]
        assert twin.material_slots[0].material == low.material_slots[0].material


# Libraries


def link(tmp_path, datablock, kind):
    """Write a datablock into a library, open an empty file, and link it from there."""
    name, path = datablock.name, str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {datablock}, fake_user=True)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        setattr(wanted, kind, [name])
    linked = getattr(bpy.data, kind)[name]
    assert linked.library
    return linked


def overridden(linked):
    """A library override of a datablock, which something of the file has to use: Blender 5.3 makes none of others."""
    bpy.context.scene["uses"] = linked
    return linked.override_create()


@pytest.mark.parametrize("override", [False, True])
@pytest.mark.parametrize("single_user", [False, True])
def test_a_linked_material(tmp_path, single_user, override):
    material = link(tmp_path, make_material()[0], "materials")
    if override:
        material = overridden(material)
    low = make_low(material)
    materials.check(low)
    before = nodes_and_links(material.node_tree)
    (note,) = hook_up(low, make_image(), single_user=single_user)
    assert '"Skin"' in note
    assert "library" in note
    assert nodes_and_links(material.node_tree) == before
    if single_user:
        copy = low.active_material
        assert not copy.library
        assert not copy.override_library
        shown(copy.node_tree.nodes["Principled BSDF"].inputs["Normal"])
    else:
        assert low.active_material == material


def test_a_linked_low_is_refused(tmp_path):
    low = link(tmp_path, make_low(make_material()[0]), "objects")
    with pytest.raises(BakeError, match='"Low".*library'):
        materials.check(low)


def test_a_linked_mesh_without_slots_is_refused(tmp_path):
    mesh = link(tmp_path, make_low().data, "meshes")
    with pytest.raises(BakeError, match='mesh "Low".*library'):
        materials.check(bpy.data.objects.new("Local", mesh))


@pytest.mark.parametrize("single_user", [False, True])
@pytest.mark.parametrize("is_filled", [False, True])
def test_a_linked_mesh_with_slots_takes_materials_on_the_object(tmp_path, is_filled, single_user):
    mesh = link(tmp_path, make_low(make_material()[0] if is_filled else None).data, "meshes")
    low, image = bpy.data.objects.new("Local", mesh), make_image()
    materials.check(low)
    notes = hook_up(low, image, single_user=single_user)
    if is_filled and not single_user:
        assert low.active_material.library
    else:
        assert low.material_slots[0].link == "OBJECT"
        assert shown(low.active_material.node_tree.nodes["Principled BSDF"].inputs["Normal"])[1].image == image
    assert len(notes) == is_filled


def test_an_override_of_low_takes_materials(tmp_path):
    linked = link(tmp_path, make_low(make_material()[0]), "objects")
    low = overridden(linked)
    materials.check(low)
    hook_up(low, make_image(), single_user=True)
    assert not low.active_material.library
    shown(low.active_material.node_tree.nodes["Principled BSDF"].inputs["Normal"])


def test_check_accepts_editable_objects_and_changes_nothing():
    objects = [make_low(), make_low(None), make_low(make_material()[0])]
    before = snapshot()
    for low in objects:
        materials.check(low)
    assert difference(before, snapshot()) == {}


# Bakes with Cycles show the normal of the map

TILTED = (0.48, 0.36, 0.8)
CYCLES_TOLERANCE = 1e-4  # single precision, read back from a float image


def normal_in_cycles(low):
    """The object-space normal that the material shows on low, as Cycles bakes it into its middle texel."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", 1
    scene.render.bake.normal_space = "OBJECT"
    tree, target = low.active_material.node_tree, make_image("Target")
    tree.nodes.active = new_node(tree, "ShaderNodeTexImage", image=target)
    bpy.context.view_layer.objects.active = low
    low.select_set(True)
    bpy.ops.object.bake(type="NORMAL", margin=0)
    return np.array(target.pixels).reshape(8, 8, 4)[4, 4, :3] * 2 - 1


@pytest.mark.parametrize("space", ["TANGENT", "OBJECT", "WORLD"])
@pytest.mark.parametrize("green", ["+Y", "-Y"])
def test_cycles_shows_the_normal_of_the_map(space, green):
    low, image = make_low(), make_image()
    stored = np.array([TILTED[0], TILTED[1] if green == "+Y" else -TILTED[1], TILTED[2]]) * 0.5 + 0.5
    image.pixels = np.tile([*stored, 1.0], 64)
    assert hook_up(low, image, space=space, channels=("+X", green, "+Z")) == []
    np.testing.assert_allclose(normal_in_cycles(low), TILTED, atol=CYCLES_TOLERANCE)


def test_cycles_reads_the_uv_layer_that_was_baked():
    low, image = make_low(), make_image()
    pixels = np.tile(np.array([*np.array(TILTED) * 0.5 + 0.5, 1.0]), (8, 8, 1))
    pixels[:, 4:] = (0.5, 0.5, 1.0, 1.0)  # flat normals, where layer "Other" has no faces
    image.pixels = pixels.ravel()
    for corner in low.data.uv_layers["Other"].data:
        corner.uv.x *= 0.25
    assert hook_up(low, image, uv_layer="Other") == []
    np.testing.assert_allclose(normal_in_cycles(low), TILTED, atol=CYCLES_TOLERANCE)
