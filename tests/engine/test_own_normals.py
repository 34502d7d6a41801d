# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole bakes that count the high mesh's own normal and bump maps in, compared with the closed form of the turned original."""

import bmesh
import bpy
import mathutils
import numpy as np
import pytest

from addon.core.progress import Pace
from addon.core.settings import Settings
from addon.jobs import Job, bake_jobs
from tests.support import angles, layouts, maps, scenes, zoo
from tests.support.layouts import Layout

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 96
LOW = Layout(degrees=24.0, scale=0.34)
PAINT = Layout(degrees=-37.0, is_mirrored=True, scale=0.31, center=(0.47, 0.55))
METHODS = ("FLATTEN", "CAST")
DEGREES = 0.2
"""The most by which a normal may be off."""
WAVES = 2.0
"""Of the picture, over the whole image: broad, so that a texel's footprint hardly flattens them."""
TILT = 0.35


def original(uv):
    """The tangent-space normals (..., 3) of the normal map at coordinates (..., 2)."""
    turn = 2.0 * np.pi * WAVES * uv
    slopes = TILT * np.stack([np.sin(turn[..., 0]), np.cos(turn[..., 1]) * 0.7], axis=-1)
    normals = np.concatenate([slopes, np.ones((*uv.shape[:-1], 1))], axis=-1)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def carved(name="carved", *, strength=1.0, layer="", pixels=512):
    """A material with the normal map."""
    found = bpy.data.materials.new(name)
    stored = original(maps.texel_uv(pixels, pixels)) * 0.5 + 0.5
    shown = scenes.texture(found, scenes.image(name, stored, space="Non-Color", is_float=True))
    node = found.node_tree.nodes.new("ShaderNodeNormalMap")
    node.inputs["Strength"].default_value, node.uv_map = strength, layer
    found.node_tree.links.new(shown.outputs["Color"], node.inputs["Color"])
    scenes.set_inputs(found, Normal=node.outputs["Normal"])
    return found


def bumpy(heights, distance=0.3):
    """A material with a bump map. heights: of coordinates (..., 2)."""
    found = bpy.data.materials.new("bumpy")
    shown = scenes.image("heights", heights(maps.texel_uv(512, 512)), space="Non-Color", is_float=True)
    node = found.node_tree.nodes.new("ShaderNodeBump")
    node.inputs["Strength"].default_value, node.inputs["Distance"].default_value = 1.0, distance
    found.node_tree.links.new(scenes.texture(found, shown).outputs["Color"], node.inputs["Height"])
    scenes.set_inputs(found, Normal=node.outputs["Normal"])
    return found


def pair(material, *, low=LOW, paint=PAINT):
    high = layouts.square("hi", {zoo.LAYER: low, layouts.PAINT: paint}, z=0.01)
    high.data.materials.append(material)
    return layouts.square("lo", {zoo.LAYER: low}), high


def expected(*, space, low=LOW, paint=PAINT, low_matrix=None, high_matrix=None):
    """The normals (SIZE, SIZE, 3) in the space of the map, and where they are known.

    Matrices (3, 3) of the objects; both objects lie on each other.
    """
    low_matrix, high_matrix = (
        np.eye(3) if matrix is None else np.array(matrix) for matrix in (low_matrix, high_matrix)
    )
    points, inside = low.texels(SIZE)
    on_high = points @ (np.linalg.inv(high_matrix) @ low_matrix)[:2, :2].T
    inside &= np.abs(on_high).max(axis=-1) < 0.97
    world = original(paint.uv(on_high)) @ in_world(paint, high_matrix).T
    if space == "WORLD":
        return world, inside
    to_space = in_world(low, low_matrix) if space == "TANGENT" else low_matrix
    return world @ np.linalg.inv(to_space).T, inside


def in_world(layout, matrix):
    """Tangent, bitangent and normal (3, 3) as columns of unit length, in world space; the normal is up."""
    frame = matrix @ layout.frame()
    frame[:, 2] = 0, 0, 1
    return frame / np.linalg.norm(frame, axis=0)


def worst(texels, normals, inside):
    assert inside.mean() > 0.15
    assert (texels[inside, 3] == 1.0).all()
    return angles.degrees(angles.decode(texels), normals)[inside].max()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("space", ["TANGENT", "OBJECT", "WORLD"])
