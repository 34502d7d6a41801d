# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes, each with one thing that renders see otherwise than the viewport, or one kind of object or instance.

Each function builds a scene and returns its high objects.
"""

import math
import tempfile
from collections.abc import Callable
from pathlib import Path

import bpy

from tests.support import scenes, zoo
from tests.support.geometry_nodes import Tree, set_material

SCENES: dict[str, Callable[[], list[bpy.types.Object]]] = {}
SLOW: set[str] = set()
"""Scenes whose kind others of them check, too."""


def scene(make):
    SCENES[make.__name__] = make
    return make


def slow(make):
    SLOW.add(make.__name__)
    return scene(make)


# Parts


def collection(name, *objects, parent=None):
    """A collection of these objects alone, in the scene's or in another one; in none for False."""
    made = bpy.data.collections.new(name)
    if parent is not False:
        (parent or bpy.context.scene.collection).children.link(made)
    for obj in objects:
        for other in list(obj.users_collection):
            other.objects.unlink(obj)
        made.objects.link(obj)
    return made


def empty(name, shown=None):
    """An empty, which shows a collection."""
    obj = scenes.link(bpy.data.objects.new(name, None))
    if shown is not None:
        obj.instance_type, obj.instance_collection = "COLLECTION", shown
    return obj


def subdivided(name, viewport=0, render=2):
    obj = zoo.plane(name)
    modifier = obj.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.render_levels = viewport, render
    return obj


def layer_of(shown):
    return bpy.context.view_layer.layer_collection.children[shown.name]


def simplify(**values):
    render = bpy.context.scene.render
    render.use_simplify = True
    for name, value in values.items():
        setattr(render, f"simplify_{name}", value)


# Levels and resolutions


@scene
def subdivision():
    return [subdivided("high")]


@slow
def subdivision_with_more_in_the_viewport():
    return [subdivided("high", 3, 1)]


@scene
def simplify_in_the_viewport():
    simplify(subdivision=0, subdivision_render=6)
    return [subdivided("high", 2, 2)]


@slow
def simplify_in_renders():
    simplify(subdivision=6, subdivision_render=1)
    return [subdivided("high", 3, 3)]


def multires(name):
    obj = scenes.select(zoo.plane(name))
    modifier = obj.modifiers.new("Multires", "MULTIRES")
    for _ in range(3):
        bpy.ops.object.multires_subdivide(modifier=modifier.name, mode="SIMPLE")
    modifier.levels, modifier.render_levels = 1, 3
    return obj


@scene
def multires_levels():
    return [multires("high")]


@slow
def multires_under_simplify():
    simplify(subdivision=0, subdivision_render=2)
    return [multires("high")]


@scene
def screw():
    data = bpy.data.meshes.new("high")
    data.from_pydata([(0.2, 0.0, 0.0), (0.9, 0.0, 0.1)], [(0, 1)], [])
    obj = scenes.link(bpy.data.objects.new("high", data))
    modifier = obj.modifiers.new("Screw", "SCREW")
    modifier.steps, modifier.render_steps = 4, 16
    return [obj]


def curve_object(**values):
    data = bpy.data.curves.new("curve", "CURVE")
    data.resolution_u, data.render_resolution_u = 1, 8
    for name, value in values.items():
        setattr(data, name, value)
    spline = data.splines.new("BEZIER")
    spline.bezier_points.add(3)
    for number, point in enumerate(spline.bezier_points):
        angle = math.pi * number / 2.0
        point.co = (0.6 * math.cos(angle), 0.6 * math.sin(angle), 0.0)
        point.handle_left_type = point.handle_right_type = "AUTO"
    spline.use_cyclic_u = True
    return scenes.link(bpy.data.objects.new("high", data))


@scene
def filled_curve():
    return [curve_object(dimensions="2D", fill_mode="BOTH")]


@slow
def curve_with_a_bevel():
    return [curve_object(dimensions="3D", bevel_depth=0.1, bevel_resolution=2)]


@slow
def curve_with_modifiers():
    obj = curve_object(dimensions="2D", fill_mode="BOTH")
    modifier = obj.modifiers.new("Solidify", "SOLIDIFY")
    modifier.show_viewport = False
    return [obj]


@scene
def text():
    data = bpy.data.curves.new("text", "FONT")
    data.body, data.resolution_u, data.render_resolution_u = "O", 1, 6
    return [scenes.link(bpy.data.objects.new("high", data))]


def metaball(name, x, **values):
    data = bpy.data.metaballs.new(name)
    data.resolution, data.render_resolution = 0.5, 0.25
    data.elements.new().co = (x, 0.0, 0.0)
    obj = scenes.link(bpy.data.objects.new(name, data))
    for key, value in values.items():
        setattr(obj, key, value)
    return obj


