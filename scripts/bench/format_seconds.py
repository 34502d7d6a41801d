#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures what files of blocks with mip levels take beside PNG files: seconds of the processor, within the GPU's calls and
outside.

    .venv/bin/python scripts/bench/format_seconds.py [PAIR.blend] [--size 2048]

The normal map of the objects "hi" and "lo" is baked into memory, and into files of each format; what memory takes is taken off.
Without a GPU, the driver's own work on the processor stands for that of a GPU: it is in the calls of Blender's `gpu` module,
which cProfile tells from all others.
"""

import argparse
import cProfile
import pstats
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402
import gpu  # noqa: E402

import addon  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.jobs import bake_pair  # noqa: E402

PAIR = ROOT.parent / "shared" / "assets" / "pairs" / "king_40480_4000.blend"
RUNS = 3
"""Of each format: the fastest counts."""
IN_MEMORY = "memory"
FILES = {
    IN_MEMORY: {"storage": "MEMORY"},
    "PNG, 8 bits": {"output": "map.png", "depth": 8},
    "PNG, 8 bits, with mip files": {"output": "map.png", "depth": 8, "mip_files": True},
    "BC5 with mip levels": {"output": "map.dds", "depth": 8},
    "BC7 with mip levels": {"output": "map.dds", "depth": 8, "compression": "BC7"},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("pair", nargs="?", default=str(PAIR), metavar="PAIR.blend")
    parser.add_argument("--size", type=int, default=2048, metavar="TEXELS")
    options = parser.parse_args()
    bpy.ops.wm.open_mainfile(filepath=options.pair)
    gpu.init()
    addon.register()
    low, high = bpy.data.objects["lo"], bpy.data.objects["hi"]
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, how in FILES.items():
            where = {"storage": "FILE", "output": str(Path(folder, how["output"]))} if "output" in how else {}
            settings = Settings(width=options.size, height=options.size, **(how | where))
            found[name] = min(seconds(low, high, settings) for _ in range(RUNS))
    before = found[IN_MEMORY]
    print(f"{'':30} outside  within the GPU's calls, seconds of the processor at {options.size}")
    for name, each in found.items():
        outside, within = (a - b * (name != IN_MEMORY) for a, b in zip(each, before, strict=True))
        print(f"{name:30} {outside:7.2f} {within:7.2f}", flush=True)


def seconds(low: bpy.types.Object, high: bpy.types.Object, settings: Settings) -> tuple[float, float]:
    """Outside the GPU's calls, and within."""
    profile, start = cProfile.Profile(time.process_time), time.process_time()
    profile.runcall(bake_pair, bpy.context, low, [high], settings)
    whole = time.process_time() - start
    calls = pstats.Stats(profile).stats.items()
    within = sum(each[2] for (_, _, name), each in calls if "GPU" in name or "gpu." in name)
    return whole - within, within


if __name__ == "__main__":
    main()
