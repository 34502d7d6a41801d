# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures how long the views of stored maps take until their pixels can be read back.

    .venv/bin/python scripts/bench/views.py [--size TEXELS] [--depth 8|16] [--rounds N] [--file PAIR.blend]

A file holds two objects that share UVs, "hi" and "lo"; without one, two terrains. Two pairs beside each other are baked once.
The first views of a map are apart from the later ones, and so is the view with all texels, which follows in a pause. CPU is the
time of this process on all cores, which counts on a machine that does other work, too. It ends with 1 if a median is over its
limit or if a view has baked.
"""

import argparse
import os
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402
import gpu  # noqa: E402
import numpy as np  # noqa: E402

import addon  # noqa: E402
from addon.jobs import live_session  # noqa: E402
from addon.passes import target  # noqa: E402
from addon.ui import stored_maps  # noqa: E402
from addon.ui.views import viewer  # noqa: E402
from tests.support import zoo  # noqa: E402

VIEWPORT = 1500, 950
"""Pixels of a viewport in a window of 1920 x 1080."""
BAKED = 64
"""Texels of the bake. Its images are scaled up: for a view, only the size of an image counts."""
LIMITS = {"view of a map": 50.0, "flicker": 50.0, "switch of object": 100.0}
"""Milliseconds."""


def prepare(file: Path | None, size: int, depth: str) -> list[bpy.types.Object]:
    """Two baked pairs beside each other; returns the low objects."""
    lows = []
    for number, name in enumerate(("crate", "barrel")):
        if file is None:
            low, high = zoo.terrain("low", n=64), zoo.terrain("high", n=300, height=0.15)
        else:
            with bpy.data.libraries.load(str(file)) as (_, into):
                into.objects = ["lo", "hi"]
            low, high = into.objects
            for obj in (low, high):
                bpy.context.scene.collection.objects.link(obj)
        low.name, high.name = f"{name}_low", f"{name}_high"
        offset = 1.1 * max(low.dimensions.x, high.dimensions.x) * number
        for obj in (low, high):
            obj.location.x += offset
        lows.append(low)
    settings = bpy.context.scene.imprint
    settings.width = settings.height = BAKED
    settings.samples, settings.maps, settings.depth, settings.method = "1", {"POSITION"}, depth, "FLATTEN"
    settings.show_result = False
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    for image in (image for low in lows for shown in stored_maps.maps_of(low).values() for image in [shown[0].image]):
        image.scale(size, size)
    return lows


def drawn() -> np.ndarray:
    """The pixels that the draw callbacks draw, read back: (height, width, 4) float32."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region), target.drawing(screen()):
        screen().framebuffer.clear(depth=1.0)
        viewer.draw()
        pixels = np.empty((*VIEWPORT[::-1], 4), np.float32)
        screen().read(pixels)
    return pixels


def screen() -> target.Target:
    """What stands for the viewport."""
    if not hasattr(screen, "made"):
        screen.made = target.Target(*VIEWPORT, ("RGBA32F", "DEPTH_COMPONENT32F"))
    return screen.made


def timed(action: Callable[[], object]) -> tuple[float, float]:
    """Milliseconds, by the clock and by the CPU, until the pixels after `action` are read back."""
    start, used = time.perf_counter(), sum(os.times()[:2])
    action()
    drawn()
    return 1000 * (time.perf_counter() - start), 1000 * (sum(os.times()[:2]) - used)


def show(name: str) -> None:
    assert bpy.ops.imprint.view_map(map=name) == {"FINISHED"}


def activate(low: bpy.types.Object) -> None:
    """Make an object the active one, and let the view notice it, as after a click in the Outliner."""
    bpy.context.view_layer.objects.active = low
    drawn()
    viewer.catch_up()


def measure(lows: list[bpy.types.Object], rounds: int) -> dict[str, list[tuple[float, float]]]:
    """The times of each kind of step, the first ones apart."""
    maps = "NORMAL", "POSITION"
    activate(lows[0])
    found = {
        "first view of a map": [timed(lambda: show(maps[0]))],
        "first view of positions": [timed(lambda: show(maps[1]))],
        "all texels, in a pause": [timed(viewer.sharpen)],
        "view of a map": [timed(lambda n=n: show(maps[n % 2])) for n in range(rounds)],
        "first flicker": [timed(bpy.ops.imprint.view_flicker)],
        "flicker": [timed(bpy.ops.imprint.view_flicker) for _ in range(rounds)],
    }
    show("POSITION")
    viewer.sharpen()
    found["first switch of object"] = [timed(lambda: activate(lows[1]))]
    found["switch of object"] = [timed(lambda n=n: activate(lows[n % 2])) for n in range(rounds)]
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=4096, metavar="TEXELS")
    parser.add_argument("--depth", choices=("8", "16"), default="16")
    parser.add_argument("--rounds", type=int, default=11, metavar="N")
    parser.add_argument("--file", type=Path, metavar="PAIR.blend")
    given = parser.parse_args()
    gpu.init()
    bpy.ops.wm.read_homefile(use_empty=False, use_factory_startup=True)
    bpy.data.batch_remove(bpy.data.objects[:])
    addon.register()
    try:
        lows = prepare(given.file, given.size, given.depth)
        data = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D").spaces[0]
        data.region_3d.view_perspective, data.region_3d.view_distance = "PERSP", 6.0
        data.region_3d.update()
        live_session.Session.work = None  # any bake would fail
        found = measure(lows, given.rounds)
    finally:
        vars(screen).clear()
        viewer.off()
        addon.unregister()
    is_slow = False
    for name, times in found.items():
        clock, cpu = (statistics.median(column) for column in zip(*times, strict=True))
        limit = LIMITS.get(name)
        is_slow |= limit is not None and clock > limit
        ends = f", at most {limit:.0f}" if limit else ""
        print(f"{name:24} {clock:8.1f} ms, CPU {cpu:8.1f} ms, median of {len(times)}{ends}", flush=True)
    return int(is_slow)


if __name__ == "__main__":
    sys.exit(main())