@scene
def metaballs():
    return [metaball("high", 0.0)]


@scene
def a_family_of_metaballs():
    high = metaball("high", 0.0)
    metaball("high.001", 1.0)
    return [high]


@slow
def a_family_of_metaballs_with_one_in_a_hidden_collection():
    high = metaball("high", 0.0)
    collection("hidden", metaball("high.001", 1.0)).hide_render = True
    return [high]


@slow
def a_family_of_metaballs_with_a_hidden_one():
    high = metaball("high", 0.0)
    metaball("high.001", 1.0, hide_render=True)
    metaball("high.002", -1.0, hide_viewport=True)
    return [high]


@scene
def nurbs_surface():
    bpy.ops.surface.primitive_nurbs_surface_sphere_add()
    obj = bpy.context.object
    obj.name = "high"
    obj.data.resolution_u = obj.data.resolution_v = 1
    obj.data.render_resolution_u = obj.data.render_resolution_v = 3
    return [obj]


@scene
def ocean():
    obj = zoo.plane("high")
    modifier = obj.modifiers.new("Ocean", "OCEAN")
    modifier.viewport_resolution, modifier.resolution = 2, 3
    return [obj]


# Nodes


@scene
def is_viewport_node():
    obj = zoo.plane("high")
    tree = Tree(obj)
    fine = tree.add("GeometryNodeSubdivideMesh", {0: tree.geometry, 1: 2})
    inputs = {0: tree.add("GeometryNodeIsViewport"), 1: fine, 2: tree.geometry}
    tree.end(tree.add("GeometryNodeSwitch", inputs, input_type="GEOMETRY"))
    return [obj]


@scene
def object_info():
    obj = zoo.plane("high")
    tree = Tree(obj)
    tree.end(tree.object(subdivided("part")))
    return [obj]


@slow
def object_info_as_an_instance():
    obj = zoo.plane("high")
    tree = Tree(obj)
    tree.end(tree.object(subdivided("part"), as_instance=True))
    return [obj]


@scene
def object_info_of_an_object_that_renders_hide():
    high = object_info()
    bpy.data.objects["part"].hide_render = True
    return high


@scene
def collection_info_with_a_hidden_member():
    obj, hidden = zoo.plane("high"), subdivided("hidden")
    hidden.hide_render = True
    kit = collection("kit", subdivided("part"), hidden)
    tree = Tree(obj)
    tree.end(tree.add("GeometryNodeCollectionInfo", {"Collection": kit}))
    return [obj]


@slow
def instances_with_materials_of_nodes():
    obj = zoo.plane("high")
    tree = Tree(obj)
    shown = tree.add(
        "GeometryNodeSetMaterial", {"Geometry": tree.object(subdivided("part")), "Material": scenes.material("red")}
    )
    tree.end(tree.add("GeometryNodeInstanceOnPoints", {"Points": tree.geometry, "Instance": shown}))
    return [obj]


@scene
def instances_of_an_object_with_materials():
    obj, part = zoo.plane("high"), subdivided("part")
    scenes.material("own", part)
    tree = Tree(obj)
    shown = tree.object(part, as_instance=True)
    on_points = tree.add("GeometryNodeInstanceOnPoints", {"Points": tree.geometry, "Instance": shown})
    tree.end(tree.add("GeometryNodeJoinGeometry", {"Geometry": [on_points, tree.geometry]}))
    return [obj]


@scene
def materials_of_nodes():
    obj = zoo.plane("high", 2)
    scenes.material("own", obj)
    set_material(obj, scenes.material("red"), first=2)
    return [obj]


@slow
def realized_parts_with_materials():
    obj, part = zoo.plane("high"), subdivided("part")
    scenes.material("own", obj)
    scenes.material("other", part)
    tree = Tree(obj)
    real = tree.add("GeometryNodeRealizeInstances", {"Geometry": tree.object(part, as_instance=True)})
    tree.end(tree.add("GeometryNodeJoinGeometry", {"Geometry": [tree.geometry, real]}))
    return [obj]


@slow
def scene_time_node():
    bpy.context.scene.frame_set(7, subframe=0.25)
    obj = zoo.plane("high")
    tree = Tree(obj)
    time = tree.add("GeometryNodeInputSceneTime").node.outputs["Frame"]
    offset = tree.add("ShaderNodeCombineXYZ", {"Z": time})
    tree.end(tree.add("GeometryNodeSetPosition", {"Geometry": tree.geometry, "Offset": offset}))
    return [obj]