@pytest.mark.parametrize(("turn", "is_mirrored"), [(63.0, False), (200.0, True)])
def test_a_normal_map_comes_back_turned_and_mirrored(method, space, is_mirrored, turn):
    paint = Layout(turn, is_mirrored, 0.31, (0.47, 0.55))
    texels = maps.bake(*pair(carved(), paint=paint), method=method, space=space, size=(SIZE, SIZE))
    normals, inside = expected(space=space, paint=paint)
    assert worst(texels, normals, inside) < DEGREES


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("samples", [4, 16])
def test_several_samples_are_averaged(method, samples):
    texels = maps.bake(*pair(carved()), method=method, samples=samples, size=(SIZE, SIZE))
    assert worst(texels, *expected(space="TANGENT")) < DEGREES


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("samples", [1, 4])
def test_the_pictures_of_a_bake_are_in_the_space_of_the_map(method, samples):
    """Also before the detail is there. The squares stand upright in the space of the object."""
    low, high = pair(carved())
    for obj in (low, high):
        obj.data.transform(mathutils.Matrix.Rotation(np.radians(70.0), 4, "X"))
    settings = Settings(method=method, width=SIZE, height=SIZE, samples=samples, storage="MEMORY", material=False)
    shown = []
    for step in bake_jobs.work(bpy.context, [Job(low, [high])], settings, Pace(0.0)):
        if step.picture is not None:
            texels = np.array(step.picture.read().to_list(), np.float32).reshape(step.picture.height, -1, 4)
            shown += [texels[texels[..., 3] > 0.0]]
    assert any(map(len, shown))
    # No normal of the map leans over by 45 degrees.
    assert min(texels[:, 2].min(initial=1.0) for texels in shown) > 0.85


@pytest.mark.parametrize("method", METHODS)
def test_the_switch_leaves_detail_out(method):
    low, high = pair(carved())
    texels = maps.bake(low, high, method=method, detail_maps=False, size=(SIZE, SIZE))
    _, inside = expected(space="TANGENT")
    assert np.abs(texels[inside, :3] - (0.5, 0.5, 1.0)).max() < 1e-6


@pytest.mark.parametrize("method", METHODS)
def test_maps_from_rays_come_from_the_geometry_alone(method):
    names = ("AO", "THICKNESS", "CURVATURE")
    ball = zoo.sphere("ball", 12)
    ball.scale, ball.location.z = (0.4,) * 3, 0.5
    found = [maps.bake_all_maps(*pair(carved()), ball, maps=names, method=method, detail_maps=on)[1] for on in (0, 1)]
    for name in map(str.lower, names):
        np.testing.assert_array_equal(found[0][name], found[1][name])
    assert np.ptp(found[0]["ao"][found[0]["ao"][..., 3] == 1.0, 0]) > 0.1


@pytest.mark.parametrize("method", METHODS)
def test_only_faces_with_the_material_have_its_detail(method):
    low, high = pair(carved())
    parts = layouts.square("parts", {zoo.LAYER: LOW, layouts.PAINT: PAINT}, n=2, z=0.01)
    for material in (high.data.materials[0], bpy.data.materials.new("plain")):
        parts.data.materials.append(material)
    parts.data.polygons.foreach_set("material_index", np.array([0, 1, 0, 1]))
    texels = maps.bake(low, parts, method=method, size=(SIZE, SIZE))
    normals, inside = expected(space="TANGENT")
    points, _ = LOW.texels(SIZE)
    left, right = points[..., 0] < -0.05, points[..., 0] > 0.05
    assert worst(texels, normals, inside & left) < DEGREES
    assert np.abs(texels[inside & right, :3] - (0.5, 0.5, 1.0)).max() < 1e-6


