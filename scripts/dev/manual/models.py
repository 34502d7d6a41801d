# SPDX-License-Identifier: GPL-3.0-or-later
"""The objects in the manual's pictures, all made by Blender and numpy, and the Cycles renders of them."""

import math
import tempfile
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

CLAY = (0.62, 0.58, 0.52, 1.0)
STONE = (0.33, 0.30, 0.27, 1.0)
STEEL = (0.55, 0.56, 0.58, 1.0)
NIGHT = (0.05, 0.05, 0.055, 1.0)
CYCLES_SAMPLES = 24
FROM_LEFT = (-0.6, -0.7, 0.9)
"""Where the sun stands."""


def clear() -> None:
    """Remove all objects, meshes, materials, images and other data of the scene."""
    bpy.data.batch_remove(
        [
            *bpy.data.objects,
            *bpy.data.meshes,
            *bpy.data.curves,
            *bpy.data.cameras,
            *bpy.data.lights,
            *bpy.data.materials,
            *bpy.data.textures,
            *(image for image in bpy.data.images if image.type != "RENDER_RESULT"),
        ]
    )


def add(name: str, data: bpy.types.ID | None) -> bpy.types.Object:
    """A new object in the scene, with a clay material of its own if it is a mesh without one."""
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    if isinstance(data, bpy.types.Mesh) and not data.materials:
        data.materials.append(material(name))
    return obj


