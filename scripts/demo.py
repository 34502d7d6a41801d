# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes a real terrain onto a simplified one and onto a plane, as in Figures 7 to 9 of the paper.

Started by `python3 scripts/imprint.py demo`. Makes the maps, a scene with the four terrains side by side, and a picture.
"""

import argparse
import math
import sys
import time
from pathlib import Path

import bpy
import gpu
import numpy as np
from mathutils import Euler, Matrix, Vector

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import addon  # noqa: E402
from addon.cli import standard_streams  # noqa: E402
from addon.core.errors import BakeError  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.jobs import bake_pair  # noqa: E402
from addon.output.atomic_file import replacing  # noqa: E402

ELEVATIONS = ROOT / "scripts/data/jacksboro_fault_dem.npz"
KM_PER_DEGREE = 111.2  # of latitude; one unit of the scene is a kilometer
EXAGGERATION = 2.0  # of the heights: the real relief, 0.84 km over 30 x 32 km, looks flat in a small picture
LOW_TRIANGLES = 9079  # as in the paper's simplified terrain

PICTURE = (2000, 580)
GAP = 3.0  # between two terrains; this and the lengths below are in kilometers
LABEL_SIZE, LABEL_DROP = 2.2, 3.3  # the height of the letters, and their baseline's distance from the terrain
CAMERA_DROP = 2.8  # below the middle of the terrains, which leaves room for the labels
VIEW = Euler((math.radians(38), 0, 0))  # tilted from looking straight down
SUN = Euler((math.radians(38 - 90), 0, math.radians(50)))  # 38 degrees high in the north-west, as maps are shaded
CLAY, BACKGROUND, LABEL = (0.62, 0.58, 0.52, 1), (0.06, 0.06, 0.065, 1), (0.85, 0.85, 0.85, 1)


def parse() -> argparse.Namespace:
    """Read the command line."""
    result = argparse.ArgumentParser(prog="imprint.py demo", description="Bake a terrain, and make a picture of it.")
    result.add_argument("--size", type=int, default=2048, metavar="TEXELS", help="of the square maps (default: 2048)")
    result.add_argument("--output", type=Path, default=ROOT / "out/demo", metavar="DIR", help="default: out/demo")
    result.add_argument("--quick", action="store_true", help="make a small, coarse picture")
    return result.parse_args()


# The meshes


def read_terrain() -> tuple[np.ndarray, tuple[float, float]]:
    """Read the heights in kilometers above their mean, row 0 in the south, and the extent along west-east and south-north."""
    with np.load(ELEVATIONS) as dem:
        meters = dem["elevation"][::-1].astype(np.float64)  # the file begins in the north
        latitude = math.radians(float(dem["ymin"] + dem["ymax"]) / 2)
        spacing = np.array([dem["dx"] * math.cos(latitude), dem["dy"]]) * KM_PER_DEGREE
    rows, columns = meters.shape
    width, depth = spacing * (columns - 1, rows - 1)
    return (meters - meters.mean()) / 1000, (width, depth)


def grid_mesh(name: str, heights: np.ndarray, extent: tuple[float, float]) -> bpy.types.Mesh:
    """A smooth, centered mesh of quads through a grid of heights. Its UVs are the grid seen from above, from 0 to 1."""
    rows, columns = heights.shape
    u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    positions = np.stack([(u - 0.5) * extent[0], (v - 0.5) * extent[1], heights], axis=-1)
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    corners = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).ravel()

    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(index.size)
    mesh.vertices.foreach_set("co", positions.astype(np.float32).ravel())
    mesh.loops.add(corners.size)
    mesh.loops.foreach_set("vertex_index", corners)
    mesh.polygons.add(corners.size // 4)
    mesh.polygons.foreach_set("loop_start", np.arange(0, corners.size, 4, dtype=np.int32))
    uvs = np.stack([u, v], axis=-1).reshape(-1, 2)[corners]
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", uvs.astype(np.float32).ravel())
    mesh.update(calc_edges=True)
    mesh.shade_smooth()
    return mesh


def simplified(name: str, high: bpy.types.Object, triangles: int) -> bpy.types.Mesh:
    """The mesh simplified by Blender's Decimate modifier, which keeps the UV layout."""
    decimate = high.modifiers.new("Decimate", "DECIMATE")
    decimate.ratio = triangles / count_triangles(high)
    decimate.use_collapse_triangulate = True
    evaluated = high.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = bpy.data.meshes.new_from_object(evaluated)
    mesh.name = name
    high.modifiers.remove(decimate)

    # Decimate moves the corners of the border a little, which could be a texel outside the map.
    uvs = np.empty(2 * len(mesh.loops), np.float32)
    mesh.uv_layers.active.uv.foreach_get("vector", uvs)
    mesh.uv_layers.active.uv.foreach_set("vector", uvs.clip(0, 1))
    return mesh


def count_triangles(obj: bpy.types.Object) -> int:
    """The number of triangles that Blender draws for an object's mesh."""
    return len(obj.data.loops) - 2 * len(obj.data.polygons)


# The scene


def add(name: str, data: bpy.types.ID) -> bpy.types.Object:
    """Add a new object to the scene."""
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def add_terrain(mesh: bpy.types.Mesh) -> bpy.types.Object:
    """Add a terrain with its own matte clay material: its shading depends only on the angle of the light."""
    material = bpy.data.materials.new(mesh.name)
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = CLAY
    shader.inputs["Roughness"].default_value = 1
    shader.inputs["Specular IOR Level"].default_value = 0
    mesh.materials.clear()
    mesh.materials.append(material)
    return add(mesh.name, mesh)


