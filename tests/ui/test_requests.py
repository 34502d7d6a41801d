# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes as people without a high object have them, after public requests: one press each. Either the maps have the values of
a closed form, or one sentence says what is wrong.
"""

from dataclasses import dataclass, field
from functools import partial

import bpy
import numpy as np
import pytest

from addon.cli import command, run_report
from addon.scene.importing import PLAIN, import_meshes
from addon.ui import results
from tests.support import glb, gltf_characters, layouts, maps, panel, scenes, zoo

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SIDE = 32
EXACT = 1e-4
"""Of values that are read and not traced."""
NOISE = 0.12
"""Of the occlusion of one texel with RAYS rays: four standard errors."""
BIAS = 0.02
"""Of its mean over all texels."""
RAYS = 256
WALL = 2.0
"""The height of walls at x = 1 of floors from x = -1 to 1. They are so long that their ends do not matter."""
LONG = 60.0
SHOWN = np.s_[..., 3]


@dataclass
class Outcome:
    """What a press must lead to.

    Attributes:
        values: By the name of an image, the values (H, W, C) of its first channels; where they are NaN, they do not count.
        tolerance: Of each value, and of the mean of all.
        refused: A part of the sentence of a press that changes nothing.
        told: A part of a warning.
        left_out: Names of objects that are selected and not baked.
        also: Called after the press, for what values do not show.
    """

    values: dict = field(default_factory=dict)
    tolerance: tuple[float, float] = (EXACT, EXACT)
    refused: str = ""
    told: str = ""
    left_out: tuple[str, ...] = ()
    also: object = None


SCENES = {}


def scene(name):
    """Enter a builder into the table of scenes. It selects what is pressed for, and returns an Outcome."""
    return partial(SCENES.__setitem__, name)


def use(*kinds, **settings):
    """Choose maps, SIDE x SIDE floats, without a normal map."""
    usual = {"normal": False, "storage": "MEMORY", "depth": "32", "margin": 0, "samples": "1", "material": False}
    panel.use(**usual | {"width": SIDE, "height": SIDE, "rays": RAYS, "maps": set(kinds)} | settings)


def select(*objects):
    """Select these, the first of which is active, and returns it. Blender cannot select what it has not evaluated."""
    bpy.context.view_layer.update()
    return scenes.select(*objects)


def grid(side=SIDE):
    """u and v (side, side) of texels."""
    return np.moveaxis(maps.texel_uv(side, side), -1, 0)


def of_plane(z=0.0):
    """The positions on zoo.plane."""
    u, v = grid()
    return np.stack([2.0 * u - 1.0, 2.0 * v - 1.0, np.full_like(u, z)], axis=-1)


COLORS = np.random.default_rng(43).uniform(0.05, 0.95, (11, 3))


def stripes(name, count=11, **inputs):
    """A plane of `count` stripes along u, each with a material of its own color and roughness."""
    obj = zoo.plane(name, count, smooth=False)
    for number in range(count):
        values = {"Roughness": (number + 1.0) / (count + 1.0), "Metallic": 1.0 if number % 2 else 0.0, **inputs}
        scenes.material(f"{name} {number}", obj, Base_Color=COLORS[number], **values)
    for polygon in obj.data.polygons:
        polygon.material_index = min(int((polygon.center.x + 1.0) / 2.0 * count), count - 1)
    return obj


def number_of(u, count=11):
    """The number of the stripe at u, and whether it is no border."""
    return np.clip((u * count).astype(int), 0, count - 1), np.abs(u * count - np.round(u * count)) > 0.02


def colors_at(u, count=11):
    number, is_inside = number_of(u, count)
    return np.where(is_inside[..., None], COLORS[number], np.nan)


def occlusion(distances, height=WALL):
    """Of a floor at distances from long walls of a height, in closed form: the cosine-weighted share of the sky."""
    return 1.0 - sum(0.5 * (1.0 - d / np.hypot(d, height)) for d in distances)


def floor(name="floor", *, at=0.0, tall=None, **options):
    """A floor from -1 to 1 in x whose texels fill u from 0 to 0.5, and a wall at x = 1, which fills the rest."""
    points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    points += [(1, -LONG, 0), (1, LONG, 0), (1, LONG, WALL), (1, -LONG, WALL)]
    uv = [(0, 0), (0.5, 0), (0.5, 1), (0, 1), (0.5, 0), (0.5, 1), (1, 1), (1, 0)]
    points = np.array(points, float)
    if tall is not None:
        points[6:, 2] = tall
    obj = zoo.build(name, points, [(0, 1, 2, 3), (4, 7, 6, 5)], np.array(uv, float), smooth=False, **options)
    obj.location.y = at
    return obj


def wall(name="wall", x=1.0):
    """A wall alone, which faces -x."""
    points = np.array([(x, -LONG, 0), (x, LONG, 0), (x, LONG, WALL), (x, -LONG, WALL)], float)
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    return zoo.build(name, points, [(0, 3, 2, 1)], uv, smooth=False)


def of_floor(height=WALL):
    """The occlusion of the texels of `floor`; its wall does not count."""
    u, _ = grid()
    return np.where(u < 0.5, occlusion([1.0 - (4.0 * u - 1.0)], height), np.nan)[..., None]


def of_ground(height=WALL):
    """The occlusion of zoo.plane beside a wall at x = 1."""
    return occlusion([1.0 - of_plane()[..., 0]], height)[..., None]


def traced(values, **more):
    return Outcome(values, tolerance=(NOISE, BIAS), **more)


# Several objects without a high object


@scene("ambient occlusion of several objects")
def _():
    objects = [floor(name, at=500.0 * number) for number, name in enumerate("abc")]
    select(*objects)
    use("AO")
    return traced({f"{obj.name}_ao": of_floor() for obj in objects})


@scene("curvature of several objects")
def _():
    flat = zoo.plane("flat")
    bpy.ops.mesh.primitive_uv_sphere_add(location=(6.0, 0.0, 0.0))
    bpy.context.object.name = "ball"
    bpy.ops.object.shade_smooth()
    select(flat, bpy.data.objects["ball"])
    use("CURVATURE", distance_unit="SCENE", curvature_limited=True, curvature_radius=0.4)

    def convex():
        texels = maps.pixels(bpy.data.images["ball_curvature"])
        assert (texels[texels[SHOWN] > 0.0, 0] > 0.5).mean() > 0.95

    return Outcome({"flat_curvature": np.full((SIDE, SIDE, 1), 0.5)}, also=convex)


@scene("two low objects under one that is high")
def _():
    select(zoo.plane("a_low"), zoo.plane("b_low"))
    bpy.data.objects["b_low"].location.x = 3.0
    zoo.plane("a_high", slope=0.2)
    bpy.context.view_layer.update()
    use("POSITION")
    sloped = of_plane()
    sloped[..., 2] = 0.2 * sloped[..., 0]
    return Outcome({"a_low_position": sloped, "b_low_position": of_plane()}, tolerance=(2e-2, 1e-2))


@scene("a light, a camera and an empty are selected as well")
def _():
    others = panel.add("Sun", bpy.data.lights.new("Sun", "SUN")), panel.add("Eye", bpy.data.cameras.new("Eye"))
    planes = zoo.plane("a"), zoo.plane("b")
    planes[1].location.x = 5.0
    select(*planes, *others, panel.add("Target"))
    use("POSITION")
    return Outcome({f"{name}_position": of_plane() for name in "ab"})


@scene("a light is selected with one object alone")
def _():
    select(zoo.plane("crate"), panel.add("Sun", bpy.data.lights.new("Sun", "SUN")))
    use("POSITION")
    return Outcome({"crate_position": of_plane()})


@scene("an armature is selected with one object alone")
def _():
    select(zoo.plane("crate"), panel.add("Rig", bpy.data.armatures.new("Rig")))
    use("POSITION")
    return Outcome(refused="'Rig' is of the type armature")


@scene("moved apart by a script a moment before")
def _():
    first, second = zoo.plane("a"), zoo.plane("b")
    select(first, second)
    second.location.x = 5.0
    use("POSITION")
    return Outcome({f"{name}_position": of_plane() for name in "ab"})


@scene("an ending of a name without a partner")
def _():
    select(zoo.plane("crate_low"))
    use("POSITION")
    return Outcome({"crate_low_position": of_plane()})


@scene("objects that share a mesh")
def _():
    first = zoo.plane("a")
    second = scenes.link(bpy.data.objects.new("b", first.data))
    second.location.x = 5.0
    bpy.context.view_layer.update()
    select(first, second)
    use("POSITION")
    return Outcome({f"{name}_position": of_plane() for name in "ab"})


@scene("objects that share a mesh in one image")
def _():
    first = zoo.plane("a")
    second = scenes.link(bpy.data.objects.new("b", first.data))
    second.location.x = 5.0
    select(first, second)
    use("POSITION", share_image=True)
    return Outcome(told="which have the same mesh: make it a single user")


@scene("one of several has no UV map")
def _():
    bare = zoo.plane("bare")
    bare.data.uv_layers.remove(bare.data.uv_layers[0])
    bare.location.x = 5.0
    bpy.context.view_layer.update()
    select(zoo.plane("a"), bare)
    use("POSITION")
    return Outcome({"a_position": of_plane()}, left_out=("bare",))


# Many materials


@scene("eleven materials into one")
def _():
    obj = select(stripes("figure"))
    use("BASE_COLOR", "ROUGHNESS", one_material=True)
    number, is_inside = number_of(grid()[0])
    rough = np.where(is_inside, (number + 1.0) / 12.0, np.nan)[..., None]

    def one():
        assert [slot.material.name for slot in obj.material_slots] == ["figure"]

    return Outcome({"figure_base_color": colors_at(grid()[0]), "figure_roughness": rough}, also=one)


@scene("eleven materials that overlap")
def _():
    obj = stripes("figure")
    for corner in obj.data.uv_layers[0].uv:
        corner.vector.x = corner.vector.x * 11.0 % 1.0
    for polygon in obj.data.polygons:
        for corner, x in zip(polygon.loop_indices, (0.0, 1.0, 1.0, 0.0), strict=True):
            obj.data.uv_layers[0].uv[corner].vector.x = x
    select(obj)
    use("BASE_COLOR", "POSITION", width=128, height=128)

    def unwrapped():
        """A new UV map has them all."""
        assert bpy.ops.imprint.unwrap() == {"FINISHED"}
        assert bpy.ops.imprint.bake() == {"FINISHED"}
        color, position = (maps.pixels(bpy.data.images[f"figure_{name}"]) for name in ("base_color", "position"))
        expected = colors_at(position[..., 0] / 2.0 + 0.5)
        counts = (position[SHOWN] > 0.0) & ~np.isnan(expected[..., 0])
        assert counts.mean() > 0.3
        np.testing.assert_allclose(color[counts, :3], expected[counts], atol=1e-3)

    return Outcome(told="belong to faces of different materials", also=unwrapped)


@scene("all materials into one set of images")
def _():
    select(stripes("shelf", 5))
    use("BASE_COLOR", "METALLIC")
    number, is_inside = number_of(grid()[0], 5)
    metal = np.where(is_inside, number % 2, np.nan)[..., None]
    return Outcome({"shelf_base_color": colors_at(grid()[0], 5), "shelf_metallic": metal})


def halves(*names):
    """Planes that have the left and the right half of one UV map."""
    objects = [zoo.plane(name) for name in names]
    for number, obj in enumerate(objects):
        scenes.move_uvs(obj, (0.5, 1.0), (0.5 * number, 0.0))
        obj.location.x = 5.0 * number
        scenes.material(f"{obj.name} paint", obj, Base_Color=COLORS[number])
    bpy.context.view_layer.update()
    return objects


def of_halves():
    return COLORS[(grid()[0] > 0.5).astype(int)]


@scene("another object comes into a set of images")
def _():
    first, second = halves("cup", "plate")
    select(first)
    use("BASE_COLOR", image="set", share_image=True)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    select(second)
    return Outcome({"set_base_color": of_halves()})


@scene("two objects in one set of images")
def _():
    select(*halves("cup", "plate"))
    use("BASE_COLOR", image="set", share_image=True)
    return Outcome({"set_base_color": of_halves()})


@scene("names of images")
def _():
    select(*halves("cup", "plate"))
    use("BASE_COLOR", image="T_{low}")
    expected = {}
    for number, name in enumerate(("cup", "plate")):
        is_own = (grid()[0] > 0.5) == number
        expected[f"T_{name}_base_color"] = np.where(is_own[..., None], COLORS[number], np.nan)
    return Outcome(expected)


@scene("twelve tiles of a city")
def _():
    tiles = [stripes(f"tile {number}", 3 + number % 3) for number in range(12)]
    for number, tile in enumerate(tiles):
        tile.location = (2.0 * (number % 4), 2.0 * (number // 4), 0.0)
    bpy.context.view_layer.update()
    select(*tiles)
    use("BASE_COLOR", "POSITION", share_image=True, one_material=True, width=128, height=128)
    assert bpy.ops.imprint.pack_uvs(selected=True) == {"FINISHED"}

    def one():
        assert {slot.material.name for tile in tiles for slot in tile.material_slots} == {"atlas"}
        color = maps.pixels(bpy.data.images["atlas_base_color"])
        for tile in tiles:
            uv = np.array([corner.vector for corner in tile.data.uv_layers["Atlas"].uv])
            points = np.array([tile.data.vertices[loop.vertex_index].co for loop in tile.data.loops])
            affine = np.linalg.lstsq(np.c_[uv, np.ones(len(uv))], points[:, 0], rcond=None)[0]
            u, v = grid(128)
            lows, highs = uv.min(axis=0), uv.max(axis=0)
            x = affine[0] * u + affine[1] * v + affine[2]
            inside = (u > lows[0]) & (u < highs[0]) & (v > lows[1]) & (v < highs[1])
            expected = colors_at(x / 2.0 + 0.5, 3 + tiles.index(tile) % 3)
            counts = inside & ~np.isnan(expected[..., 0])
            assert counts.sum() > 100
            np.testing.assert_allclose(color[counts, :3], expected[counts], atol=1e-3)

    return Outcome(also=one)


def ramp(name="ramp"):
    """An image whose red is u and whose green is v."""
    u, v = grid()
    return scenes.image(name, np.stack([u, v, 0.5 + 0.0 * u], axis=-1), space="Non-Color", is_float=True)


@scene("a material of objects with other UVs")
def _():
    objects = zoo.plane("a"), zoo.plane("b")
    objects[1].location.x = 5.0
    scenes.show(objects[0], ramp(), interpolation="Linear", extension="EXTEND")
    objects[1].data.materials.append(objects[0].data.materials[0])
    scenes.move_uvs(objects[1], (0.5, 0.5), (0.25, 0.25))
    bpy.context.view_layer.update()
    select(*objects)
    use("BASE_COLOR")
    u, v = grid()
    expected = np.stack([u, v], axis=-1)
    is_within = (np.abs(expected - 0.5) < 0.25).all(axis=-1)[..., None]
    return Outcome(
        {"a_base_color": expected, "b_base_color": np.where(is_within, expected, np.nan)}, tolerance=(2e-3, 1e-3)
    )


@scene("no material")
def _():
    select(zoo.plane("clay"))
    use("BASE_COLOR")
    return Outcome({"clay_base_color": np.full((SIDE, SIDE, 3), 0.8)})


@scene("empty slots")
def _():
    obj = stripes("shelf", 4)
    obj.material_slots[1].material = None
    select(obj)
    use("BASE_COLOR")
    expected = colors_at(grid()[0], 4)
    expected[number_of(grid()[0], 4)[0] == 1] = 0.8
    return Outcome({"shelf_base_color": expected})


@scene("an alpha that is constant 0")
def _():
    obj = select(zoo.plane("ghost"))
    scenes.material("clear", obj, Alpha=0.0, Base_Color=COLORS[0])
    use("BASE_COLOR", "AO")
    return Outcome(told="The alpha of 'ghost' is below its threshold everywhere")


@scene("thickness of a slab")
def _():
    """Of h / cos of the angle, up to D, the mean over a hemisphere weighted by the cosine is 2 b - b^2 of D, with b = h / D."""
    points = [(x, y, z) for z in (0.0, -0.5) for x, y in ((-9, -9), (9, -9), (9, 9), (-9, 9))]
    uv = np.array([(0, 0), (1, 0), (1, 0.5), (0, 0.5), (0, 0.5), (1, 0.5), (1, 1), (0, 1)], float)
    obj = zoo.build("slab", np.array(points, float), [(0, 1, 2, 3), (4, 7, 6, 5)], uv[[0, 1, 2, 3, 4, 7, 6, 5]])
    select(obj)
    use("THICKNESS", distance_unit="SCENE", thickness_limited=True, thickness_distance=4.0)

    expected = np.full((SIDE, SIDE, 1), np.nan)
    expected[4:12, 8:24] = 2.0 * 0.125 - 0.125**2  # the sides are farther away there
    return traced({"slab_thickness": expected})


# Textures that are there


@scene("the UV map stays when a model is textured anew")
def _():
    obj = select(stripes("chair", 3))
    uv = [tuple(corner.vector) for corner in obj.data.uv_layers[0].uv]
    use("BASE_COLOR", material=True)

    def stays():
        assert len(obj.data.uv_layers) == 1
        assert [tuple(corner.vector) for corner in obj.data.uv_layers[0].uv] == uv

    return Outcome({"chair_base_color": colors_at(grid()[0], 3)}, also=stays)


@scene("a material reads the image that is written")
def _():
    obj = select(zoo.plane("wall"))
    scenes.show(obj, ramp("wall_base_color"))
    use("BASE_COLOR")
    return Outcome(refused="which this bake would fill")


@scene("a mesh's own normal map")
def _():
    obj = select(zoo.plane("brick"))
    noise = np.random.default_rng(4).normal(size=(SIDE, SIDE, 3)) * 0.2 + (0.0, 0.0, 1.0)
    stored = noise / np.linalg.norm(noise, axis=-1, keepdims=True) * 0.5 + 0.5
    made = scenes.material("bricks", obj)
    texture = scenes.texture(made, scenes.image("bricks", stored, space="Non-Color", is_float=True))
    node = made.node_tree.nodes.new("ShaderNodeNormalMap")
    made.node_tree.links.new(texture.outputs["Color"], node.inputs["Color"])
    scenes.set_inputs(made, Normal=node.outputs["Normal"])
    use(normal=True, image="out")
    return Outcome({"out": stored}, tolerance=(0.5 / 255.0, 0.5 / 255.0))


@scene("onto a second UV map")
def _():
    obj = layouts.square(
        "sign", {"to": layouts.Layout(degrees=90.0, scale=0.5), layouts.PAINT: layouts.Layout(scale=0.5)}
    )
    scenes.show(obj, ramp(), extension="EXTEND")
    select(obj)
    use("BASE_COLOR")
    u, v = grid()
    return Outcome({"sign_base_color": np.stack([v, 1.0 - u], axis=-1)}, tolerance=(2e-3, 1e-3))


@scene("tiles of UDIM")
def _():
    obj = stripes("wide", 2)
    for polygon in obj.data.polygons:
        for corner in polygon.loop_indices:
            place = obj.data.uv_layers[0].uv[corner].vector
            place.x = place.x * 2.0
    select(obj)
    use("BASE_COLOR", udim=True, storage="PACK")

    def both():
        image = bpy.data.images["wide_base_color"]
        assert sorted(tile.number for tile in image.tiles) == [1001, 1002]
        np.testing.assert_allclose(maps.pixels(image)[..., :3].reshape(-1, 3)[0], COLORS[0], atol=EXACT)

    return Outcome(also=both)


@scene("tiles of UDIM without the setting")
def _():
    obj = select(zoo.plane("wide"))
    scenes.move_uvs(obj, (2.0, 1.0))
    use("POSITION")
    return Outcome(told="reach outside the UV tile")


# What blocks rays


@scene("an object in a room")
def _():
    ground = select(zoo.plane("ground", smooth=False))
    wall()
    use("AO", occluders="SCENE")
    return traced({f"{ground.name}_ao": of_ground()})


@scene("an object in a room for itself")
def _():
    select(zoo.plane("ground", smooth=False))
    wall()
    use("AO")
    return Outcome({"ground_ao": np.ones((SIDE, SIDE, 1))})


@scene("a hidden wall of a room")
def _():
    select(zoo.plane("ground", smooth=False))
    wall().hide_render = True
    use("AO", occluders="SCENE")
    return Outcome({"ground_ao": np.ones((SIDE, SIDE, 1))})


@scene("a room of instances")
def _():
    shelf = panel.shelve(wall(), is_linked=False)
    ground = zoo.plane("ground", smooth=False)
    panel.instance_of(shelf, "room")
    select(ground)
    use("AO", occluders="SCENE")
    return traced({"ground_ao": of_ground()})


def see_through(threshold):
    """A wall of alpha 0.6, which its material compares with a threshold."""
    obj = select(floor())
    scenes.material("ground", obj)
    glass = scenes.material("fence", obj)
    node = glass.node_tree.nodes.new("ShaderNodeMath")
    node.operation, node.inputs[1].default_value = "GREATER_THAN", threshold
    plain = scenes.texture(glass, scenes.image("alpha", np.full((4, 4), 0.6), space="Non-Color", is_float=True))
    glass.node_tree.links.new(plain.outputs["Color"], node.inputs[0])
    scenes.set_inputs(glass, Alpha=node.outputs[0])
    obj.data.polygons[1].material_index = 1
    use("AO")


@scene("alpha above its threshold")
def _():
    see_through(0.5)
    return traced({"floor_ao": of_floor()})


@scene("alpha below its threshold")
def _():
    see_through(0.8)
    return Outcome({"floor_ao": np.where(np.isnan(of_floor()), np.nan, 1.0)})


# What shapes an object


@scene("mirrored by its scale")
def _():
    obj = select(floor())
    obj.scale.x = -1.0
    bpy.context.view_layer.update()
    use("AO", two_sided=True)
    return traced({"floor_ao": of_floor()})


@scene("scaled unevenly")
def _():
    obj = select(floor())
    obj.scale.z = 0.25
    bpy.context.view_layer.update()
    use("AO")
    return traced({"floor_ao": of_floor(0.25 * WALL)})


@scene("a Mirror modifier")
def _():
    obj = select(floor())
    obj.modifiers.new("Mirror", "MIRROR").use_mirror_merge = False
    obj.location.x = 0.0
    mirror = obj.modifiers["Mirror"]
    mirror.mirror_object = panel.add("middle")
    select(obj)
    use("AO")
    u, _ = grid()
    x = 4.0 * u - 1.0
    return traced({"floor_ao": np.where(u < 0.5, occlusion([1.0 - x, 1.0 + x]), np.nan)[..., None]})


@scene("a shape key that raises a wall")
def _():
    obj = select(floor(tall=0.0))
    obj.shape_key_add(name="Basis")
    key = obj.shape_key_add(name="up")
    for number in (6, 7):
        key.data[number].co.z = WALL
    key.value = 1.0
    obj.data.vertices[6].co.x = obj.data.vertices[7].co.x = 1.0 + WALL
    bpy.context.view_layer.update()
    use("AO")
    return traced({"floor_ao": of_floor()})


@scene("posed by an armature")
def _():
    obj = floor()
    for number in (6, 7):
        obj.data.vertices[number].co = (1.0 + WALL, obj.data.vertices[number].co.y, 0.0)
    scenes.weigh(obj, "wall", [0, 0, 0, 0, 1, 1, 1, 1])
    rig = panel.add("rig", bpy.data.armatures.new("rig"))
    select(rig)
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.data.edit_bones.new("wall")
    bone.head, bone.tail = (1.0, 0.0, 0.0), (1.0 + WALL, 0.0, 0.0)
    bone.align_roll((0.0, 0.0, 1.0))
    bpy.ops.object.mode_set(mode="OBJECT")
    rig.pose.bones["wall"].rotation_mode = "XYZ"
    rig.pose.bones["wall"].rotation_euler.x = np.pi / 2.0
    obj.modifiers.new("Armature", "ARMATURE").object = rig
    bpy.context.view_layer.update()
    select(obj)
    use("AO")
    return traced({"floor_ao": of_floor()})


@scene("one triangle")
def _():
    points = np.array([(-1, -1, 0), (1, -1, 0), (-1, 1, 0)], float)
    select(zoo.build("tri", points, [(0, 1, 2)], points[:, :2] / 2.0 + 0.5))
    use("POSITION")
    u, v = grid()
    return Outcome({"tri_position": np.where((u + v < 0.98)[..., None], of_plane(), np.nan)})


@scene("a linked library object")
def _(folder):
    obj = scenes.link(scenes.to_library(folder / "library.blend", zoo.plane("statue")))
    select(obj)
    use("POSITION")
    return Outcome({"statue_position": of_plane()})


@scene("in Edit Mode")
def _():
    select(zoo.plane("draft"))
    bpy.ops.object.mode_set(mode="EDIT")
    use("POSITION")
    return Outcome({"draft_position": of_plane()})


# Wrong input


@scene("no UV map")
def _():
    obj = select(zoo.plane("bare"))
    obj.data.uv_layers.remove(obj.data.uv_layers[0])
    use("AO")
    return Outcome(refused="'bare' has no UV layer: unwrap it first.")


@scene("an empty UV map")
def _():
    obj = select(zoo.plane("bare"))
    scenes.move_uvs(obj, (0.0, 0.0))
    use("AO")
    return Outcome(refused="UV")


@scene("nothing is selected")
def _():
    bpy.context.view_layer.objects.active = None
    use("AO")
    return Outcome(refused="No low object")


@scene("a collection's instance")
def _():
    select(panel.instance_of(panel.shelve(zoo.plane("crate"), is_linked=False), "crates"))
    use("AO")
    return Outcome(refused="cannot be baked onto")


@scene("text that is no mesh yet")
def _():
    select(panel.add("sign", bpy.data.curves.new("sign", "FONT")))
    use("AO")
    return Outcome(refused="choose a mesh, or convert it to one")


@scene("no faces")
def _():
    select(panel.add("wire", bpy.data.meshes.new("wire")))
    use("AO")
    return Outcome(refused="'wire' has no faces")


@scene("no thickness by its scale")
def _():
    select(zoo.plane("flat")).scale.x = 0.0
    bpy.context.view_layer.update()
    use("AO")
    return Outcome(refused="zero scale")


@scene("halves on the same texels")
def _():
    select(zoo.mirrored("face"))
    use("AO")
    return Outcome(told="Shared UVs")


# Files


@scene("an avatar into an atlas of one material")
def _(folder):
    objects = import_meshes(str(gltf_characters.character(folder / "avatar.glb")), PLAIN)
    select(*objects)
    use("BASE_COLOR", "POSITION", share_image=True, one_material=True, width=64, height=64)
    assert bpy.ops.imprint.pack_uvs(selected=True) == {"FINISHED"}

    def one():
        assert {slot.material.name for obj in objects for slot in obj.material_slots} == {"atlas"}
        color, position = (maps.pixels(bpy.data.images[f"atlas_{name}"]) for name in ("base_color", "position"))
        uv = np.array([corner.vector for corner in bpy.data.objects["stone"].data.uv_layers["Atlas"].uv])
        center, half = (uv.max(axis=0) + uv.min(axis=0)) / 2.0, np.ptp(uv, axis=0) / 2.0
        is_stone = (position[SHOWN] > 0.0) & (np.abs(maps.texel_uv(64, 64) - center) < half).all(axis=-1)
        assert is_stone.sum() > 30
        np.testing.assert_allclose(color[is_stone, :3], 0.4, atol=EXACT)
        assert (position[SHOWN] > 0.0).mean() > 0.12

    return Outcome(also=one)


@scene("organs without UV maps")
def _(folder):
    """Eggs of two lengths side by side: no ray meets another one."""
    objects = import_meshes(str(organs(folder / "organs.glb")), PLAIN)
    select(*objects)
    use("AO", "POSITION", normal=True)
    for obj in objects:
        assert bpy.ops.imprint.unwrap(low=obj.name) == {"FINISHED"}

    def eggs():
        for obj in objects:
            occluded, position, normal = (
                maps.pixels(bpy.data.images[f"{obj.name}_{name}"]) for name in ("ao", "position", "normal")
            )
            is_hit = position[SHOWN] > 0.0
            assert is_hit.mean() > 0.1
            assert occluded[is_hit, 0].min() > 0.95
            size = np.linalg.norm(position[is_hit, :3] / EGG, axis=-1)  # 1 on the egg, a little less within its faces
            assert size.min() > 0.9 and size.max() < 1.0 + EXACT
            assert np.abs(normal[is_hit, :3] - (0.5, 0.5, 1.0)).max() < 1.0 / 255.0

    return Outcome(also=eggs)


EGG = np.array([1.0, 1.0, 1.5])
"""The radii of organs in Blender, whose z is glTF's y."""


