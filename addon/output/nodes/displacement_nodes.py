# SPDX-License-Identifier: GPL-3.0-or-later
"""Connects a height map or a map of vectors to the Displacement of a material, and fits the normal map to it."""

from bpy.types import Node, NodeSocket

from ... import older_blender
from ...core.declarations.choices import Space
from ...core.map_types import MARK
from . import image_nodes, tree_editing
from .image_nodes import MapImage
from .tree_editing import TreeEditor

BUMP_ONLY = "BUMP"
"""The displacement method of a material whose surface does not move."""


def connect(editor: TreeEditor, image: MapImage, *, is_vector: bool) -> None:
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
        if image_nodes.feed(editor, node, _entry(node), image):
            is_shown = True
            # Heights are distances in the scene; vectors are in the space of the map.
            is_world = not is_vector or image.space == Space.WORLD
            tree_editing.change(node, space="WORLD" if is_world else "OBJECT")
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


def _entry(node: Node) -> NodeSocket:
    """The input of a displacement node for the map."""
    return node.inputs["Vector" if node.bl_idname == "ShaderNodeVectorDisplacement" else "Height"]


def _shows_own_image(editor: TreeEditor, node: Node | None) -> bool:
    """Whether a node displaces by an image that Imprint has made."""
    is_displacement = node is not None and node.bl_idname in ("ShaderNodeDisplacement", "ShaderNodeVectorDisplacement")
    return is_displacement and _is_own(editor, *editor.trace(_entry(node))[1:])


def _is_own(editor: TreeEditor, node: Node | None, kind: str | None) -> bool:
    """Whether the node at an input shows an image that Imprint has made."""
    texture = image_nodes.texture_of(editor, node, kind)[0]
    return texture is not None and texture.image is not None and not tree_editing.is_foreign(texture.image)
