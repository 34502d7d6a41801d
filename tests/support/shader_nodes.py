# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes materials of nodes for tests, and reads them."""

import bpy
import numpy as np

from addon.core.material_feeds import HighMaterial
from addon.scene.materials.material_reading import read_materials
from addon.scene.textures import ImageTextures


def principled(material):
    return material.node_tree.nodes["Principled BSDF"]


def add(material, kind, inputs=None, **properties):
    """A new node. inputs: values or output sockets by identifier or index."""
    tree = material.node_tree if hasattr(material, "node_tree") else material
    node = tree.nodes.new(f"ShaderNode{kind}")
    for name, value in properties.items():
        setattr(node, name, value)
    for name, value in (inputs or {}).items():
        socket = node.inputs[name] if isinstance(name, int) else next(s for s in node.inputs if s.identifier == name)
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, socket)
        else:
            socket.default_value = value
    return node


def new_node(tree, kind, **values):
    """A new node of any tree. kind: its whole type."""
    node = tree.nodes.new(kind)
    for name, value in values.items():
        setattr(node, name, value)
    return node


def nodes_and_links(tree):
    """The addresses of all nodes and links. They are equal only if none was added, removed or replaced."""
    return {node.as_pointer() for node in tree.nodes}, {
        (link.as_pointer(), link.from_socket.as_pointer(), link.to_socket.as_pointer()) for link in tree.links
    }


def image(name="dots", size=(7, 5), *, seed=0, space="sRGB", alpha=False, ends=(0.0, 1.0)):
    """An image of random colors. ends: of its values; of floats, if they leave 0 to 1."""
    width, height = size
    found = bpy.data.images.new(name, width, height, alpha=alpha, float_buffer=ends != (0.0, 1.0))
    found.colorspace_settings.name = space
    pixels = np.random.default_rng(seed).uniform(*ends, (width * height, 4)).astype(np.float32)
    pixels[:, 3] = 0.5 + 0.5 * pixels[:, 3] if alpha else 1.0
    found.pixels.foreach_set(pixels.ravel())
    found.pack()
    return found


def texture(material, found=None, **properties):
    return add(material, "TexImage", image=found or image(), interpolation="Closest", **properties)


def feed_color(material, output, socket="Base Color") -> HighMaterial:
    """Connect an output to a socket, and read the material."""
    material.node_tree.links.new(output, principled(material).inputs[socket])
    return read(material)


def read(material) -> HighMaterial:
    return read_materials([material], ImageTextures())[0]
