# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures what signs cost: a redraw, an edit, and the slices of looks.

    .venv/bin/python scripts/bench/signs.py [--parts N] [--segments N] [--occluders OWN|ALL]

Parts are pairs by name of spheres, in one set, that count as baked as they are. With 500 parts of few triangles it measures the
redraw and the edit, with 100 of 320 segments, which are 10 million triangles, the slices. It ends with 1 if a median is over
its limit.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402

import addon  # noqa: E402
from addon.core import progress  # noqa: E402
from addon.jobs import part_state  # noqa: E402
from addon.ui import looks as of_looks  # noqa: E402
from addon.ui import sets, signs  # noqa: E402
from addon.ui.signs import looks  # noqa: E402

LIMITS = {"redraw": 5.0, "edit": 1.0}
"""Milliseconds."""
ROUNDS = 21
ROWS = 12
"""Parts that a list shows at once."""


def prepare(parts: int, segments: int) -> sets.ImprintSet:
    """A set of pairs."""
    bpy.ops.wm.read_homefile(use_empty=True)
    meshes = bpy.data.meshes
    for name, count in (("low", 12), ("high", segments)):
        bpy.ops.mesh.primitive_uv_sphere_add(segments=count, ring_count=max(3, count // 2))
        bpy.context.object.data.name = name
        bpy.data.objects.remove(bpy.context.object)
    for number in range(parts):
        for name in ("low", "high"):
            obj = bpy.data.objects.new(f"part{number:03}_{name}", meshes[name].copy())
            obj.location.x = 3.0 * number
            bpy.context.scene.collection.objects.link(obj)
    one = bpy.context.scene.imprint_sets.add()
    one.name, one.source = "Set", "NAMES"
    bpy.context.scene.imprint.bakes = "SETS"
    bpy.context.view_layer.update()
    return one


def keep_as_baked(one: sets.ImprintSet) -> None:
    """Keep the present state of each part as that of its last bake."""
    every = list(sets.jobs(bpy.context, one))
    jobs, known = tuple(job for _, job, _ in every), {}
    for low, job, _ in every:
        state = progress.finish(part_state.look(bpy.context, job, one.settings, jobs=jobs, known=known))
        low.imprint.result = "[]"
        part_state.keep(low, [state])


def draw(one: sets.ImprintSet, lows: list[bpy.types.Object]) -> None:
    """What the panel asks for."""
    signs.of_set(bpy.context, one)
    signs.waiting(bpy.context)
    for low in lows[:ROWS]:
        signs.of(bpy.context, low)


def timed(work: Callable[[], object], clock: Callable[[], float] = time.thread_time) -> float:
    """Milliseconds, of this thread by default: what other programs do does not count."""
    start = clock()
    work()
    return 1e3 * (clock() - start)


def median(work: Callable[[], object]) -> float:
    return statistics.median(timed(work) for _ in range(ROUNDS))


def handled(edit: Callable[[int], object]) -> float:
    """The median of the handler's milliseconds after an edit."""
    spent, whole = [], looks.note_update

    def note(*arguments) -> None:
        spent[-1] += timed(lambda: whole(*arguments))

    heard = of_looks.events._heard["depsgraph_update_post"]
    place = heard.index(whole)
    heard[place] = note
    for number in range(ROUNDS):
        spent.append(0.0)
        edit(number)
        bpy.context.view_layer.update()
    heard[place] = whole
    return statistics.median(spent)


def look_at_all(one: sets.ImprintSet, lows: list[bpy.types.Object]) -> list[float]:
    """The milliseconds of each step until all parts are looked at."""
    looks.mark_all()
    for low in lows:
        signs.of(bpy.context, low)
    steps = []
    while signs.waiting(bpy.context):
        steps.append(timed(lambda: looks._step(bpy.context), time.perf_counter))
    return steps


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", type=int, default=500)
    parser.add_argument("--segments", type=int, default=24)
    parser.add_argument("--occluders", default="OWN")
    arguments = parser.parse_args()
    addon.register()
    one = prepare(arguments.parts, arguments.segments)
    bpy.context.scene.imprint.occluders = arguments.occluders
    keep_as_baked(one)
    lows = sets.lows(bpy.context, one)
    triangles = sum(len(polygon.vertices) - 2 for polygon in bpy.data.objects["part000_high"].data.polygons)
    print(f"{len(lows)} parts of {triangles:,} triangles, occluders {arguments.occluders}")
    for title in ("first looks", "again"):
        steps = look_at_all(one, lows)
        longest = ", ".join(f"{step:.1f}" for step in sorted(steps)[-3:])
        print(
            f"{title:24} {sum(steps):8.0f} ms in {len(steps)} steps: median {statistics.median(steps):.2f}, longest {longest}"
        )
    print(signs.of_set(bpy.context, one).text)
    high = bpy.data.objects["part000_high"]
    found = {"redraw": median(lambda: draw(one, lows))}
    found["edit"] = handled(lambda number: setattr(high.data.vertices[0], "co", (0.0, 0.0, 1.0 + number / 100.0)))
    found["redraw after a change"] = median(lambda: (looks.note_bake(0), draw(one, lows)))
    found["click"] = handled(lambda number: high.select_set(number % 2 == 0))
    found["new object"] = handled(
        lambda number: bpy.context.scene.collection.objects.link(bpy.data.objects.new(f"new{number}", None))
    )
    found["all objects move"] = handled(lambda number: [setattr(low, "location", (0.0, 0.0, number)) for low in lows])
    for name, value in found.items():
        print(f"{name:24} {value:8.3f} ms")
    return int(any(found[name] > limit for name, limit in LIMITS.items()))


if __name__ == "__main__":
    sys.exit(main())
