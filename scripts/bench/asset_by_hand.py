# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares the shading errors of game assets: made by Imprint, and by hand with Blender, at equal triangles and map size.

.venv/bin/python scripts/bench/asset_by_hand.py FILE.blend ... [--high NAME] [--triangles 3000] [--size 512] [--equal]
    [--rivals]

By hand: Decimate, Smart UV Project, and Cycles' selected to active with the best of five distances. --equal also says how many
triangles that takes for the error of Imprint. --rivals adds meshoptimizer's simplify and xatlas in place of Decimate and Smart
UV Project, if these packages are there. Maps are in object space with 32 bits, so that no tangent basis and no rounding enters.
Seconds are those of the processor.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import gpu
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.audit import appearance  # noqa: E402
from addon.audit.appearance import ShownMap  # noqa: E402
from addon.core import udim  # noqa: E402
from addon.core.asset_limits import Wanted  # noqa: E402
from addon.core.naming import Suffixes  # noqa: E402
from addon.core.progress import Pace, finish  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.engine import normal_space  # noqa: E402
from addon.jobs import asset  # noqa: E402
from addon.jobs.job import Job  # noqa: E402
from addon.mesh.welding import weld  # noqa: E402
from addon.scene import mesh_reader, reading  # noqa: E402

DISTANCES = 0.002, 0.005, 0.01, 0.02, 0.05
"""How far outside the low mesh Cycles' rays start, as a share of the diagonal. They are twice as long."""
CYCLES_SAMPLES = 16
EQUAL, TRIES = 0.02, 6
"""The share by which errors that count as equal differ at most, and how many counts of triangles are tried for that."""
ANGLE = np.radians(66.0)
"""The default of Smart UV Project."""
MARGIN = 0.004
"""Between islands, as a share of the map."""


