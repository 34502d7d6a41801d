# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of meshes whose layers lie near each other, baked with the first hit by a distance that was set, and by default.

Red are texels whose detail comes from another part than the one that they belong to.
"""

import math
from collections.abc import Callable, Iterator, Sequence

import bmesh
import bpy
import numpy as np

from scripts.dev.manual import models

Picture = tuple[str, np.ndarray]
"""The name of a file, without its ending, and (height, width, 3) bytes."""
SIZE = (480, 360)
HALF_SIZE = (960, 1080)
"""Of each of two pictures side by side, in the gallery of the extension."""
START_SIZE = (500, 520)
"""Of each of three in the README."""
COLLAR_CAMERA = (-0.5, -3.4, 1.3), (0, 0, 0.5)
MAP = 1024
RED = (0.6, 0.02, 0.01)
FROM_BEHIND = (-0.45, 0.8, 0.6)


class Parts:
    """Pairs of surfaces, as models.grid takes them: the low ones in one object, each with a strip of the UV map; the high ones
    have a material for each part, so that a Material ID map tells them apart."""

    def __init__(self, lows: Sequence[Callable], highs: Sequence[Callable], *, low_sides: int, high_sides: int):
        self.highs = []
        self.materials = [models.material(f"part_{part}") for part in range(len(highs))]
        for part, surface in enumerate(highs):
            self.add(part, models.grid(f"high_{part}", high_sides, surface))
        strips = [models.grid(f"low_{part}", low_sides, surface) for part, surface in enumerate(lows)]
        for part, strip in enumerate(strips):
            strip.data.materials[0] = strips[0].data.materials[0]
            uvs = np.empty(len(strip.data.loops) * 2, np.float32)
            strip.data.uv_layers[0].uv.foreach_get("vector", uvs)
            uvs = uvs.reshape(-1, 2) * (0.98 / len(strips), 0.98) + (part / len(strips) + 0.01 / len(strips), 0.01)
            strip.data.uv_layers[0].uv.foreach_set("vector", uvs.astype(np.float32).ravel())
        self.vertices = (low_sides + 1) ** 2
        """The number of vertices of each part of the low mesh."""
        self.low = strips[0]
        with bpy.context.temp_override(active_object=self.low, object=self.low, selected_editable_objects=strips):
            bpy.ops.object.join()
        self.low.name = "low"

    def add(self, part: int, high: bpy.types.Object) -> None:
        """Count a high object to a part."""
        high.data.materials[0] = self.materials[part]
        self.highs.append(high)

    def bake(self, **settings) -> None:
        """Bake the normal map, and color the low mesh by the Material ID map. settings: of the operator."""
        size = {"width": MAP, "height": MAP, "samples": "4", "method": "CAST"}
        high = [{"name": one.name} for one in self.highs]
        bpy.ops.imprint.bake(low=self.low.name, high=high, image="map", maps={"MATERIAL_ID"}, **size, **settings)
        ids = bpy.data.images["map_material_id"]
        self._color(np.round(_pixels(ids)[..., :3] * 255).astype(np.int64) @ (1, 256, 65536))

    def _color(self, ids: np.ndarray) -> None:
        """Let the low mesh glow red where a texel's ID is not the most frequent one of its strip."""
        width = MAP // len(self.materials)
        is_other = np.zeros(ids.shape, bool)
        for part in range(len(self.materials)):
            strip = np.s_[:, part * width : (part + 1) * width]
            values, counts = np.unique(ids[strip][ids[strip] > 0], return_counts=True)
            # Samples mix the colors of two parts along the borders between them.
            is_known = np.isin(ids[strip], values[counts > 0.002 * counts.sum()])
            is_other[strip] = is_known & (ids[strip] != values[np.argmax(counts)])
        print(f"{is_other.mean():.2%} of the texels show another part")
        pixels = np.ones((MAP, MAP, 4), np.float32)
        pixels[..., :3] = is_other[..., None] * np.float32(RED)
        image = bpy.data.images.new("color", MAP, MAP, float_buffer=True, is_data=True)
        image.pixels.foreach_set(pixels.ravel())
        tree = self.low.active_material.node_tree
        node = tree.nodes.get("color") or tree.nodes.new("ShaderNodeTexImage")
        node.name, node.image = "color", image
        shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
        tree.links.new(node.outputs["Color"], shader.inputs["Emission Color"])
        shader.inputs["Emission Strength"].default_value = 1.0

    def remove(self, part: int, is_removed: Callable[[np.ndarray], np.ndarray]) -> None:
        """Remove faces of a part of the low mesh: is_removed(centers (faces, 3)) says which, (faces,) bool."""
        faces = self.low.data.polygons
        centers, vertices = np.empty(len(faces) * 3, np.float32), np.empty(len(faces) * 4, np.int32)
        faces.foreach_get("center", centers)
        faces.foreach_get("vertices", vertices)
        chosen = is_removed(centers.reshape(-1, 3)) & (vertices[::4] // self.vertices == part)
        edited = bmesh.new()
        edited.from_mesh(self.low.data)
        edited.faces.ensure_lookup_table()
        bmesh.ops.delete(edited, geom=[edited.faces[face] for face in np.flatnonzero(chosen)], context="FACES")
        edited.to_mesh(self.low.data)
        edited.free()

    def change_places(self, change: Callable[[np.ndarray], np.ndarray]) -> None:
        """Move the vertices of the low mesh: change((parts, vertices, 3)) returns their new places."""
        places = np.empty(len(self.low.data.vertices) * 3, np.float32)
        self.low.data.vertices.foreach_get("co", places)
        moved = change(places.reshape(-1, self.vertices, 3))
        self.low.data.vertices.foreach_set("co", moved.astype(np.float32).ravel())
        self.low.data.update()

    def show(
        self,
        camera: tuple,
        sun: tuple = models.FROM_LEFT,
        size: tuple[int, int] = SIZE,
        words: str = "",
        shown: Sequence[bpy.types.Object] = (),
    ) -> np.ndarray:
        """A render of the low mesh alone, or of the objects `shown`, with words below it."""
        for obj in list(bpy.data.objects):
            if obj.type == "FONT":  # words of an earlier picture
                bpy.data.objects.remove(obj)
                continue
            obj.hide_render = obj.type == "MESH" and obj not in (shown or (self.low,))
        models.light_and_camera(*camera, sun)
        models.set_sky("night")
        if words:
            below = models.letter(words, (0, -0.46, -2), 0.05)
            below.parent, below.rotation_euler = bpy.context.scene.camera, (0, 0, 0)
        return models.render(size)


def _pixels(image: bpy.types.Image) -> np.ndarray:
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, 4)


