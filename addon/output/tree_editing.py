# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits the node tree of one material: follows links, adds marked nodes that later bakes reuse, and collects notes.

No node is removed. Node setups that are not recognized stay unchanged, with a note.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from bpy.types import Image, Material, Node, NodeLink, NodeSocket

from ..core.map_types import MARK

NODE_HEIGHT = 320
"""The space for one node in a column. Blender knows the real height only after drawing the node in a window."""
NODE_GAP = 60


@dataclass(frozen=True)
class Coordinates:
    """The UV layer of the maps.

    Attributes:
        uv_names: The names by which nodes may use this layer: "", or no node at all, means the render-active layer.
    """

    uv_layer: str
    uv_names: tuple[str, ...]


class TreeEditor:
    """One material: the state of its node tree, and the notes."""

    def __init__(self, material: Material, coordinates: Coordinates):
        self.material, self.tree, self.coordinates = material, material.node_tree, coordinates
        # By input socket: NodeSocket.links searches the whole tree.
        self._links: dict[NodeSocket, NodeLink] = {link.to_socket: link for link in self.tree.links}
        self._own_nodes: dict[tuple[str, str], Node] = {}
        """The nodes that Imprint has made, by type and role. All shaders of a material share them."""
        self._notes: dict[str, None] = {}
        """An ordered set, because two shaders can cause the same note."""
        for node in self.tree.nodes:
            is_texture = node.bl_idname == "ShaderNodeTexImage"
            if node.get(MARK) and not node.mute and not (is_texture and is_foreign(node.image)):
                self._own_nodes.setdefault((node.bl_idname, _role(node)), node)

    @property
    def notes(self) -> list[str]:
        """Notes for the report."""
        return list(self._notes)

    def note(self, text: str) -> None:
        self._notes[f'Material "{self.material.name}": {text}'] = None

    def note_unchanged(self, node: Node, input_name: str, source: Node, kind: str) -> None:
        muted = ", muted or in a circle" if kind == "muted" else ""
        self.note(f"{title(node)} takes its {input_name} from {title(source)}{muted}, so it was left as it is.")

    def outputs(self) -> list[Node]:
        """The Material Outputs of all render engines. Adds one if there is none."""
        outputs = [output for output in map(self.tree.get_output_node, ("ALL", "EEVEE", "CYCLES")) if output]
        return list(dict.fromkeys(outputs)) or [self._new_output()]

    def shaders(self) -> list[Node]:
        """The shader nodes that reach the surface of the Material Output of any render engine."""
        waiting = [output.inputs["Surface"] for output in self.outputs()]
        nodes: dict[Node, None] = {}  # an ordered set
        while waiting:
            _, node, _ = self.trace(waiting.pop())
            if node and node not in nodes:  # include muted nodes: the artist may unmute them
                nodes[node] = None
                waiting += node.inputs  # all inputs: Shader to RGB converts shaders to colors
        return [node for node in nodes if any(socket.type == "SHADER" for socket in node.outputs)]

    def trace(self, socket: NodeSocket) -> tuple[NodeSocket, Node | None, str | None]:
        """Follow an input back through reroutes. Returns the last input, the node connected to it, and its kind,
        "type.output".

        For an unconnected input, node and kind are None. For muted nodes and links, and for circles, the kind is "muted".
        """
        while link := self._links.get(socket):
            node = link.from_node
            # Blender marks one link in every circle as invalid, unless a single node is connected to itself.
            if link.is_muted or node.mute or not link.is_valid or node == link.to_node:
                return socket, node, "muted"
            if node.bl_idname != "NodeReroute":
                return socket, node, f"{node.bl_idname}.{link.from_socket.identifier}"
            socket = node.inputs[0]
        return socket, None, None

    def is_shared(self, socket: NodeSocket) -> bool:
        """Whether a reroute before an input leads to other inputs as well."""
        while (link := self._links.get(socket)) and link.from_node.bl_idname == "NodeReroute":
            if len(link.from_socket.links) > 1:
                return True
            socket = link.from_node.inputs[0]
        return False

    def feed_coordinates(self, texture: Node) -> None:
        """Make an Image Texture read the UV layer that was baked."""
        vector = texture.inputs["Vector"]
        end, node, kind = self.trace(vector)
        if "" in self.coordinates.uv_names and kind in (None, "ShaderNodeTexCoord.UV"):
            return
        if kind not in (None, "ShaderNodeUVMap.UV"):
            self.note_unchanged(texture, "Vector", node, kind)
            return
        if node and not node.get(MARK):
            if node.uv_map in self.coordinates.uv_names:
                return
            self.note(
                f'{title(texture)} no longer uses the UV map "{node.uv_map}"; its node {title(node)} was not removed.'
            )
            node, end = None, vector
        change(node or self.own_node("ShaderNodeUVMap", "UV", end), uv_map=self.coordinates.uv_layer)

    def own_node(self, kind: str, output: str, socket: NodeSocket, role: str = "", name: str = "") -> Node:
        """Connect Imprint's node of the type `kind` for `role` to the socket, and return it. Adds the node if there is none.

        name: of a new node, without "Imprint"; its type's name by default.
        """
        node = self._own_nodes.get((kind, role)) or self.add(kind, role, name, socket.node)
        self.connect(node.outputs[output], socket)
        return node

    def add(self, kind: str, role: str, name: str, left_of: Node) -> Node:
        """Add a marked node to the left of another one. See `own_node`."""
        node = self._own_nodes[kind, role] = self.tree.nodes.new(kind)
        node[MARK] = role or True
        node.name = node.label = f"Imprint {name or node.bl_label}"
        self._place(node, left_of)
        return node

    def connect(self, output: NodeSocket, socket: NodeSocket) -> None:
        """Link two sockets. An equal link stays: a new one would make the viewport compile the material again."""
        link = self._links.get(socket)
        if link is None or link.from_socket != output:
            self._links[socket] = self.tree.links.new(output, socket)

    def nodes_of(self, kind: str) -> Iterator[Node]:
        """All nodes of a type that are not muted."""
        return (node for node in self.tree.nodes if node.bl_idname == kind and not node.mute)

    def _new_output(self) -> Node:
        """Add a Material Output with a Principled BSDF, to the right of all other nodes."""
        right = max((node.location_absolute.x + node.width for node in self.tree.nodes), default=0)
        output = self.tree.nodes.new("ShaderNodeOutputMaterial")
        output.location = right + 2 * NODE_GAP + 240, 100
        principled = self.tree.nodes.new("ShaderNodeBsdfPrincipled")
        self._place(principled, output)
        self.connect(principled.outputs["BSDF"], output.inputs["Surface"])
        self.note("it had no Material Output; one was added, with a Principled BSDF.")
        return output

    def _place(self, node: Node, left_of: Node) -> None:
        """Move a new node to the first free place to the left of another node, in the same frame, and deselect it."""
        node.select = False
        node.parent = left_of.parent
        x, y = left_of.location_absolute
        x -= node.width + NODE_GAP
        others = [other for other in self.tree.nodes if other != node and other.bl_idname != "NodeFrame"]
        column = [other for other in others if x - other.width < other.location_absolute.x < x + node.width]
        for top in sorted((other.location_absolute.y for other in column), reverse=True):
            if abs(top - y) < NODE_HEIGHT:
                y = top - NODE_HEIGHT
        node.location_absolute = x, y


def _role(node: Node) -> str:
    """The role of a marked node. Nodes of the normal map, and those that all maps share, have none."""
    mark = node[MARK]
    return mark if isinstance(mark, str) else ""


def is_foreign(image: Image | None) -> bool:
    """Whether Imprint has not made the image."""
    return image is not None and not image.get(MARK)


def change(node: Node | NodeSocket, **values: object) -> None:
    """Set the values that differ: writing an equal value would make the viewport compile the material again."""
    for name, value in values.items():
        if getattr(node, name) != value:
            setattr(node, name, value)


def title(node: Node) -> str:
    return f'"{node.label or node.name}"'