@dataclass(frozen=True)
class Made:
    """An asset that was measured. errors: as Appearance.to_dict has them."""

    name: str
    triangles: int
    errors: dict
    seconds: float

    def row(self) -> str:
        """A line of the table."""
        mean, most, alone = (self.errors[key] for key in ("mean", "percentile_99", "silhouette"))
        return (
            f"  {self.name:24} {self.triangles:7,} triangles  {mean:6.3f} mean  {most:6.2f} p99  {alone:6.2%} outline  "
            + (f"{self.seconds:6.1f} s")
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("files", nargs="+", metavar="FILE.blend")
    parser.add_argument("--high", default="hi", metavar="NAME")
    parser.add_argument("--triangles", type=int, default=3000, metavar="N")
    parser.add_argument("--size", type=int, default=512, metavar="TEXELS")
    parser.add_argument("--samples", type=int, default=4, metavar="N")
    parser.add_argument("--equal", action="store_true")
    parser.add_argument("--rivals", action="store_true")
    options = parser.parse_args()
    gpu.init()
    settings = Settings(
        width=options.size, height=options.size, samples=options.samples, space="OBJECT", storage="MEMORY", depth=32
    )
    for file in options.files:
        bpy.ops.wm.open_mainfile(filepath=file)
        high = bpy.data.objects[options.high]
        for obj in [obj for obj in bpy.data.objects if obj is not high]:
            bpy.data.objects.remove(obj)
        print(f"{Path(file).stem}, {options.size} x {options.size}")
        with appearance.kept_pictures():
            compare(high, settings, options)


def compare(high: bpy.types.Object, settings: Settings, options: argparse.Namespace) -> None:
    """Print what each way makes of a high object."""
    ours = of_imprint(high, options.triangles, settings)
    print(ours.row(), flush=True)
    distance, best = min(by_hand(high, ours.triangles, settings), key=lambda each: each[1].errors["mean"])
    print(best.row())
    print(f"  Imprint has {ours.errors['mean'] / best.errors['mean']:.2f} of the error by hand", flush=True)
    if options.equal:
        print_equal(high, ours, best, distance, settings)
    if options.rivals:
        best = best_rival(high, ours.triangles, settings)
        print(best.row())
        print(f"  Imprint has {ours.errors['mean'] / best.errors['mean']:.2f} of the error of rivals", flush=True)


def best_rival(high: bpy.types.Object, triangles: int, settings: Settings) -> Made:
    """By meshoptimizer, xatlas and Cycles, with the best of the distances."""
    made = by_cycles(rival_low, high, triangles, settings)
    return min((each for _, each in made), key=lambda each: each.errors["mean"])


def of_imprint(high: bpy.types.Object, triangles: int, settings: Settings) -> Made:
    start = time.process_time()
    work = asset.work(
        bpy.context, Job(high, [high]), Wanted(triangles=triangles), settings, Pace(), suffixes=Suffixes()
    )
    (report,) = finish(work)
    seconds = time.process_time() - start
    return Made("Imprint", report.triangles["low"], report.appearance, seconds)


def print_equal(high: bpy.types.Object, ours: Made, first: Made, distance: float, settings: Settings) -> None:
    """Print how many triangles the way by hand takes for the error of Imprint's low mesh, by the secant in logarithms."""
    most = sum(len(polygon.vertices) - 2 for polygon in high.data.polygons)
    tried = [(first.triangles, first.errors["mean"])]
    while len(tried) <= TRIES and abs(tried[-1][1] / ours.errors["mean"] - 1.0) > EQUAL:
        slope = -1.0
        if len(tried) > 1:
            (before, error), (last, now) = tried[-2:]
            slope = min(math.log(now / error) / math.log(last / before), -0.2)
        count, error = tried[-1]
        count = round(min(max(count * (ours.errors["mean"] / error) ** (1.0 / slope), count / 2, 100), 3 * count, most))
        if count == tried[-1][0]:
            break
        ((_, made),) = by_hand(high, count, settings, [distance])
        tried.append((made.triangles, made.errors["mean"]))
    count, error = tried[-1]
    print(
        f"  By hand, {count:,} triangles have {error:.3f}: Imprint takes {ours.triangles / count:.2f} of them",
        flush=True,
    )


def by_hand(
    high: bpy.types.Object, triangles: int, settings: Settings, distances: Sequence[float] = DISTANCES
) -> list[tuple[float, Made]]:
    """By Blender alone, with each of the distances."""
    return by_cycles(decimated, high, triangles, settings, distances)


def by_cycles(
    make: Callable[[bpy.types.Object, int, int], bpy.types.Object],
    high: bpy.types.Object,
    triangles: int,
    settings: Settings,
    distances: Sequence[float] = DISTANCES,
) -> list[tuple[float, Made]]:
    """Baked by Cycles, with each of the distances. make: takes the high object, the triangles, and the side of the map."""
    start = time.process_time()
    low = make(high, triangles, settings.sampling.width)
    image = target(low, settings.sampling.width)
    diagonal = float(np.linalg.norm(np.array(high.dimensions)))
    before, made = time.process_time() - start, []
    for distance in distances:
        start = time.process_time()
        bake(low, high, distance * diagonal)
        seconds = before + time.process_time() - start
        errors = measured(low, high, image, settings)
        made.append((distance, Made(f"{low.data.name}, {distance:.1%}", len(low.data.polygons), errors, seconds)))
    bpy.data.meshes.remove(low.data)
    return made


def rival_low(high: bpy.types.Object, triangles: int, size: int) -> bpy.types.Object:
    """As `decimated`, by meshoptimizer, whose error has no limit, and xatlas, with the same margin."""
    import meshoptimizer
    import xatlas

    data = high.data.copy()
    data.transform(high.matrix_world)
    data.calc_loop_triangles()
    corners = mesh_reader.corner_vertices(data)[mesh_reader.triangles(data)]
    points, corners = weld(mesh_reader.points(data), corners)
    corners = np.ascontiguousarray(corners.reshape(-1), np.uint32)
    left = np.zeros_like(corners)
    count = meshoptimizer.simplify(left, corners, points, target_index_count=3 * triangles, target_error=1e9)
    used, numbers = np.unique(left[:count], return_inverse=True)
    atlas, pack = xatlas.Atlas(), xatlas.PackOptions()
    atlas.add_mesh(points[used], numbers.reshape(-1, 3).astype(np.uint32))
    pack.resolution, pack.padding = size, round(MARGIN * size)
    atlas.generate(xatlas.ChartOptions(), pack)
    vertices, faces, uv = atlas[0]
    made = bpy.data.meshes.new("rivals")
    made.from_pydata(points[used], [], vertices[faces])
    scale = np.array([atlas.width, atlas.height]) / max(atlas.width, atlas.height)
    made.uv_layers.new().uv.foreach_set("vector", (uv * scale)[faces].astype(np.float32).reshape(-1))
    made.shade_smooth()
    low = bpy.data.objects.new("rivals", made)
    bpy.context.scene.collection.objects.link(low)
    return low


def decimated(high: bpy.types.Object, triangles: int, _size: int = 0) -> bpy.types.Object:
    """A coarse copy with new UVs, in the place of the high object, without its scale and rotation."""
    low = bpy.data.objects.new("by hand", high.data.copy())
    low.data.name = low.name
    bpy.context.scene.collection.objects.link(low)
    low.data.transform(high.matrix_world)
    low.data.materials.clear()
    for layer in list(low.data.uv_layers):
        low.data.uv_layers.remove(layer)
    low.data.calc_loop_triangles()
    modifier = low.modifiers.new("Decimate", "DECIMATE")
    modifier.ratio, modifier.use_collapse_triangulate = triangles / len(low.data.loop_triangles), True
    only(low)
    bpy.ops.object.modifier_apply(modifier=modifier.name)
    bpy.ops.object.shade_smooth()
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(angle_limit=ANGLE, island_margin=MARGIN)
    bpy.ops.object.mode_set(mode="OBJECT")
    return low


def only(active: bpy.types.Object, *others: bpy.types.Object) -> None:
    """Select these objects alone."""
    for obj in bpy.context.view_layer.objects:
        obj.hide_set(False)
        obj.select_set(obj is active or obj in others)
    bpy.context.view_layer.objects.active = active


def target(low: bpy.types.Object, size: int) -> bpy.types.Image:
    """An image in the active node of a new material, to which Cycles bakes."""
    image = bpy.data.images.new("by hand", size, size, alpha=False, float_buffer=True, is_data=True)
    material = bpy.data.materials.new("by hand")
    low.data.materials.append(material)
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    material.node_tree.nodes.active = node
    return image


def bake(low: bpy.types.Object, high: bpy.types.Object, distance: float) -> None:
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", CYCLES_SAMPLES
    scene.cycles.use_denoising = False
    only(low, high)
    bpy.ops.object.bake(
        type="NORMAL",
        normal_space="OBJECT",
        margin=16,
        use_selected_to_active=True,
        cage_extrusion=distance,
        max_ray_distance=2.0 * distance,
    )


def measured(low: bpy.types.Object, high: bpy.types.Object, image: bpy.types.Image, settings: Settings) -> dict:
    """The shading error of a low object with its map."""
    size = settings.sampling.width
    texels = np.empty(size * size * 4, np.float32)
    image.pixels.foreach_get(texels)
    shown = ShownMap({udim.FIRST: texels.reshape(size, size, 4)}, normal_space.reading(settings.map))
    meshes = reading.read(bpy.context, low, [high], None, settings)
    return finish(appearance.measure(meshes.highs, meshes.basis or meshes.low, shown)).to_dict()


if __name__ == "__main__":
    main()
