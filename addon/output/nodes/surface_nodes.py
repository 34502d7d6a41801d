# SPDX-License-Identifier: GPL-3.0-or-later
"""Connects maps to the inputs of the Principled BSDF, of the Displacement node, and of the node that glTF's exporter reads.

Connecting again reuses the nodes.
"""

from collections.abc import Mapping

from bpy.types import Material, Node

from ...core.map_types import AO, BY_NAME, EMISSION, HEIGHT, VECTOR_DISPLACEMENT, WIDENED_ROUGHNESS, MapType
from . import displacement_nodes, gltf_group, image_nodes, tree_editing
from .image_nodes import MapImage
from .tree_editing import Coordinates, TreeEditor

PRINCIPLED = "ShaderNodeBsdfPrincipled"


def takes(map_type: MapType | None) -> bool:
    """Whether an input of a material takes this map."""
    return map_type is not None and (bool(map_type.socket) or map_type in (AO, HEIGHT, VECTOR_DISPLACEMENT))


def connect(material: Material, images: Mapping[str, MapImage], coordinates: Coordinates) -> list[str]:
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
                if image_nodes.feed(editor, shader, shader.inputs[name], image) and name == EMISSION.socket:
                    _light_up(editor, shader, image.scale)
    if AO.name in images:
        group = gltf_group.node_of(editor)
        image_nodes.feed(editor, group, group.inputs[gltf_group.OCCLUSION], images[AO.name])
    for map_type in (HEIGHT, VECTOR_DISPLACEMENT):
        if map_type.name in images:
            displacement_nodes.connect(editor, images[map_type.name], is_vector=map_type.is_vector)
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