@slow
def self_object_node():
    obj = zoo.plane("high")
    obj.location.z = 0.5
    tree = Tree(obj)
    info = tree.add("GeometryNodeObjectInfo", {"Object": tree.add("GeometryNodeSelfObject")}).node
    offset = info.outputs["Location"]
    tree.end(tree.add("GeometryNodeSetPosition", {"Geometry": tree.geometry, "Offset": offset}))
    return [obj]


# Modifiers


def with_operand(**values):
    obj, operand = zoo.cube("high"), zoo.ball("operand", 4)
    operand.location.x = 1.0
    levels = operand.modifiers.new("Subdivision", "SUBSURF")
    levels.levels, levels.render_levels = 0, 1
    scenes.material("inside", operand)
    boolean = obj.modifiers.new("Boolean", "BOOLEAN")
    boolean.object, boolean.solver = operand, "EXACT"
    for name, value in values.items():
        setattr(operand, name, value)
    return [obj]


@scene
def boolean():
    return with_operand()


@scene
def boolean_with_a_hidden_operand():
    return with_operand(hide_render=True, display_type="WIRE")


@slow
def boolean_with_a_collection():
    (obj,) = with_operand()
    modifier = obj.modifiers[0]
    modifier.operand_type, modifier.collection = "COLLECTION", collection("cutters", bpy.data.objects["operand"])
    return [obj]


def solidified(name, **values):
    obj = zoo.plane(name)
    modifier = obj.modifiers.new("Solidify", "SOLIDIFY")
    for key, value in values.items():
        setattr(modifier, key, value)
    return obj


@scene
def a_modifier_for_renders_alone():
    return [solidified("high", show_viewport=False)]


@scene
def a_modifier_for_the_viewport_alone():
    return [solidified("high", show_render=False)]


@slow
def materials_of_solidify():
    obj = solidified("high", material_offset=1, material_offset_rim=2)
    for name in ("top", "bottom", "rim"):
        scenes.material(name, obj)
    return [obj]


@slow
def decimate_above_subdivision():
    obj = subdivided("high", 1, 3)
    obj.modifiers.new("Decimate", "DECIMATE").ratio = 0.5
    return [obj]


@slow
def remesh_above_subdivision():
    obj = zoo.cube("high")
    obj.modifiers.new("Subdivision", "SUBSURF").levels = 0
    remesh = obj.modifiers.new("Remesh", "REMESH")
    remesh.mode, remesh.voxel_size = "VOXEL", 0.5
    return [obj]


@slow
def array_as_far_as_an_object():
    obj = zoo.plane("high")
    array = obj.modifiers.new("Array", "ARRAY")
    array.use_relative_offset, array.use_object_offset, array.offset_object = False, True, empty("offset")
    bpy.data.objects["offset"].location = (3.0, 1.0, 0.5)
    return [obj]


@slow
def a_driver_of_levels():
    obj = subdivided("high")
    driver = obj.modifiers[0].driver_add("render_levels").driver
    driver.expression = "frame"
    bpy.context.scene.frame_set(3)
    return [obj]


@scene
def a_driver_by_a_property_of_the_scene():
    bpy.context.scene["detail"] = 3
    obj = subdivided("high")
    driver = obj.modifiers[0].driver_add("render_levels").driver
    variable = driver.variables.new()
    variable.type = "CONTEXT_PROP"
    variable.targets[0].data_path = '["detail"]'
    driver.expression = variable.name
    return [obj]


@slow
def wave():
    obj = zoo.plane("high", 8)
    obj.modifiers.new("Wave", "WAVE")
    bpy.context.scene.frame_set(12, subframe=0.5)
    return [obj]


@slow
def build_at_a_frame():
    obj = zoo.plane("high", 4)
    obj.modifiers.new("Build", "BUILD").frame_duration = 20
    bpy.context.scene.frame_set(9)
    return [obj]


# Deformation and transforms


@slow
def shape_keys():
    obj = zoo.plane("high")
    obj.shape_key_add(name="Basis")
    obj.shape_key_add(name="Up").points[0].co.z = 1.0
    obj.data.shape_keys.key_blocks["Up"].value = 0.5
    return [obj]


@scene
def a_shape_key_that_is_pinned():
    (obj,) = shape_keys()
    obj.show_only_shape_key, obj.active_shape_key_index = True, 1
    return [obj]


