# SPDX-License-Identifier: GPL-3.0-or-later
"""Feeds an input of a node from an image, or from a channel of an image that holds several maps.

Image Texture -> Separate Color, if the image is packed -> Math, if the channel is inverted -> the input.
"""

from dataclasses import dataclass

from bpy.types import Image, Node, NodeSocket

from ...core.declarations.choices import Space
from ...core.map_types import MARK
from . import tree_editing
from .tree_editing import TreeEditor, title

SEPARATED = ("Red", "Green", "Blue")
"""The outputs of Separate Color."""


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


def feed(editor: TreeEditor, node: Node, socket: NodeSocket, image: MapImage) -> bool:
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
