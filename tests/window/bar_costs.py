# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes with the progress bar in a real Blender window, and the same bakes from a script in it, and prints what the bar costs.
Not collected by pytest.

    blender --factory-startup --python tests/window/bar_costs.py

Arguments: a folder with PAIRS, as NAME_*.blend with the objects 'lo' and 'hi', instead of a generated terrain; the number of
rounds; and pairs and bakes to skip, as -kepler or -occlusion.
Each row has the bake, the seconds from the script and with the bar (medians), their ratio, the longest time between two
events of the window, and how often the viewport was drawn. Blender exits with 1 if the bar costs more than LIMIT.
"""

import math
import statistics
import sys
import time
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import addon  # noqa: E402
from addon.ui import modal  # noqa: E402
from tests.support import window  # noqa: E402

LIMIT = 1.5
"""How many times longer a bake with the bar may take."""
ROUNDS = 3
PAIRS = ("kepler", "helmet")
PATIENCE = 300.0
QUADS = 200
"""Per side of the generated terrain."""
CASES = [
    ("16 samples", {"method": "CAST", "samples": "16", "width": 1024, "height": 1024, "maps": set()}),
    ("occlusion", {"method": "CAST", "samples": "1", "width": 1024, "height": 1024, "maps": {"AO"}, "rays": 32}),
    ("Flatten", {"method": "FLATTEN", "samples": "16", "width": 1024, "height": 1024, "maps": set()}),
]


def step():
    """Run all cases. Yields the seconds to wait."""
    addon.register()
    yield 0.5
    words = list(globals().get("ARGS", ()))
    folder = next((Path(word) for word in words if Path(word).is_dir()), None)
    rounds = next((int(word) for word in words if word.isdigit()), ROUNDS)
    skipped = {word[1:] for word in words if word.startswith("-")}
    is_well = True
    print(f"{'pair':10} {'bake':12} {'script':>8} {'bar':>8} {'ratio':>6} {'longest':>8} {'drawn':>6}", flush=True)
    for pair in PAIRS if folder else ["terrain"]:
        for name, settings in CASES:
            if skipped & {name, pair}:
                continue
            prepare(folder, pair, settings)
            yield 0.5
            from_script, with_bar, longest, drawn = [], [], 0.0, 0
            for number in range(rounds + 1):
                script = scripted()
                yield 0.3
                bar, gap, drawn = yield from in_window()
                if number:  # the first one compiles shaders
                    from_script.append(script)
                    with_bar.append(bar)
                    longest = max(longest, gap)
                yield 0.3
            script, bar = statistics.median(from_script), statistics.median(with_bar)
            is_well &= bar < LIMIT * script
            print(
                f"{pair:10} {name:12} {script:8.2f} {bar:8.2f} {bar / script:6.2f} {longest:8.2f} {drawn:6}", flush=True
            )
    print("all as promised" if is_well else "the bar costs TOO MUCH", flush=True)
    addon.unregister()
    if not is_well:
        raise SystemExit(1)


def prepare(folder, pair, wanted):
    """The pair in the scene, and the settings of the bake."""
    with window.at_view():
        for obj in list(bpy.data.objects):
            bpy.data.objects.remove(obj)
        for image in list(bpy.data.images):
            bpy.data.images.remove(image)
        if folder is None:
            terrain("hi", QUADS)
            terrain("lo", 16)
        else:
            path = next(folder.glob(f"{pair}_*.blend"))
            with bpy.data.libraries.load(str(path)) as (_, into):
                into.objects = ["lo", "hi"]
            for obj in into.objects:
                bpy.context.scene.collection.objects.link(obj)
        bpy.ops.object.select_all(action="SELECT")
        bpy.ops.view3d.view_selected()
    settings = bpy.context.scene.imprint
    settings.low = bpy.data.objects["lo"]
    settings.highs.clear()
    settings.highs.add().object = bpy.data.objects["hi"]
    settings.storage, settings.material, settings.show_result = "MEMORY", False, False
    for name, value in wanted.items():
        setattr(settings, name, value)


def terrain(name, quads):
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=quads, y_subdivisions=quads, size=4)
    obj = bpy.context.object
    bpy.ops.object.shade_smooth()
    obj.name = name
    points = np.empty((len(obj.data.vertices), 3), np.float32)
    obj.data.vertices.foreach_get("co", points.ravel())
    points[:, 2] = 0.1 * np.sin(math.tau * points[:, 0]) * np.cos(math.tau * points[:, 1])
    obj.data.vertices.foreach_set("co", points.ravel())
    obj.data.update()


def scripted():
    """The seconds of a bake from a script."""
    start = time.perf_counter()
    with window.at_view():
        bpy.ops.imprint.bake("EXEC_DEFAULT")
    return time.perf_counter() - start


def in_window():
    """Bake with the bar. Returns its seconds, the longest time without an event of the window, and the drawn viewports."""
    drawn, gaps, ends = [], [], []
    advance, stop = modal.Runner.advance, modal.Runner.stop

    def advance_timed(self, context):
        begin = time.perf_counter()
        try:
            advance(self, context)
        finally:
            gaps.append(time.perf_counter() - begin)

    def stop_timed(self, context):
        result = stop(self, context)
        ends.append(time.perf_counter())
        return result

    modal.Runner.advance, modal.Runner.stop = advance_timed, stop_timed
    handle = bpy.types.SpaceView3D.draw_handler_add(lambda: drawn.append(1), (), "WINDOW", "POST_PIXEL")
    try:
        start = time.perf_counter()
        with window.at_view():
            bpy.ops.imprint.bake("INVOKE_DEFAULT")
        while modal.runner.run is not None and time.perf_counter() - start < PATIENCE:
            yield 0.02
    finally:
        modal.Runner.advance, modal.Runner.stop = advance, stop
        bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW")
    return ends[-1] - start, max(gaps), len(drawn)


if __name__ == "__main__":  # otherwise, another script calls step()
    window.start(step())