def build_terrains() -> list[bpy.types.Object]:
    """Add the four terrains at the same place: high, low, low with a map, and a plane with a map."""
    heights, extent = read_terrain()
    high = add_terrain(grid_mesh("High", heights, extent))
    low = add_terrain(simplified("Low", high, LOW_TRIANGLES))
    mapped = low.data.copy()
    mapped.name = "Low with map"
    flat = grid_mesh("Plane with map", np.zeros((2, 2)), extent)
    terrains = [high, low, add_terrain(mapped), add_terrain(flat)]
    for terrain in terrains:  # last, because Decimate works better with the real proportions
        terrain.data.transform(Matrix.Diagonal((1, 1, EXAGGERATION, 1)))
    return terrains


def bake(high: bpy.types.Object, low: bpy.types.Object, size: int, path: Path) -> bpy.types.Image:
    """Bake the detail of one terrain into a map for another, and print the summary."""
    settings = Settings(width=size, height=size, storage="FILE", output=str(path), image=path.stem)
    report = bake_pair(bpy.context, low, [high], settings)
    print(*report.summary(), *(f"warning: {text}" for text in report.warnings), sep="\n")
    return bpy.data.images[report.image]


def add_labels(terrains: list[bpy.types.Object]) -> None:
    """Add a label with name and triangle count below each terrain, facing the camera and unlit."""
    material = bpy.data.materials.new("Label")
    nodes = material.node_tree.nodes
    nodes.clear()
    emission, output = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    emission.inputs["Color"].default_value = LABEL
    material.node_tree.links.new(emission.outputs["Emission"], output.inputs["Surface"])
    for terrain in terrains:
        text = bpy.data.curves.new(f"{terrain.name} label", "FONT")
        text.body = f"{terrain.name}\n{count_triangles(terrain):,} triangles"
        text.align_x, text.size = "CENTER", LABEL_SIZE
        text.materials.append(material)
        label = add(text.name, text)
        label.rotation_euler = VIEW
        front = Vector((terrain.location.x, -terrain.dimensions.y / 2, 0))
        label.location = front - VIEW.to_matrix() @ Vector((0, LABEL_DROP, 0))


def arrange(terrains: list[bpy.types.Object]) -> None:
    """Put the terrains side by side, each in an equal share of the picture, with labels, a camera and a sun."""
    scene = bpy.context.scene
    share = terrains[0].dimensions.x + GAP
    for place, terrain in enumerate(terrains):
        terrain.location.x = (place - (len(terrains) - 1) / 2) * share
    add_labels(terrains)

    scene.camera = add("Camera", bpy.data.cameras.new("Camera"))
    scene.camera.data.type, scene.camera.data.clip_end = "ORTHO", 300
    scene.camera.data.ortho_scale = share * len(terrains)
    scene.camera.rotation_euler = VIEW
    scene.camera.location = VIEW.to_matrix() @ Vector((0, -CAMERA_DROP, 100))
    sun = add("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.data.angle = 4.2, math.radians(1)
    sun.rotation_euler = SUN
    scene.world = bpy.data.worlds.new("Background")
    background = next(node for node in scene.world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = BACKGROUND


# The files


def render(path: Path, quick: bool) -> None:
    """Render the picture with Cycles on the CPU."""
    scene = bpy.context.scene
    scene.cycles.device = "CPU"
    scene.cycles.samples = 4 if quick else 32
    scene.cycles.use_denoising = False  # it would smooth the detail of the maps
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = PICTURE
    scene.render.resolution_percentage = 25 if quick else 100
    scene.render.image_settings.color_mode = "RGB"
    with replacing(path) as partial:
        bpy.ops.render.render()
        bpy.data.images["Render Result"].save_render(str(partial))


def save(path: Path, images: list[bpy.types.Image]) -> None:
    """Save the scene, with relative paths to the images beside it, so that the folder can be moved."""
    for image in images:
        image.filepath = f"//{Path(image.filepath).name}"
    bpy.context.preferences.filepaths.file_preview_type = "NONE"  # write no thumbnail into the user's folder
    with replacing(path) as partial, standard_streams.silence():
        bpy.ops.wm.save_as_mainfile(filepath=str(partial), copy=True, relative_remap=False)


def demo(folder: Path, size: int, quick: bool) -> None:
    """Build, bake, render, save."""
    folder.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with standard_streams.silence():  # EGL's messages are harmless, and imprint.py has seen the GPU start
        gpu.init()
    bpy.context.scene.render.engine = "CYCLES"  # before the bakes, because maps are made for the scene's engine
    high, low, mapped, flat = terrains = build_terrains()
    images = [bake(high, mapped, size, folder / "low_normal.png"), bake(high, flat, size, folder / "plane_normal.png")]
    arrange(terrains)
    render(folder / "terrain.png", quick)
    save(folder / "terrain.blend", images)
    print(*(folder / name for name in ("terrain.png", "terrain.blend", "low_normal.png", "plane_normal.png")), sep="\n")


def main() -> int:
    """Run the demo and return the exit code. An error is one line on stderr."""
    options = parse()
    start = time.perf_counter()
    try:
        demo(options.output.absolute(), options.size, options.quick)
    except (BakeError, OSError) as error:  # for example, the folder cannot be created
        print(f"imprint: {error}", file=sys.stderr)
        return 1
    finally:
        addon.free()  # Blender crashes on exit while GPU objects exist
    print(f"{time.perf_counter() - start:.1f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
