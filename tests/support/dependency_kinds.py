# SPDX-License-Identifier: GPL-3.0-or-later
"""Ways in which an object can depend on a file: each makes one, for an object that has to be different without it.

A kind is a function of an object and an empty folder. It gives the object, a square of 8 x 8 faces, the dependency, and returns
the file, which it has written.
"""

import shutil
import struct
from pathlib import Path

import bpy
import numpy as np

from tests.support import feeds

FONT = Path(bpy.utils.system_resource("DATAFILES"), "fonts", "Inter.woff2")
KINDS = {}
"""The kinds by their names."""


def kind(make):
    KINDS[make.__name__] = make
    return make


def points_of(obj, shift=0.2):
    """The points of an object (N, 3), moved up by a wave."""
    points = np.empty((len(obj.data.vertices), 3), np.float32)
    obj.data.vertices.foreach_get("co", points.reshape(-1))
    points[:, 2] += shift * np.sin(7 * points[:, 0])
    return points


def picture(path, seed=0):
    """Write a PNG of random grays."""
    values = np.random.default_rng(seed).integers(0, 256, (16, 16, 1)).astype(np.uint8)
    feeds.write_png(path, np.repeat(values, 3, axis=2))
    return path


def image_of(path):
    return bpy.data.images.load(str(path))


def nodes_of(obj, name="nodes"):
    """A new modifier of geometry nodes that changes nothing yet: its tree, and the nodes of its input and output."""
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    tree.links.new(start.outputs[0], end.inputs[0])
    modifier = obj.modifiers.new(name, "NODES")
    modifier.node_group = tree
    return tree, start, end, modifier


def texture_of(path):
    texture = bpy.data.textures.new("rough", "IMAGE")
    texture.image = image_of(path)
    return texture


# Caches of points


@kind
def mesh_cache_mdd(obj, folder):
    points, path = points_of(obj), folder / "moved.mdd"
    head = struct.pack(">II", 1, len(points)) + struct.pack(">f", 0.0)
    path.write_bytes(head + points.astype(">f4").tobytes())
    modifier = obj.modifiers.new("cache", "MESH_CACHE")
    modifier.cache_format, modifier.filepath = "MDD", str(path)
    return path


@kind
def mesh_cache_pc2(obj, folder):
    points, path = points_of(obj), folder / "moved.pc2"
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, len(points), 0.0, 1.0, 1)
    path.write_bytes(head + points.astype("<f4").tobytes())
    modifier = obj.modifiers.new("cache", "MESH_CACHE")
    modifier.cache_format, modifier.filepath = "PC2", str(path)
    return path


def _moved_copy(obj):
    copy = obj.copy()
    copy.data = obj.data.copy()
    copy.data.vertices.foreach_set("co", points_of(obj).reshape(-1))
    copy.name = "moved"
    bpy.context.scene.collection.objects.link(copy)
    return copy


def _exported(obj, folder, ending, operator, **more):
    """The file of a moved copy of an object, which is removed."""
    copy, path = _moved_copy(obj), folder / f"moved{ending}"
    bpy.context.view_layer.update()
    for each in bpy.context.view_layer.objects:
        each.select_set(each == copy)
    bpy.context.view_layer.objects.active = copy
    operator(filepath=str(path), **more)
    bpy.data.objects.remove(copy)
    assert path.stat().st_size > 1000
    return path


def _sequence_cache(obj, path):
    bpy.ops.cachefile.open(filepath=str(path))
    modifier = obj.modifiers.new("cache", "MESH_SEQUENCE_CACHE")
    modifier.cache_file = bpy.data.cache_files[path.name]
    bpy.context.view_layer.update()  # reads the paths
    modifier.object_path = max((each.path for each in modifier.cache_file.object_paths), key=len)


@kind
def alembic_cache(obj, folder):
    path = _exported(obj, folder, ".abc", bpy.ops.wm.alembic_export, selected=True, start=1, end=1)
    _sequence_cache(obj, path)
    return path


@kind
def usd_cache(obj, folder):
    path = _exported(obj, folder, ".usda", bpy.ops.wm.usd_export, selected_objects_only=True)
    _sequence_cache(obj, path)
    return path


@kind
def multires_external(obj, folder):
    modifier = obj.modifiers.new("detail", "MULTIRES")
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.multires_subdivide(modifier=modifier.name)
    bpy.ops.object.multires_base_apply(modifier=modifier.name)
    path = folder / "detail.btx"
    bpy.ops.object.multires_external_save(modifier=modifier.name, filepath=str(path))
    return path


# Images in modifiers


@kind
def displace_image(obj, folder):
    path = picture(folder / "rough.png")
    modifier = obj.modifiers.new("rough", "DISPLACE")
    modifier.texture, modifier.texture_coords, modifier.strength = texture_of(path), "UV", 0.2
    return path


@kind
def warp_image(obj, folder):
    path = picture(folder / "warp.png")
    ends = [bpy.data.objects.new(name, None) for name in ("from", "to")]
    ends[1].location.z = 0.3
    for end in ends:
        bpy.context.scene.collection.objects.link(end)
    modifier = obj.modifiers.new("warp", "WARP")
    modifier.object_from, modifier.object_to = ends
    modifier.texture, modifier.texture_coords = texture_of(path), "UV"
    return path


# Nodes


