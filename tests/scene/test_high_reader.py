# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests high objects of all types with a surface, with instances, and in hidden collections."""

import math
import os
import re
import subprocess
import sys
from dataclasses import fields, replace
from types import SimpleNamespace

import bpy
import mathutils
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import Job, bake_all, bake_pair
from addon.mesh.triangle_mesh import ATTRIBUTE
from addon.scene import mesh_reader, object_checks, reading
from addon.scene.high_reader import _holds, read_moved
from scripts import imprint
from tests.support import maps, scenes, zoo
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")


SINGLE = 1e-6
"""The error of single precision: Blender rounds the transforms of instances, and the vertices of real copies."""
ROUNDING, RIMS = 1e-4, 2e-3
"""The error in texels on curved surfaces, and the share of texels on rims, which may differ more."""
FULL = bool(os.environ.get("IMPRINT_ENDURANCE"))
GIB = 2**30


def link(obj, collection=None):
    (collection or bpy.context.scene.collection).objects.link(obj)
    return obj


def empty(name, collection, **transform):
    obj = bpy.data.objects.new(name, None)
    obj.instance_type, obj.instance_collection = "COLLECTION", collection
    for key, value in transform.items():
        setattr(obj, key, value)
    return obj


def shelf(*objects, name="Shelf"):
    """A collection with only `objects`, not linked to the scene."""
    collection = bpy.data.collections.new(name)
    for obj in objects:
        for other in obj.users_collection:
            other.objects.unlink(obj)
        collection.objects.link(obj)
    return collection


def low():
    return zoo.plane("lo")


def cast(low, *highs, **settings):
    values = {"method": "CAST", "space": "OBJECT", "extrusion": 2.0, "max_distance": 4.0, "size": (48, 48), **settings}
    return maps.bake(low, *highs, **values)


def assert_alike(texels, expected):
    """Equal, except where rounding decides whether a rim is hit, or which of two surfaces is."""
    assert (np.abs(texels - expected).max(axis=-1) > ROUNDING).mean() < RIMS


def is_seen(texels):
    """Whether some texels were hit, but not all, with different normals."""
    hit = texels[..., 3] > 0
    return hit.any() and not hit.all() and np.ptp(texels[hit][:, :3]) > 0.2


# Kinds


def text():
    data = bpy.data.curves.new("hi", "FONT")
    data.body, data.extrude, data.bevel_depth, data.align_x = "Ag", 0.1, 0.05, "CENTER"
    return link(bpy.data.objects.new("hi", data))


def curve():
    bpy.ops.curve.primitive_bezier_circle_add(radius=0.6)
    bpy.context.object.data.bevel_depth = 0.2
    return bpy.context.object


def nurbs():
    bpy.ops.surface.primitive_nurbs_surface_sphere_add(radius=0.7)
    return bpy.context.object


def metaballs():
    for x in (-0.3, 0.3):
        bpy.ops.object.metaball_add(location=(x, 0, 0), radius=0.5)
    surface = bpy.data.objects["Mball"]
    surface.data.render_resolution = surface.data.resolution  # `made_real` is as the viewport shows it
    return surface


def hair_with_a_mesh():
    obj = link(bpy.data.objects.new("hi", bpy.data.hair_curves.new("hi")))
    tree, *_ = nodes(obj)
    ball = tree.nodes.new("GeometryNodeMeshIcoSphere")
    ball.inputs["Radius"].default_value = 0.6
    tree.links.new(ball.outputs[0], tree.nodes["Group Output"].inputs[0])
    return obj


KINDS = (text, curve, nurbs, metaballs, hair_with_a_mesh)


def nodes(obj):
    """Add geometry nodes to `obj`. Returns the tree, the output socket of the group input, the input of the group output."""
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for side in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=side, socket_type="NodeSocketGeometry")
    first, last = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    obj.modifiers.new("Nodes", "NODES").node_group = tree
    return tree, first.outputs[0], last.inputs[0]


