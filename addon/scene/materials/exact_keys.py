# SPDX-License-Identifier: GPL-3.0-or-later
"""A short key of all that decides a value that Cycles evaluates: the nodes that feed it, and nothing else of the material."""

from dataclasses import dataclass, field
from typing import Any

from bpy.types import Material

from ...core.contents import short
from .. import content_keys
from ..textures import ImageTextures
from .material_reading import EMISSION, NORMAL, READINGS, Mix, Shader, displacement, find_shader
from .node_values import NodeValues, Place
from .signals import NotFollowedError

_OF_WORLD = {
    *("ShaderNodeNewGeometry", "ShaderNodeObjectInfo", "ShaderNodeVectorTransform", "ShaderNodeBump"),
    *("ShaderNodeDisplacement", "ShaderNodeVectorDisplacement", "ShaderNodeTexEnvironment"),
}
"""Nodes that may look at where in the scene a point is."""


def of_socket(material: Material, socket: str) -> tuple[str, bool]:
    """The key of the value of a socket, as an ExactFeed has it, and whether it may change with the place in the scene."""
    values = NodeValues(ImageTextures(), READINGS)
    try:
        shader = find_shader(values, material)
    except NotFollowedError:
        return "", False
    found = _Nodes(values, material.pass_index)
    if socket == NORMAL:
        moved = displacement(values, material)
        what = [found.normal(shader), found.at(moved) if moved is not None else None]
    else:
        what = found.value(shader, socket)
    return short([what, found.nodes]), found.is_of_world


@dataclass
class _Nodes:
    """The nodes that feed some sockets, as plain data, each once.

    Attributes:
        pass_index: Of their material, which some of them read.
    """

    values: NodeValues
    pass_index: int
    nodes: list[Any] = field(default_factory=list)
    is_of_world: bool = False
    _numbers: dict[Place, int] = field(default_factory=dict)

    def normal(self, shader: Shader) -> Any:
        """The normal of a shader."""
        mix = shader.mixed_normals
        if mix is not None:
            return [self.at(mix.factor), self.normal(mix.first), self.normal(mix.second)]
        return None if shader.normal is None else self.at(shader.normal)

    def value(self, shader: Shader, socket: str) -> Any:
        """The value of a socket of a shader."""
        value = shader.values[socket]
        if isinstance(value, Mix):
            sides = [self.value(value.side(is_second, socket), socket) for is_second in (False, True)]
            plain = [self.at(value.factor), *sides]
        else:
            plain = value if isinstance(value, float) else self.at(value)
        strength = self.at(shader.strength) if socket == EMISSION and shader.strength is not None else None
        return [plain, strength, [[self.at(share.factor), share.is_rest] for share in shader.opacity]]

    def at(self, place: Place) -> Any:
        """What an input gets: the number of an output, or its own value."""
        source = self.values.links.source(place)
        if source.socket.is_output:
            return [place.socket.type, self._number(source)]
        return [place.socket.type, source.socket.type, content_keys.plain_value(_default(source))]

    def _number(self, output: Place) -> int:
        """The number of an output among `nodes`."""
        if output not in self._numbers:
            number = self._numbers[output] = len(self.nodes)
            node = output.node
            self.nodes.append(None)
            self.is_of_world |= node.bl_idname in _OF_WORLD or (
                node.bl_idname == "ShaderNodeTexCoord" and output.socket.name in {"Object", "Normal"}
            )
            inputs = [[each.identifier, self.at(output.beside(each))] for each in node.inputs if each.enabled]
            own = [content_keys.plain_value(_default(output.beside(each))) for each in node.outputs]
            kind = [node.bl_idname, output.socket.identifier, content_keys.settings_of(node)]
            if output.socket.name == "Material Index":
                kind.append(self.pass_index)
            self.nodes[number] = [kind, inputs, own]
        return self._numbers[output]


def _default(place: Place) -> Any:
    return getattr(place.socket, "default_value", None)
