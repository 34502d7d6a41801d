# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures of docs/troubleshooting.md: each fault beside what it looks like once it is put right.

Each function yields names and pictures; all are renders by Cycles of real bakes, or the maps themselves.
"""

import math
from collections.abc import Iterator

import bpy
import numpy as np
from mathutils import Matrix, Vector

from scripts.dev.manual import models

Picture = tuple[str, np.ndarray]
"""The name of a file, without its ending, and (height, width, 3) bytes."""
SIZE = (480, 360)
PLAQUE_CAMERA = ((0, -0.75, 1.75), (0, -0.02, 0), 58.0)
FROM_TOP = (-0.35, 0.8, 0.55)


BOX_CAMERA = ((-1.5, -2.3, 1.7), (0, 0, -0.04), 60.0)
CORNER_CAMERA = ((-2.0, -2.4, 1.5), (-0.4, -0.4, 0.22), 90.0)
CLOSE_CAMERA = ((-2.0, -2.4, 1.5), (-0.5, -0.5, 0.44), 300.0)
BALL_CAMERA = ((-1.5, -5, 2.2), (0, 0, 0), 75.0)


def _show(
    low: bpy.types.Object, camera: tuple = PLAQUE_CAMERA, samples: int = models.CYCLES_SAMPLES, sky: str = "night"
) -> np.ndarray:
    """A render of one object alone."""
    for obj in bpy.data.objects:
        obj.hide_render = obj.type == "MESH" and obj != low
    models.light_and_camera(*camera, FROM_TOP if camera == PLAQUE_CAMERA else models.FROM_LEFT)
    models.set_sky(sky)
    return models.render(SIZE, samples)


def pixels_of(image: bpy.types.Image) -> np.ndarray:
    """An image over dark gray where its alpha is 0: (height, width, 3) bytes, row 0 at the top."""
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(height, width, 4)[::-1]
    color = pixels[..., :3] * pixels[..., 3:] + 0.15 * (1 - pixels[..., 3:])
    return np.round(np.clip(color, 0, 1) * 255).astype(np.uint8)


def _enlarged(pixels: np.ndarray, left: float = 0, top: float = 0, share: float = 1.0) -> np.ndarray:
    """A square part of an image, at 360 x 360 by the nearest texel. left, top and share are shares of its sides."""
    height, width = pixels.shape[:2]
    steps = (np.arange(360) + 0.5) / 360 * share
    return pixels[((top + steps) * height).astype(int)][:, ((left + steps) * width).astype(int)]


def _plaque(name: str = "plaque") -> tuple[bpy.types.Object, bpy.types.Object]:
    """(high, low): a plate with nine rivets and a groove, and two triangles."""

    def carved(u, v):
        groove = -0.02 * np.clip(1 - (np.abs(np.maximum(np.abs(u - 0.5), np.abs(v - 0.5)) - 0.46) / 0.012) ** 2, 0, 1)
        inside = np.clip((u - 0.08) / 0.84, 0, 1), np.clip((v - 0.08) / 0.84, 0, 1)
        return u - 0.5, v - 0.5, models.rivets(*inside) + groove

    return models.grid(f"{name}_high", 400, carved), models.grid(
        f"{name}_low", 1, lambda u, v: (u - 0.5, v - 0.5, 0 * u)
    )


def green() -> Iterator[Picture]:
    """A map with green down, read as if it were up: as an engine does that was not told."""
    high, low = _plaque()
    right = models.bake(low, high, green="+Y")
    wrong = models.bake(low, high, green="-Y", material=False)
    node = next(node for node in low.active_material.node_tree.nodes if node.type == "TEX_IMAGE")
    for name, image in (("green-wrong", wrong), ("green-right", right)):
        node.image = image
        yield name, _show(low)


def missed() -> Iterator[Picture]:
    """Rays that are too short, the mask that shows where, and the measured distances."""
    high, low = models.monkeys()
    camera = ((-2.4, -6, 1.2), (0.05, 0, -0.03), 78.0)
    models.bake(low, high, method="CAST", extrusion=0.012, max_distance=0.03, image="short", mask=True)
    yield "missed-wrong", _show(low, camera)
    yield (
        "missed-mask",
        _enlarged(pixels_of(next(image for image in bpy.data.images if image.name.startswith("short_")))),
    )
    models.bake(low, high, method="CAST", measure=True)
    yield "missed-right", _show(low, camera)


def layer() -> Iterator[Picture]:
    """Rays that start beyond a plate that the low mesh lacks, and rays whose distances are measured."""

    def ground(u, v):
        return 2 * u - 1, 2 * v - 1, 0.12 * models.rivets(u, v, 9, 0.3, 1.0)

    floor_high = models.grid("floor_high", 540, ground)
    floor_low = models.grid("floor_low", 1, lambda u, v: (2 * u - 1, 2 * v - 1, 0 * u))
    plate = models.grid("plate", 200, lambda u, v: (u - 0.5, v - 0.5, 0.45 + 0.25 * models.rivets(u, v, 3)))
    high = [{"name": floor_high.name}, {"name": plate.name}]
    for name, distances in (
        ("layer-wrong", {"extrusion": 0.6, "max_distance": 0.7}),
        ("layer-right", {"measure": True}),
    ):
        size = {"width": 1024, "height": 1024, "samples": "4", "method": "CAST"}
        bpy.ops.imprint.bake(low=floor_low.name, high=high, image=name, **size, **distances)
        yield name, _show(floor_low, ((0, -1.6, 3.4), (0, -0.05, 0), 58.0))


def _box(seams: bool) -> tuple[bpy.types.Object, bpy.types.Object]:
    """(high, low): a rounded box, and a cube with hard edges whose six faces are UV islands of their own, or one."""
    bpy.ops.mesh.primitive_cube_add(size=1.0)
    low = bpy.context.object
    low.name = "box_low"
    low.data.materials.append(models.material("box", models.STEEL, 0.35))
    bevel = low.modifiers.new("Bevel", "BEVEL")
    bevel.width, bevel.segments = 0.2, 16
    high = models.evaluated_copy(low, "box_high")
    high.data.shade_smooth()
    low.modifiers.clear()
    low.data.shade_flat()
    if seams:
        models.unwrap(low, 30.0, 0.06)
    return high, low


def hard_edges() -> Iterator[Picture]:
    """Hard edges inside a UV island, and on its border. Blender's cube comes unfolded into one island."""
    for name, seams in (("hard-edges-wrong", False), ("hard-edges-right", True)):
        models.clear()
        high, low = _box(seams)
        models.bake(low, high, method="CAST", measure=True, width=64, height=64, samples="16")
        yield name, _show(low, CORNER_CAMERA)


