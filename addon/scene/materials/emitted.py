# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes a material emit the value of one socket of its shader, also of one inside groups."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import bpy
from bpy.types import Image, Material, Node, NodeSocket, NodeTree

from ..textures import ImageTextures
from .exact_nodes import normal_maps
from .material_reading import (
    ALPHA,
    EMISSION,
    NORMAL,
    READINGS,
    Mix,
    Shader,
    displacement,
    find_shader,
    normal_places,
    places_of,
)
from .node_values import NodeValues, Place

_INTERFACE = {"RGBA": "NodeSocketColor", "VECTOR": "NodeSocketVector"}
"""The types of sockets of groups, by those of nodes; others are numbers."""
Keep = Callable[[bpy.types.ID], bpy.types.ID]
"""Takes a datablock that was made, and returns it."""


AXES = "Imprint tangents {}", "Imprint bitangents {}", "Imprint normals {}"
"""The attributes that the mesh needs for Normal Map nodes by a UV map: the axes that normals are given in, in its space."""


def emitting(source: Material, socket: str, image: Image, keep: Keep) -> Material:
    """A copy of `source` that emits the value of a socket as an ExactFeed has it, and whose active image is `image`.

    Copies of node groups have further outputs. Raises NotFollowedError if the material has no shader that can be read.
    """
    values = NodeValues(ImageTextures(), READINGS)
    shader = find_shader(values, source)
    material = keep(source.copy())
    tree, copied = material.node_tree, _Copied(material.node_tree, keep)
    moved = displacement(values, source) if socket == NORMAL else None
    places = normal_places(shader) if socket == NORMAL else places_of(shader, socket)
    for normal_map in normal_maps(values, [*places, *([moved] if moved else ())]):
        copied.replace_normal_map(normal_map)
    color = _normal(copied, values, shader) if socket == NORMAL else _value(copied, shader, socket)
    bump = copied.output(moved) if moved else None
    for node in [node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial"]:
        tree.nodes.remove(node)
    emission, output, target = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("Emission", "OutputMaterial", "TexImage")
    )
    tree.links.new(color, emission.inputs["Color"])
    if socket == EMISSION and shader.strength is not None:
        tree.links.new(copied.output(shader.strength), emission.inputs["Strength"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    if bump is not None:
        tree.links.new(bump, output.inputs["Displacement"])
        material.displacement_method = "BUMP"
    target.image = image
    tree.nodes.active = target
    return material


def _normal(copied: "_Copied", values: NodeValues, shader: Shader) -> NodeSocket:
    """The normal of a shader, as normal maps store directions."""
    return copied.vector("MULTIPLY_ADD", _direction(copied, values, shader), (0.5, 0.5, 0.5), (0.5, 0.5, 0.5))


def _direction(copied: "_Copied", values: NodeValues, shader: Shader) -> NodeSocket:
    mix = shader.mixed_normals
    if mix is not None:
        sides = (_direction(copied, values, side) for side in (mix.first, mix.second))
        return copied.mix(copied.output(mix.factor), *sides)
    if shader.normal is None or not values.links.source(shader.normal).socket.is_output:
        return copied.tree.nodes.new("ShaderNodeNewGeometry").outputs["Normal"]
    return copied.output(shader.normal)


def _value(copied: "_Copied", shader: Shader, socket: str) -> NodeSocket:
    value = shader.values[socket]
    if isinstance(value, Mix):
        sides = [value.side(is_second, socket) for is_second in (False, True)]
        emitted = copied.mix(copied.output(value.factor), *(_emitted(copied, side, socket) for side in sides))
    else:
        emitted = copied.number(value) if isinstance(value, float) else copied.output(value)
    for share in shader.opacity if socket == ALPHA else ():
        factor = copied.math("ADD", copied.output(share.factor), 0.0, use_clamp=True)
        if share.is_rest:
            factor = copied.math("SUBTRACT", 1.0, factor)
        emitted = copied.math("MULTIPLY", factor, emitted)
    return emitted


def _emitted(copied: "_Copied", shader: Shader, socket: str) -> NodeSocket:
    """As _value, with the strength of an emission."""
    emitted = _value(copied, shader, socket)
    if socket == EMISSION and shader.strength is not None:
        emitted = copied.scaled(emitted, copied.output(shader.strength))
    return emitted


@dataclass
class _Copied:
    """A copy of a material's tree. Its groups are those of the original, but for copies of the ones that it was asked about."""

    tree: NodeTree
    keep: Keep
    _groups: dict[tuple[str, ...], NodeTree] = field(default_factory=dict)

    def output(self, place: Place) -> NodeSocket:
        """An output in the tree itself with the value of an input of the original."""
        tree = self._tree(place.groups)
        node = tree.nodes[place.node.name]
        socket = next(one for one in node.inputs if one.identifier == place.socket.identifier)
        kind = _INTERFACE.get(socket.type, "NodeSocketFloat")
        source = _source(tree, socket, kind)
        for depth in range(len(place.groups), 0, -1):
            item = tree.interface.new_socket("Imprint", in_out="OUTPUT", socket_type=kind)
            end = next(n for n in tree.nodes if n.bl_idname == "NodeGroupOutput" and n.is_active_output)
            tree.links.new(source, next(one for one in end.inputs if one.identifier == item.identifier))
            tree, group = self._tree(place.groups[: depth - 1]), place.groups[depth - 1]
            source = next(one for one in tree.nodes[group.name].outputs if one.identifier == item.identifier)
        return source

    def number(self, value: float) -> NodeSocket:
        node = self.tree.nodes.new("ShaderNodeValue")
        node.outputs[0].default_value = value
        return node.outputs[0]

    def math(
        self, operation: str, first: NodeSocket | float, second: NodeSocket | float, *, use_clamp: bool = False
    ) -> NodeSocket:
        return _math(self.tree, operation, first, second, use_clamp=use_clamp)

    def mix(self, factor: NodeSocket, first: NodeSocket, second: NodeSocket) -> NodeSocket:
        """Colors or numbers by a factor from 0 to 1, as colors."""
        node = self.tree.nodes.new("ShaderNodeMix")
        node.data_type = "RGBA"
        for identifier, source in (("Factor_Float", factor), ("A_Color", first), ("B_Color", second)):
            self.tree.links.new(source, next(one for one in node.inputs if one.identifier == identifier))
        return next(one for one in node.outputs if one.identifier == "Result_Color")

    def scaled(self, color: NodeSocket, factor: NodeSocket) -> NodeSocket:
        return self.vector("SCALE", color, factor)

    def vector(self, operation: str, *values: NodeSocket | Sequence[float]) -> NodeSocket:
        return _vector(self.tree, operation, *values)

    def replace_normal_map(self, output: Place) -> None:
        """Have nodes that look at an output of a Normal Map node in tangent space look at the same from attributes.

        Cycles would take the tangents of the mesh, which is made of loose triangles.
        """
        tree = self._tree(output.groups)
        node = tree.nodes[output.node.name]
        normal = _normal_of_map(tree, node)
        for link in [link for link in tree.links if link.from_socket == node.outputs[0]]:
            is_muted, socket = link.is_muted, link.to_socket
            tree.links.new(normal, socket).is_muted = is_muted

    def _tree(self, groups: tuple[Node, ...]) -> NodeTree:
        """The tree inside these groups. They get copies of their trees, once, since other nodes share them."""
        tree, names = self.tree, ()
        for group in groups:
            node, names = tree.nodes[group.name], (*names, group.name)
            if names not in self._groups:
                node.node_tree = self._groups[names] = self.keep(node.node_tree.copy())
            tree = self._groups[names]
        return tree


def _source(tree: NodeTree, socket: NodeSocket, kind: str) -> NodeSocket:
    """An output in `tree` with the value of an input, as a number where the input is one."""
    links = [link for link in tree.links if link.to_socket == socket and not link.is_muted and link.is_valid]
    source = links[0].from_socket if links else None
    if kind == "NodeSocketFloat":  # a color becomes a number by its luminance, as Blender converts it
        return _math(tree, "ADD", source if links else float(socket.default_value), 0.0)
    if source is not None:
        return source
    if kind == "NodeSocketColor":
        node = tree.nodes.new("ShaderNodeRGB")
        node.outputs[0].default_value = socket.default_value
    else:
        node = tree.nodes.new("ShaderNodeCombineXYZ")
        for one, value in zip(node.inputs, socket.default_value, strict=False):
            one.default_value = value
    return node.outputs[0]


def _normal_of_map(tree: NodeTree, node: Node) -> NodeSocket:
    """What Cycles' Normal Map node gives, by the mesh's attributes AXES."""
    color, strength = (
        _source(tree, node.inputs[name], kind)
        for name, kind in (("Color", "NodeSocketColor"), ("Strength", "NodeSocketFloat"))
    )
    green = -2.0 if getattr(node, "convention", "OPENGL") == "DIRECTX" else 2.0
    parts = tree.nodes.new("ShaderNodeSeparateXYZ")
    signed = _vector(tree, "MULTIPLY_ADD", color, (2.0, green, 2.0), (-1.0, -green / 2.0, -1.0))
    tree.links.new(signed, parts.inputs[0])
    x, y = (_math(tree, "MULTIPLY", parts.outputs[axis], strength) for axis in (0, 1))
    up = _math(tree, "SUBTRACT", parts.outputs[2], 1.0)
    share = _math(tree, "ADD", strength, 0.0, use_clamp=True)
    z = _math(tree, "ADD", _math(tree, "MULTIPLY", up, share), 1.0)
    along = []
    for name, amount in zip(AXES, (x, y, z), strict=True):
        axis = tree.nodes.new("ShaderNodeAttribute")
        axis.attribute_name = name.format(node.uv_map)
        along.append(_vector(tree, "SCALE", axis.outputs["Vector"], amount))
    turned = _vector(tree, "ADD", _vector(tree, "ADD", along[0], along[1]), along[2])
    to_world = tree.nodes.new("ShaderNodeVectorTransform")
    to_world.vector_type, to_world.convert_from, to_world.convert_to = "NORMAL", "OBJECT", "WORLD"
    tree.links.new(_vector(tree, "NORMALIZE", turned), to_world.inputs[0])
    return to_world.outputs[0]


def _vector(tree: NodeTree, operation: str, *values: NodeSocket | Sequence[float]) -> NodeSocket:
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = operation
    sockets = [node.inputs[0], node.inputs["Scale"]] if operation == "SCALE" else node.inputs
    for socket, value in zip(sockets, values, strict=False):
        if isinstance(value, NodeSocket):
            tree.links.new(value, socket)
        else:
            socket.default_value = value
    return node.outputs[0]


def _math(
    tree: NodeTree,
    operation: str,
    first: NodeSocket | float,
    second: NodeSocket | float,
    *,
    use_clamp: bool = False,
) -> NodeSocket:
    node = tree.nodes.new("ShaderNodeMath")
    node.operation, node.use_clamp = operation, use_clamp
    for socket, value in zip(node.inputs, (first, second), strict=False):
        if isinstance(value, float):
            socket.default_value = value
        else:
            tree.links.new(value, socket)
    return node.outputs[0]