def made_real(obj):
    """The meshes that `obj` shows, as mesh objects, as from Blender's Make Instances Real."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    found = []
    for item in depsgraph.object_instances:
        owner = item.parent if item.is_instance else item.object
        if owner.original == obj and item.object.type == "MESH":
            data = bpy.data.meshes.new_from_object(item.object)
            found.append((data, item.matrix_world.copy()))
    result = []
    for data, matrix in found:
        result.append(link(bpy.data.objects.new("real", data)))
        result[-1].matrix_world = matrix
    return result


# Blender makes one surface of all metaballs of a family, wherever they are, so instances of them are not copies.
READ = [(kind, is_shared) for kind in KINDS for is_shared in (False, True) if not (is_shared and kind is metaballs)]


@pytest.mark.parametrize(
    ("kind", "is_shared"), READ, ids=[f"{kind.__name__}-{'instanced' if shared else 'itself'}" for kind, shared in READ]
)
def test_objects_with_a_surface_are_read(kind, is_shared):
    plane, high = low(), kind()
    high.rotation_euler.z = 0.3
    expected = cast(plane, *made_real(high))
    assert is_seen(expected)
    if is_shared:
        high = link(empty("outer", shelf(high)))
    assert_alike(cast(plane, high), expected)


def test_text_can_be_flattened():
    """Blender gives text and curves UVs."""
    assert maps.bake(low(), text(), space="OBJECT")[..., 3].any()


def test_only_the_first_metaball_has_a_surface():
    metaballs()
    with pytest.raises(BakeError, match=r"'Mball.001' has no faces: .* belongs to 'Mball'"):
        cast(low(), bpy.data.objects["Mball.001"])


ODD = {
    "CAMERA": lambda: bpy.data.cameras.new("odd"),
    "LIGHT": lambda: bpy.data.lights.new("odd", "SUN"),
    "ARMATURE": lambda: bpy.data.armatures.new("odd"),
    "LATTICE": lambda: bpy.data.lattices.new("odd"),
    "EMPTY": lambda: None,
    "POINTCLOUD": lambda: bpy.data.pointclouds.new("odd"),
    "VOLUME": lambda: bpy.data.volumes.new("odd"),
    "CURVES": lambda: bpy.data.hair_curves.new("odd"),
    "SPEAKER": lambda: bpy.data.speakers.new("odd"),
}


@pytest.mark.parametrize("kind", ODD)
def test_objects_without_a_surface_are_named(kind):
    odd = link(bpy.data.objects.new("odd", ODD[kind]()))
    assert odd.type == kind
    before = snapshot()
    with pytest.raises(BakeError) as refused:
        cast(low(), odd)
    assert "'odd'" in str(refused.value)
    assert "choose a mesh" in str(refused.value)
    assert set(difference(before, snapshot())) <= {
        "objects",
        "meshes",
        ("object", "lo"),
        ("mesh", "lo"),
        ("Scene", "ViewLayer"),
    }


def test_an_empty_instance_has_no_faces():
    with pytest.raises(BakeError, match="'hi' has no faces"):
        cast(low(), link(empty("hi", bpy.data.collections.new("Nothing"))))


# Instances


def bolt(name="bolt", n=3):
    """A small dome with a slope, so that mirrored copies look different."""
    obj = zoo.terrain(name, n, height=0.2, waves=0.5)
    obj.scale = (0.1, 0.1, 0.1)
    for vertex in obj.data.vertices:
        vertex.co.z += 0.3 * vertex.co.x
    scenes.material(f"{name} steel", obj)
    return obj


def scattered(count, *, realized, scale=(1.0, 1.0, 1.0), n=3, seed=11):
    """A plane with `count` randomly rotated bolts on it, as instances or realized as one mesh."""
    points = np.random.default_rng(seed).uniform(-0.9, 0.9, (count, 3)) * (1, 1, 0.05)
    cloud = zoo.build("hi", points, np.empty((0, 3), int))
    hidden = bolt("source", n)
    hidden.hide_viewport = True
    tree, geometry, result = nodes(cloud)
    on_points, info, turn, join = (
        tree.nodes.new(f"{kind}")
        for kind in (
            "GeometryNodeInstanceOnPoints",
            "GeometryNodeObjectInfo",
            "FunctionNodeRandomValue",
            "GeometryNodeJoinGeometry",
        )
    )
    info.inputs["Object"].default_value, info.inputs["As Instance"].default_value = hidden, True
    turn.data_type = "FLOAT_VECTOR"
    turn.inputs["Max"].default_value = (0.5, 0.5, math.tau)
    on_points.inputs["Scale"].default_value = tuple(0.05 * side for side in scale)
    grid = tree.nodes.new("GeometryNodeMeshGrid")
    grid.inputs["Size X"].default_value = grid.inputs["Size Y"].default_value = 2.0
    tree.links.new(geometry, on_points.inputs["Points"])
    tree.links.new(info.outputs["Geometry"], on_points.inputs["Instance"])
    tree.links.new(turn.outputs["Value"], on_points.inputs["Rotation"])
    tree.links.new(on_points.outputs[0], join.inputs[0])
    tree.links.new(grid.outputs[0], join.inputs[0])
    last = join
    if realized:
        last = tree.nodes.new("GeometryNodeRealizeInstances")
        tree.links.new(join.outputs[0], last.inputs[0])
    tree.links.new(last.outputs[0], result)
    return cloud


def test_instances_on_points_give_the_map_of_realized_ones():
    plane = low()
    instanced, realized = (scattered(200, realized=is_realized) for is_realized in (False, True))
    mesh, real = (
        reading.read(bpy.context, plane, [obj], None, Settings(method="CAST")).highs[0] for obj in (instanced, realized)
    )
    assert (mesh.instances, real.instances) == (200 + 1, 0)
    assert len(mesh.triangles) == len(real.triangles) == 18 * 200 + 8
    texels = cast(plane, instanced, size=(128, 128), facing_only=True)
    assert np.ptp(texels[..., 0]) > 0.2
    assert_alike(texels, cast(plane, realized, size=(128, 128), facing_only=True))


TEN_MILLION = """
import resource, sys
import bpy, gpu, numpy as np
from tests.scene import test_high_reader as here