def overlaps() -> Iterator[Picture]:
    """Two plates whose UVs lie on each other, and side by side."""

    def two(sides, left, right, shift, name):
        one = models.grid(f"{name}_left", sides, lambda u, v: (u - 1.04, v - 0.5, left(u, v)))
        other = models.grid(f"{name}_right", sides, lambda u, v: (u + 0.04, v - 0.5, right(u, v)))
        for obj, first in ((one, 0.0), (other, shift)):
            uvs = np.empty(len(obj.data.loops) * 2, np.float32)
            obj.data.uv_layers[0].uv.foreach_get("vector", uvs)
            uvs = uvs.reshape(-1, 2) * (0.48, 0.98) + (0.01 + first, 0.01)
            obj.data.uv_layers[0].uv.foreach_set("vector", uvs.astype(np.float32).ravel())
        with bpy.context.temp_override(active_object=one, object=one, selected_editable_objects=[one, other]):
            bpy.ops.object.join()
        one.name = name
        return one

    def waves(u, v):
        return 0.02 * np.sin(u * 8 * math.pi)

    for name, shift in (("overlap-wrong", 0.0), ("overlap-right", 0.5)):
        models.clear()
        high = two(240, models.rivets, waves, shift, "two_high")
        low = two(1, lambda u, v: 0 * u, lambda u, v: 0 * u, shift, "two_low")
        models.bake(low, high, method="CAST", extrusion=0.2, max_distance=0.4)
        yield name, _show(low, ((0, -1.3, 3.2), (0, 0, 0), 50.0))


