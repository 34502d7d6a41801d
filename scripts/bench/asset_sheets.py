# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws what a lead artist looks at of game assets: renders beside the high mesh, wireframes, UV layouts, maps, levels.

.venv/bin/python scripts/bench/asset_sheets.py FOLDER FILE.blend [...] [--high hi] [--triangles 3000] [--size 1024] [--levels 2]

Makes an asset of the high object of each file. For each, FOLDER gets NAME.png: in the upper row the high mesh and each level
by Cycles with its maps; below them the wireframes, the UV layout (a color for each island) and the normal map.
"""

import argparse
import sys
from pathlib import Path

import bpy
import gpu
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.core.asset_limits import Wanted  # noqa: E402
from addon.core.naming import Suffixes  # noqa: E402
from addon.core.progress import Pace, finish  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.jobs import asset  # noqa: E402
from addon.jobs.job import Job  # noqa: E402
from addon.mesh import uv_islands  # noqa: E402
from scripts.bench import hard_surfaces, unwrap_shapes  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE.blend")
    parser.add_argument("--high", default="hi", metavar="NAME")
    parser.add_argument("--triangles", type=int, default=3000, metavar="N")
    parser.add_argument("--size", type=int, default=1024, metavar="TEXELS")
    parser.add_argument("--levels", type=int, default=2, metavar="N")
    options = parser.parse_args()
    gpu.init()
    options.folder.mkdir(parents=True, exist_ok=True)
    for file in options.files:
        bpy.ops.wm.open_mainfile(filepath=str(file))
        high = bpy.data.objects[options.high]
        for obj in [obj for obj in bpy.data.objects if obj is not high]:
            bpy.data.objects.remove(obj)
        high.data.materials.clear()
        settings = Settings(width=options.size, height=options.size, samples=4, storage="MEMORY")
        wanted = Wanted(triangles=options.triangles, levels=options.levels)
        work = asset.work(bpy.context, Job(high, [high]), wanted, settings, Pace(), suffixes=Suffixes())
        reports = finish(work)
        lows = [bpy.data.objects[report.low] for report in reports]
        for report in reports:
            islands = int(uv_islands.islands(unwrap_shapes.read(bpy.data.objects[report.low])).max()) + 1
            print(f"{file.stem}: {report.low}, {report.triangles['low']:,} triangles, {islands} islands", flush=True)
            print(f"  {report.appearance}", flush=True)
        sheet(options.folder / f"{file.stem}.png", high, lows, options.folder)


def sheet(path: Path, high: bpy.types.Object, lows: list[bpy.types.Object], folder: Path) -> None:
    """Draw one asset. folder: for pictures in between."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    for obj in lows:
        obj.hide_set(False)
    upper, lower = [], []
    for number, low in enumerate(lows):
        name = f"{path.stem}_{number}"
        others = [each for each in lows if each is not low]
        for each in others:
            each.hide_render = True
        hard_surfaces.pictured(name, high, low, folder, ("CYCLES",))
        if not number:
            upper.append((f"{high.name}, Cycles", folder / f"{name}_cycles_high.png"))
        upper.append((f"{low.name}, Cycles", folder / f"{name}_cycles_low.png"))
        lower.append((low.name, folder / f"{name}_cycles_wires.png"))
    lower.append(("islands", folder / f"{path.stem}_layout.png"))
    unwrap_shapes.draw(lows[0], lower[-1][1], lows[0].name)
    image = next(each for each in bpy.data.images if "normal" in each.name)
    side = 800
    image.scale(side, side)
    texels = np.empty(side * side * 4, np.float32)
    image.pixels.foreach_get(texels)
    plt.imsave(folder / f"{path.stem}_map.png", np.clip(texels.reshape(side, side, 4)[::-1, :, :3], 0.0, 1.0))
    upper.append(("normal map", folder / f"{path.stem}_map.png"))
    figure, rows = plt.subplots(2, len(upper), figsize=(4.2 * len(upper), 8.6), dpi=80)
    for axes in rows.ravel():
        axes.axis("off")
    for axes, (title, file) in zip(rows.ravel(), [*upper, *lower], strict=False):
        axes.imshow(plt.imread(file))
        axes.set_title(title, fontsize=8)
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)


if __name__ == "__main__":
    main()
