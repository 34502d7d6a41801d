# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures what Make Game Asset takes: seconds of the processor by stage, the longest time without an event, and memory.

.venv/bin/python scripts/bench/asset_seconds.py [FILE.blend] [--high NAME] [--of 400000] [--triangles 5000] [--levels 3]
    [--size 2048] [--follow] [--profile FILE]

Without a file, the high mesh is a lumpy ball of about as many triangles as --of says, with noise at several scales; --smooth
leaves the noise out. With a file, its high object is divided until it has so many; --of 0 leaves it as it is.
"""

import argparse
import cProfile
import resource
import sys
import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import bpy
import gpu
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.core import progress  # noqa: E402
from addon.core.asset_limits import Wanted  # noqa: E402
from addon.core.naming import Suffixes  # noqa: E402
from addon.core.progress import Pace, Progress, finish  # noqa: E402
from addon.core.report import Report  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.jobs import asset  # noqa: E402
from addon.jobs.job import Job  # noqa: E402
from addon.scene import mesh_reader, mesh_writer  # noqa: E402
from scripts.bench import made_highs  # noqa: E402

LONG = 2.0
"""Seconds of the processor without an event from which they are listed."""
OCTAVES = 4
"""Of the lumps."""
NOISE = 0.1
"""As a share of the height of a triangle."""
AT_ONCE = 2**16
"""Points of the ball that are moved at once."""


class Gaps:
    """The seconds between events, by what the event before them said.

    are_shown: whether each event is printed that says something else than the one before it.
    """

    def __init__(self, *, are_shown: bool) -> None:
        self._are_shown = are_shown
        self._last, self._what = (time.process_time(), time.perf_counter()), "starting"
        self.longest: Counter = Counter()
        """By event, the most seconds of the processor after it."""
        self.of_clock = 0.0
        """The most seconds of the clock on the wall after any."""

    def note(self, step: Progress) -> None:
        """Note that an event came."""
        now = time.process_time(), time.perf_counter()
        self.longest[self._what] = max(self.longest[self._what], now[0] - self._last[0])
        self.of_clock = max(self.of_clock, now[1] - self._last[1])
        if self._are_shown and self._what != step.what:
            print(f"  {now[0]:8.1f} s {100.0 * step.done:5.1f} % {step.what}", flush=True)
        self._last, self._what = now, step.what


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("file", nargs="?", metavar="FILE.blend")
    parser.add_argument("--high", default="hi", metavar="NAME")
    parser.add_argument("--of", type=int, default=400_000, metavar="N", help="triangles of the high mesh")
    parser.add_argument("--smooth", action="store_true", help="without noise")
    parser.add_argument("--triangles", type=int, default=5000, metavar="N", help="triangles of the low mesh")
    parser.add_argument("--levels", type=int, default=0, metavar="N")
    parser.add_argument("--size", type=int, default=2048, metavar="TEXELS")
    parser.add_argument("--follow", action="store_true", help="print events, and the seconds so far")
    parser.add_argument("--profile", metavar="FILE", help="write what cProfile finds")
    options = parser.parse_args()
    gpu.init()
    high = of_file(options) if options.file else lumpy_ball(options.of, is_smooth=options.smooth)
    print(f"{mesh_reader.count_triangles(high.data):,} triangles; {gigabytes():.1f} GB before", flush=True)
    profile, gaps = cProfile.Profile(time.process_time), Gaps(are_shown=options.follow)
    # Stages by seconds of the processor: what else a machine does is none of an asset's.
    progress.time = SimpleNamespace(**vars(time) | {"perf_counter": time.process_time})
    if options.profile:
        profile.enable()
    start = time.process_time()
    reports = made(high, options, gaps)
    seconds = time.process_time() - start
    profile.disable()
    if options.profile:
        profile.dump_stats(options.profile)
    for stage, each in reports[0].asset["seconds"].items():
        if stage != "total":
            print(f"  {stage:10} {each:7.1f} s")
    for name in ("mean", "percentile_99", "silhouette"):
        print(f"  {name:14}", *(f"{report.appearance[name]:9.5f}" for report in reports))
    print("  triangles     ", *(f"{report.triangles['low']:9,}" for report in reports))
    for what, each in gaps.longest.most_common():
        if each > LONG or each == max(gaps.longest.values()):
            print(f"  {each:5.1f} s without an event after {what!r}")
    print(f"  at most {gaps.of_clock:.1f} s by the clock on the wall without an event")
    print(f"  {seconds:.1f} s of the processor, at most {gigabytes():.1f} GB", flush=True)


def made(high: bpy.types.Object, options: argparse.Namespace, gaps: Gaps) -> list[Report]:
    settings = Settings(width=options.size, height=options.size, samples=4, storage="MEMORY")
    wanted = Wanted(triangles=options.triangles, levels=options.levels)
    pace = Pace(progress.LONGEST, has_picture=False)  # as the button has it
    work = asset.work(bpy.context, Job(high, [high]), wanted, settings, pace, suffixes=Suffixes())
    return finish(work, gaps.note)


def of_file(options: argparse.Namespace) -> bpy.types.Object:
    """The high object of a file, divided until it has enough triangles."""
    bpy.ops.wm.open_mainfile(filepath=options.file)
    high = bpy.data.objects[options.high]
    for obj in [obj for obj in bpy.data.objects if obj is not high]:
        bpy.data.objects.remove(obj)
    while mesh_reader.count_triangles(high.data) < options.of:
        divided = high.modifiers.new("divided", "SUBSURF")
        divided.levels, divided.subdivision_type = 1, "SIMPLE"
        with bpy.context.temp_override(object=high):
            bpy.ops.object.modifier_apply(modifier=divided.name)
    return high


def lumpy_ball(triangles: int, *, is_smooth: bool) -> bpy.types.Object:
    """A closed lumpy sphere of about 4 * rings ** 2 triangles, in a scene of its own."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    rings = round((triangles / 4.0) ** 0.5)
    down, around = np.arange(1, rings) * np.pi / rings, np.arange(2 * rings) * np.pi / rings
    belt = np.empty((rings - 1, 2 * rings, 3), np.float32)
    belt[..., 0], belt[..., 1] = np.outer(np.sin(down), np.cos(around)), np.outer(np.sin(down), np.sin(around))
    belt[..., 2] = np.cos(down)[:, None]
    points = np.concatenate([belt.reshape(-1, 3), np.array([(0, 0, 1), (0, 0, -1)], np.float32)])
    noise = np.random.default_rng(made_highs.SEED)
    for first in range(0, len(points), AT_ONCE):
        block = points[first : first + AT_ONCE]
        heights = made_highs.lumpy(block.astype(np.float64), np.random.default_rng(made_highs.SEED), OCTAVES)
        heights += 0.0 if is_smooth else noise.normal(0.0, NOISE * np.pi / rings, len(block))
        block *= (1.0 + heights[:, None]).astype(np.float32)
    number = np.arange(2 * rings, dtype=np.int32)
    following, row = np.roll(number, -1), 2 * rings * np.arange(rings - 2, dtype=np.int32)[:, None]
    a, b = (row + each for each in (number, following))
    last, poles = 2 * rings * (rings - 2), np.full((2, 2 * rings), len(points) - 1, np.int32)
    poles[0] -= 1
    parts = (a, a + 2 * rings, b), (b, a + 2 * rings, b + 2 * rings)
    parts += (poles[0], number, following), (poles[1], last + following, last + number)
    faces = np.concatenate([np.stack([each.reshape(-1) for each in part], axis=1) for part in parts])
    data = bpy.data.meshes.new("hi")
    mesh_writer.fill(data, points, faces)
    data.update(calc_edges=True)
    data.shade_smooth()
    high = bpy.data.objects.new("hi", data)
    bpy.context.scene.collection.objects.link(high)
    return high


def gigabytes() -> float:
    """The most memory that this process had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e9


if __name__ == "__main__":
    main()
