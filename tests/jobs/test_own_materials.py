# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of many kinds, baked onto their own object, against what Cycles bakes of it; normals that Cycles evaluates."""

import bpy
import mathutils
import numpy as np
import pytest

from addon.core.declarations import bases
from addon.core.material_feeds import BumpFeed
from addon.scene.materials.material_reading import read_materials
from addon.scene.textures import ImageTextures
from tests.support import angles, cycles, maps, material_setups, own_bakes, scenes, zoo
from tests.support.material_setups import bump
from tests.support.shader_nodes import add, principled

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = (192, 192)
MEAN, WORST = 0.3, 2.0
"""In steps of 8 bits."""
WORST_OF_HEIGHTS = 6.0
"""Where an image of heights is stretched: Imprint takes the slope over a pixel of the image, Cycles within one."""
FAST = (
    "image by another UV map",
    "voronoi",
    "snow on top",
    "rust on metal",
    "packed image",
    "with transparency",
    "mix 3",
)
NORMALS = (
    "normal map",
    "normal map in object space",
    "two normal maps mixed",
    "bumps of noise",
    "two bumps",
    "bumps on a normal map",
    "bumps in a group",
    "bumps of one of two shaders",
    "displacement",
    "moss on bumps",
    "mix 5",
)
ALL = {**material_setups.SETUPS, **{f"mix {seed}": material_setups.mixed(seed) for seed in range(20)}}


@pytest.mark.parametrize(
    "name", [name if name in FAST + NORMALS else pytest.param(name, marks=pytest.mark.slow) for name in ALL]
)
def test_each_map_is_what_cycles_bakes(name):
    differences, report = own_bakes.compare(name, ALL[name], SIZE)
    details = [material.detail for material in read_materials(bpy.data.materials, ImageTextures(), is_exact=True)]
    worst = WORST_OF_HEIGHTS if any(isinstance(detail, BumpFeed) for detail in details) else WORST
    assert {socket: one for socket, one in differences.items() if not (one.mean < MEAN and one.worst < worst)} == {}
    assert max(one.jumps for one in differences.values()) < 0.4
    assert not [text for text in report.warnings if "left out" in text]


@pytest.mark.parametrize("socket", ["Base Color", "Normal"])
@pytest.mark.parametrize("name", material_setups.TOLD)
def test_what_is_not_known_at_a_point_is_told(name, socket):
    """Also behind a Bump node, and in the report of what was read."""

    def make(material):
        output = material_setups.TOLD[name](material)
        if socket == "Normal":
            output = bump(material, add(material, "VectorMath", {0: output}).outputs[0])
        material.node_tree.links.new(output, principled(material).inputs[socket])

    obj, _ = own_bakes.head("Rust", make)
    report, _ = maps.bake_all_maps(obj, obj, maps=["BASE_COLOR"], size=16, normal=True)
    (told,) = [text for text in report.warnings if text.startswith(f'Material "Rust": {socket}')]
    assert "is left out" in told
    assert report.materials["Rust"][socket] == "NONE"


def normal_map(material, texels, **properties):
    """A Normal Map node that shows texels (H, W, 4), pixel by pixel."""
    image = bpy.data.images.new("own", *texels.shape[1::-1], float_buffer=True, is_data=True)
    image.pixels.foreach_set(np.ascontiguousarray(texels, np.float32).ravel())
    image.pack()
    shown = add(material, "TexImage", image=image, interpolation="Closest")
    node = add(material, "NormalMap", {"Color": shown.outputs[0]}, **properties)
    material.node_tree.links.new(node.outputs[0], principled(material).inputs["Normal"])


@pytest.mark.parametrize("is_exact", [False, True])
@pytest.mark.parametrize("basis", [basis.name for basis in bases.BASES])
@pytest.mark.parametrize("is_hard", [False, True])
def test_a_normal_map_comes_back_as_it_is(basis, is_hard, is_exact):
    """Of the material, not of the shape, by the same tangents: equal to 8 bits. is_exact: whether Cycles evaluates it."""
    random = np.random.default_rng(2).uniform(-0.5, 0.5, (*SIZE, 3)) + (0.0, 0.0, 1.2)
    random /= np.linalg.norm(random, axis=-1, keepdims=True)
    texels = np.round(np.dstack([random * 0.5 + 0.5, np.ones(SIZE)]) * 255.0) / 255.0

    def make(material):
        normal_map(material, texels)
        if is_exact:
            node = principled(material).inputs["Normal"].links[0].from_node
            doubled = add(material, "Gamma", {"Color": node.inputs["Color"].links[0].from_socket, "Gamma": 1.0 + 1e-6})
            material.node_tree.links.new(doubled.outputs[0], node.inputs["Color"])

    obj, _ = own_bakes.head("Rust", make)
    if is_hard:
        obj.data.shade_flat()
    found = maps.bake(obj, obj, size=SIZE, basis=basis)
    known = (found[..., 3] == 1.0) & ~cycles.shared(obj, SIZE)
    assert known.mean() > 0.3
    apart = np.abs(found[..., :3] - texels[..., :3]).max(axis=-1)[known] * 255.0
    # Stored steps are no unit vectors: they come back with length 1.
    length = np.linalg.norm(texels[..., :3] * 2.0 - 1.0, axis=-1)[known]
    assert np.abs(length - 1.0).max() < 0.01
    assert np.mean(apart < 1.0) > 0.999


def noisy(material, scale=3.0):
    shown = add(material, "TexNoise", {"Vector": add(material, "TexCoord").outputs["Object"], "Scale": scale})
    material.node_tree.links.new(bump(material, shown.outputs[0]), principled(material).inputs["Normal"])
    return material


