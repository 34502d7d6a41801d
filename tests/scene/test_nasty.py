# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that files and scene states that break other tools give a map or a clear message."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector

from addon.core.declarations.all_settings import DECLARED
from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import bake_pair
from tests.support import angles, lanes, maps, outcome, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

FILES = {  # with the number of their meshes
    "BoxBadNormals.glb": 1,
    "BoxWithInfinites.glb": 1,  # the importer moves all of its vertices to one point
    "MirroredCube_252.blend": 2,
    "busted.STL": 1,
    "chair_model.obj": 4,
    "cycloidal.ply": 1,
    "empty.obj": 0,
    "fuze.obj": 1,
    "groups.obj": 2,
    "nancolor.obj": 1,
}
LARGE = {"cycloidal.ply", "fuze.obj"}
"""Those of the slow lane."""
IMPORTERS = {
    ".obj": lambda path: bpy.ops.wm.obj_import(filepath=path),
    ".ply": lambda path: bpy.ops.wm.ply_import(filepath=path),
    ".stl": lambda path: bpy.ops.wm.stl_import(filepath=path),
    ".glb": lambda path: bpy.ops.import_scene.gltf(filepath=path),
    ".blend": lambda path: bpy.ops.wm.open_mainfile(filepath=path),
}
AROUND = 1.2
"""The size of a shape around an object, relative to the object."""
ROUNDING = 1e-3
"""Degrees: the error of positions in single precision, with quads of 1/64 of their size."""
SMALL = {"width": 32, "height": 32, "storage": "MEMORY"}
SCALES = [(1.0, 1.0, 1.0), (-1e-3, 1e3, 1.0), (1.0, 1.0, 0.0), (1e30, 1e30, 1e30)]


@pytest.mark.shared
def test_every_file_is_tested(shared_assets):
    assert sorted(path.name for path in (shared_assets / "nasty").iterdir()) == sorted(FILES)


@pytest.fixture(params=lanes.slow_but(FILES.keys() - LARGE, FILES))
def meshes(request, shared_assets):
    """The mesh objects of a file."""
    path = shared_assets / "nasty" / request.param
    IMPORTERS[path.suffix.lower()](str(path))
    found = [obj for obj in bpy.context.scene.objects if obj.type == "MESH"]
    assert len(found) == FILES[request.param]
    return found


def around(shape, obj):
    """Move and scale a shape of radius 1 so that it contains the object's bounding box."""
    bpy.context.view_layer.update()
    corners = np.array([obj.matrix_world @ Vector(corner) for corner in obj.bound_box])
    low, high = corners.min(axis=0), corners.max(axis=0)
    shape.location, shape.scale = (low + high) / 2, np.maximum((high - low) / 2, 1e-3) * AROUND
    return shape


def unwrap(obj):
    """Add UVs from the vertices' x and y, so that most faces overlap others."""
    points = np.array([vertex.co[:2] for vertex in obj.data.vertices])
    points = (points - points.min(axis=0)) / np.maximum(np.ptp(points, axis=0), 1e-9)
    corners = [loop.vertex_index for loop in obj.data.loops]
    obj.data.uv_layers.new(name=zoo.LAYER).uv.foreach_set("vector", points[corners].astype(np.float32).ravel())


def is_map(result):
    return not isinstance(result, str)


def is_a_point(obj):
    return not any(obj.dimensions)


def bake(low, high, method, folder, **settings):
    return outcome.of_bake(low, [high], Settings(method=method, **SMALL | settings), folder)


@pytest.mark.shared
@pytest.mark.parametrize(("make", "method"), [(zoo.plane, "CAST"), (zoo.sphere, "FLATTEN"), (zoo.sphere, "AUTO")])
def test_a_file_as_high(meshes, make, method, tmp_path):
    for high in meshes:
        result = bake(around(make("lo", 8), high), high, method, tmp_path)
        if method == "FLATTEN" and not high.data.uv_layers:
            assert "has no UV layer" in result
        else:
            edge_on = make is zoo.plane and high.name == "something!"  # an upright disc
            assert is_map(result) or is_a_point(high) or edge_on, result
        bpy.data.objects.remove(bpy.data.objects["lo"])


