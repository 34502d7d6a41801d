# SPDX-License-Identifier: GPL-3.0-or-later
"""Follows the links of shader nodes backwards: through reroutes, groups and muted nodes, to the node that makes a value."""

from dataclasses import dataclass, field

from bpy.types import Node, NodeLink, NodeSocket, NodeTree

MOST_STEPS = 10_000
"""A limit on the links of one chain. It ends circles that Blender does not mark."""


@dataclass(frozen=True)
class Place:
    """A socket, and the group nodes around it, from the outside in: the same group can be used several times."""

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