@pytest.mark.parametrize("method", METHODS)
def test_strength_and_another_layer(method):
    """The image and the tangents are of a layer that is neither active nor rendered."""
    other = Layout(80.0, False, 0.29, (0.52, 0.48))
    material = carved(strength=0.5, layer="Other")
    tree = material.node_tree
    uv = tree.nodes.new("ShaderNodeUVMap")
    uv.uv_map = "Other"
    tree.links.new(uv.outputs["UV"], next(node for node in tree.nodes if node.type == "TEX_IMAGE").inputs["Vector"])
    high = layouts.square("hi", {zoo.LAYER: LOW, "Other": other, layouts.PAINT: PAINT}, z=0.01)
    high.data.materials.append(material)
    texels = maps.bake(layouts.square("lo", {zoo.LAYER: LOW}), high, method=method, space="WORLD", size=(SIZE, SIZE))
    points, inside = LOW.texels(SIZE)
    normals = original(other.uv(points))
    normals = 0.5 * normals + (0.0, 0.0, 0.5)  # as Cycles mixes
    normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True) @ in_world(other, np.eye(3)).T
    assert worst(texels, normals, inside) < DEGREES


TURN = mathutils.Matrix.Rotation(np.radians(40.0), 3, "Z")
MIRROR = mathutils.Matrix.Diagonal((-1.0, 1.0, 1.0))
MATRICES = {
    "high turned": (mathutils.Matrix.Identity(3), TURN),
    "high mirrored": (mathutils.Matrix.Identity(3), TURN @ MIRROR),
    "low mirrored": (MIRROR @ TURN, mathutils.Matrix.Identity(3)),
    "both mirrored and scaled": (TURN @ MIRROR * 3.0, MIRROR * 3.0),
}


@pytest.mark.parametrize("space", ["TANGENT", "WORLD"])
@pytest.mark.parametrize("case", MATRICES)
def test_objects_may_be_turned_scaled_and_mirrored(case, space):
    low, high = pair(carved())
    for obj, matrix in zip((low, high), MATRICES[case], strict=True):
        obj.matrix_world = mathutils.Matrix.Translation((5.0, -3.0, obj.location.z)) @ matrix.to_4x4()
    texels = maps.bake(low, high, method="CAST", space=space, size=(SIZE, SIZE))
    low_matrix, high_matrix = MATRICES[case]
    normals, inside = expected(space=space, low_matrix=low_matrix, high_matrix=high_matrix)
    assert worst(texels, normals, inside) < DEGREES


