# SPDX-License-Identifier: GPL-3.0-or-later
"""Connects an image to the shaders of one material, with the nodes and links that an artist would use.

Image Texture -> Normal Map -> the Normal input of every shader that reaches the output, below any Bump nodes in between.
Connecting again reuses these nodes. No node is removed. Node setups that are not recognized stay unchanged, with a note.
"""

from dataclasses import dataclass, field

from bpy.types import Image, Material, Node, NodeLink, NodeSocket

MARK = "imprint"
"""A custom property of the nodes and images that Imprint has made. Artists may rename nodes; the mark survives renaming,
copying and saving, so that a later bake finds the nodes that it may change."""
NODE_HEIGHT = 320
"""The space for one node in a column. Blender knows the real height only after drawing the node in a window."""
NODE_GAP = 60


@dataclass(frozen=True)
class NodeSettings:
    """The settings of the nodes.

    image: the normal map. normal_map: properties of the Normal Map node. uv_layer: the UV layer of the map. uv_names: the names
    by which nodes may use this layer: "", or no node at all, means the render-active layer.
    """

    image: Image
    normal_map: dict[str, str]
    uv_layer: str
    uv_names: tuple[str, ...]


@dataclass
class _Job:
    """One material: its target settings, the state of its node tree, and the notes."""

    material: Material
    settings: NodeSettings
    links: dict[NodeSocket, NodeLink]
    """By input socket: NodeSocket.links searches the whole tree."""
    own_nodes: dict[str, Node] = field(default_factory=dict)
    """The nodes that Imprint has made, by type. All shaders of a material share them."""
    notes: dict[str, None] = field(default_factory=dict)
    """An ordered set, because two shaders can cause the same note."""

    def note(self, text: str) -> None:
        self.notes[f'Material "{self.material.name}": {text}'] = None

    def note_unchanged(self, node: Node, input_name: str, source: Node, kind: str) -> None:
        muted = ", muted or in a circle" if kind == "muted" else ""
        self.note(f"{_title(node)} takes its {input_name} from {_title(source)}{muted}, so it was left as it is.")


def connect(material: Material, settings: NodeSettings) -> list[str]:
    """Connect the map to every shader of the material's surface. Returns notes for the report."""
    tree = material.node_tree
    job = _Job(material, settings, {link.to_socket: link for link in tree.links})
    for node in tree.nodes:
        is_texture = node.bl_idname == "ShaderNodeTexImage"
        if node.get(MARK) and not node.mute and not (is_texture and _is_foreign(node.image)):
            job.own_nodes.setdefault(node.bl_idname, node)
    done: set[NodeSocket] = set()
    for shader in _shaders(job):
        normal = next((s for s in shader.inputs if s.name == "Normal" and s.type == "VECTOR" and s.enabled), None)
        if normal:
            _feed_normal(job, shader, normal, done)
        elif shader.bl_idname == "ShaderNodeGroup":
            job.note(f"the group {_title(shader)} has no Normal input, so the map does not reach the shaders in it.")
    if not done:
        job.note("no shader with a Normal input reaches the output, so the map is not shown.")
    return list(job.notes)


def _shaders(job: _Job) -> list[Node]:
    """The shader nodes that reach the surface of the Material Output of any render engine."""
    tree = job.material.node_tree
    outputs = [output for output in map(tree.get_output_node, ("ALL", "EEVEE", "CYCLES")) if output]
    waiting = [output.inputs["Surface"] for output in outputs or [_new_output(job)]]
    nodes: dict[Node, None] = {}  # an ordered set
    while waiting:
        _, node, _ = _trace(job, waiting.pop())
        if node and node not in nodes:  # include muted nodes: the artist may unmute them
            nodes[node] = None
            waiting += node.inputs  # all inputs: Shader to RGB converts shaders to colors
    return [node for node in nodes if any(socket.type == "SHADER" for socket in node.outputs)]


def _new_output(job: _Job) -> Node:
    """Add a Material Output with a Principled BSDF, to the right of all other nodes."""
    tree = job.material.node_tree
    right = max((node.location_absolute.x + node.width for node in tree.nodes), default=0)
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.location = right + 2 * NODE_GAP + 240, 100
    principled = tree.nodes.new("ShaderNodeBsdfPrincipled")
    _place(job, principled, output)
    _connect(job, principled.outputs["BSDF"], output.inputs["Surface"])
    job.note("it had no Material Output; one was added, with a Principled BSDF.")
    return output


