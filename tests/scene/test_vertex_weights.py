# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that painted weights are read of the mesh that is baked, for each of its corners."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.scene import reading
from tests.support import zoo

NAMES = {"offset_group": "far", "straight_group": "turned"}


def paint(obj, name, by_vertex):
    """Give the group `name` these weights; vertices with None stay outside."""
    group = obj.vertex_groups.get(name) or obj.vertex_groups.new(name=name)
    for vertex, weight in enumerate(by_vertex):
        if weight is not None:
            group.add([vertex], weight, "REPLACE")


def read(low, high=None, **settings):
    high = high or zoo.plane("hi")
    bpy.context.view_layer.update()
    return reading.read(bpy.context, low, [high], None, Settings(**{"method": "CAST"} | settings))


def with_nodes(obj, build):
    """Add a Geometry Nodes modifier; build(tree, group_input, group_output) makes the nodes."""
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for kind in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=kind, socket_type="NodeSocketGeometry")
    build(tree, tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput"))
    obj.modifiers.new("Nodes", "NODES").node_group = tree


def test_each_corner_has_the_weight_of_its_vertex():
    low = zoo.plane("lo", n=2)
    paint(low, "other", [0.1] * 9)
    paint(low, "turned", [0.0, 0.25, 0.5, 1.0] + [None] * 5)
    paint(low, "far", [None] * 5 + [0.0, 0.25, 0.5, 1.0])
    meshes = read(low, **NAMES)
    offset = np.array([1, 1, 1, 1, 1, 0, 0.5, 1, 2], np.float32)  # twice the weight, 1 outside the group
    straight = np.array([-1, -0.5, 0, 1, 0, 0, 0, 0, 0], np.float32)
    assert np.array_equal(meshes.offset, offset[meshes.low.vertices])
    assert np.array_equal(meshes.straight, straight[meshes.low.vertices])
    assert meshes.offset.dtype == meshes.straight.dtype == np.float32


def test_without_names_nothing_is_read():
    low = zoo.plane("lo")
    paint(low, "far", [0.0] * 4)
    meshes = read(low)
    assert meshes.offset is None
    assert meshes.straight is None
    meshes = read(low, offset_group="far")
    assert (meshes.offset == 0.0).all()
    assert meshes.straight is None


def test_a_new_group_changes_nothing():
    low = zoo.plane("lo", n=2)
    bpy.context.view_layer.update()  # before the group is added, which Blender does not take for a change
    low.vertex_groups.new(name="far")
    assert (read(low, offset_group="far").offset == 1.0).all()


def test_flatten_needs_no_group():
    low, high = zoo.plane("lo"), zoo.plane("hi")
    assert read(low, high, method="FLATTEN", **NAMES).offset is None
    with pytest.raises(BakeError, match="'lo' has no vertex group 'far': name one that it has"):
        read(low, high, method="AUTO", **NAMES)


def test_a_group_with_a_similar_name_is_suggested():
    low = zoo.plane("lo")
    paint(low, "farther", [0.0] * 4)
    with pytest.raises(BakeError, match=r"'lo' has no vertex group 'fahrter': did you mean 'farther'\?$"):
        read(low, offset_group="fahrter")


@pytest.mark.parametrize("kind", ["SUBSURF", "MIRROR", "TRIANGULATE", "ARRAY"])
def test_modifiers_carry_the_weights_to_their_vertices(kind):
    """The weight is 0.5 + x / 2, which all of these modifiers keep up to their own moves of the vertices."""
    low = zoo.plane("lo", n=4)
    paint(low, "far", [0.5 + 0.5 * vertex.co.x for vertex in low.data.vertices])
    modifier = low.modifiers.new("Modifier", kind)
    if kind == "SUBSURF":
        modifier.subdivision_type, modifier.levels, modifier.render_levels = "SIMPLE", 1, 2
    meshes = read(low, offset_group="far")
    x = meshes.low.positions[meshes.low.vertices][:, 0]
    if kind == "ARRAY":
        x = np.where(np.arange(len(x)) < len(x) // 2, x, x - 2.0)
    if kind == "MIRROR":  # merged and copied vertices have the weights of their originals
        assert len(x) == 128
        x = np.concatenate([x[:64], -x[64:]])
    if kind == "SUBSURF":
        assert len(x) == 64 * 16  # as set for rendering
    assert np.allclose(meshes.offset, 1.0 + x, atol=1e-6)


def test_modifiers_may_renumber_the_groups():
    low, other = zoo.plane("lo"), zoo.plane("other")
    paint(other, "another", [0.9] * 4)
    paint(low, "far", [0.25] * 4)

    def join(tree, first, last):
        node, info = tree.nodes.new("GeometryNodeJoinGeometry"), tree.nodes.new("GeometryNodeObjectInfo")
        info.inputs["Object"].default_value = other
        tree.links.new(first.outputs[0], node.inputs[0])
        tree.links.new(info.outputs["Geometry"], node.inputs[0])
        tree.links.new(node.outputs[0], last.inputs[0])

    with_nodes(low, join)
    assert sorted(read(low, offset_group="far").offset) == [0.5] * 4 + [1.0] * 4


def test_modifiers_that_remove_the_group_are_named():
    low = zoo.plane("lo")
    paint(low, "far", [1.0] * 4)

    def remove(tree, first, last):
        node = tree.nodes.new("GeometryNodeRemoveAttribute")
        node.inputs["Name"].default_value = "far"
        tree.links.new(first.outputs[0], node.inputs[0])
        tree.links.new(node.outputs[0], last.inputs[0])

    with_nodes(low, remove)
    with pytest.raises(BakeError, match="The modifiers of 'lo' remove its vertex group 'far'"):
        read(low, offset_group="far")


def test_a_base_mesh_has_its_own_weights():
    low = zoo.plane("lo", n=2)
    paint(low, "far", [0.0] * 3 + [None] * 6)
    low.modifiers.new("Subdivision", "SUBSURF")
    meshes = read(low, low, offset_group="far")
    assert meshes.is_own_base
    assert np.array_equal(meshes.offset, np.where(meshes.low.vertices < 3, 0.0, 1.0))


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT", "WEIGHT_PAINT"])
def test_every_mode_has_the_weights(mode):
    low, high = zoo.plane("lo", n=2), zoo.plane("hi")
    paint(low, "far", [0.0] * 3 + [None] * 6)
    bpy.context.view_layer.objects.active = low
    bpy.ops.object.mode_set(mode=mode)
    settings = Settings(method="CAST", offset_group="far")
    for meshes in (
        reading.read(bpy.context, low, [high], None, settings),
        reading.read_again(bpy.context, low, [high], None, settings),
    ):
        assert np.array_equal(meshes.offset, np.where(meshes.low.vertices < 3, 0.0, 1.0))
