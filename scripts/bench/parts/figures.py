# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders Figures 1 and 3 to 9 of the paper with other models, which this repository or Blender generates."""

import math
from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler, Vector
from PIL import Image

from addon.core.settings import Settings
from addon.jobs import bake_pair
from scripts import demo
from scripts.bench.meshes import scenes

VIEW = Euler((math.radians(78), 0, math.radians(25)))
SUN = Euler((math.radians(50), math.radians(-15), math.radians(-20)))


def make(folder: Path, scratch: Path, quick: bool) -> dict[str, str]:
    """Write the pictures into a folder. Returns their names and captions."""
    return sphere(folder, scratch) | creature(folder, scratch, quick) | terrain(folder, scratch, quick)


def sphere(folder: Path, scratch: Path) -> dict[str, str]:
    """Figure 1: the map of one surface in world and in tangent space."""
    pair = scenes.belt(256)
    maps = []
    for space in ("WORLD", "TANGENT"):
        path = scratch / f"{space}.png"
        bake(pair.low, pair.high, path, space=space, method="FLATTEN", width=1024, height=512)
        maps.append(path)
    beside(maps, folder / "figure_1.png")
    return {"figure_1.png": "Figure 1: waves on a sphere, the map in world space and in tangent space"}


def creature(folder: Path, scratch: Path, quick: bool) -> dict[str, str]:
    """Figures 3 to 6: the high mesh, the low mesh, the map, and the low mesh with the map."""
    scenes.empty()
    bpy.ops.mesh.primitive_monkey_add()
    low = demo.add_terrain(_subdivided(bpy.context.object, "Low", 1))
    high = demo.add_terrain(_subdivided(bpy.context.object, "High", 5))
    bpy.data.objects.remove(bpy.context.object)
    _wrinkle(high.data)
    _add_camera_and_sun(low, 640, quick)
    count = {obj.name: f"{demo.count_triangles(obj):,} triangles" for obj in (high, low)}
    _render(high, folder / "figure_3.png")
    _render(low, folder / "figure_4.png")
    high.hide_render = False
    bake(low, high, folder / "figure_5.png", method="CAST", width=1024, height=1024)
    _render(low, folder / "figure_6.png")
    return {
        "figure_3.png": f"Figure 3: the high mesh, {count['High']}",
        "figure_4.png": f"Figure 4: the low mesh, {count['Low']}",
        "figure_5.png": "Figure 5: the map of the two, baked with Cast",
        "figure_6.png": f"Figure 6: the low mesh, {count['Low']}, with the map",
    }


def terrain(folder: Path, scratch: Path, quick: bool) -> dict[str, str]:
    """Figures 7 to 9, from the demo: the map, the high mesh beside the low mesh with the map, and a plane with its map."""
    demo.demo(scratch / "demo", 1024 if quick else 2048, quick)
    with Image.open(scratch / "demo" / "low_normal.png") as picture:
        picture.convert("RGB").resize((1024, 1024)).save(folder / "figure_7.png")
    with Image.open(scratch / "demo" / "terrain.png") as picture:
        width, height = picture.size
        high, _, mapped, plane = (
            picture.crop((part * width // 4, 0, (part + 1) * width // 4, height)) for part in range(4)
        )
        _paste((high, mapped), folder / "figure_8.png")
        plane.save(folder / "figure_9.png")
    return {
        "figure_7.png": "Figure 7: a terrain's map",
        "figure_8.png": "Figure 8: the high mesh, and the low one with the map",
        "figure_9.png": "Figure 9: a plane with its map",
    }


def bake(low: bpy.types.Object, high: bpy.types.Object, path: Path, **settings) -> None:
    """Bake a map for Cycles into a file of 8 bits."""
    bake_pair(bpy.context, low, [high], Settings(basis="CYCLES", storage="FILE", output=str(path), depth=8, **settings))


def beside(paths: Sequence[Path], path: Path) -> None:
    """Join pictures from files side by side."""
    pictures = []
    for source in paths:
        with Image.open(source) as picture:
            pictures.append(picture.convert("RGB"))
    _paste(pictures, path)


def _paste(pictures: Sequence[Image.Image], path: Path) -> None:
    Image.fromarray(np.concatenate([np.asarray(picture) for picture in pictures], axis=1)).save(path)


def _subdivided(obj: bpy.types.Object, name: str, levels: int) -> bpy.types.Mesh:
    """An object's mesh after Catmull-Clark subdivision, with linear UVs, so that all levels share them."""
    modifier = obj.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.uv_smooth = levels, "NONE"
    mesh = bpy.data.meshes.new_from_object(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    obj.modifiers.remove(modifier)
    mesh.name = name
    mesh.shade_smooth()
    return mesh


def _wrinkle(mesh: bpy.types.Mesh) -> None:
    """Displace the vertices along their normals with nested waves."""
    points, normals = (np.empty(3 * len(mesh.vertices), np.float32) for _ in range(2))
    mesh.vertices.foreach_get("co", points)
    mesh.vertex_normals.foreach_get("vector", normals)
    x, y, z = points.reshape(-1, 3).T
    waves = np.sin(30 * x + 3 * np.sin(9 * z)) * np.sin(28 * y + 3 * np.sin(8 * x)) + 0.6 * np.sin(
        55 * z + 4 * np.sin(12 * x)
    )
    points += (0.006 * waves[:, None] * normals.reshape(-1, 3)).ravel()
    mesh.vertices.foreach_set("co", points)
    mesh.update()


def _add_camera_and_sun(obj: bpy.types.Object, side: int, quick: bool) -> None:
    """Add a camera that shows the object, a sun, and a dark background."""
    scene = bpy.context.scene
    scene.camera = demo.add("Camera", bpy.data.cameras.new("Camera"))
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 1.15 * max(obj.dimensions)
    scene.camera.rotation_euler = VIEW
    scene.camera.location = VIEW.to_matrix() @ Vector((0, 0, 20))
    sun = demo.add("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.data.angle, sun.rotation_euler = 4.0, math.radians(1), SUN
    scene.world = bpy.data.worlds.new("Background")
    background = next(node for node in scene.world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = demo.BACKGROUND
    scene.render.resolution_x = scene.render.resolution_y = side
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", 8 if quick else 64
    scene.cycles.use_denoising = False
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.color_mode = "RGB"


def _render(shown: bpy.types.Object, path: Path) -> None:
    """Render a picture of one object."""
    for obj in bpy.context.scene.objects:
        obj.hide_render = obj.type == "MESH" and obj is not shown
    bpy.ops.render.render()
    bpy.data.images["Render Result"].save_render(str(path))
