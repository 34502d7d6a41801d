# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes six maps of real pairs from one press, and compares their time with that of their rays alone.

.venv/bin/python scripts/bench/map_costs.py [PAIR ...] [--size 1024] [--rays 128] [--method cast]

The rays alone: the time in which the normal map is drawn, and the time that ambient occlusion, curvature and thickness each
add to drawing when they are baked one at a time. Needs the real meshes of ../shared/assets.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402
import gpu  # noqa: E402
import numpy as np  # noqa: E402

from addon.core.settings import Settings  # noqa: E402
from addon.jobs import bake_pair  # noqa: E402

PAIRS = ("king_40480_4000", "helmet_23358_6117", "kepler_199712_9079")
WITH_RAYS = ("AO", "THICKNESS", "CURVATURE")
SIX = ("POSITION", *WITH_RAYS, "BASE_COLOR")
"""Beside the normal map."""
RUNS = 3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("pairs", nargs="*", default=PAIRS, metavar="PAIR")
    parser.add_argument("--size", type=int, default=1024, metavar="TEXELS")
    parser.add_argument("--rays", type=int, default=128)
    parser.add_argument("--method", default="cast", choices=["cast", "flatten"])
    options = parser.parse_args()
    gpu.init()
    settings = Settings(
        method=options.method.upper(),
        width=options.size,
        height=options.size,
        rays=options.rays,
        storage="MEMORY",
        material=False,
        depth=8,
    )
    print(f"| pair | {' | '.join(name.lower() for name in WITH_RAYS)} | rays alone | six maps | ratio |")
    print("| --- " * (len(WITH_RAYS) + 4) + "|")
    for name in options.pairs:
        bpy.ops.wm.open_mainfile(filepath=str(ROOT.parent / "shared" / "assets" / "pairs" / f"{name}.blend"))
        paint(bpy.data.objects["hi"])
        total(settings, ())  # shaders are compiled, and the tree is built
        rays = drawn = draws(settings, ())
        added = [draws(settings, (one,)) - drawn for one in WITH_RAYS]
        rays += sum(added)
        six = total(settings, SIX)
        print(f"| {name} | {' | '.join(f'{x:.2f}' for x in added)} | {rays:.2f} | {six:.2f} | {six / rays:.2f} |")


def paint(high: bpy.types.Object) -> None:
    """Give the mesh a material with an image of noise."""
    image = bpy.data.images.new("noise", 1024, 1024)
    image.pixels.foreach_set(np.random.default_rng(0).random(4 * 1024 * 1024, np.float32))
    material = bpy.data.materials.new("noise")
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    material.node_tree.links.new(
        node.outputs["Color"], material.node_tree.nodes["Principled BSDF"].inputs["Base Color"]
    )
    high.data.materials.clear()
    high.data.materials.append(material)


def draws(settings: Settings, maps: tuple[str, ...]) -> float:
    """Seconds of drawing in the fastest of some bakes."""
    return min(report(settings, maps).seconds["draw"] for _ in range(RUNS))


def total(settings: Settings, maps: tuple[str, ...]) -> float:
    """Seconds of the fastest of some bakes, from reading the meshes to the images."""
    found = []
    for _ in range(RUNS):
        start = time.perf_counter()
        report(settings, maps)
        found.append(time.perf_counter() - start)
    return min(found)


def report(settings: Settings, maps: tuple[str, ...]):
    return bake_pair(
        bpy.context, bpy.data.objects["lo"], [bpy.data.objects["hi"]], replace(settings, maps=maps, image="map")
    )


if __name__ == "__main__":
    main()
