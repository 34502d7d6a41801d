# SPDX-License-Identifier: GPL-3.0-or-later
"""Times Imprint against Blender's own bakers, in one process, as ratios of medians.

python3 scripts/imprint.py bench [--pairs DIR] [--large]

Every time is end to end: from the objects to pixels in an image (the image in the low object's material, where the baker
does that). The first bake of each kind warms up and is not counted.
"""

import argparse
import json
import os
import platform
import resource
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import addon  # noqa: E402
from addon.bake import casting, pipeline  # noqa: E402
from addon.bake.errors import BakeError  # noqa: E402
from addon.bake.settings import Settings  # noqa: E402

REPEATS = 5


def main() -> None:
    parser = argparse.ArgumentParser(prog="imprint.py bench", description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--pairs", type=Path, help="folder of .blend files with objects 'hi' and 'lo'")
    parser.add_argument("--large", action="store_true", help="ten million triangles at 8192 as well")
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "bench.json")
    options = parser.parse_args()
    rows = [large()] if options.large else []  # first: the peak memory of a process never falls
    rows.append(against_multires())
    if options.pairs is not None:
        rows += [row for path, size in sorted_pairs(options.pairs) for row in against_cycles(path, size)]
    import gpu

    result = {
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "renderer": gpu.platform.renderer_get(),
        "rows": rows,
    }
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    for row in rows:
        print(json.dumps(row))


def sorted_pairs(folder: Path) -> list[tuple[Path, int]]:
    """Terrains at 2048, all others at 1024."""
    return [
        (path, 2048 if path.name.startswith(("kepler", "sthelens")) else 1024)
        for path in sorted(folder.glob("*.blend"))
    ]


def against_multires() -> dict:
    """A grid of half a million triangles at 1024, against Blender's multires bake of as many."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    low, high = plane(1), plane(512)
    imprint, stages = bake_times(low, [high], 1024, method="FLATTEN")
    sculpt = plane(1)
    bpy.context.view_layer.objects.active = sculpt
    sculpt.select_set(True)
    sculpt.modifiers.new("Multires", "MULTIRES")
    for _ in range(9):
        bpy.ops.object.multires_subdivide(modifier="Multires", mode="SIMPLE")
    sculpt.modifiers["Multires"].levels = 0
    target_image(sculpt, 1024)
    bake = bpy.context.scene.render.bake
    bake.use_multires, bake.type, bake.margin = True, "NORMALS", 16
    bpy.context.scene.render.engine = "CYCLES"
    multires = times(bpy.ops.object.bake_image)
    return row("grid 524,288 triangles, 1024", imprint, stages, "multires", multires)


def against_cycles(path: Path, size: int) -> list[dict]:
    """A real pair by each method against Cycles' selected-to-active bake of it, one sample, scene kept warm."""
    bpy.ops.wm.open_mainfile(filepath=str(path))
    low, high = bpy.data.objects["lo"], bpy.data.objects["hi"]
    extrusion = max(low.dimensions) * 0.02
    distances = {"extrusion": extrusion, "max_distance": 2.0 * extrusion}
    ours = {}
    try:
        ours["flatten"] = bake_times(low, [high], size, method="FLATTEN")
    except BakeError as error:
        print(f"{path.stem}: {error}")
    ours["cast, tree rebuilt"] = bake_times(low, [high], size, method="CAST", keep=False, **distances)
    ours["cast, tree kept"] = bake_times(low, [high], size, method="CAST", **distances)
    ours["cast, distances measured"] = bake_times(low, [high], size, method="CAST")
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    target_image(low, size)
    for obj in bpy.data.objects:
        obj.select_set(obj in (low, high))
    bpy.context.view_layer.objects.active = low
    cycles = times(
        lambda: bpy.ops.object.bake(
            type="NORMAL",
            margin=16,
            use_selected_to_active=True,
            cage_extrusion=extrusion,
            max_ray_distance=2.0 * extrusion,
        )
    )
    return [row(f"{path.stem}, {size}, {how}", *timed, "cycles", cycles) for how, timed in ours.items()]


def large() -> dict:
    """Ten million triangles at 8192: does it fit, and in what."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    low, high = plane(1), plane(2237)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.perf_counter()
    report = pipeline.bake(
        bpy.context, low, [high], Settings(width=8192, height=8192, storage="MEMORY", depth=32, method="FLATTEN")
    )
    return {
        "case": "plane 10,008,338 triangles, 8192",
        "triangles": report.triangles["high"],
        "seconds": round(time.perf_counter() - start, 2),
        "peak GB": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20, 2),
        "peak GB before the bake": round(before / 2**20, 2),
    }


def bake_times(
    low: bpy.types.Object, highs: list[bpy.types.Object], size: int, *, keep: bool = True, **settings
) -> tuple[list[float], dict[str, float]]:
    """Seconds of each bake, and the medians of its stages. keep: whether the tree of one bake serves the next."""
    reports = []
    wanted = Settings(width=size, height=size, depth=32, storage="MEMORY", **settings)

    def bake() -> None:
        if not keep:
            casting.free()
        reports.append(pipeline.bake(bpy.context, low, highs, wanted))

    seconds = times(bake)
    stages = {name: statistics.median(r.seconds[name] for r in reports[1:]) for name in reports[0].seconds}
    return seconds, stages


def times(work: Callable[[], object]) -> list[float]:
    """Seconds of REPEATS runs after one to warm up."""
    result = []
    for _ in range(REPEATS + 1):
        start = time.perf_counter()
        work()
        result.append(time.perf_counter() - start)
    return result[1:]


def row(case: str, imprint: list[float], stages: dict[str, float], peer: str, peers: list[float]) -> dict:
    ours, theirs = statistics.median(imprint), statistics.median(peers)
    return {
        "case": case,
        "imprint": round(ours, 3),
        "range": [round(min(imprint), 3), round(max(imprint), 3)],
        peer: round(theirs, 3),
        f"{peer} range": [round(min(peers), 3), round(max(peers), 3)],
        "times faster": round(theirs / ours, 2),
        "stages": {name: round(seconds, 3) for name, seconds in stages.items()},
    }


def plane(n: int) -> bpy.types.Object:
    """The square -1..1 in n x n quads with waves on it, smooth, its UVs over 0..1."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=n, y_subdivisions=n)
    obj = bpy.context.object
    positions = np.empty(len(obj.data.vertices) * 3, np.float32)
    attribute = obj.data.attributes["position"].data
    attribute.foreach_get("vector", positions)
    if n > 1:
        x, y = positions[0::3], positions[1::3]
        positions[2::3] = 0.03 * np.sin(20 * x) * np.cos(17 * y)
        attribute.foreach_set("vector", positions)
    obj.data.shade_smooth()
    return obj


def target_image(obj: bpy.types.Object, size: int) -> None:
    """What Blender's bakers ask for: an image node, active, in the object's material."""
    if not obj.data.materials:
        obj.data.materials.append(bpy.data.materials.new("target"))
    tree = obj.data.materials[0].node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.new("target", size, size, float_buffer=True, is_data=True)
    tree.nodes.active = node
    node.select = True


if __name__ == "__main__":
    try:
        main()
    finally:
        addon.free()