@slow
def an_armature():
    obj, data = zoo.plane("high", 2), bpy.data.armatures.new("rig")
    rig = scenes.select(scenes.link(bpy.data.objects.new("rig", data)))
    bpy.ops.object.mode_set(mode="EDIT")
    data.edit_bones.new("bone").tail = (0.0, 0.0, 1.0)
    bpy.ops.object.mode_set(mode="OBJECT")
    scenes.weigh(obj, "bone", 1.0)
    obj.modifiers.new("Armature", "ARMATURE").object = rig
    rig.pose.bones["bone"].location.x = 0.4
    return [obj]


@slow
def a_mirrored_object_of_uneven_scale():
    obj = subdivided("high")
    obj.scale, obj.rotation_euler = (-1.0, 2.0, 0.5), (0.3, 0.2, 0.1)
    return [obj]


@slow
def an_animated_object_at_a_subframe():
    obj = subdivided("high")
    for frame in (1, 11):
        obj.location.z = frame
        obj.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(4, subframe=0.5)
    return [obj]


@slow
def constraints_and_parents():
    obj, target = subdivided("high"), empty("target")
    target.location = (0.5, 0.0, 1.0)
    obj.parent = empty("parent")
    obj.parent.rotation_euler.x = 0.4
    obj.constraints.new("COPY_LOCATION").target = target
    return [obj]


# Visibility


@scene
def hidden_in_renders():
    obj = subdivided("high")
    obj.hide_render = True
    return [obj]


@slow
def hidden_in_the_viewport():
    obj = subdivided("high")
    obj.hide_viewport = True
    return [obj]


@scene
def moved_while_the_viewport_hides_it():
    obj = subdivided("high")
    obj.parent = empty("parent")
    obj.hide_viewport = True
    bpy.context.view_layer.update()
    obj.parent.location.z = 0.5
    return [obj]


@slow
def hidden_by_the_eye():
    obj = subdivided("high")
    obj.hide_set(True)
    return [obj]


@scene
def in_an_excluded_collection():
    obj = subdivided("high")
    layer_of(collection("excluded", obj)).exclude = True
    return [obj]


@slow
def in_a_collection_that_renders_hide():
    obj = subdivided("high")
    collection("hidden", obj).hide_render = True
    return [obj]


def kit_with(**values):
    """An instanced kit of a part and of another one with these properties."""
    part, other = subdivided("part"), subdivided("other")
    other.location.z = 0.5
    scenes.material("steel", other)
    for name, value in values.items():
        setattr(other, name, value)
    return [empty("high", collection("kit", part, other, parent=False))]


@scene
def a_kit_with_a_member_that_renders_hide():
    return kit_with(hide_render=True)


@scene
def a_kit_with_a_member_that_the_viewport_hides():
    return kit_with(hide_viewport=True)


@slow
def a_kit_in_an_excluded_collection():
    high = kit_with()
    layer_of(collection("excluded", *high)).exclude = True
    return high


@scene
def a_kit_that_renders_hide():
    high = kit_with()
    high[0].hide_render = True
    return high


@scene
def a_kit_with_a_hidden_collection():
    kit = collection("kit", subdivided("part"), parent=False)
    collection("cutters", subdivided("cutter"), parent=kit).hide_render = True
    return [empty("high", kit)]


@slow
def a_kit_with_a_collection_that_the_viewport_hides():
    kit = collection("kit", subdivided("part"), parent=False)
    collection("parts", subdivided("other"), parent=kit).hide_viewport = True
    return [empty("high", kit)]


@scene
def kits_in_kits_with_hidden_members():
    inner = collection("inner", subdivided("part"), subdivided("hidden"), parent=False)
    bpy.data.objects["hidden"].hide_render = True
    shown, left_out = empty("shown", inner), empty("left out", inner)
    shown.location.x, left_out.location.x, left_out.hide_render = 3.0, 6.0, True
    return [empty("high", collection("outer", shown, left_out, parent=False))]


@slow
def a_kit_whose_members_are_in_the_scene_too():
    part, other = subdivided("part"), subdivided("other")
    other.hide_render = True
    return [empty("high", collection("kit", part, other))]


@slow
def a_kit_of_curves_and_text():
    curve = curve_object(dimensions="2D", fill_mode="BOTH")
    curve.name = "curve"
    data = bpy.data.curves.new("text", "FONT")
    data.body, data.resolution_u, data.render_resolution_u = "o", 1, 4
    return [empty("high", collection("kit", curve, scenes.link(bpy.data.objects.new("text", data)), parent=False))]


# Instances


def emitter(**values):
    obj = zoo.plane("high", 2)
    settings = obj.modifiers.new("Particles", "PARTICLE_SYSTEM").particle_system.settings
    settings.count, settings.frame_start, settings.frame_end = 20, 1, 1
    settings.physics_type, settings.render_type = "NO", "OBJECT"
    for name, value in values.items():
        setattr(settings, name, value)
    bpy.context.scene.frame_set(1)
    return obj


