# SPDX-License-Identifier: GPL-3.0-or-later
"""Adds the nodes that show maps to materials: images, normals, displacement, inputs of the shader, glTF's occlusion.

An image: Image Texture -> Separate Color, if it is packed -> Math, if the channel is inverted -> the input. A normal map: Image
Texture -> Normal Map -> the Normal input of every shader that reaches the output, below any Bump nodes in between. Connecting
again reuses the nodes.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import bpy
from bpy.types import Image, Material, Node, NodeSocket, ShaderNodeTree

from .. import older_blender
from ..core.declarations.choices import Space
from ..core.map_types import AO, BY_NAME, EMISSION, HEIGHT, MARK, VECTOR_DISPLACEMENT, WIDENED_ROUGHNESS, MapType
from . import tree_editing
from .tree_editing import Coordinates, TreeEditor, title

GLTF_GROUP = "glTF Material Output"
"""The exporter looks for groups whose names start with this, or with the older name, in any case."""
OLDER_GLTF_GROUP = "glTF Settings"
OCCLUSION = "Occlusion"
SOCKETS = {
    OCCLUSION: 0.0,
    "Thickness": 0.0,
    "Dispersion": 0.0,
    "Iridescence Factor": 0.0,
    "Iridescence Thickness Minimum": 100.0,
}
"""The inputs of the exporter's own group, create_settings_group of io_scene_gltf2/blender/com/material_helpers.py, with
their defaults. The importer relies on all of them."""


def gltf_node_of(editor: TreeEditor) -> Node:
    """The node that the exporter reads in a material. Adds it if there is none."""
    for node in editor.nodes_of("ShaderNodeGroup"):
        if node.node_tree and _is_exporters(node.node_tree) and OCCLUSION in node.inputs:
            return node
    node = editor.add("ShaderNodeGroup", "occlusion", GLTF_GROUP, editor.outputs()[0])
    node.node_tree = _gltf_group()
    return node


def _is_exporters(group: ShaderNodeTree) -> bool:
    return group.name.lower().startswith((GLTF_GROUP.lower(), OLDER_GLTF_GROUP.lower()))


def _gltf_group() -> ShaderNodeTree:
    """The group, made if the file has none with an input for occlusion."""
    existing = bpy.data.node_groups.get(GLTF_GROUP)
    if existing is not None and OCCLUSION in existing.interface.items_tree:
        return existing
    group = bpy.data.node_groups.new(GLTF_GROUP, "ShaderNodeTree")
    for name, value in SOCKETS.items():
        group.interface.new_socket(name, in_out="INPUT", socket_type="NodeSocketFloat").default_value = value
    group.nodes.new("NodeGroupOutput")
    group.nodes.new("NodeGroupInput").location = -200, 0
    return group


SEPARATED = ("Red", "Green", "Blue")
"""The outputs of Separate Color."""


@dataclass(frozen=True)
class MapImage:
    """An image that holds a map.

    Attributes:
        role: Of its nodes, the same for all maps in one image.
        label: Of its nodes.
        channel: Of a packed image, "Red", "Green", "Blue" or "Alpha", else empty.
        is_inverted: Whether the channel holds 1 - value.
        midlevel, scale: The value is (stored - midlevel) * scale.
        space: Of vectors, as in Settings: with normals in tangent space, they are in the low object's.
        is_tangent: Whether vectors are in tangent space as well.
    """

    image: Image
    role: str
    label: str
    channel: str = ""
    is_inverted: bool = False
    midlevel: float = 0.0
    scale: float = 1.0
    space: str = Space.TANGENT
    is_tangent: bool = False


def feed_socket(editor: TreeEditor, node: Node, socket: NodeSocket, image: MapImage) -> bool:
    """Connect an image to an input, if nothing or an Image Texture is connected to it. Returns whether it shows the image."""
    end, source, kind = editor.trace(socket)
    if kind is not None:
        texture, channel, is_inverted = texture_of(editor, source, kind)
        if texture is None:
            editor.note_unchanged(node, socket.name, source, kind)
            return False
        if tree_editing.is_foreign(texture.image):
            editor.note(
                f'{title(node)} no longer takes its {socket.name} from "{texture.image.name}"; its node {title(texture)} '
                "was not removed."
            )
            end = socket
        elif (texture.image, channel, is_inverted) == (image.image, image.channel, image.is_inverted):
            editor.feed_coordinates(texture)
            return True
    _connect_own(editor, socket if editor.is_shared(socket) else end, image)
    return True


def texture_of(editor: TreeEditor, node: Node, kind: str | None) -> tuple[Node | None, str, bool]:
    """The Image Texture that feeds an input through the nodes that `_connect_own` makes, the channel of its image, and
    whether it is inverted. The first is None for other nodes."""
    is_inverted = kind == "ShaderNodeMath.Value" and bool(node.get(MARK))
    if is_inverted:
        _, node, kind = editor.trace(node.inputs[1])
    channel = ""
    if kind in [f"ShaderNodeSeparateColor.{name}" for name in SEPARATED]:
        channel = kind.rpartition(".")[2]
        _, node, kind = editor.trace(node.inputs["Color"])
    elif kind == "ShaderNodeTexImage.Alpha":
        return node, "Alpha", is_inverted
    return (node if kind == "ShaderNodeTexImage.Color" else None), channel, is_inverted


def _connect_own(editor: TreeEditor, socket: NodeSocket, image: MapImage) -> None:
    """Connect Imprint's own nodes that show the image to the socket."""
    if image.is_inverted:
        role = f"{image.role} {image.channel} inverted"
        invert = editor.own_node("ShaderNodeMath", "Value", socket, role, f"Invert {image.label}")
        tree_editing.change(invert, operation="SUBTRACT")
        tree_editing.change(invert.inputs[0], default_value=1.0)
        socket = invert.inputs[1]
    output = "Alpha" if image.channel == "Alpha" else "Color"
    if image.channel in SEPARATED:
        separate = editor.own_node("ShaderNodeSeparateColor", image.channel, socket, image.role, f"Split {image.label}")
        tree_editing.change(separate, mode="RGB")
        socket = separate.inputs["Color"]
    texture = editor.own_node("ShaderNodeTexImage", output, socket, image.role, image.label)
    tree_editing.change(texture, image=image.image)
    editor.feed_coordinates(texture)


