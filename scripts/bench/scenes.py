# SPDX-License-Identifier: GPL-3.0-or-later
"""The pairs to bake: from files, generated terrains, and two surfaces with known normals."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from scripts import demo
from tests.support import zoo

PAPER = ((1696, 536), (7910, 4274), (48048, 23378), (61644, 20517))
"""The high and low polygons of Table 1 of the paper: Gumbau, González and Chover, "Hardware generation of normal maps"."""
TERRAIN = (275_772, 9_079)
"""The demo's terrain, used if no folder of pairs has one: about the paper's next sizes."""
TERRAINS = ("kepler", "sthelens", "terrain")
RELIEF = 0.05
"""Height of the waves on both closed-form surfaces, in scene units."""
LATITUDE = 60.0
"""The latitude, in degrees, where the belt of the sphere ends."""


@dataclass
class Pair:
    """Two objects of the open scene. `truth` returns the world-space normals of the high object by UV, if known."""

    name: str
    low: bpy.types.Object
    high: bpy.types.Object
    truth: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
    reach: float = 0.0

    @property
    def extrusion(self) -> float:
        """The distance outside the surface where rays start, in scene units; rays are twice as long."""
        return self.reach or max(self.low.dimensions) * 0.02

    @property
    def triangles(self) -> tuple[int, int]:
        """The triangle counts of the high and the low object."""
        return demo.count_triangles(self.high), demo.count_triangles(self.low)

    @property
    def is_terrain(self) -> bool:
        return self.name.startswith(TERRAINS)


def empty() -> None:
    """An empty scene."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


def opened(path: Path) -> Pair:
    """The objects 'hi' and 'lo' of a .blend."""
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return Pair(path.stem, bpy.data.objects["lo"], bpy.data.objects["hi"])


def made(high: int, low: int) -> Pair:
    """The demo's terrain with about `high` triangles, and the same terrain decimated to about `low`."""
    empty()
    heights, extent = demo.read_terrain()
    share = min(1.0, math.sqrt(high / 2 / np.prod(np.array(heights.shape) - 1)))
    rows, columns = (
        np.linspace(0, count - 1, round((count - 1) * share) + 1).round().astype(int) for count in heights.shape
    )
    top = demo.add("hi", demo.grid_mesh("hi", heights[np.ix_(rows, columns)], extent))
    bottom = demo.add("lo", demo.simplified("lo", top, low))
    return Pair(f"terrain_{demo.count_triangles(top)}_{demo.count_triangles(bottom)}", bottom, top)


def sized(folder: Path | None, high: int, low: int) -> Callable[[], Pair]:
    """A function that opens a pair of that size from a folder, or generates one if the folder has none."""
    found = sorted(folder.glob(f"*_{high}_{low}.blend")) if folder else []
    return (lambda: opened(found[0])) if found else (lambda: made(high, low))


def sizes(path: Path) -> tuple[int, int] | None:
    """The triangle counts of the high and low object in a file's name, NAME_HIGH_LOW.blend."""
    match = re.fullmatch(r".*_(\d+)_(\d+)", path.stem)
    return (int(match[1]), int(match[2])) if match else None