def margin() -> Iterator[Picture]:
    """A small map without a margin and with one, on the mesh and around its islands."""
    high, low = _box(seams=True)
    for name, width in (("margin-wrong", 0), ("margin-right", 16)):
        image = models.bake(low, high, method="CAST", measure=True, width=96, height=96, samples="16", margin=width)
        yield name, _show(low, CLOSE_CAMERA)
        yield f"{name}-map", _enlarged(pixels_of(image))


def depth() -> Iterator[Picture]:
    """A smooth shining surface with a map of 8 bits, and of 16."""
    high = models.grid("swell_high", 300, lambda u, v: (u - 0.5, v - 0.5, 0.03 * np.sin(3 * u + 1) * np.sin(3 * v + 1)))
    low = models.grid("swell_low", 1, lambda u, v: (u - 0.5, v - 0.5, 0 * u))
    low.data.materials[0] = models.material("mirror", models.STEEL, 0.03, 1.0)
    for name, bits in (("depth-wrong", "8"), ("depth-right", "16")):
        models.bake(low, high, method="FLATTEN", depth=bits)
        yield name, _show(low, samples=48, sky="stripes")


def doubled() -> Iterator[Picture]:
    """The modifiers' detail and the map of it together, and the base mesh with the map."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24)
    low = bpy.context.object
    low.name = "stone"
    low.data.materials.append(models.material("stone"))
    low.data.shade_smooth()
    subdivision = low.modifiers.new("Subdivision", "SUBSURF")
    subdivision.levels = subdivision.render_levels = 3
    displace = low.modifiers.new("Displace", "DISPLACE")
    displace.texture, displace.strength = bpy.data.textures.new("Chips", "VORONOI"), 0.12
    displace.texture.noise_scale = 0.3
    bpy.ops.imprint.bake(low=low.name, high=[{"name": low.name}], width=1024, height=1024, samples="4")
    yield "doubled-wrong", _show(low, BALL_CAMERA)
    for modifier in low.modifiers:
        modifier.show_render = False
    yield "doubled-right", _show(low, BALL_CAMERA)


def color_space() -> Iterator[Picture]:
    """The map read as a color, and as data."""
    high, low = _plaque()
    image = models.bake(low, high, depth="8")
    image.colorspace_settings.name = "sRGB"
    yield "color-space-wrong", _show(low)
    image.colorspace_settings.name = "Non-Color"
    yield "color-space-right", _show(low)


def skewed() -> Iterator[Picture]:
    """Detail near a hard edge, baked along smooth normals and with blended directions, the default."""
    for name, directions in (("skewed-wrong", "SMOOTH"), ("skewed-right", "BLENDED")):
        models.clear()
        _, low = _box(seams=True)
        bpy.data.objects.remove(bpy.data.objects["box_high"])
        high = _studded_box()
        models.bake(low, high, method="CAST", measure=True, directions=directions, samples="16")
        yield name, _show(low, BOX_CAMERA)


def _studded_box() -> bpy.types.Object:
    """A cube with round studs near the corners of each face."""
    bpy.ops.mesh.primitive_cube_add(size=1.0)
    parts = [bpy.context.object]
    turns = [Matrix.Rotation(math.radians(90 * k), 4, "X") for k in range(4)]
    turns += [Matrix.Rotation(math.radians(90 * k), 4, "Y") for k in (1, 3)]
    for turn in turns:
        for x in (-0.36, 0.36):
            for y in (-0.36, 0.36):
                bpy.ops.mesh.primitive_cylinder_add(
                    vertices=48, radius=0.08, depth=0.09, location=turn @ Vector((x, y, 0.5))
                )
                stud = bpy.context.object
                stud.rotation_euler = turn.to_euler()
                bevel = stud.modifiers.new("Bevel", "BEVEL")
                bevel.width, bevel.segments = 0.02, 3
                bpy.ops.object.convert(target="MESH")
                parts.append(stud)
    with bpy.context.temp_override(active_object=parts[0], object=parts[0], selected_editable_objects=parts):
        bpy.ops.object.join()
    parts[0].name = "studded_high"
    return parts[0]


FAULTS = (green, missed, layer, hard_edges, overlaps, margin, depth, doubled, color_space, skewed)


def pictures() -> Iterator[Picture]:
    """All of them, each in a scene of its own."""
    for fault in FAULTS:
        models.clear()
        yield from fault()
    models.clear()
