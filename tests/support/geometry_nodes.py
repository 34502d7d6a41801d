# SPDX-License-Identifier: GPL-3.0-or-later
"""Modifiers of geometry nodes, in few words."""

import bpy


class Tree:
    """The nodes of a new modifier of `obj`. geometry: the socket of what the modifier gets."""

    def __init__(self, obj: bpy.types.Object):
        self.tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
        for side in ("INPUT", "OUTPUT"):
            self.tree.interface.new_socket("Geometry", in_out=side, socket_type="NodeSocketGeometry")
        self.geometry = self.tree.nodes.new("NodeGroupInput").outputs[0]
        self._output = self.tree.nodes.new("NodeGroupOutput")
        self.modifier = obj.modifiers.new("Nodes", "NODES")
        self.modifier.node_group = self.tree

    def add(self, kind: str, inputs: dict | None = None, **properties) -> bpy.types.NodeSocket:
        """Add a node, and return its first output.

        inputs: values or output sockets, several of them in a list, by the name or the number of the enabled input.
        properties: of the node.
        """
        node = self.tree.nodes.new(kind)
        for name, value in properties.items():
            setattr(node, name, value)
        enabled = [socket for socket in node.inputs if socket.enabled]
        for name, values in (inputs or {}).items():
            socket = enabled[name] if isinstance(name, int) else next(each for each in enabled if each.name == name)
            for value in values if isinstance(values, list) else [values]:
                if isinstance(value, bpy.types.NodeSocket):
                    self.tree.links.new(value, socket)
                else:
                    socket.default_value = value
        return next(socket for socket in node.outputs if socket.enabled)

    def object(self, obj: bpy.types.Object, *, as_instance: bool = False) -> bpy.types.NodeSocket:
        """The geometry of another object."""
        node = self.add("GeometryNodeObjectInfo", {"Object": obj, "As Instance": as_instance}).node
        return node.outputs["Geometry"]

    def end(self, socket: bpy.types.NodeSocket) -> None:
        """Let this geometry be the result."""
        self.tree.links.new(socket, self._output.inputs[0])


def set_material(obj: bpy.types.Object, material: bpy.types.Material, *, first: int | None = None) -> None:
    """Let nodes give a material to the faces of `obj`, or to the first ones of them."""
    tree = Tree(obj)
    inputs = {"Geometry": tree.geometry, "Material": material}
    if first is not None:
        index = tree.add("GeometryNodeInputIndex")
        inputs["Selection"] = tree.add(
            "FunctionNodeCompare", {0: index, 1: first}, data_type="INT", operation="LESS_THAN"
        )
    tree.end(tree.add("GeometryNodeSetMaterial", inputs))


def uv_from_above(obj: bpy.types.Object, name: str) -> None:
    """Let nodes store a UV map: x and y from -1 to 1 as UVs from 0 to 1."""
    tree = Tree(obj)
    half = (0.5, 0.5, 0.0)
    uv = tree.add(
        "ShaderNodeVectorMath", {0: tree.add("GeometryNodeInputPosition"), 1: half, 2: half}, operation="MULTIPLY_ADD"
    )
    inputs = {"Geometry": tree.geometry, "Name": name, "Value": uv}
    tree.end(tree.add("GeometryNodeStoreNamedAttribute", inputs, data_type="FLOAT2", domain="CORNER"))
