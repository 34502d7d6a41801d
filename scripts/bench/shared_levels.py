# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares levels of detail of game assets that share the textures of the low mesh with levels that have their own.

.venv/bin/python scripts/bench/shared_levels.py FILE.blend ... [--high NAME] [--triangles 3000] [--levels 3] [--size 1024]
"""

import argparse
import sys
import time
from pathlib import Path

import bpy
import gpu

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.core.asset_limits import Wanted  # noqa: E402
from addon.core.naming import Suffixes  # noqa: E402
from addon.core.progress import Pace, finish  # noqa: E402
from addon.core.report import Report  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.jobs import asset  # noqa: E402
from addon.jobs.job import Job  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("files", nargs="+", metavar="FILE.blend")
    parser.add_argument("--high", default="hi", metavar="NAME")
    parser.add_argument("--triangles", type=int, default=3000, metavar="N")
    parser.add_argument("--levels", type=int, default=3, metavar="N")
    parser.add_argument("--size", type=int, default=1024, metavar="TEXELS")
    parser.add_argument("--space", default="TANGENT", choices=["TANGENT", "OBJECT"])
    parser.add_argument("--save", metavar="FILE.blend", help="keep the last file, with shared textures")
    options = parser.parse_args()
    gpu.init()
    for file in options.files:
        print(f"{Path(file).stem}, {options.size} x {options.size}, {options.space.lower()} space")
        own, shared = (_made(file, options, owns_textures=owns) for owns in (True, False))
        for number, (one, other) in enumerate(zip(own, shared, strict=True)):
            errors = [report.appearance["mean"] for report in (one, other)]
            silhouettes = [report.appearance["silhouette"] for report in (one, other)]
            counts = [report.triangles["low"] for report in (one, other)]
            print(
                f"  LOD{number}: own {counts[0]:6,} triangles {errors[0]:6.3f} degrees {silhouettes[0]:6.2%} outline; "
                f"shared {counts[1]:6,} {errors[1]:6.3f} {silhouettes[1]:6.2%}; {errors[1] / errors[0]:.2f} of own",
                flush=True,
            )
        if options.save:
            bpy.ops.file.pack_all()
            bpy.ops.wm.save_as_mainfile(filepath=str(Path(options.save).resolve()))


def _made(file: str, options: argparse.Namespace, *, owns_textures: bool) -> list[Report]:
    bpy.ops.wm.open_mainfile(filepath=file)
    high = bpy.data.objects[options.high]
    for obj in [obj for obj in bpy.data.objects if obj is not high]:
        bpy.data.objects.remove(obj)
    size = options.size
    settings = Settings(width=size, height=size, samples=4, storage="MEMORY", space=options.space)
    wanted = Wanted(triangles=options.triangles, levels=options.levels, owns_textures=owns_textures)
    start = time.process_time()
    reports = finish(asset.work(bpy.context, Job(high, [high]), wanted, settings, Pace(), suffixes=Suffixes()))
    stages = ", ".join(f"{stage} {seconds:.1f}" for stage, seconds in reports[0].asset["seconds"].items())
    print(
        f"  {time.process_time() - start:.1f} s of processor time; {stages}; {reports[0].asset['unwrapped']}",
        flush=True,
    )
    return reports


if __name__ == "__main__":
    main()