def organs(path):
    """Three meshes without UV sets."""
    file = gltf_characters.Writer()
    for number in range(3):
        positions, normals, _, corners = gltf_characters.ellipsoid(np.zeros(3), EGG[[0, 2, 1]], 16, 24)
        attributes = {"POSITION": file.accessor(positions, has_bounds=True), "NORMAL": file.accessor(normals)}
        primitive = {"attributes": attributes, "indices": file.accessor(corners.reshape(-1), "H")}
        mesh = file.add("meshes", {"name": f"organ {number}", "primitives": [primitive]})
        node = {"name": f"organ {number}", "mesh": mesh, "translation": [5.0 * number, 0.0, 0.0]}
        file.tree["scenes"][0]["nodes"].append(file.add("nodes", node))
    return file.save(path)


@pytest.mark.parametrize("name", SCENES)
def test_one_press(name, tmp_path):
    build = SCENES[name]
    outcome = build(tmp_path) if build.__code__.co_argcount else build()
    if outcome.refused:
        assert outcome.refused in panel.refusal(bpy.ops.imprint.bake)
        return
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    manager = bpy.context.window_manager
    assert outcome.told in manager.imprint_warnings + manager.imprint_summary
    batch = results.batch()
    assert tuple(low for low, _ in batch.left_out) == outcome.left_out if batch else not outcome.left_out
    for image, expected in outcome.values.items():
        found = maps.pixels(bpy.data.images[image])
        apart = found[..., : expected.shape[-1]] - expected
        assert np.isfinite(apart).any(), image
        assert np.nanmax(np.abs(apart)) <= outcome.tolerance[0], image
        assert np.abs(np.nanmean(apart, axis=(0, 1))).max() <= outcome.tolerance[1], image
    if outcome.also is not None:
        outcome.also()


def test_occlusion_and_thickness_in_the_file_that_was_given(tmp_path, monkeypatch):
    """One command: the .glb has the same meshes, and maps."""
    monkeypatch.chdir(tmp_path)
    before, _ = glb.parse(gltf_characters.cart(tmp_path / "cart.glb"))
    words = ["cart.glb", "--size", "64", "--no-normal", "--maps", "ao,thickness", "--export", "out.glb", "--rays", "32"]
    assert command.run(words) == run_report.DONE
    after, _ = glb.parse(tmp_path / "out.glb")
    assert after["nodes"] == before["nodes"]
    assert any("occlusionTexture" in material for material in after["materials"])
    assert {path.name for path in tmp_path.glob("*.png")} >= {"out_ao.png", "out_thickness.png"}


def test_a_file_of_organs_without_uv_maps_is_told(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    organs(tmp_path / "organs.glb")
    words = ["organs.glb", "--size", "64", "--maps", "ao", "--export", "out.glb"]
    assert command.run(words) != run_report.DONE
    said = capsys.readouterr().err
    assert "has no UV layer: unwrap it first" in said and "Traceback" not in said
    assert not (tmp_path / "out.glb").exists()