BUMP_ONLY = "BUMP"
"""The displacement method of a material whose surface does not move."""


def connect_displacement(editor: TreeEditor, image: MapImage, *, is_vector: bool) -> None:
    """Connect the image to the Displacement of each Material Output."""
    name = "VectorDisplacement" if is_vector else "Displacement"
    is_shown = False
    for output in editor.outputs():
        socket = output.inputs["Displacement"]
        end, node, kind = editor.trace(socket)
        if node is not None and node.get(MARK) and kind != "muted":  # Imprint's own node, also of the other type
            node = None
        elif kind not in (None, f"ShaderNode{name}.Displacement"):
            editor.note_unchanged(output, "Displacement", node, kind)
            continue
        node = node or editor.own_node(f"ShaderNode{name}", "Displacement", end)
        if feed_socket(editor, node, _displacement_entry(node), image):
            is_shown = True
            # Heights are distances in the scene; vectors are in the space of the map.
            is_world = not is_vector or image.space == Space.WORLD
            of_node = Space.TANGENT if image.is_tangent else Space.WORLD if is_world else Space.OBJECT
            tree_editing.change(node, space=str(of_node))
            tree_editing.change(node.inputs["Midlevel"], default_value=image.midlevel)
            tree_editing.change(node.inputs["Scale"], default_value=image.scale)
    if is_shown and editor.material.displacement_method == BUMP_ONLY:
        methods = editor.material.bl_rna.properties["displacement_method"].enum_items
        moving = next(method.name for method in methods if method.identifier != BUMP_ONLY)
        editor.note(
            f'its Displacement setting is "{methods[BUMP_ONLY].name}", so the surface does not move. To move it, choose '
            f'"{moving}".'
        )
    fit_normal_maps(editor)


def fit_normal_maps(editor: TreeEditor) -> None:
    """Make baked normal maps count from the surface without its baked displacement: both hold the same detail.

    Otherwise EEVEE adds the normals to the displaced surface, and Cycles does so where the surface moves.
    """
    displaced = (editor.trace(output.inputs["Displacement"]) for output in editor.outputs())
    if not any(_shows_own_image(editor, node) for _, node, _ in displaced):
        return
    for node in editor.nodes_of("ShaderNodeNormalMap"):
        if _is_own(editor, *editor.trace(node.inputs["Color"])[1:]):
            tree_editing.change(node, **older_blender.normal_map_values(node, {"base": "ORIGINAL"}))


def _displacement_entry(node: Node) -> NodeSocket:
    """The input of a displacement node for the map."""
    return node.inputs["Vector" if node.bl_idname == "ShaderNodeVectorDisplacement" else "Height"]


def _shows_own_image(editor: TreeEditor, node: Node | None) -> bool:
    """Whether a node displaces by an image that Imprint has made."""
    is_displacement = node is not None and node.bl_idname in ("ShaderNodeDisplacement", "ShaderNodeVectorDisplacement")
    return is_displacement and _is_own(editor, *editor.trace(_displacement_entry(node))[1:])


def _is_own(editor: TreeEditor, node: Node | None, kind: str | None) -> bool:
    """Whether the node at an input shows an image that Imprint has made."""
    texture = texture_of(editor, node, kind)[0]
    return texture is not None and texture.image is not None and not tree_editing.is_foreign(texture.image)


