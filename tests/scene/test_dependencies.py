# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that the files that objects are made from are found, and no others."""

import bpy
import numpy as np
import pytest

from addon.scene import dependencies
from tests.support import dependency_kinds, zoo


def shape(obj):
    """The points of an evaluated object, as bytes."""
    bpy.context.view_layer.update()
    data = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    points = np.empty((len(data.vertices), 3), np.float32)
    data.vertices.foreach_get("co", points.reshape(-1))
    return points.tobytes()


@pytest.mark.parametrize("name", dependency_kinds.KINDS)
def test_a_file_is_found_from_the_object_that_depends_on_it(name, tmp_path):
    obj, other = zoo.plane("rock", 8), zoo.plane("other", 8)
    before = shape(obj)
    path = dependency_kinds.KINDS[name](obj, tmp_path)
    found = {each.path: each for each in dependencies.of([obj], [obj])}
    assert str(path) in found
    assert found[str(path)].is_needed
    assert not dependencies.of([other], [other])
    assert not dependencies.not_followed([obj])
    assert shape(obj) != before  # the object does depend on it


def test_images_that_only_materials_show_are_those_of_the_objects_that_are_shown(tmp_path):
    obj, path = zoo.plane("rock"), dependency_kinds.picture(tmp_path / "skin.png")
    material = bpy.data.materials.new("skin")
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.load(str(path))
    obj.data.materials.append(material)
    assert not dependencies.of([obj])
    (found,) = dependencies.of([obj], [obj])
    assert (found.path, found.is_surface, found.is_own_map) == (str(path), True, False)
    node.image.pack()
    assert not dependencies.of([obj], [obj])


def test_a_path_that_nodes_compute_is_named(tmp_path):
    obj = zoo.plane("rock", 8)
    dependency_kinds.nodes_import_obj(obj, tmp_path)
    tree = obj.modifiers[0].node_group
    node = next(each for each in tree.nodes if each.bl_idname == "GeometryNodeImportOBJ")
    joined = tree.nodes.new("GeometryNodeStringJoin")
    tree.links.new(joined.outputs[0], node.inputs[0])
    assert dependencies.not_followed([obj]) == [
        f"the node {node.name!r} of {tree.name!r} computes the path of its file"
    ]