def _joined_import(obj, path, ending):
    tree, start, end, modifier = nodes_of(obj)
    node = tree.nodes.new(f"GeometryNodeImport{ending}")
    both = tree.nodes.new("GeometryNodeJoinGeometry")
    tree.links.new(start.outputs[0], both.inputs[0])
    realized = tree.nodes.new("GeometryNodeRealizeInstances")
    tree.links.new(node.outputs[0], realized.inputs[0])
    tree.links.new(realized.outputs[0], both.inputs[0])
    tree.links.new(both.outputs[0], end.inputs[0])
    node.inputs[0].default_value = str(path)
    return tree, node, modifier


@kind
def nodes_import_obj(obj, folder):
    path = _exported(obj, folder, ".obj", bpy.ops.wm.obj_export, export_selected_objects=True)
    _joined_import(obj, path, "OBJ")
    return path


@kind
def nodes_import_stl(obj, folder):
    path = _exported(obj, folder, ".stl", bpy.ops.wm.stl_export, export_selected_objects=True)
    _joined_import(obj, path, "STL")
    return path


@kind
def nodes_import_ply(obj, folder):
    path = _exported(obj, folder, ".ply", bpy.ops.wm.ply_export, export_selected_objects=True)
    _joined_import(obj, path, "PLY")
    return path


@kind
def nodes_import_by_text_node(obj, folder):
    path = _exported(obj, folder, ".obj", bpy.ops.wm.obj_export, export_selected_objects=True)
    tree, node, _ = _joined_import(obj, "", "OBJ")
    text = tree.nodes.new("FunctionNodeInputString")
    text.string = str(path)
    tree.links.new(text.outputs[0], node.inputs[0])
    return path


@kind
def nodes_import_by_modifier(obj, folder):
    path = _exported(obj, folder, ".obj", bpy.ops.wm.obj_export, export_selected_objects=True)
    tree, node, modifier = _joined_import(obj, "", "OBJ")
    socket = tree.interface.new_socket("Path", in_out="INPUT", socket_type="NodeSocketString")
    start = next(each for each in tree.nodes if each.type == "GROUP_INPUT")
    tree.links.new(start.outputs["Path"], node.inputs[0])
    if hasattr(modifier, "properties"):
        getattr(modifier.properties.inputs, socket.identifier).value = str(path)
    else:
        modifier[socket.identifier] = str(path)
    return path


@kind
def nodes_import_in_group(obj, folder):
    """The path is given to a group that contains the node."""
    path = _exported(obj, folder, ".obj", bpy.ops.wm.obj_export, export_selected_objects=True)
    inner, node, _ = _joined_import(obj, "", "OBJ")
    obj.modifiers.clear()
    inner.interface.new_socket("Path", in_out="INPUT", socket_type="NodeSocketString")
    start = next(each for each in inner.nodes if each.type == "GROUP_INPUT")
    inner.links.new(start.outputs["Path"], node.inputs[0])
    tree, start, end, _ = nodes_of(obj, "outer")
    group = tree.nodes.new("GeometryNodeGroup")
    group.node_tree = inner
    tree.links.new(start.outputs[0], group.inputs[0])
    tree.links.new(group.outputs[0], end.inputs[0])
    group.inputs["Path"].default_value = str(path)
    return path


@kind
def nodes_image(obj, folder):
    path = picture(folder / "nodes.png")
    tree, start, end, _ = nodes_of(obj)
    texture, place = tree.nodes.new("GeometryNodeImageTexture"), tree.nodes.new("GeometryNodeSetPosition")
    texture.inputs["Image"].default_value = image_of(path)
    position = tree.nodes.new("GeometryNodeInputPosition")
    tree.links.new(position.outputs[0], texture.inputs["Vector"])
    tree.links.new(start.outputs[0], place.inputs["Geometry"])
    tree.links.new(texture.outputs["Color"], place.inputs["Offset"])
    tree.links.new(place.outputs[0], end.inputs[0])
    return path


def _filled(obj, node_type):
    """Nodes that fill the curves of a new node and join them with the object: the tree and the node."""
    tree, start, end, _ = nodes_of(obj)
    node, fill = tree.nodes.new(node_type), tree.nodes.new("GeometryNodeFillCurve")
    both, realized = tree.nodes.new("GeometryNodeJoinGeometry"), tree.nodes.new("GeometryNodeRealizeInstances")
    out = next(socket for socket in node.outputs if socket.type == "GEOMETRY")
    for one, other in ((out, realized), (realized.outputs[0], fill), (fill.outputs[0], both), (start.outputs[0], both)):
        tree.links.new(one, other.inputs[0])
    tree.links.new(both.outputs[0], end.inputs[0])
    return tree, node


@kind
def font_of_text_object(obj, folder):
    path = folder / "text.woff2"
    shutil.copyfile(FONT, path)
    text = bpy.data.objects.new("text", bpy.data.curves.new("text", "FONT"))
    text.data.body, text.data.font = "ab", bpy.data.fonts.load(str(path))
    bpy.context.scene.collection.objects.link(text)
    _, node = _filled(obj, "GeometryNodeObjectInfo")
    node.inputs["Object"].default_value = text
    return path


@kind
def font_of_nodes(obj, folder):
    path = folder / "text.woff2"
    shutil.copyfile(FONT, path)
    _, node = _filled(obj, "GeometryNodeStringToCurves")
    node.inputs["String"].default_value = "ab"
    found = bpy.data.fonts.load(str(path))
    if "Font" in node.inputs:
        node.inputs["Font"].default_value = found
    else:
        node.font = found
    return path


OPTIONS = {}