def sine(n: int, waves: int = 4, *, alone: bool = True) -> Pair:
    """A sine terrain of n x n quads, with exact normals, over a plane of two triangles. alone: empty the scene first."""
    if alone:
        empty()

    def truth(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        a, b = 2.0 * np.pi * waves * u, 2.0 * np.pi * waves * v
        slope = RELIEF * np.pi * waves  # x and y go from -1 to 1, twice as far as u and v
        return _unit(np.stack([-slope * np.cos(a) * np.sin(b), -slope * np.sin(a) * np.cos(b), np.ones_like(a)], -1))

    normals = truth(*zoo.grid_uv(n, n).T)[zoo.grid_faces(n, n)]
    high = zoo.terrain("hi", n, height=RELIEF, waves=waves, normals=normals)
    return Pair("sine terrain onto a plane", zoo.plane("lo"), high, truth, 1.5 * RELIEF)


def belt(n: int, waves: tuple[int, int] = (12, 4)) -> Pair:
    """A sphere's belt with waves along its radius, 2n x n quads, exact normals, over the belt of 256 x 128."""
    empty()
    round_, up = waves
    half = math.radians(LATITUDE)

    def frame(u: np.ndarray, v: np.ndarray):
        longitude, latitude = 2.0 * np.pi * u, half * (2.0 * v - 1.0)
        east = np.stack([-np.sin(longitude), np.cos(longitude), np.zeros_like(u)], -1)
        outward = np.stack(
            [np.cos(longitude) * np.cos(latitude), np.sin(longitude) * np.cos(latitude), np.sin(latitude)], -1
        )
        return latitude, east, np.cross(outward, east), outward

    def surface(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        radius = 1.0 + RELIEF * np.sin(2.0 * np.pi * round_ * u) * np.sin(2.0 * np.pi * up * v)
        return radius[..., None] * frame(u, v)[3]

    def truth(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        # The gradient of the radius on the unit sphere tilts the normal: n ~ r o - dr/dlon / cos(lat) e - dr/dlat n.
        latitude, east, north, outward = frame(u, v)
        a, b = 2.0 * np.pi * round_ * u, 2.0 * np.pi * up * v
        radius = 1.0 + RELIEF * np.sin(a) * np.sin(b)
        by_longitude = RELIEF * round_ * np.cos(a) * np.sin(b) / np.cos(latitude)
        by_latitude = RELIEF * np.sin(a) * np.cos(b) * (np.pi * up / half)
        return _unit(radius[..., None] * outward - by_longitude[..., None] * east - by_latitude[..., None] * north)

    normals = truth(*zoo.grid_uv(2 * n, n).T)[zoo.grid_faces(2 * n, n)]
    high = zoo.sheet("hi", surface, 2 * n, n, normals=normals)
    return Pair("waves on a sphere's belt", zoo.sphere("lo", 128, latitude=LATITUDE), high, truth, 1.5 * RELIEF)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def multires(levels: int) -> tuple[Pair, bpy.types.Object]:
    """The sine terrain as Blender's Multires: a plane with `levels`, and a pair of the same surface for Imprint."""
    pair = sine(2)
    bpy.data.objects.remove(pair.high)
    sculpt = zoo.plane("sculpt")
    bpy.context.view_layer.objects.active = sculpt
    sculpt.select_set(True)
    sculpt.modifiers.new("Multires", "MULTIRES")
    for _ in range(levels):
        bpy.ops.object.multires_subdivide(modifier="Multires", mode="SIMPLE")
    evaluated = sculpt.evaluated_get(bpy.context.evaluated_depsgraph_get())
    high = demo.add("hi", bpy.data.meshes.new_from_object(evaluated))
    points = np.empty(3 * len(high.data.vertices), np.float32)
    position = high.data.attributes["position"].data
    position.foreach_get("vector", points)
    x, y = points[0::3], points[1::3]
    points[2::3] = RELIEF * np.sin(4.0 * np.pi * (x + 1.0)) * np.sin(4.0 * np.pi * (y + 1.0))
    position.foreach_set("vector", points)
    high.data.update()
    high.data.shade_smooth()
    high.select_set(True)
    bpy.ops.object.multires_reshape(modifier="Multires")
    high.select_set(False)
    sculpt.modifiers["Multires"].levels = 0
    return Pair("sine terrain as Multires", pair.low, high, pair.truth, pair.reach), sculpt


# Files, for processes that open them by themselves


def terrain_file(folder: Path | None, scratch: Path) -> Path:
    """The first terrain of the folder, or the demo's, saved in `scratch`."""
    found = [path for path in sorted(folder.glob("*.blend")) if path.name.startswith(TERRAINS)] if folder else []
    return found[0] if found else saved(made(*TERRAIN), scratch)


def small_file(folder: Path | None, scratch: Path) -> Path:
    """The smallest pair of the paper's table, from the folder or generated and saved in `scratch`."""
    high, low = PAPER[0]
    found = sorted(folder.glob(f"*_{high}_{low}.blend")) if folder else []
    return found[0] if found else saved(made(high, low), scratch)


def saved(pair: Pair, scratch: Path) -> Path:
    """Save the open scene, which shows a pair, in `scratch`."""
    path = scratch / f"{pair.name}.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return path.absolute()