def material(name: str, color: tuple = CLAY, roughness: float = 1.0, metallic: float = 0.0) -> bpy.types.Material:
    """A plain Principled BSDF."""
    result = bpy.data.materials.new(name)
    shader = next(node for node in result.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = color
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Metallic"].default_value = metallic
    shader.inputs["Specular IOR Level"].default_value = 0.0 if roughness == 1.0 else 0.5
    return result


def mesh_of(
    name: str, positions: np.ndarray, corners: np.ndarray, uvs: np.ndarray, smooth: bool = True
) -> bpy.types.Mesh:
    """A mesh of quads. positions: (n, 3); corners: (faces, 4) vertices; uvs: (faces, 4, 2)."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(positions.tolist(), [], corners.tolist(), shade_flat=not smooth)
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", uvs.astype(np.float32).ravel())
    mesh.update()
    return mesh


def grid(name: str, sides: int, surface: Callable, smooth: bool = True) -> bpy.types.Object:
    """A grid of sides x sides quads. surface(u, v) returns x, y, z for arrays of UVs from 0 to 1."""
    u, v = np.meshgrid(np.linspace(0, 1, sides + 1), np.linspace(0, 1, sides + 1))
    positions = np.stack(np.broadcast_arrays(*surface(u, v)), axis=-1).reshape(-1, 3)
    index = np.arange((sides + 1) ** 2).reshape(sides + 1, sides + 1)
    corners = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
    uvs = np.stack([u, v], axis=-1).reshape(-1, 2)[corners]
    return add(name, mesh_of(name, positions, corners, uvs, smooth))


def rivets(u: np.ndarray, v: np.ndarray, count: int = 3, radius: float = 0.28, depth: float = 0.16) -> np.ndarray:
    """Heights of count x count round rivets, in units of a cell of which there are `count` in a unit of length."""
    x, y = (u * count) % 1 - 0.5, (v * count) % 1 - 0.5
    distance = np.sqrt(x * x + y * y) / radius
    dome = np.sqrt(np.clip(1 - distance**2, 0, 1))
    return depth / count * np.minimum(dome * 1.6, 1) ** 0.8


def evaluated_copy(obj: bpy.types.Object, name: str) -> bpy.types.Object:
    """A new object with the mesh that another one's modifiers make."""
    graph = bpy.context.evaluated_depsgraph_get()
    mesh = bpy.data.meshes.new_from_object(obj.evaluated_get(graph))
    mesh.name = name
    mesh.materials.clear()
    return add(name, mesh)


def monkeys(levels: int = 5) -> tuple[bpy.types.Object, bpy.types.Object]:
    """(high, low): Blender's monkey, carved in stone by modifiers, and the bare one with UVs unwrapped again."""
    bpy.ops.mesh.primitive_monkey_add()
    low = bpy.context.object
    low.name = low.data.name = "monkey_low"
    low.data.materials.append(material("monkey", STONE))
    low.data.shade_smooth()
    subdivision = low.modifiers.new("Subdivision", "SUBSURF")
    subdivision.levels = subdivision.render_levels = levels
    for name, kind, size, strength in (("Chips", "VORONOI", 0.22, 0.08), ("Grain", "CLOUDS", 0.05, 0.016)):
        texture = bpy.data.textures.new(name, kind)
        texture.noise_scale = size
        displace = low.modifiers.new(name, "DISPLACE")
        displace.texture, displace.strength, displace.mid_level = texture, strength, 0.5
    high = evaluated_copy(low, "monkey_high")
    high.data.shade_smooth()
    low.modifiers.clear()
    once = low.modifiers.new("Subdivision", "SUBSURF")
    once.levels = once.render_levels = 1
    coarse = evaluated_copy(low, "coarse")
    low.data, coarse.data = coarse.data, low.data
    bpy.data.objects.remove(coarse)
    low.modifiers.clear()
    low.data.materials.clear()
    low.data.materials.append(bpy.data.materials["monkey"])
    low.data.shade_smooth()
    unwrap(low)
    triangulate(low)
    return high, low


def unwrap(obj: bpy.types.Object, angle: float = 66.0, gap: float = 0.02) -> None:
    """New UVs by Smart UV Project."""
    for other in bpy.context.view_layer.objects:
        other.select_set(other == obj)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(angle_limit=math.radians(angle), island_margin=gap)
    bpy.ops.object.mode_set(mode="OBJECT")


def triangulate(obj: bpy.types.Object) -> None:
    """Cut a mesh into triangles for good."""
    obj.modifiers.new("Triangulate", "TRIANGULATE")
    copy = evaluated_copy(obj, "triangles")
    obj.modifiers.clear()
    materials = list(obj.data.materials)
    obj.data, copy.data = copy.data, obj.data
    obj.data.materials.clear()
    for one in materials:
        obj.data.materials.append(one)
    bpy.data.objects.remove(copy)


def bake(low: bpy.types.Object, high: bpy.types.Object, **settings) -> bpy.types.Image:
    """Bake by the extension's own operator; return the normal map."""
    before = set(bpy.data.images)
    settings = {"width": 1024, "height": 1024, "samples": "4", "image": f"{low.name}_{len(before)}"} | settings
    bpy.ops.imprint.bake(low=low.name, high=[{"name": high.name}], **settings)
    return bpy.data.images[settings["image"]]


def light_and_camera(
    place: tuple[float, float, float],
    aim: tuple[float, float, float] = (0, 0, 0),
    lens: float = 60.0,
    sun: tuple[float, float, float] = FROM_LEFT,
) -> None:
    """A camera at a place that looks at a point, and a sun in a direction, before a dark background. lens in millimeters."""
    scene = bpy.context.scene
    for name in ("Camera", "Sun"):
        if name in bpy.data.objects:
            bpy.data.objects.remove(bpy.data.objects[name])
    scene.camera = add("Camera", bpy.data.cameras.new("Camera"))
    scene.camera.data.lens = lens
    scene.camera.location = place
    scene.camera.rotation_euler = (Vector(aim) - Vector(place)).to_track_quat("-Z", "Y").to_euler()
    lamp = add("Sun", bpy.data.lights.new("Sun", "SUN"))
    lamp.data.energy, lamp.data.angle = 3.6, math.radians(2)
    lamp.rotation_euler = Vector(sun).to_track_quat("Z", "Y").to_euler()


def set_sky(kind: str) -> None:
    """What is around the scene: "night" is dark gray, "stripes" are what a polished surface shows best."""
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.get(kind) or bpy.data.worlds.new(kind)
    tree = scene.world.node_tree
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = NIGHT
    if kind == "stripes" and not background.inputs["Color"].is_linked:
        place, wave = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeTexWave")
        wave.inputs["Scale"].default_value = 2.5
        tree.links.new(place.outputs["Generated"], wave.inputs["Vector"])
        tree.links.new(wave.outputs["Color"], background.inputs["Color"])


def render(size: tuple[int, int], samples: int = CYCLES_SAMPLES) -> np.ndarray:
    """A picture of the scene by Cycles on the processor: (height, width, 3) bytes as on the screen, row 0 at the top."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", samples, False
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.render.film_transparent = False
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGB", "8"
    bpy.ops.render.render()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "render.png"
        bpy.data.images["Render Result"].save_render(str(path))
        return load(path)


def load(path: Path) -> np.ndarray:
    """The pixels of an image file: (height, width, 3) bytes, row 0 at the top."""
    image = bpy.data.images.load(str(path))
    try:
        width, height = image.size
        pixels = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(pixels)
        pixels = pixels.reshape(height, width, -1)[::-1, :, :3]
        return np.round(pixels * 255).astype(np.uint8)
    finally:
        bpy.data.images.remove(image)


def letter(words: str, place: tuple[float, float, float], size: float) -> bpy.types.Object:
    """Words that face a camera on -Y, lit by nothing."""
    text = bpy.data.curves.new(words, "FONT")
    text.body, text.align_x, text.size = words, "CENTER", size
    glow = bpy.data.materials.new(words)
    shader = next(node for node in glow.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = (0, 0, 0, 1)
    shader.inputs["Emission Color"].default_value = (0.85, 0.85, 0.85, 1)
    shader.inputs["Emission Strength"].default_value = 1.0
    text.materials.append(glow)
    obj = add(words, text)
    obj.location, obj.rotation_euler = place, (np.pi / 2, 0, 0)
    obj.visible_shadow = False
    return obj