@dataclass(frozen=True)
class NormalMapSettings:
    """The settings of the nodes.

    Attributes:
        image: The normal map.
        normal_map: Properties of the Normal Map node.
    """

    image: Image
    normal_map: dict[str, str]


def connect_normals(material: Material, settings: NormalMapSettings, coordinates: Coordinates) -> list[str]:
    """Connect the map to every shader of the material's surface. Returns notes for the report."""
    editor = TreeEditor(material, coordinates)
    done: set[NodeSocket] = set()
    for shader in editor.shaders():
        normal = next((s for s in shader.inputs if s.name == "Normal" and s.type == "VECTOR" and s.enabled), None)
        if normal:
            _feed_normal(editor, settings, shader, normal, done)
        elif shader.bl_idname == "ShaderNodeGroup":
            editor.note(f"the group {title(shader)} has no Normal input, so the map does not reach the shaders in it.")
    if not done:
        editor.note("no shader with a Normal input reaches the output, so the map is not shown.")
    fit_normal_maps(editor)
    return editor.notes


def _feed_normal(
    editor: TreeEditor, settings: NormalMapSettings, shader: Node, normal: NodeSocket, done: set[NodeSocket]
) -> None:
    """Connect the map to a shader's Normal input, or to the first Bump node of the chain connected to it."""
    while normal not in done:  # another shader may share the chain
        done.add(normal)
        end, node, kind = editor.trace(normal)
        if kind == "ShaderNodeBump.Normal":
            normal = node.inputs["Normal"]
        elif kind in (None, "ShaderNodeNormalMap.Normal"):
            _feed_normal_map(editor, settings, node or editor.own_node("ShaderNodeNormalMap", "Normal", end))
        else:
            editor.note_unchanged(shader, "Normal", node, kind)


def _feed_normal_map(editor: TreeEditor, settings: NormalMapSettings, normal_map: Node) -> None:
    """Make a Normal Map node show the image, if its Color input is connected to an Image Texture or to nothing."""
    color = older_blender.normal_map_color(editor, normal_map, settings.normal_map)
    end, texture, kind = editor.trace(color)
    if kind not in (None, "ShaderNodeTexImage.Color"):
        editor.note_unchanged(normal_map, "Color", texture, kind)
        return
    if texture and tree_editing.is_foreign(texture.image):
        editor.note(
            f'{title(normal_map)} no longer shows "{texture.image.name}"; its node {title(texture)} was not removed.'
        )
        texture, end = None, color
    texture = texture or editor.own_node("ShaderNodeTexImage", "Color", end)
    tree_editing.change(normal_map, **older_blender.normal_map_values(normal_map, settings.normal_map))
    tree_editing.change(texture, image=settings.image)
    editor.feed_coordinates(texture)


PRINCIPLED = "ShaderNodeBsdfPrincipled"


def takes_map(map_type: MapType | None) -> bool:
    """Whether an input of a material takes this map."""
    return map_type is not None and (bool(map_type.socket) or map_type in (AO, HEIGHT, VECTOR_DISPLACEMENT))


def connect_surface(material: Material, images: Mapping[str, MapImage], coordinates: Coordinates) -> list[str]:
    """Connect the maps, by their names, to the inputs that they belong to. Returns notes for the report.

    Maps that no input takes, such as curvature, are ignored.
    """
    editor = TreeEditor(material, coordinates)
    names = [name for name in images if BY_NAME[name].socket]
    names.sort(key=lambda name: name == WIDENED_ROUGHNESS.name)  # it replaces roughness, which feeds the same input
    of_sockets = {BY_NAME[name].socket: images[name] for name in names}
    if of_sockets:
        shaders = [shader for shader in editor.shaders() if shader.bl_idname == PRINCIPLED]
        if not shaders:
            editor.note("no Principled BSDF reaches the output, so its maps are not shown.")
        for shader in shaders:
            for name, image in of_sockets.items():
                if feed_socket(editor, shader, shader.inputs[name], image) and name == EMISSION.socket:
                    _light_up(editor, shader, image.scale)
    if AO.name in images:
        group = gltf_node_of(editor)
        feed_socket(editor, group, group.inputs[OCCLUSION], images[AO.name])
    for map_type in (HEIGHT, VECTOR_DISPLACEMENT):
        if map_type.name in images:
            connect_displacement(editor, images[map_type.name], is_vector=map_type.is_vector)
            break
    return editor.notes


def _light_up(editor: TreeEditor, shader: Node, scale: float) -> None:
    """Set the strength that the baked emission needs: the map holds color times strength, divided by `scale`."""
    strength = shader.inputs["Emission Strength"]
    _, node, kind = editor.trace(strength)
    if node is None:
        tree_editing.change(strength, default_value=scale)
    else:
        editor.note_unchanged(shader, strength.name, node, kind)