@scene
def particles_of_which_the_viewport_shows_some():
    return [emitter(instance_object=subdivided("part"), display_percentage=20)]


@slow
def particles_of_an_object_that_renders_hide():
    part = zoo.plane("part")  # renders show its own mesh, without modifiers
    part.hide_render = True
    return [emitter(instance_object=part)]


@scene
def particles_of_a_collection_with_a_hidden_member():
    part, other = subdivided("part"), subdivided("other")
    other.hide_render = True
    kit = collection("kit", part, other)
    return [emitter(render_type="COLLECTION", instance_collection=kit, use_whole_collection=True, count=5)]


def hair(**values):
    part = zoo.plane("part")
    hairs = {"type": "HAIR", "use_advanced_hair": True, "physics_type": "NEWTON", "hair_length": 2.0}
    return [emitter(**hairs, instance_object=part, count=6, **values)]


@slow
def children_of_particles():
    return hair(child_type="SIMPLE", child_percent=2, rendered_child_count=5)


@slow
def children_of_particles_under_simplify():
    simplify(child_particles=0.0, child_particles_render=1.0)
    return hair(child_type="SIMPLE", child_percent=4, rendered_child_count=4)


@slow
def an_emitter_that_renders_do_not_show():
    obj = emitter(instance_object=subdivided("part"))
    obj.show_instancer_for_render = False
    return [obj]


@slow
def an_emitter_that_the_viewport_does_not_show():
    obj = emitter(instance_object=subdivided("part"))
    obj.show_instancer_for_viewport = False
    return [obj]


def parent_of(*children, kind="VERTS"):
    obj = zoo.plane("high")
    obj.instance_type = kind
    for child in children:
        child.parent = obj
    return obj


@scene
def instances_on_vertices():
    return [parent_of(subdivided("part"))]


@scene
def instances_on_faces_with_a_hidden_child():
    hidden = zoo.cube("hidden")
    hidden.hide_render = True
    obj = parent_of(subdivided("part"), hidden, kind="FACES")
    obj.use_instance_faces_scale = True
    return [obj]


@slow
def instances_on_vertices_with_a_child_in_a_hidden_collection():
    other = zoo.cube("other")
    obj = parent_of(subdivided("part"), other)
    collection("hidden", other).hide_render = True
    return [obj]


@slow
def instances_on_vertices_in_a_kit():
    part = subdivided("part")
    obj = parent_of(part)
    obj.name = "inner"
    return [empty("high", collection("kit", obj, part))]


@slow
def copies_by_the_modifier_particle_instance():
    source = emitter(instance_object=None, render_type="NONE", display_percentage=30)
    source.name = "source"
    obj = subdivided("high")
    obj.modifiers.new("Copies", "PARTICLE_INSTANCE").object = source
    return [obj]


# Other files, layers and simulations


def in_a_library():
    folder = tempfile.mkdtemp()
    obj = subdivided("high")
    scenes.material("steel", obj)
    path = Path(folder) / "library.blend"
    bpy.data.libraries.write(str(path), {obj})
    bpy.data.objects.remove(obj)
    bpy.data.batch_remove([*bpy.data.meshes, *bpy.data.materials])
    zoo.plane("low")
    return scenes.from_library(path, "objects", "high")


@scene
def a_linked_object():
    return in_a_library()


@slow
def an_overridden_object():
    (linked,) = in_a_library()
    local = linked.override_create()
    bpy.context.scene.collection.objects.unlink(linked)
    scenes.link(local)
    return [local]


@slow
def in_another_view_layer():
    obj = subdivided("high")
    shown = collection("part", obj)
    other = bpy.context.scene.view_layers.new("other")
    other.use = False
    layer_of(shown).exclude = True
    other.layer_collection.children[shown.name].exclude = False
    return [obj]


@slow
def a_rigid_body_at_a_frame():
    bpy.context.scene.gravity.z = -30.0
    obj = scenes.select(subdivided("high"))
    obj.location.z = 2.0
    bpy.ops.rigidbody.object_add()
    for frame in range(1, 9):
        bpy.context.scene.frame_set(frame)
    return [obj]


@slow
def a_cloth_at_a_frame():
    obj = zoo.plane("high", 3)
    obj.modifiers.new("Cloth", "CLOTH")
    bpy.ops.object.effector_add(type="WIND", location=(0.0, 0.0, -1.0))
    bpy.context.object.field.strength = 500.0
    for frame in range(1, 8):
        bpy.context.scene.frame_set(frame)
    return [obj]
