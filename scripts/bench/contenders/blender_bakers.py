# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's own bakers: Cycles and the multires bake."""

import bpy
import numpy as np

from scripts.bench.contenders.names import CYCLES, MULTIRES
from scripts.bench.contenders.racing import Contender, clocked
from scripts.bench.scenes import Pair
from tests.support import angles


def cycles(pair: Pair, size: int, *, samples: int = 1, space: str = "TANGENT") -> Contender:
    """Blender's selected-to-active bake, with the same rays as Cast."""
    image = target_image(pair.low, "cycles", size)

    def bake() -> float:
        scene = bpy.context.scene
        scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", samples
        scene.cycles.use_denoising = False
        scene.render.bake.use_multires = False
        activate(pair.low, "cycles")
        for obj in bpy.data.objects:
            obj.select_set(obj in (pair.low, pair.high))
        bpy.context.view_layer.objects.active = pair.low
        return clocked(
            lambda: bpy.ops.object.bake(
                type="NORMAL",
                normal_space=space,
                margin=16,
                use_selected_to_active=True,
                cage_extrusion=pair.extrusion,
                max_ray_distance=2.0 * pair.extrusion,
            )
        )

    return Contender(CYCLES, bake, lambda: normals_of(image, size))


def multires(sculpt: bpy.types.Object, size: int) -> Contender:
    """Blender's multires bake in tangent space, which equals world space for a plane along x and y."""
    image = target_image(sculpt, "multires", size)

    def bake() -> float:
        scene = bpy.context.scene
        scene.render.engine = "CYCLES"
        settings = scene.render.bake
        settings.use_multires, settings.type, settings.margin = True, "NORMALS", 16
        for obj in bpy.data.objects:
            obj.select_set(obj is sculpt)
        bpy.context.view_layer.objects.active = sculpt
        return clocked(bpy.ops.object.bake_image)

    return Contender(MULTIRES, bake, lambda: normals_of(image, size))


def target_image(obj: bpy.types.Object, name: str, size: int) -> bpy.types.Image:
    """Add an image node to each of the object's materials, which Blender's bakers need."""
    if old := bpy.data.images.get(name):
        bpy.data.images.remove(old)
    image = bpy.data.images.new(name, size, size, float_buffer=True, is_data=True)
    if not any(slot.material for slot in obj.material_slots):
        obj.data.materials.append(bpy.data.materials.new("target"))
    for slot in obj.material_slots:
        if slot.material:
            nodes = slot.material.node_tree.nodes
            node = nodes.get(name) or nodes.new("ShaderNodeTexImage")
            node.name, node.image = name, image
    activate(obj, name)
    return image


def activate(obj: bpy.types.Object, name: str) -> None:
    """Make the image node of this name active. Blender bakes to the active image node."""
    for slot in obj.material_slots:
        if slot.material:
            nodes = slot.material.node_tree.nodes
            nodes.active = nodes[name]
            nodes[name].select = True


def normals_of(image: bpy.types.Image, size: int) -> np.ndarray:
    """The world-space normals (size, size, 3) in an image that stores n * 0.5 + 0.5."""
    texels = np.empty(size * size * 4, np.float32)
    image.pixels.foreach_get(texels)
    return angles.decode(texels.reshape(size, size, 4))