def _trace(job: _Job, socket: NodeSocket) -> tuple[NodeSocket, Node | None, str | None]:
    """Follow an input back through reroutes. Returns the last input, the node connected to it, and its kind, "type.output".

    For an unconnected input, node and kind are None. For muted nodes and links, and for circles, the kind is "muted".
    """
    while link := job.links.get(socket):
        node = link.from_node
        # Blender marks one link in every circle as invalid, unless a single node is connected to itself.
        if link.is_muted or node.mute or not link.is_valid or node == link.to_node:
            return socket, node, "muted"
        if node.bl_idname != "NodeReroute":
            return socket, node, f"{node.bl_idname}.{link.from_socket.identifier}"
        socket = node.inputs[0]
    return socket, None, None


def _feed_normal(job: _Job, shader: Node, normal: NodeSocket, done: set[NodeSocket]) -> None:
    """Connect the map to a shader's Normal input, or to the first Bump node of the chain connected to it."""
    while normal not in done:  # another shader may share the chain
        done.add(normal)
        end, node, kind = _trace(job, normal)
        if kind == "ShaderNodeBump.Normal":
            normal = node.inputs["Normal"]
        elif kind in (None, "ShaderNodeNormalMap.Normal"):
            _feed_normal_map(job, node or _own_node(job, "ShaderNodeNormalMap", "Normal", end))
        else:
            job.note_unchanged(shader, "Normal", node, kind)


def _feed_normal_map(job: _Job, normal_map: Node) -> None:
    """Make a Normal Map node show the image, if its Color input is connected to an Image Texture or to nothing."""
    color = normal_map.inputs["Color"]
    end, texture, kind = _trace(job, color)
    if kind not in (None, "ShaderNodeTexImage.Color"):
        job.note_unchanged(normal_map, "Color", texture, kind)
        return
    if texture and _is_foreign(texture.image):
        job.note(
            f'{_title(normal_map)} no longer shows "{texture.image.name}"; its node {_title(texture)} was not removed.'
        )
        texture, end = None, color
    texture = texture or _own_node(job, "ShaderNodeTexImage", "Color", end)
    _set(normal_map, **job.settings.normal_map)
    _set(texture, image=job.settings.image)
    _feed_coordinates(job, texture)


def _feed_coordinates(job: _Job, texture: Node) -> None:
    """Make an Image Texture read the UV layer that was baked."""
    vector = texture.inputs["Vector"]
    end, node, kind = _trace(job, vector)
    if "" in job.settings.uv_names and kind in (None, "ShaderNodeTexCoord.UV"):
        return
    if kind not in (None, "ShaderNodeUVMap.UV"):
        job.note_unchanged(texture, "Vector", node, kind)
        return
    if node and not node.get(MARK):
        if node.uv_map in job.settings.uv_names:
            return
        job.note(
            f'{_title(texture)} no longer uses the UV map "{node.uv_map}"; its node {_title(node)} was not removed.'
        )
        node, end = None, vector
    _set(node or _own_node(job, "ShaderNodeUVMap", "UV", end), uv_map=job.settings.uv_layer)


def _own_node(job: _Job, kind: str, output: str, socket: NodeSocket) -> Node:
    """Connect Imprint's node of the type `kind` to the socket, and return it. Adds the node if there is none."""
    if kind not in job.own_nodes:
        node = job.own_nodes[kind] = job.material.node_tree.nodes.new(kind)
        node[MARK] = True
        node.name = node.label = f"Imprint {node.bl_label}"
        _place(job, node, socket.node)
    _connect(job, job.own_nodes[kind].outputs[output], socket)
    return job.own_nodes[kind]


def _place(job: _Job, node: Node, left_of: Node) -> None:
    """Move a new node to the first free place to the left of another node, in the same frame, and deselect it."""
    node.select = False
    node.parent = left_of.parent
    x, y = left_of.location_absolute
    x -= node.width + NODE_GAP
    others = [other for other in job.material.node_tree.nodes if other != node and other.bl_idname != "NodeFrame"]
    column = [other for other in others if x - other.width < other.location_absolute.x < x + node.width]
    for top in sorted((other.location_absolute.y for other in column), reverse=True):
        if abs(top - y) < NODE_HEIGHT:
            y = top - NODE_HEIGHT
    node.location_absolute = x, y


def _connect(job: _Job, output: NodeSocket, socket: NodeSocket) -> None:
    job.links[socket] = job.material.node_tree.links.new(output, socket)


def _is_foreign(image: Image | None) -> bool:
    """Whether Imprint has not made the image."""
    return image is not None and not image.get(MARK)


def _set(node: Node, **values: object) -> None:
    """Set the values that differ: writing an equal value would make the viewport compile the material again."""
    for name, value in values.items():
        if getattr(node, name) != value:
            setattr(node, name, value)


def _title(node: Node) -> str:
    return f'"{node.label or node.name}"'
