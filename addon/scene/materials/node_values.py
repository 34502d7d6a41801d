# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluates the sockets of shader nodes to feeds: follows links backwards, through reroutes, groups and muted nodes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from bpy.types import Node, NodeLink, NodeSocket, NodeTree

from ..textures import ImageTextures
from .signals import NotAffineError, NotFollowedError, Signal, color, converted, number

MOST_STEPS = 10_000
"""A limit on the links of one chain. It ends circles that Blender does not mark."""


@dataclass(frozen=True)
class Place:
    """A socket, and the group nodes around it, from the outside in: the same group can be used several times.

    Attributes:
        groups: The outermost first.
    """

    socket: NodeSocket
    groups: tuple[Node, ...] = ()

    @property
    def node(self) -> Node:
        return self.socket.node

    def beside(self, socket: NodeSocket) -> "Place":
        """Another socket of the same node, or of a node in the same tree."""
        return Place(socket, self.groups)

    def input(self, identifier: str) -> "Place":
        """The input of the same node with this identifier."""
        return self.beside(next(socket for socket in self.node.inputs if socket.identifier == identifier))


@dataclass
class Links:
    """The links of node trees by input socket: NodeSocket.links searches a whole tree for each socket."""

    _by_input: dict[NodeTree, dict[NodeSocket, NodeLink]] = field(default_factory=dict)

    def source(self, place: Place) -> Place:
        """Where the links of an input socket begin: an output socket, or an input without a link, whose own value counts.

        The sockets of groups and reroutes on the way do not convert the value. Those of reroutes and muted nodes have none.
        """
        own = place
        for _ in range(MOST_STEPS):
            link = self._link(place.socket)
            before = self._before(place.beside(link.from_socket)) if link else None
            if before is None:
                break
            if before.socket.is_output:
                return before
            if before.groups != place.groups:
                own = before
            place = before
        return own

    def has_use(self, output: NodeSocket) -> bool:
        """Whether a link leaves from an output socket."""
        links = self._of_tree(output.id_data).values()
        return any(link.from_socket == output for link in links)

    def _link(self, socket: NodeSocket) -> NodeLink | None:
        link = self._of_tree(socket.id_data).get(socket)
        # Blender marks one link in every circle as invalid, unless a single node is connected to itself.
        if link is None or link.is_muted or not link.is_valid or link.from_node == link.to_node:
            return None
        return link

    def _of_tree(self, tree: NodeTree) -> dict[NodeSocket, NodeLink]:
        if tree not in self._by_input:
            self._by_input[tree] = {link.to_socket: link for link in tree.links}
        return self._by_input[tree]

    def _before(self, output: Place) -> Place | None:
        """The input that an output passes on unchanged, or `output` if its node makes the value; None if it has no value."""
        node, groups = output.node, output.groups
        if node.mute:
            return next(
                (output.beside(i.from_socket) for i in node.internal_links if i.to_socket == output.socket), None
            )
        if node.bl_idname == "NodeReroute":
            return output.beside(node.inputs[0])
        if node.bl_idname == "NodeGroupInput" and groups:
            outside = _by_identifier(groups[-1].inputs, output.socket.identifier)
            return Place(outside, groups[:-1]) if outside else None
        if node.bl_idname == "ShaderNodeGroup" and node.node_tree:
            end = next(
                (n for n in node.node_tree.nodes if n.bl_idname == "NodeGroupOutput" and n.is_active_output), None
            )
            inside = _by_identifier(end.inputs, output.socket.identifier) if end else None
            return Place(inside, (*groups, node)) if inside else None
        return output


def _by_identifier(sockets, identifier: str) -> NodeSocket | None:
    return next((socket for socket in sockets if socket.identifier == identifier), None)


def title(node: Node) -> str:
    """The name of a node as Blender shows it, in quotes."""
    return f'"{node.label or node.name}"'


MOST_EVALUATED = 60
"""The longest chain of nodes that is followed, because each takes several calls of Python's stack."""

Reading: TypeAlias = Callable[["NodeValues", Place], Signal]
"""A function that evaluates an output socket of one type of node."""


@dataclass
class NodeValues:
    """The values of the sockets of one material's nodes. It remembers them, because nodes can share inputs.

    Attributes:
        readings: How to evaluate outputs, by type of node.
    """

    images: ImageTextures
    readings: Mapping[str, Reading]
    links: Links = field(default_factory=Links)
    _known: dict[Place, Signal | NotFollowedError] = field(default_factory=dict)
    _depth: int = 0

    def read(self, place: Place) -> Signal:
        """The value of an input socket, in its own type.

        Raises NotFollowedError for what no feed can express, and NotAffineError if the node of `place` is the reason.
        """
        source = self.links.source(place)
        signal = self.output(source) if source.socket.is_output else own_value(source.socket)
        return converted(signal, source.socket.type, place.socket.type)

    def input(self, output: Place, identifier: str) -> Signal:
        """The value of an input of the node that has this output."""
        return self.read(output.input(identifier))

    def constant(self, output: Place, identifier: str) -> np.ndarray:
        """The constant value (3,) of an input. Raises NotFollowedError for an input that varies over the surface."""
        value = self.input(output, identifier).constant
        if value is None:
            raise NotFollowedError(f"a texture feeds {identifier} of {title(output.node)}")
        return value

    def output(self, place: Place) -> Signal:
        """The value of an output socket. Raises NotFollowedError for what no feed can express."""
        if place not in self._known:
            self._known[place] = self._evaluated(place)
        known = self._known[place]
        if isinstance(known, NotFollowedError):
            raise known
        return known

    def _evaluated(self, place: Place) -> Signal | NotFollowedError:
        read = self.readings.get(place.node.bl_idname)
        if read is None:
            return NotFollowedError(f"Imprint cannot follow the node {title(place.node)}")
        if self._depth == MOST_EVALUATED:
            return NotFollowedError(f"more than {MOST_EVALUATED} nodes follow each other")
        self._depth += 1
        try:
            return read(self, place)
        except NotAffineError as error:
            return NotFollowedError(f"the node {title(place.node)} {error}")
        except NotFollowedError as error:
            return error
        finally:
            self._depth -= 1


def own_value(socket: NodeSocket) -> Signal:
    """The value of a socket without a link. Raises NotFollowedError for a socket that has none."""
    if socket.type == "RGBA":
        return color(tuple(socket.default_value))
    if socket.type == "VECTOR":
        return color(tuple(socket.default_value)[:3])
    if socket.type in {"VALUE", "INT", "BOOLEAN"}:
        return number(float(socket.default_value))
    raise NotFollowedError(f"the socket {socket.name} has no value")
