# SPDX-License-Identifier: GPL-3.0-or-later
"""Random node trees: nothing is raised, each socket is a feed or a note, and feeds without a note are what Cycles shows."""

import random

import bpy
import numpy as np

from addon.core.material_feeds import AVERAGE
from addon.scene.textures import ImageTextures
from tests.support import feeds, random_cases
from tests.support.random_nodes import FOLLOWED, OTHERS, SHADERS, grow
from tests.support.shader_nodes import image, principled, read

SIZE = 48
TOLERANCE = 2 / 255
BORDERS = 0.05
"""The largest share of texels on borders of pixels, where rounding decides."""


def images_for(source):
    found = [image(f"image {place}", (4 + place, 3), seed=source.randrange(1000), space=space)
             for place, space in enumerate(("sRGB", "Non-Color"))]  # fmt: skip
    gone = bpy.data.images.new("gone", 1, 1)
    gone.source, gone.filepath = "FILE", "//gone.png"
    return [*found, gone]


@random_cases.seeds(60, fast=24)
def test_each_socket_is_a_feed_or_a_note_seed(seed, material):
    source = random.Random(seed)
    images = images_for(source)
    for name in ("inner", "outer"):
        group = bpy.data.node_groups.new(name, "ShaderNodeTree")
        for place in range(3):
            kind = source.choice(["NodeSocketColor", "NodeSocketFloat", "NodeSocketVector"])
            group.interface.new_socket(str(place), in_out=source.choice(["INPUT", "OUTPUT"]), socket_type=kind)
        start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
        grow(group, source, FOLLOWED + OTHERS, 6, images)
        for socket in end.inputs[:-1]:
            group.links.new(source.choice([out for node in group.nodes for out in node.outputs]), socket)
        assert start.outputs
    grow(material.node_tree, source, FOLLOWED * 3 + OTHERS + SHADERS, 30, images)
    shader = principled(material)
    outputs = [output for node in material.node_tree.nodes for output in node.outputs]
    for socket in shader.inputs:
        if source.random() < 0.7:
            material.node_tree.links.new(source.choice(outputs), socket)
    if source.random() < 0.5:
        surface = material.node_tree.get_output_node("ALL").inputs["Surface"]
        material.node_tree.links.new(source.choice([o for o in outputs if o.type == "SHADER"]), surface)
    found = read(material)
    assert all(
        note.startswith('Material "Rust": ') and note.endswith(".") for notes in found.notes.values() for note in notes
    )
    if "" not in found.notes:
        # Another Principled BSDF of the tree may be the surface, with other settings.
        inputs = [s for n in material.node_tree.nodes if n.bl_idname == shader.bl_idname for s in n.inputs]
        sockets = {socket.name for socket in inputs if socket.enabled and socket.type in {"RGBA", "VALUE"}}
        assert set(found.feeds) | set(found.notes) >= sockets - {"Subsurface IOR"}
        assert set(found.feeds) <= sockets
    images = ImageTextures()
    for feed in found.feeds.values():
        if hasattr(feed, "image"):
            assert images.load(feed.image).values.size


@random_cases.seeds(100, fast=40)
def test_feeds_without_notes_are_what_cycles_shows_seed(seed, material):
    source = random.Random(seed)
    images = [*images_for(source)[:2], image("wide", (4, 3), seed=seed, space="Non-Color", ends=(-1.0, 2.0))]
    grow(material.node_tree, source, ["TexImage"], 2, images, is_sound=True)
    grow(material.node_tree, source, FOLLOWED, source.randrange(1, 6), images, is_sound=True)
    outputs = [o for node in material.node_tree.nodes for o in node.outputs if o.enabled and o.type != "SHADER"]
    output = outputs[-1 - source.randrange(min(3, len(outputs)))]
    material.node_tree.links.new(output, principled(material).inputs["Base Color"])
    found = read(material)
    if "Base Color" in found.notes:
        return
    obj = feeds.square(material, ((0.03, 0.02), (1.9, -0.3), (2.4, 1.7), (0.53, 2.02)))
    colors = np.random.default_rng(seed).uniform(0.1, 2, (4, 4)).astype(np.float32)
    obj.data.color_attributes.new("paint", "FLOAT_COLOR", "CORNER").data.foreach_set("color", colors.ravel())
    feed = found.feeds["Base Color"]
    if getattr(feed, "name", "paint") == "missing":
        return
    if (getattr(feed, "name", ""), getattr(feed, "channel", 0)) == ("UVMap", AVERAGE):
        return  # Cycles takes the mean of two components, EEVEE that of three
    mine = feeds.evaluate(feed, ImageTextures(), obj.data, SIZE)
    theirs = feeds.cycles(obj, output, SIZE)
    # Emission has no negative light.
    scale = max(1.0, np.abs(mine).max())
    wrong = np.abs(mine.clip(0.0, None) - theirs.clip(0.0, None)).max(axis=-1) > TOLERANCE * scale
    assert wrong.mean() < BORDERS, (output.node.name, output.name, feed, mine[10, 10], theirs[10, 10])