@pytest.mark.shared
@pytest.mark.parametrize(
    ("method", "scale"),
    [
        ("AUTO", SCALES[0]),
        ("FLATTEN", SCALES[0]),
        ("CAST", SCALES[1]),
        *(pytest.param("CAST", scale, marks=pytest.mark.slow) for scale in SCALES[2:]),
    ],
)
def test_a_file_as_instances(meshes, method, scale, tmp_path):
    """All objects of the file, twice in a collection that an empty instances."""
    shelf, twice = bpy.data.collections.new("Shelf"), bpy.data.collections.new("Twice")
    for obj in meshes:
        shelf.objects.link(obj)
    for number in range(2):
        inner = bpy.data.objects.new(f"inner {number}", None)
        inner.instance_type, inner.instance_collection = "COLLECTION", shelf
        inner.scale, inner.location.x = scale, 0.1 * number
        twice.objects.link(inner)
    high = bpy.data.objects.new("hi", None)
    high.instance_type, high.instance_collection = "COLLECTION", twice
    bpy.context.scene.collection.objects.link(high)
    low = around(zoo.sphere("lo", 8), meshes[0]) if meshes else zoo.sphere("lo", 8)
    result = bake(low, high, method, tmp_path)
    if not meshes:
        assert result == "'hi' has no faces."
    elif scale == (1.0, 1.0, 1.0) and method != "FLATTEN":
        assert is_map(result) or is_a_point(meshes[0]), result


@pytest.mark.shared
@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_a_file_as_low(meshes, method, tmp_path):
    for low in meshes:
        high = around(zoo.sphere("hi", 8), low)
        if not low.data.uv_layers:
            assert "has no UV layer" in bake(low, high, method, tmp_path)
            unwrap(low)
        result = bake(low, high, method, tmp_path)
        assert is_map(result) or is_a_point(low), result
        bpy.data.objects.remove(high)


@pytest.mark.shared
@pytest.mark.parametrize("method", ["AUTO", "FLATTEN"])
def test_a_file_onto_itself(meshes, method, tmp_path):
    """With a modifier that adds detail, and with the file's UVs if it has some."""
    for obj in meshes:
        if not obj.data.uv_layers:
            unwrap(obj)
        obj.modifiers.new("Detail", "DISPLACE").strength = 0.01
        result = bake(obj, obj, method, tmp_path)
        assert is_map(result) or is_a_point(obj), result


# Sizes


def scaled_pair(size):
    """A plane and a terrain over it. Their meshes, not their objects, are scaled by `size`."""
    pair = zoo.plane("lo", 8), zoo.terrain("hi", 64)
    for obj in pair:
        obj.data.transform(Matrix.Scale(size, 4))
    return pair


@pytest.mark.parametrize("size", [1e-6, 1e3, 5e8])
@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_the_map_does_not_depend_on_the_size(method, size):
    expected = maps.bake(*scaled_pair(1.0), method=method, space="TANGENT")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    texels = maps.bake(*scaled_pair(size), method=method, space="TANGENT")
    assert angles.degrees(angles.decode(texels), angles.decode(expected)).max() < ROUNDING


@pytest.mark.parametrize("size", [1e-37, 1e-12, 1e-8, 1e10, 1e20, 1e37])
@pytest.mark.parametrize("method", DECLARED["method"].values)
def test_a_size_without_valid_normals_is_refused(method, size, tmp_path):
    result = bake(*scaled_pair(size), method, tmp_path)
    assert ("too small" if size < 1.0 else "too large") in result


@pytest.mark.parametrize("size", [1e-9, 1e9])
@pytest.mark.parametrize("method", DECLARED["method"].values)
def test_a_very_small_or_large_object_scale_works(method, size, tmp_path):
    low, high = zoo.plane("lo", 8), zoo.terrain("hi", 64)
    low.scale = high.scale = [size / 2] * 3
    assert is_map(bake(low, high, method, tmp_path))


@pytest.mark.parametrize("margin_type", DECLARED["margin_type"].values)
@pytest.mark.parametrize(
    ("size", "method"), [(1e3, "FLATTEN"), (1e9, "CAST"), (1e20, "AUTO"), (1e37, "FLATTEN"), (1e37, "CAST")]
)
def test_uvs_far_outside_the_tile(method, size, margin_type, tmp_path):
    """Of one quad at the map's seams."""
    low, high = zoo.plane("lo", 8), zoo.terrain("hi", 8)
    for obj in (low, high):
        for corner in obj.data.polygons[0].loop_indices:
            obj.data.uv_layers[0].uv[corner].vector *= size
    report = bake(low, high, method, tmp_path, margin_type=margin_type)
    assert any("reach outside" in warning for warning in report.warnings)