def _around(radius: np.ndarray, u: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A surface of revolution about z, with its seam at the back."""
    angle = (2 * u + 0.5) * math.pi
    return radius * np.cos(angle), radius * np.sin(angle), z


def _collar_parts() -> Parts:
    """A collar around a neck. Its studs stand off farther than the gap between the two is wide."""
    gap, thickness, studs = 0.03, 0.03, 0.05

    def neck(u, v, detail=0.0):
        v, dome = np.minimum(v, 0.8) / 0.8, np.clip((v - 0.8) / 0.2, 0, 1) * 0.5 * math.pi
        radius = (0.30 + 0.35 * np.exp(-v / 0.1) + detail) * np.cos(dome)
        return _around(radius, u, v + 0.2 * np.sin(dome))

    def skin(u, v):
        return neck(u, v, 0.004 * np.sin(150 * v + 4 * np.sin(8 * math.pi * u)))

    def ring(u, v, detail=0.0):
        """v runs from the lower border up on the outside, over the upper border, and down on the inside."""
        up = 1 - np.abs(2 * v - 1)
        half = 0.5 * thickness * np.clip((1 - up) / 0.06, 0, 1) ** 0.5
        z = 0.22 + 0.5 * up
        radius = 0.30 + 0.35 * np.exp(-z / 0.1) + gap + 0.5 * thickness + 0.05 * up**2
        return _around(radius + np.where(v < 0.5, half + detail, -half), u, z)

    def studded(u, v):
        return ring(u, v, studs / 0.16 * models.rivets(u * 16 % 1, v / 0.24 % 1, 1, 0.3, 0.16) * (v < 0.48))

    return Parts((neck, ring), (skin, studded), low_sides=32, high_sides=600)


def collar(size: tuple[int, int] = SIZE, lens: float = 95.0, words: tuple[str, str] = ("", "")) -> Iterator[Picture]:
    """The collar, with the first hit and by default. Its front is cut away for the picture."""
    for name, settings, text in (
        ("collar-first-hit", {"hit": "OUTERMOST", "extrusion": 0.07, "max_distance": 0.14}, words[0]),
        ("collar-own-hit", {}, words[1]),
    ):
        models.clear()
        parts = _collar_parts()
        parts.bake(**settings)
        parts.remove(1, lambda center: (center[:, 1] < 0) & (np.abs(center[:, 0]) < 0.26))
        yield name, parts.show((*COLLAR_CAMERA, lens), size=size, words=text)


def start() -> Iterator[Picture]:
    """README.md: the sculpt, the low mesh, and the low mesh after one press, side by side."""
    models.clear()
    parts = _collar_parts()
    camera = (*COLLAR_CAMERA, 68.0)
    bare, words = models.material("bare"), "{}: {:,} triangles"
    highs = sum(2 * len(high.data.polygons) for high in parts.highs)
    sculpt = parts.show(camera, size=START_SIZE, words=words.format("Sculpt", highs), shown=parts.highs)
    parts.bake()
    baked = parts.show(camera, size=START_SIZE, words="Bake pressed, nothing set")
    parts.low.data.materials[0] = bare
    low = parts.show(camera, size=START_SIZE, words=words.format("Low", 2 * len(parts.low.data.polygons)))
    yield "start", np.concatenate([sculpt, low, baked], axis=1)
    models.clear()


def gallery() -> Iterator[Picture]:
    """docs/extension/: the collar with the first hit and by default, side by side."""
    words = "The first hit, a distance set", "Imprint, no setting touched"
    halves = [pixels for _, pixels in collar(HALF_SIZE, 68.0, words)]
    yield "../extension/gallery-layers.jpg", np.concatenate(halves, axis=1)
    models.clear()


def fingers() -> Iterator[Picture]:
    """Four fingers side by side. Their nails stand off farther than the gaps between them are wide.

    For the picture the fingers are apart and turned, so that one sees the sides that face each other.
    """
    radius, gap = 0.13, 0.03
    places = (np.arange(4) - 1.5) * (2 * radius + gap)
    lengths = 0.85, 1.0, 0.95, 0.75

    def finger(place, length):
        def smooth(u, v, detail=0.0):
            dome = np.clip((v - 0.8) / 0.2, 0, 1) * 0.5 * math.pi
            x, y, z = _around((radius + detail) * np.cos(dome), u, np.minimum(v, 0.8) / 0.8 * length)
            return x + place, y, z + radius * np.sin(dome)

        def wrinkled(u, v):
            knuckles = sum(np.exp(-(((v - at) / 0.05) ** 2)) for at in (0.27, 0.55))
            wrinkles = -0.012 * knuckles * (0.5 + 0.5 * np.sin(300 * v))
            front = np.abs(u - 0.5)
            nail = np.clip((0.09 - front) / 0.01, 0, 1) * np.clip((0.06 - np.abs(v - 0.76)) / 0.008, 0, 1)
            return smooth(u, v, wrinkles + 0.02 * nail + 0.002 * np.sin(80 * math.pi * u) * np.sin(120 * v))

        return smooth, wrinkled

    def turned(parts):
        angle, separation = math.radians(65), 1.4
        turn = np.array([(math.cos(angle), math.sin(angle), 0), (-math.sin(angle), math.cos(angle), 0), (0, 0, 1)])
        shift = np.stack([places, 0 * places, 0 * places], axis=1)[:, None]
        return (parts - shift) @ turn + separation * shift

    for name, settings in (
        ("fingers-first-hit", {"hit": "OUTERMOST", "extrusion": 0.05, "max_distance": 0.1}),
        ("fingers-own-hit", {}),
    ):
        models.clear()
        lows, highs = zip(*map(finger, places, lengths), strict=True)
        parts = Parts(lows, highs, low_sides=24, high_sides=400)
        parts.bake(**settings)
        parts.change_places(turned)
        yield name, parts.show(((0, -3.6, 1.2), (0, 0, 0.55), 80.0))


def plates() -> Iterator[Picture]:
    """Plates that stand off a panel, and a pipe that runs closer to it. The low mesh has the panel and the pipe."""
    raised, clearance, radius = 0.07, 0.045, 0.09

    def panel(u, v):
        return 2 * u - 1, 2 * v - 1, 0 * u

    def plated(u, v):
        return 2 * u - 1, 2 * v - 1, 0.004 * np.sin(40 * math.pi * v) * (np.abs(u - 0.5) < 0.47)

    def pipe(u, v, detail=0.0):
        x, y, z = _around(radius + detail, u, 1.9 * v - 0.95)
        return x, z, radius + clearance - y

    def ribbed(u, v):
        return pipe(u, v, 0.012 * (0.5 + 0.5 * np.tanh(12 * np.sin(24 * math.pi * v))))

    for name, settings in (
        ("plates-near", {"hit": "OUTERMOST", "extrusion": 0.02, "max_distance": 0.06}),
        ("plates-far", {"hit": "OUTERMOST", "extrusion": 0.1, "max_distance": 0.2}),
        ("plates-own-hit", {}),
    ):
        models.clear()
        parts = Parts((panel, pipe), (plated, ribbed), low_sides=24, high_sides=400)
        for x in (-0.55, 0.55):
            for y in (-0.6, 0.0, 0.6):
                parts.add(0, models.grid("plate", 120, _plate(x, y, raised)))
        parts.bake(**settings)
        yield name, parts.show(((-2.2, -2.9, 2.2), (0, -0.02, 0), 62.0), FROM_BEHIND)


def _plate(x: float, y: float, raised: float) -> Callable:
    """A plate with four screws above a place of the panel."""

    def surface(u, v):
        border = np.maximum(np.abs(u - 0.5), np.abs(v - 0.5))
        height = 0.012 * np.clip((0.49 - border) / 0.03, 0, 1) + 0.3 * models.rivets(u, v, 2, 0.25)
        return x + 0.4 * (u - 0.5), y + 0.4 * (v - 0.5), raised - 0.02 + height

    return surface


SCENES = (collar, fingers, plates)


def pictures() -> Iterator[Picture]:
    """All of them, each in a scene of its own."""
    for scene in SCENES:
        yield from scene()
    models.clear()
