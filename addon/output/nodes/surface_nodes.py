# SPDX-License-Identifier: GPL-3.0-or-later
"""Connects maps to the inputs of the Principled BSDF, of the Displacement node, and of the node that glTF's exporter reads.

Image Texture -> the input, through Separate Color where one image holds several maps. Connecting again reuses these nodes.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from bpy.types import Image, Material, Node, NodeSocket

from ...core.declarations.choices import Space
from ...core.map_types import AO, BY_NAME, EMISSION, HEIGHT, VECTOR_DISPLACEMENT, MapType
from . import gltf_group, tree_editing
from .tree_editing import MARK, Coordinates, TreeEditor, title

PRINCIPLED = "ShaderNodeBsdfPrincipled"
SEPARATED = ("Red", "Green", "Blue")
"""The outputs of Separate Color."""

BUMPS = ("BUMP", "BOTH")
"""The displacement methods of a material that add heights to its normals."""


@dataclass(frozen=True)
class MapImage:
    """An image that holds a map.

    role: of its nodes, the same for all maps in one image. label: of its nodes. channel: of a packed image, "Red", "Green",
    "Blue" or "Alpha", else empty. is_inverted: whether the channel holds 1 - value. midlevel, scale: the value is
    (stored - midlevel) * scale. space: of vectors, as in Settings.
    """

    image: Image
    role: str
    label: str
    channel: str = ""
    is_inverted: bool = False
    midlevel: float = 0.0
    scale: float = 1.0
    space: str = Space.TANGENT


def takes(map_type: MapType | None) -> bool:
    """Whether an input of a material takes this map."""
    return map_type is not None and (bool(map_type.socket) or map_type in (AO, HEIGHT, VECTOR_DISPLACEMENT))


def connect(material: Material, images: Mapping[str, MapImage], coordinates: Coordinates) -> list[str]:
    """Connect the maps, by their names, to the inputs that they belong to. Returns notes for the report.

    Maps that no input takes, such as curvature, are ignored.
    """
    editor = TreeEditor(material, coordinates)
    of_sockets = {BY_NAME[name].socket: image for name, image in images.items() if BY_NAME[name].socket}
    if of_sockets:
        shaders = [shader for shader in editor.shaders() if shader.bl_idname == PRINCIPLED]
        if not shaders:
            editor.note("no Principled BSDF reaches the output, so its maps are not shown.")
        for shader in shaders:
            for name, image in of_sockets.items():
                if _feed(editor, shader, shader.inputs[name], image) and name == EMISSION.socket:
                    _light_up(editor, shader, image.scale)
    if AO.name in images:
        group = gltf_group.node_of(editor)
        _feed(editor, group, group.inputs[gltf_group.OCCLUSION], images[AO.name])
    for map_type in (HEIGHT, VECTOR_DISPLACEMENT):
        if map_type.name in images:
            _displace(editor, images[map_type.name], is_vector=map_type.is_vector)
            break
    return editor.notes


def _feed(editor: TreeEditor, node: Node, socket: NodeSocket, image: MapImage) -> bool:
    """Connect an image to an input, if nothing or an Image Texture is connected to it. Returns whether it shows the image."""
    end, source, kind = editor.trace(socket)
    if kind is not None:
        texture, channel, is_inverted = _texture(editor, source, kind)
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
    _connect_own(editor, end, image)
    return True


def _texture(editor: TreeEditor, node: Node, kind: str | None) -> tuple[Node | None, str, bool]:
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


def _light_up(editor: TreeEditor, shader: Node, scale: float) -> None:
    """Set the strength that the baked emission needs: the map holds color times strength, divided by `scale`."""
    strength = shader.inputs["Emission Strength"]
    _, node, kind = editor.trace(strength)
    if node is None:
        tree_editing.change(strength, default_value=scale)
    else:
        editor.note_unchanged(shader, strength.name, node, kind)


def _displace(editor: TreeEditor, image: MapImage, *, is_vector: bool) -> None:
    """Connect a height map or a map of vectors to the Displacement of each Material Output."""
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
        if _feed(editor, node, node.inputs["Vector" if is_vector else "Height"], image):
            is_shown = True
            # Heights are distances in the scene; vectors are in the space of the map.
            is_world = not is_vector or image.space == Space.WORLD
            tree_editing.change(node, space="WORLD" if is_world else "OBJECT")
            tree_editing.change(node.inputs["Midlevel"], default_value=image.midlevel)
            tree_editing.change(node.inputs["Scale"], default_value=image.scale)
    methods = editor.material.bl_rna.properties["displacement_method"].enum_items
    chosen = methods[editor.material.displacement_method]
    if is_shown and chosen.identifier in BUMPS:
        moving = next(method.name for method in methods if method.identifier not in BUMPS)
        editor.note(
            f'its Displacement setting is "{chosen.name}", which adds the heights to the normal map. To move the surface, '
            f'choose "{moving}".'
        )
