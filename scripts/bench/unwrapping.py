# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares UV maps: of Unwrap, and of Smart UV Project with its defaults, on low meshes made of high ones.

.venv/bin/python scripts/bench/unwrapping.py FILE.blend ... [--high NAME] [--triangles 3000] [--size 1024]

Low meshes are made by Decimate. Smart UV Project packs with the margin that Unwrap keeps for the same map: without one, texels
of islands side by side mix in mip levels. "as it comes" is without any.
"""

import argparse
import sys
import time
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.audit import mip_gaps  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.jobs import unwrapping  # noqa: E402
from addon.mesh import uv_islands, uv_stretch  # noqa: E402
from addon.scene import mesh_reader  # noqa: E402
from scripts.bench.asset_by_hand import ANGLE, decimated  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("files", nargs="+", metavar="FILE.blend")
    parser.add_argument("--high", default="hi", metavar="NAME")
    parser.add_argument("--triangles", type=int, default=3000, metavar="N")
    parser.add_argument("--size", type=int, default=1024, metavar="TEXELS")
    options = parser.parse_args()
    settings = Settings(width=options.size, height=options.size)
    print("| mesh | way | used | stretch, angle | stretch, area | islands | seconds |")
    print("|---|---|--:|--:|--:|--:|--:|")
    for file in options.files:
        bpy.ops.wm.open_mainfile(filepath=file)
        low = decimated(bpy.data.objects[options.high], options.triangles)
        name = Path(file).stem
        show(name, "Smart UV Project, as it comes", low, project(low, 0.0))
        margin = mip_gaps.needed(settings.sampling) / min(settings.sampling.size)
        show(name, "Smart UV Project, margin", low, project(low, margin))
        low.data.uv_layers.remove(low.data.uv_layers[0])
        start = time.perf_counter()
        way = unwrapping.unwrap(low, settings)
        show(name, f"Unwrap: {way.split(' by ')[1].split(',')[0]}", low, time.perf_counter() - start)


def project(low: bpy.types.Object, margin: float) -> float:
    """Smart UV Project with its defaults but the margin, on the active UV map. Returns the seconds."""
    start = time.perf_counter()
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(angle_limit=ANGLE, island_margin=margin, margin_method="FRACTION")
    bpy.ops.object.mode_set(mode="OBJECT")
    return time.perf_counter() - start


def show(name: str, way: str, low: bpy.types.Object, seconds: float) -> None:
    mesh = mesh_reader.surface(low.data, low.data.uv_layers.active.name, low.name, np.eye(4))
    found = uv_stretch.measure(mesh.positions[mesh.vertices[mesh.triangles]], mesh.uv[mesh.triangles])
    islands = int(uv_islands.islands(mesh).max(initial=-1)) + 1
    print(
        f"| {name} | {way} | {found.used:.0%} | {found.angle:.2f} | {found.area:.2f} | {islands:,} | {seconds:.1f} |",
        flush=True,
    )


if __name__ == "__main__":
    main()