gpu.init()
bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
plane = here.low()
texels = []
for realized in (False, True):
    high = here.scattered(10_000, realized=realized, n=23)
    texels.append(here.cast(plane, high, size=(512, 512), extrusion=1.0, max_distance=2.0))
    if not realized:
        print("peak", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
    bpy.data.objects.remove(high)
here.assert_alike(*texels)
assert np.ptp(texels[0][..., 0]) > 0.2
"""


@pytest.mark.skipif(not FULL, reason="takes minutes: IMPRINT_ENDURANCE=1 runs it")
def test_ten_million_triangles_by_instances_fit_in_six_gib():
    """In a separate process. Its memory includes that of a software driver."""
    ran = subprocess.run(
        [sys.executable, "-c", TEN_MILLION], cwd=imprint.ROOT, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    assert int(re.search(r"peak (\d+)", ran.stdout)[1]) < 6 * GIB


@pytest.mark.parametrize("scale", [(-1, 1, 1), (1, -2, 1)])
def test_mirrored_instances_give_the_map_of_mirrored_objects(scale):
    """Realize Instances would flip their normals; Blender does not when it draws them."""
    plane, high = low(), scattered(100, realized=False, scale=scale)
    texels = cast(plane, high, size=(128, 128), facing_only=True)
    assert np.ptp(texels[..., 0]) > 0.2
    bpy.context.view_layer.update()
    assert_alike(texels, cast(plane, *made_real(high), size=(128, 128), facing_only=True))


def test_a_mirrored_instance_keeps_its_front():
    plane, source = low(), bolt()
    high = link(empty("hi", shelf(source), scale=(-5.0, 5.0, 5.0)))
    texels = cast(plane, high, facing_only=True)
    source.scale.x, source.scale.y, source.scale.z = -0.5, 0.5, 0.5
    np.testing.assert_allclose(texels, cast(plane, link(source), facing_only=True), rtol=0, atol=SINGLE)
    assert is_seen(texels)


def test_collections_in_collections():
    plane, source = low(), bolt()
    inner = empty("inner", shelf(source, name="Inner"), location=(0.4, 0.0, 0.0), rotation_euler=(0.0, 0.0, 0.7))
    outer = link(
        empty("outer", shelf(inner, text(), name="Outer"), scale=(2.0, -2.0, 2.0), rotation_euler=(0.1, 0.2, 0.0))
    )
    bpy.context.view_layer.update()
    real = made_real(outer)
    assert len(real) == 2
    texels = cast(plane, outer)
    assert_alike(texels, cast(plane, *real))
    assert is_seen(texels)


@pytest.mark.parametrize("kind", ["VERTS", "FACES"])
@pytest.mark.parametrize("shows_itself", [False, True])
def test_instances_on_vertices_and_faces(kind, shows_itself):
    plane, parent, child = low(), zoo.plane("hi", 2), bolt()
    parent.scale, child.parent, parent.instance_type = (0.7, 0.7, 0.7), parent, kind
    parent.show_instancer_for_render, parent.show_instancer_for_viewport = shows_itself, not shows_itself
    bpy.context.view_layer.update()
    mesh = reading.read(bpy.context, plane, [parent], None, Settings(method="CAST")).highs[0]
    assert mesh.instances == (9 if kind == "VERTS" else 4) + shows_itself
    assert is_seen(cast(plane, parent, size=(128, 128))) or shows_itself


def test_particles_that_are_objects():
    plane, emitter, source = low(), zoo.plane("hi", 4), bolt()
    emitter.modifiers.new("Particles", "PARTICLE_SYSTEM")
    settings = emitter.particle_systems[0].settings
    settings.type, settings.count, settings.render_type, settings.instance_object = "HAIR", 20, "OBJECT", source
    mesh = reading.read(bpy.context, plane, [emitter], None, Settings(method="CAST")).highs[0]
    assert mesh.instances == 21


def test_instances_of_zero_size_are_left_out():
    """Instances with zero scale on one axis are flat surfaces, and stay."""
    plane, source = low(), bolt()
    sizes = [(1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (3.0, 3.0, 0.0), (1.0, 0.0, 0.0)]
    shelves = shelf(source)
    inner = [empty(f"{number}", shelves, scale=scale) for number, scale in enumerate(sizes)]
    mesh = reading.read(
        bpy.context, plane, [link(empty("hi", shelf(*inner, name="All")))], None, Settings(method="CAST")
    ).highs[0]
    assert mesh.instances == 2
    assert np.isfinite(mesh.normals).all()
    flat = mesh.normals[len(mesh.normals) // 2 :]
    flat = flat / np.linalg.norm(flat, axis=1, keepdims=True)
    np.testing.assert_allclose(flat, np.broadcast_to((0, 0, 1), flat.shape), rtol=0, atol=SINGLE)


def test_instances_far_from_the_origin_stay_exact():
    plane, source = low(), bolt()
    high = link(empty("hi", shelf(source), scale=(5.0, 5.0, 5.0)))
    expected = cast(plane, high)
    plane.location = high.location = (4096.0, -4096.0, 4096.0)
    np.testing.assert_allclose(cast(plane, high), expected, rtol=0, atol=2e-3)  # Blender rounds matrices there


def test_instanced_objects_have_their_render_levels():
    plane, source = low(), bolt()
    smooth = source.modifiers.new("Smooth", "SUBSURF")
    smooth.levels, smooth.render_levels = 0, 2
    high = link(empty("hi", shelf(source)))
    counts = [
        len(reading.read(bpy.context, plane, [high], None, Settings(method="CAST", modifiers=kind)).highs[0].triangles)
        for kind in ("VIEWPORT", "RENDER")
    ]
    assert counts == [18, 18 * 16]
    assert (smooth.levels, smooth.render_levels) == (0, 2)


def test_an_instanced_object_may_be_in_edit_mode():
    plane, source = low(), bolt()
    high = link(empty("hi", shelf(source)))
    link(source)
    source.hide_viewport = False
    bpy.context.view_layer.objects.active = source
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.subdivide()
    mesh = reading.read(bpy.context, plane, [high], None, Settings(method="CAST")).highs[0]
    assert len(mesh.triangles) == 18 * 4
    assert source.mode == "EDIT"


# Auto


def auto(plane, *highs, **settings):
    values = {"width": 48, "height": 48, "storage": "MEMORY", "material": False, **settings}
    return bake_pair(bpy.context, plane, highs, Settings(method="AUTO", **values))


def test_auto_chooses_cast_for_several_instances_with_the_same_uvs():
    plane, source = low(), zoo.terrain("source", height=0.05)
    shelves = shelf(source)
    single = link(empty("one", shelves))
    report = auto(plane, single)
    assert (report.method, "agree" in report.why) == ("FLATTEN", True)
    pair = shelf(empty("left", shelves), empty("right", shelves, location=(0.0, 0.0, 0.2)), name="Pair")
    report = auto(plane, link(empty("two", pair)))
    assert report.method == "CAST"
    assert "'two' is made of 2 instances" in report.why


@pytest.mark.parametrize("is_single", [False, True])
def test_auto_chooses_cast_for_instances_on_their_own_base(is_single):
    plane, source = zoo.plane("lo", 2), bolt()
    source.data.transform(mathutils.Matrix.Scale(0.1, 4))
    tree, geometry, result = nodes(plane)
    on_points, info, join = (
        tree.nodes.new(f"GeometryNode{kind}") for kind in ("InstanceOnPoints", "ObjectInfo", "JoinGeometry")
    )
    info.inputs["Object"].default_value, info.inputs["As Instance"].default_value = source, True
    for output, socket in (
        (geometry, on_points.inputs["Points"]),
        (info.outputs["Geometry"], on_points.inputs["Instance"]),
        (geometry, join.inputs[0]),
        ((info if is_single else on_points).outputs["Geometry" if is_single else 0], join.inputs[0]),
        (join.outputs[0], result),
    ):
        tree.links.new(output, socket)
    assert object_checks.own_highs(plane) == [plane]
    report = auto(plane, plane)
    assert report.method == "CAST"
    assert ("10 instances" in report.why) != is_single


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_instances_have_the_material_of_their_object_and_the_id_of_the_high_object(method):
    plane, first, second = low(), zoo.terrain("first", height=0.02), zoo.terrain("second", height=0.02)
    for obj, side in ((first, 1), (second, -1)):
        scenes.material(obj.name, obj)
        if method == "FLATTEN":
            layer = obj.data.uv_layers[0].uv
            layer.foreach_set(
                "vector", [value for uv in layer for value in (0.5 * uv.vector.x + (side < 0) * 0.5, uv.vector.y)]
            )
        obj.scale.x, obj.location.x = 0.5, -0.5 * side
    high = link(empty("hi", shelf(first, second)))
    report = bake_pair(
        bpy.context,
        plane,
        [high],
        Settings(method=method, width=32, height=32, image="map", storage="MEMORY", maps=("OBJECT_ID", "MATERIAL_ID")),
    )
    objects, materials = (
        maps.pixels(bpy.data.images[report.maps[name]["image"]]) for name in ("object_id", "material_id")
    )
    assert len(np.unique(objects[8:-8, 4:-4, :3].reshape(-1, 3), axis=0)) == 1
    left, right = materials[16, 8, :3], materials[16, 24, :3]
    assert (left != right).any()
    assert set(report.maps["material_id"]["colours"]) == {"first", "second"}


@pytest.mark.parametrize("owners", [1, 2])
def test_instances_of_one_mesh_have_the_materials_of_their_objects_and_the_ids_of_their_owners(owners):
    plane, first = low(), zoo.terrain("first", height=0.02)
    first.data.materials.append(None)
    second = first.copy()
    for obj, side in ((first, 1), (second, -1)):
        if side < 0:
            link(obj)
        obj.material_slots[0].link = "OBJECT"
        obj.material_slots[0].material = bpy.data.materials.new(f"of {side}")
        obj.scale.x, obj.location.x = 0.5, -0.5 * side
    shown = [shelf(first, second)] if owners == 1 else [shelf(first, name="A"), shelf(second, name="B")]
    highs = [link(empty(f"hi {number}", collection)) for number, collection in enumerate(shown)]
    settings = Settings(method="CAST", width=32, height=32, storage="MEMORY", maps=("OBJECT_ID", "MATERIAL_ID"))
    report = bake_pair(bpy.context, plane, highs, settings)
    for name, count in (("object_id", owners), ("material_id", 2)):
        texels = maps.pixels(bpy.data.images[report.maps[name]["image"]])
        assert (texels[16, 8, :3] != texels[16, 24, :3]).any() == (count == 2), name


# Hidden objects and collections


def parked(obj):
    """Move `obj` into a new collection of the scene. Returns the collection and its view layer collection."""
    collection = shelf(obj, name="Parked")
    bpy.context.scene.collection.children.link(collection)
    return collection, bpy.context.view_layer.layer_collection.children["Parked"]


def nested(obj):
    collection, layer = parked(obj)
    above = bpy.data.collections.new("Above")
    bpy.context.scene.collection.children.unlink(collection)
    bpy.context.scene.collection.children.link(above)
    above.children.link(collection)
    return above, bpy.context.view_layer.layer_collection.children["Above"]


HIDDEN = {
    "by the eye": lambda obj: obj.hide_set(True),
    "in viewports": lambda obj: setattr(obj, "hide_viewport", True),
    "in renders": lambda obj: setattr(obj, "hide_render", True),
    "collection by the eye": lambda obj: setattr(parked(obj)[1], "hide_viewport", True),
    "collection in viewports": lambda obj: setattr(parked(obj)[0], "hide_viewport", True),
    "collection in renders": lambda obj: setattr(parked(obj)[0], "hide_render", True),
    "excluded": lambda obj: setattr(parked(obj)[1], "exclude", True),
    "excluded from above": lambda obj: setattr(nested(obj)[1], "exclude", True),
    "everything at once": lambda obj: [
        setattr(parked(obj)[1], "exclude", True),
        setattr(obj, "hide_viewport", True),
        setattr(obj, "hide_render", True),
    ],
}


@pytest.mark.parametrize(
    ("how", "role"), [*((how, "hi") for how in HIDDEN), *(("everything at once", role) for role in ("lo", "cage"))]
)
def test_hidden_objects_are_read_and_stay_hidden(how, role):
    plane, high, cage = low(), zoo.terrain("hi"), zoo.plane("cage")
    high.modifiers.new("Lift", "DISPLACE").strength = 0.1
    high.parent = link(bpy.data.objects.new("parent", None))
    high.parent.rotation_euler.z = 0.4
    cage.location.z = 0.5

    def bake(image):
        job = Job(plane, [high], cage)
        settings = Settings(method="CAST", width=32, height=32, image=image, depth=32, storage="MEMORY", material=False)
        bake_all(bpy.context, [job], settings)
        return maps.pixels(bpy.data.images[image])

    expected = bake("seen")
    HIDDEN[how](bpy.data.objects[role])
    bpy.context.view_layer.objects.active = None
    before = snapshot(without=("images",))
    users = [obj.name for obj in bpy.context.scene.collection.objects]
    texels = bake("hidden")
    assert difference(before, snapshot(without=("images",))) == {}
    assert [obj.name for obj in bpy.context.scene.collection.objects] == users
    np.testing.assert_array_equal(texels, expected)


def test_an_empty_in_an_excluded_collection_is_read():
    plane, high = low(), link(empty("hi", shelf(bolt()), scale=(5.0, 5.0, 5.0)))
    expected = cast(plane, high)
    parked(high)[1].exclude = True
    np.testing.assert_array_equal(cast(plane, high), expected)


def test_the_matrix_of_an_instance():
    """It is the product of the matrices of the empty and the instanced object. The other tests rely on this."""
    source = bolt()
    source.matrix_world = mathutils.Matrix.LocRotScale(
        (0.1, 0.2, 0.3), mathutils.Euler((0.4, 0.5, 0.6)), (0.7, -0.8, 0.9)
    )
    high = link(empty("hi", shelf(source), location=(0.3, 0.0, 0.1), scale=(2.0, 1.0, -0.5)))
    bpy.context.view_layer.update()
    mesh = reading.read(bpy.context, low(), [high], None, Settings(method="CAST")).highs[0]
    points = np.array([vertex.co for vertex in source.data.vertices])
    product = np.array(high.matrix_world) @ np.array(source.matrix_basis)
    np.testing.assert_allclose(
        mesh.positions @ mesh.to_world[:3, :3].T + mesh.to_world[:3, 3],
        points @ product[:3, :3].T + product[:3, 3],
        atol=SINGLE,
    )


@pytest.mark.parametrize(("chosen", "read"), [((), []), (("ROUGHNESS", "AO"), ["Roughness"])])
def test_only_the_inputs_of_materials_that_maps_show_are_read(chosen, read):
    meshes = reading.read(bpy.context, low(), [bolt()], None, Settings(method="CAST", maps=chosen))
    assert [list(material.feeds) for material in meshes.materials] == [read]


# Large meshes


def smoothed():
    high = zoo.terrain("hi", 8)
    high.modifiers.new("Subdivision", "SUBSURF").levels = 2
    return high


def doubled():
    high = zoo.cube("hi")
    high.modifiers.new("Array", "ARRAY").count = 3
    high.scale = 1.0, -2.0, 0.5
    return high


def font():
    high = bpy.data.objects.new("hi", bpy.data.curves.new("hi", "FONT"))
    high.data.body, high.data.extrude = "Ab", 0.1
    bpy.context.scene.collection.objects.link(high)
    return high


def read(low, high, **settings):
    bpy.context.view_layer.update()
    return reading.read(bpy.context, low, [high], None, Settings(**settings)).highs[0]


@pytest.mark.parametrize("settings", [{"method": "FLATTEN"}, {"method": "CAST", "maps": ("MATERIAL_ID",)}], ids=str)
@pytest.mark.parametrize("make", [smoothed, doubled])
def test_large_meshes_are_read_from_copies_that_are_gone_afterwards(monkeypatch, make, settings):
    low, high = zoo.plane("lo"), make()
    whole = read(low, high, **settings)
    before, made = snapshot(), []
    monkeypatch.setattr(mesh_reader, "LARGE", len(whole.vertices))
    part = mesh_reader.part_of_copy
    monkeypatch.setattr(
        mesh_reader, "part_of_copy", lambda data, copy: part(data, lambda: made.append(copy()) or made[-1])
    )
    in_parts = read(low, high, **settings)
    assert len(made) == 5
    assert not difference(before, snapshot())
    for field in fields(whole):
        a, b = (getattr(mesh, field.name) for mesh in (whole, in_parts))
        assert np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b, field.name


def test_smaller_meshes_are_read_without_copies(monkeypatch):
    low, high = zoo.plane("lo"), smoothed()
    monkeypatch.setattr(mesh_reader, "LARGE", len(read(low, high).vertices) + 1)
    monkeypatch.setattr(mesh_reader, "copied", lambda obj, depsgraph: pytest.fail)
    read(low, high)


def test_text_is_read_from_copies(monkeypatch):
    low, high = zoo.plane("lo"), font()
    whole = read(low, high, method="CAST")
    monkeypatch.setattr(mesh_reader, "LARGE", 1)
    assert np.array_equal(read(low, high, method="CAST").normals, whole.normals)
    assert not [data for data in bpy.data.meshes if data.users == 0]


# Numbered elements


OWN = ".imprint_face"
"""An attribute of the artist with the name that the numbers would take."""


def contents(data):
    """The names, types, domains and values of all attributes, and which one is active."""
    found = {}
    for layer in data.attributes:
        if layer.data_type == "INT":
            values = np.empty(len(layer.data), np.int32)
            layer.data.foreach_get("value", values)
            found[layer.name] = layer.data_type, layer.domain, values.tolist()
        else:
            found[layer.name] = layer.data_type, layer.domain
    return found, data.attributes.active_index


@pytest.mark.parametrize("domain", ["FACE", "EDGE"])
@pytest.mark.parametrize("own", [None, "FACE", "POINT"])
def test_numbers_go_through_modifiers_and_leave_nothing(domain, own):
    obj = zoo.plane("lo", 3)
    data = obj.data
    data.attributes.active_index = 0
    if own:
        layer = data.attributes.new(OWN, "INT", own)
        layer.data.foreach_set("value", np.arange(100, 100 + len(layer.data)))
    before = contents(data)
    obj.modifiers.new("array", "ARRAY").count = 2
    with (
        mesh_reader.numbered(obj, domain) as name,
        mesh_reader.evaluated(obj, bpy.context.evaluated_depsgraph_get()) as evaluated,
    ):
        found = mesh_reader.numbers(evaluated, name, domain)
    count = len(data.polygons if domain == "FACE" else data.edges)
    assert np.array_equal(np.sort(found), np.repeat(np.arange(count), 2))
    assert contents(data) == before


def test_nothing_stays_after_an_error():
    obj = zoo.plane("lo", 3)
    before = contents(obj.data)
    with pytest.raises(ZeroDivisionError), mesh_reader.numbered(obj):
        raise ZeroDivisionError
    assert contents(obj.data) == before


# Moved vertices


FIELDS = ("positions", "vertices", "normals", "triangles", "to_world", "uv")


def whole(obj):
    return mesh_reader.surface(obj.data, zoo.LAYER, obj.name, mesh_reader.matrix(obj))


def again(obj, known):
    return read_moved(obj.data, zoo.LAYER, known, mesh_reader.matrix(obj))


def move(obj, seed, share=0.1):
    """Move the vertices of a part of a mesh by random amounts."""
    rng = np.random.default_rng(seed)
    points = mesh_reader.points(obj.data)
    center = points[rng.integers(len(points))]
    near = np.argsort(np.linalg.norm(points - center, axis=1))[: max(1, int(share * len(points)))]
    points[near] += (rng.normal(0, 1, (len(near), 3)) * (0.002, 0.002, 0.02)).astype(np.float32)  # folds no quad
    obj.data.attributes["position"].data.foreach_set("vector", points.ravel())
    obj.data.update()


def mixed(seed):
    """A mesh of triangles, quads and pentagons: a grid of which some edges were dissolved, and some faces cut."""
    obj = zoo.terrain("mixed", n=20)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.select_random(ratio=0.3, seed=seed)
    bpy.ops.mesh.quads_convert_to_tris()
    bpy.ops.mesh.select_random(ratio=0.2, seed=seed + 1)
    bpy.ops.mesh.dissolve_faces()
    bpy.ops.object.mode_set(mode="OBJECT")
    return obj


def equal(a, b):
    return all(np.array_equal(getattr(a, field), getattr(b, field)) for field in FIELDS)


MESHES = {
    "quads": lambda: zoo.terrain("hi", n=24),
    "flat": lambda: zoo.terrain("hi", n=24, smooth=False),
    "sphere": lambda: zoo.build("hi", *_ball()),
    "mixed": lambda: mixed(3),
}


def _ball():
    bpy.ops.mesh.primitive_uv_sphere_add(segments=24, ring_count=16)
    made = bpy.context.object.data
    made.calc_loop_triangles()
    points = mesh_reader.points(made)
    faces = mesh_reader.corner_vertices(made)[mesh_reader.triangles(made)]
    return points, faces, points[faces][..., :2]


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", MESHES)
def test_moved_vertices_are_read_as_the_whole_mesh(name, seed):
    obj = MESHES[name]()
    known = whole(obj)
    for stroke in range(3):
        move(obj, 10 * seed + stroke)
        found = again(obj, known)
        assert found is not None
        assert not np.array_equal(found.normals, known.normals)
        for field in ("vertices", "triangles", "uv"):
            is_kept = getattr(found, field) is getattr(known, field)
            assert is_kept or not np.array_equal(getattr(found, field), getattr(known, field))
        assert equal(found, whole(obj))
        known = found


def test_a_moved_object_keeps_its_arrays():
    obj = zoo.terrain("hi", n=8)
    known = whole(obj)
    obj.location.x = 2.0
    bpy.context.view_layer.update()
    found = again(obj, known)
    assert found.normals is known.normals
    assert equal(found, whole(obj))


def test_labels_and_layers_of_the_earlier_reading_are_not_kept():
    obj = zoo.terrain("hi", n=8)
    known = whole(obj)
    layers = {(ATTRIBUTE, "paint"): np.zeros((len(obj.data.loops), 4), np.float32)}
    known = replace(known, layers=layers, labels=np.zeros((len(known.triangles), 2), np.float32))
    move(obj, 5)
    found = again(obj, known)
    assert (found.layers, found.labels) == ({}, None)


def _change_uv(obj):
    obj.data.uv_layers[0].uv[5].vector.x += 0.01


def _shade_flat(obj):
    obj.data.shade_flat()


def _mark_sharp(obj):
    obj.data.attributes.new("sharp_edge", "BOOLEAN", "EDGE").data[3].value = True


def _set_normals(obj):
    obj.data.normals_split_custom_set_from_vertices([(0.0, 0.6, 0.8)] * len(obj.data.vertices))


def _turn_faces(obj):
    obj.data.flip_normals()


def _make_nan(obj):
    obj.data.vertices[7].co.x = float("nan")


def _add_a_face(obj):
    import bmesh

    mesh = bmesh.new()
    mesh.from_mesh(obj.data)
    mesh.faces.new([mesh.verts.new(place) for place in ((5, 0, 0), (6, 0, 0), (5, 1, 0))])
    mesh.to_mesh(obj.data)
    mesh.free()


def _move_all(obj):
    move(obj, 5, share=1.0)


def _move_a_third(obj):
    move(obj, 5, share=0.33)


def _swap_vertices(obj):
    corners = mesh_reader.corner_vertices(obj.data)
    obj.data.loops.foreach_set("vertex_index", np.array([1, 0, *range(2, len(obj.data.vertices))], np.int32)[corners])


@pytest.mark.parametrize(
    "change",
    [
        _change_uv,
        _shade_flat,
        _mark_sharp,
        _set_normals,
        _turn_faces,
        _make_nan,
        _add_a_face,
        _move_all,
        _move_a_third,
        _swap_vertices,
    ],
)
def test_other_changes_are_read_from_the_whole_mesh(change):
    obj = zoo.terrain("hi", n=12)
    known = whole(obj)
    move(obj, 4)
    assert again(obj, known) is not None
    change(obj)
    obj.data.update()
    assert again(obj, known) is None


def test_a_folded_quad_is_divided_along_its_other_diagonal():
    obj = zoo.plane("hi", n=8)
    known = whole(obj)
    folded = obj.data.vertices[obj.data.polygons[20].vertices[1]]
    folded.co.x -= 0.2
    folded.co.y += 0.2
    obj.data.update()
    found = again(obj, known)
    assert not np.array_equal(found.triangles, known.triangles)
    assert equal(found, whole(obj))


def test_faces_that_were_divided_are_read_from_the_whole_mesh():
    """A quad and two triangles have as many corners and triangles as two triangles and a quad."""
    corners = [0, 1, 2, 3, 3, 2, 4, 3, 4, 5]
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (1, 2, 0), (0, 2, 0)]
    found = []
    for starts in ([0, 4, 7], [0, 3, 6]):
        data = bpy.data.meshes.new("hi")
        data.vertices.add(len(points))
        data.attributes["position"].data.foreach_set("vector", np.array(points, np.float32).ravel())
        data.loops.add(len(corners))
        data.loops.foreach_set("vertex_index", corners)
        data.polygons.add(3)
        data.polygons.foreach_set("loop_start", starts)
        data.uv_layers.new(name=zoo.LAYER, do_init=False)  # the same for both: initial ones follow from the faces
        data.update(calc_edges=True)
        data.shade_smooth()
        found.append(bpy.data.objects.new("hi", data))
    known = whole(found[0])
    assert again(found[0], known) is not None
    assert np.array_equal(whole(found[1]).uv, known.uv)
    assert again(found[1], known) is None


def test_a_mesh_with_nan_is_read_whole_when_it_is_mended():
    obj = zoo.terrain("hi", n=12)
    before = obj.data.vertices[7].co.copy()
    _make_nan(obj)
    obj.data.update()
    known = whole(obj)
    obj.data.vertices[7].co = before
    obj.data.update()
    assert again(obj, known) is None


@pytest.mark.parametrize(("then", "now"), [(zoo.LAYER, ""), ("", zoo.LAYER)])
def test_a_mesh_read_with_uvs_is_not_one_without_them(then, now):
    obj = zoo.terrain("hi", n=12)
    known = mesh_reader.surface(obj.data, then, obj.name, mesh_reader.matrix(obj))
    assert read_moved(obj.data, then, known, mesh_reader.matrix(obj)) is not None
    assert read_moved(obj.data, now, known, mesh_reader.matrix(obj)) is None


@pytest.mark.parametrize(("step", "number", "reads"), [(1, 4, 0), (2, 4, 1), (1, 1, 1)])
def test_memory_is_compared_only_where_values_lie_one_after_the_other(step, number, reads):
    """A single value shows no distance to the next one."""
    values = np.arange(8, dtype=np.int32)
    collection = [element(values.ctypes.data + 4 * step * each) for each in range(number)]
    done = []
    known = values[::step][:number].copy()
    assert _holds(collection, known, lambda: done.append(1) or known)
    assert len(done) == reads


@pytest.mark.parametrize(("step", "shift", "is_copied"), [(3, 0, True), (4, 0, False), (3, 1, False)])
def test_triangles_are_copied_from_memory_only_where_it_holds_them(step, shift, is_copied):
    """step: values from one triangle to the next. shift: what Blender says that they are, minus what the memory holds."""
    values = np.arange(64, dtype=np.int32)
    starts = range(0, 5 * step, step)
    source = [element(values.ctypes.data + 4 * start, values[start : start + 3] + shift) for start in starts]
    found = np.full((5, 3), -1, np.int32)
    assert mesh_reader._copy_triangles(source, found) == is_copied
    assert (found == (values[:15].reshape(5, 3) if is_copied else -1)).all()


def element(pointer, loops=()):
    """An element of one of Blender's collections, at an address."""
    return SimpleNamespace(as_pointer=lambda: pointer, loops=loops)


def test_meshes_that_had_other_normals_are_read_whole():
    obj = zoo.terrain("hi", n=12)
    _set_normals(obj)
    obj.data.update()
    known = whole(obj)
    obj.data.attributes.remove(obj.data.attributes["custom_normal"])
    obj.data.update()
    assert again(obj, known) is None
    assert again(obj, whole(obj)) is not None


def test_reading_moved_vertices_leaves_no_mesh_in_the_file():
    obj = zoo.terrain("hi", n=12)
    known = whole(obj)
    before = {*bpy.data.meshes.keys()}
    move(obj, 6)
    assert again(obj, known) is not None
    assert {*bpy.data.meshes.keys()} == before
