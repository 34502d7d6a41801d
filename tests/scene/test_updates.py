# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests which updates of the depsgraph count as changes of a shape: not those of a material, in no version of Blender."""

import bpy
import pytest

from addon.scene.updates import Shapes
from tests.support import scenes, zoo


@pytest.fixture
def changes():
    """Makes a change. Returns the names of the objects whose shape Blender then reports as another one."""
    shapes, found = Shapes(), set()

    def note(_, depsgraph):
        found.update(shapes.changed(depsgraph))

    def make(*changes):
        found.clear()
        for change in changes:
            change()
        bpy.context.view_layer.update()
        return {obj.name for obj in bpy.data.objects if obj.session_uid in found}

    bpy.app.handlers.depsgraph_update_post.append(note)
    yield make
    bpy.app.handlers.depsgraph_update_post.remove(note)


def smooth(obj):
    obj.modifiers.new("weak", "SUBSURF").levels = 0


def switch_off(obj):
    obj.modifiers.new("hidden", "DISPLACE").show_viewport = False


def share(obj):
    scenes.link(bpy.data.objects.new("twin", obj.data))


def sculpt(obj):
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="SCULPT")


def bend(obj):
    obj.modifiers.new("bend", "SIMPLE_DEFORM")


def add_key(obj):
    obj.shape_key_add(name="basis")


@pytest.mark.parametrize("prepare", [None, smooth, switch_off, share, sculpt, bend, add_key])
def test_a_material_changes_no_shape(changes, prepare):
    obj = zoo.plane("rock", 2)
    material = scenes.material("skin", obj)
    image = bpy.data.images.new("map", 4, 4)
    shows = material.node_tree.nodes.new("ShaderNodeTexImage")
    shows.image = image
    socket = material.node_tree.nodes["Principled BSDF"].inputs["Base Color"]
    material.node_tree.links.new(shows.outputs["Color"], socket)
    if prepare:
        prepare(obj)
    bpy.context.view_layer.update()
    for change in (
        lambda: setattr(material, "diffuse_color", (1.0, 0.0, 0.0, 1.0)),
        lambda: material.node_tree.nodes["Principled BSDF"].inputs["Roughness"].__setattr__("default_value", 0.25),
        image.update,
    ):
        assert changes(change) == set()


def test_a_shape_counts_beside_a_material(changes):
    obj, target = zoo.plane("rock", 2), zoo.plane("target", 2)
    material = scenes.material("skin", obj)
    bpy.context.view_layer.update()

    def paint():
        material.diffuse_color = (*(0.5 * value for value in material.diffuse_color[:3]), 1.0)

    assert changes(paint, obj.data.update) == {"rock"}
    push = obj.modifiers.new("push", "CAST")
    push.object = target
    assert changes(paint) == {"rock"}
    assert changes(paint) == set()
    assert changes(paint, lambda: setattr(target, "location", (1.0, 0.0, 0.0))) == {"rock"}
    assert changes(paint, lambda: setattr(push, "show_viewport", False)) == {"rock"}
    assert changes(paint) == set()


def test_a_modifier_that_a_driver_makes_weak_counts_beside_a_material(changes):
    """Then the object shows its datablock again, of which the material alone has changed."""
    obj, target = zoo.plane("rock", 2), zoo.plane("target", 2)
    material = scenes.material("skin", obj)
    push = obj.modifiers.new("push", "DISPLACE")
    driver = push.driver_add("strength").driver
    variable = driver.variables.new()
    variable.name, variable.type = "x", "TRANSFORMS"
    variable.targets[0].id, variable.targets[0].transform_type = target, "LOC_X"
    driver.expression = "x"
    target.location.x = 1.0
    bpy.context.view_layer.update()
    assert changes(lambda: setattr(target, "location", (2.0, 0.0, 0.0))) == {"rock"}

    def weaken():
        material.diffuse_color = (1.0, 0.0, 0.0, 1.0)
        target.location.x = 0.0

    assert changes(weaken) == {"rock"}