def pair(turn=None):
    """A coarse and a fine sphere; the fine one has bumps of noise."""
    low, high = zoo.sphere("lo", 24), zoo.sphere("hi", 48)
    material = noisy(bpy.data.materials.new("Rust"))
    principled(material).inputs["Specular IOR Level"].default_value = 0.0
    high.data.materials.append(material)
    for obj in (low, high):
        obj.matrix_world = (turn or mathutils.Matrix.Identity(3)).to_4x4()
    bpy.context.view_layer.update()
    return low, high


TURN = mathutils.Matrix.Rotation(0.7, 3, "X")
MATRICES = {
    "plain": mathutils.Matrix.Identity(3),
    "turned": TURN,
    "mirrored": TURN @ mathutils.Matrix.Diagonal((-1.0, 1.0, 1.0)),
    "large": TURN * 3.0,
}


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
@pytest.mark.parametrize("case", MATRICES)
def test_bumps_of_noise_on_the_high_mesh_of_a_pair(case, method):
    """The truth is Cycles' bake of the high mesh."""
    low, high = pair(MATRICES[case])
    found = maps.bake(low, high, method=method, space="WORLD", size=(256, 128))
    plain = maps.bake(low, high, method=method, space="WORLD", size=(256, 128), detail_maps=False)
    truth, written = cycles.world_normals(high, (256, 128))
    inner = angles.eroded(written & (found[..., 3] == 1.0), 2)
    error, without = (angles.degrees(angles.decode(texels), truth)[inner] for texels in (found, plain))
    assert inner.mean() > 0.5
    assert np.median(without) > (1.0 if case == "large" else 4.0)  # Distance is in scene units
    assert np.percentile(error, 99) < 0.1 * np.percentile(without, 99) + 0.1


def test_a_high_mesh_that_was_turned_over_has_its_bumps_outside():
    low, high = pair()
    right = maps.bake(low, high, method="CAST", space="WORLD", size=(128, 64))
    high.data.flip_normals()
    turned = maps.bake(low, high, method="CAST", space="WORLD", size=(128, 64))
    inner = angles.eroded((right[..., 3] == 1.0) & (turned[..., 3] == 1.0), 1)
    assert np.percentile(angles.degrees(angles.decode(right), angles.decode(turned))[inner], 99) < 0.5


def test_several_samples_and_instances_have_them():
    low, high = pair()
    one = maps.bake(low, high, method="CAST", size=(128, 64))
    four = maps.bake(low, high, method="CAST", size=(128, 64), samples=4)
    inner = angles.eroded(one[..., 3] == 1.0, 1)
    assert np.median(angles.degrees(angles.decode(one), angles.decode(four))[inner]) < 1.0
    uvs = add(high.data.materials[0], "TexCoord").outputs["UV"]
    noise = next(node for node in high.data.materials[0].node_tree.nodes if node.bl_idname == "ShaderNodeTexNoise")
    high.data.materials[0].node_tree.links.new(uvs, noise.inputs["Vector"])
    plain = maps.bake(low, high, method="CAST", size=(128, 64))
    shelf = bpy.data.collections.new("Shelf")
    bpy.context.scene.collection.objects.unlink(high)
    shelf.objects.link(high)
    empty = bpy.data.objects.new("instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", shelf
    bpy.context.scene.collection.objects.link(empty)
    shown = maps.bake(low, empty, method="CAST", size=(128, 64))
    assert np.abs(plain - one).max() > 0.05
    assert np.abs(shown - plain)[inner].max() < 0.01
    coordinates = add(high.data.materials[0], "TexCoord").outputs["Object"]
    high.data.materials[0].node_tree.links.new(coordinates, noise.inputs["Vector"])
    report = scenes.bake(low, empty, method="CAST")
    assert any("Normal is left out" in text and "differs between the instances" in text for text in report.warnings)


def test_off_and_shared_materials_leave_them_out():
    """A bump map in a material that both meshes share stays above the baked map: it would count twice."""
    low, high = pair()
    plain = maps.bake(low, high, method="CAST", detail_maps=False)
    report, _ = maps.bake_all_maps(low, high, maps=["AO"], method="CAST", exact_materials="OFF", rays=16)
    assert np.array_equal(maps.pixels(bpy.data.images["map"]), plain)
    assert any("the detail is left out" in text for text in report.warnings)
    assert report.materials["Rust"]["Normal"] == "NONE"
    low.data.materials.append(high.data.materials[0])
    assert np.array_equal(maps.bake(low, high, method="CAST"), plain)


def test_an_object_alone_has_its_bumps_of_images_and_again():
    """Nothing is put into its material, so nothing counts twice."""
    obj, _ = own_bakes.head("Rust", material_setups.SETUPS["bumps of an image"])
    first, second = (maps.bake(obj, obj, material=True) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert np.abs(first[..., :2] - 0.5).max() > 0.1


def test_normals_that_point_behind_their_face_are_not_turned_over():
    """Cycles' own bake turns them, and a render does not. Some smooth normals of the head are so."""
    obj, _ = own_bakes.head("Rust", material_setups.SETUPS["bumps of noise"])
    found, plain = (maps.bake(obj, obj, size=SIZE, space="OBJECT", detail_maps=on) for on in (True, False))
    assert angles.degrees(angles.decode(found), angles.decode(plain))[found[..., 3] == 1.0].max() < 90.0


def test_a_displacement_that_moves_points_is_told():
    obj, _ = own_bakes.head("Rust", material_setups.SETUPS["displacement"])
    obj.data.materials[0].displacement_method = "BOTH"
    report = scenes.bake(obj, obj)
    assert any("the displacement moves no points, and counts as bumps" in text for text in report.warnings)