@pytest.mark.parametrize("size", [0.0, 1e-30, 1e-25, 1e-10, 1e-5])
def test_an_island_that_is_a_point_on_another_island(size, tmp_path):
    """The margins of neighboring islands would take texels from it."""
    low, high = zoo.plane("lo", 2), zoo.terrain("hi", 2)
    for obj in (low, high):
        uv = obj.data.uv_layers[0].uv
        for face in obj.data.polygons:
            for corner in face.loop_indices:
                uv[corner].vector = uv[corner].vector * size if face.index == 0 else Vector((1, 1)) - uv[corner].vector
    assert is_map(bake(low, high, "FLATTEN", tmp_path, margin_type="ADJACENT_FACES", depth=32))


@pytest.mark.slow
def test_messages_stay_short_with_many_tiles_and_objects(tmp_path):
    low, highs = zoo.plane("lo"), [zoo.plane(f"high {number:02} {'x' * 40}") for number in range(20)]
    for corner in low.data.uv_layers[0].uv:
        corner.vector = 10.0 * corner.vector.x, 90.0 * corner.vector.y + 1.0
    for high in highs:
        high.data.uv_layers[0].uv.foreach_set("vector", [-1.0] * 8)
    sizes = SMALL | {"width": 16, "height": 16, "storage": "PACK", "udim": True, "method": "FLATTEN"}
    sentence = outcome.of_bake(low, highs, Settings(**sizes, tiles=tuple(range(1011, 1911))), tmp_path)
    assert (
        "'high 00" in sentence and "and 17 more" in sentence and "the tiles 1011, 1012, 1013 and 897 more" in sentence
    )
    sentence = outcome.of_bake(low, highs, Settings(**sizes, tiles=(1001,)), tmp_path)
    assert sentence == "'lo' lies on 1011, 1012, 1013 and 897 more, not on 1001."


# States


@pytest.mark.parametrize("scale", [0.0, np.nan])
@pytest.mark.parametrize("name", ["lo", "hi"])
@pytest.mark.parametrize("method", DECLARED["method"].values)
def test_a_hidden_object_whose_matrix_is_out_of_date(method, name, scale):
    """Blender evaluates hidden objects only when they are shown."""
    low, high = zoo.plane("lo"), zoo.plane("hi", 4)
    obj = bpy.data.objects[name]
    obj.hide_viewport = True
    bpy.context.view_layer.update()
    obj.scale.x = scale
    with pytest.raises(BakeError, match=f"^{name!r} has (zero scale|NaN or infinite values)"):
        bake_pair(bpy.context, low, [high], Settings(method=method, **SMALL))


@pytest.mark.parametrize("method", DECLARED["method"].values)
def test_a_hidden_object_whose_scale_is_no_longer_zero(method):
    low, high = zoo.plane("lo"), zoo.plane("hi", 4)
    high.scale.x = 0.0
    bpy.context.view_layer.update()
    high.hide_viewport = True
    high.scale.x = 1.0
    report = bake_pair(bpy.context, low, [high], Settings(method=method, **SMALL))
    assert (report.coverage, report.missed) == (1.0, 0.0)


def test_a_base_mesh_whose_modifiers_remove_its_uvs(tmp_path):
    obj = zoo.cube("own")
    tree = bpy.data.node_groups.new("Another cube", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    cube, output = tree.nodes.new("GeometryNodeMeshCube"), tree.nodes.new("NodeGroupOutput")
    cube.inputs["Size"].default_value = (2.1, 2.1, 2.1)
    tree.links.new(cube.outputs["Mesh"], output.inputs[0])
    obj.modifiers.new("Another cube", "NODES").node_group = tree
    assert bake(obj, obj, "AUTO", tmp_path).method == "CAST"


@pytest.mark.parametrize("mode", ["WEIGHT_PAINT", "VERTEX_PAINT", "TEXTURE_PAINT", "SCULPT"])
def test_a_mesh_in_a_paint_mode_on_one_object_and_in_edit_mode_on_another(mode, tmp_path):
    """Blender crashes if the modes are entered in the wrong order."""
    low, high = zoo.plane("lo"), zoo.plane("hi", 4)
    twin = high.copy()
    bpy.context.collection.objects.link(twin)
    high.modifiers.new("Mirror", "MIRROR"), twin.modifiers.new("Thick", "SOLIDIFY")
    for obj, name in ((high, mode), (twin, "EDIT")):
        bpy.context.view_layer.objects.active = obj
        bpy.ops.object.mode_set(mode=name)
    assert is_map(bake(low, high, "FLATTEN", tmp_path))
    assert (high.mode, twin.mode) == (mode, "EDIT")