@pytest.mark.parametrize("mirrored", ["nothing", "the empty", "its object"])
def test_instances_have_the_detail_of_their_mesh(mirrored):
    low, high = pair(carved())
    high.scale.x = -1.0 if mirrored == "its object" else 1.0
    shelf = bpy.data.collections.new("Shelf")
    bpy.context.scene.collection.objects.unlink(high)
    shelf.objects.link(high)
    empty = bpy.data.objects.new("instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", shelf
    bpy.context.scene.collection.objects.link(empty)
    matrix = TURN if mirrored == "nothing" else TURN @ MIRROR
    empty.matrix_world = (matrix if mirrored == "the empty" else TURN).to_4x4()
    texels = maps.bake(low, empty, method="CAST", size=(SIZE, SIZE))
    assert worst(texels, *expected(space="TANGENT", high_matrix=matrix)) < DEGREES


@pytest.mark.parametrize("method", METHODS)
def test_faces_may_have_more_than_four_corners(method):
    low, high = pair(carved())
    many = layouts.square("many", {zoo.LAYER: LOW, layouts.PAINT: PAINT}, n=3, z=0.01)
    many.data.materials.append(high.data.materials[0])
    mesh = bmesh.new()
    mesh.from_mesh(many.data)
    bmesh.ops.dissolve_faces(mesh, faces=mesh.faces[:])
    mesh.to_mesh(many.data)
    mesh.free()
    assert [len(face.vertices) for face in many.data.polygons] == [12]
    texels = maps.bake(low, many, method=method, size=(SIZE, SIZE))
    assert worst(texels, *expected(space="TANGENT")) < DEGREES


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scale", [1.0, 4.0])
@pytest.mark.parametrize("is_mirrored", [False, True])
def test_a_bump_map_tilts_by_the_slopes_of_its_heights(method, scale, is_mirrored):
    distance = 0.3
    paint = Layout(-37.0, is_mirrored, 0.31, (0.47, 0.55))

    def heights(uv):
        turn = 2.0 * np.pi * WAVES * uv
        return 0.5 + 0.2 * np.sin(turn[..., 0]) + 0.2 * np.cos(turn[..., 1])

    low, high = pair(bumpy(heights, distance), paint=paint)
    for obj in (low, high):
        obj.scale = (scale,) * 3
    texels = maps.bake(low, high, method=method, space="WORLD", size=(SIZE, SIZE))
    points, inside = LOW.texels(SIZE)
    step = 1e-4
    slopes = [
        (heights(paint.uv(points + move)) - heights(paint.uv(points - move))) / (2.0 * step) * distance / scale
        for move in (np.array([step, 0.0]), np.array([0.0, step]))
    ]
    normals = np.stack([-slopes[0], -slopes[1], np.ones_like(slopes[0])], axis=-1)
    assert worst(texels, normals / np.linalg.norm(normals, axis=-1, keepdims=True), inside) < DEGREES


@pytest.mark.parametrize("image", ["map", "other"])
@pytest.mark.parametrize("is_own_base", [False, True])
@pytest.mark.parametrize("has_normal_map", [False, True])
def test_a_map_in_a_material_that_both_meshes_share_is_not_counted_again(is_own_base, image, has_normal_map):
    """The first bake puts its map into the material; the second one writes the same image or another one."""
    low, high = zoo.plane("lo", 4), zoo.terrain("hi", 32)
    low.data.materials.append(carved("shared") if has_normal_map else bpy.data.materials.new("shared"))
    high.data.materials.append(low.data.materials[0])
    if is_own_base:
        low.modifiers.new("Detail", "SUBSURF").subdivision_type = "SIMPLE"
        low.modifiers[0].levels = low.modifiers[0].render_levels = 4
        wave = low.modifiers.new("Waves", "DISPLACE")
        wave.strength, wave.texture = 0.1, bpy.data.textures.new("clouds", "CLOUDS")
        high = low
    plain = maps.bake(low, high, detail_maps=False, size=(SIZE, SIZE))
    assert np.abs(plain[..., :2] - 0.5).max() > 0.05
    first = maps.bake(low, high, material=True, size=(SIZE, SIZE))
    assert np.array_equal(first, plain) != has_normal_map
    second = maps.bake(low, high, material=True, size=(SIZE, SIZE), image=image)
    assert np.array_equal(second, plain)


@pytest.mark.parametrize("is_shared", [False, True])
def test_a_bump_map_in_a_shared_material_stays_above_the_baked_map(is_shared):
    """It would count twice on the low mesh, which shows the map and the Bump node."""
    low, high = pair(bumpy(lambda uv: 0.5 + 0.2 * np.sin(2.0 * np.pi * WAVES * uv[..., 0])))
    low.data.materials.append(high.data.materials[0] if is_shared else bpy.data.materials.new("own"))
    texels = maps.bake(low, high, material=True, size=(SIZE, SIZE))
    assert (np.abs(texels[..., :2] - 0.5).max() < 1e-3) == is_shared


def test_a_map_that_was_baked_from_another_mesh_is_detail():
    """From a sculpt to a mesh of middle size, and from it to the low one."""
    sculpt = zoo.terrain("sculpt", 64)
    middle, low = (layouts.square(name, {zoo.LAYER: Layout()}) for name in ("middle", "low"))
    middle.data.materials.append(bpy.data.materials.new("skin"))
    first = maps.bake(middle, sculpt, image="first", material=True, method="CAST", size=(SIZE, SIZE))
    assert np.abs(first[..., :2] - 0.5).max() > 0.2
    second = maps.bake(low, middle, image="second", size=(SIZE, SIZE))
    inner = slice(2, -2), slice(2, -2)
    assert angles.degrees(angles.decode(first), angles.decode(second))[inner].max() < 3.0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("space", ["TANGENT", "WORLD"])
def test_a_high_mesh_that_was_turned_over_shows_its_normal_map(method, space):
    low, high = pair(carved(layer=layouts.PAINT))
    high.data.flip_normals()
    texels = maps.bake(low, high, method=method, space=space, size=(SIZE, SIZE), detail_maps=True)
    normals, inside = expected(space=space)
    assert angles.degrees(angles.decode(texels), normals)[inside].max() < DEGREES
