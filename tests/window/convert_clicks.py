# SPDX-License-Identifier: GPL-3.0-or-later
"""Presses Convert with the mouse in a real Blender window, for images of all kinds, and undoes and redoes it. Not collected by
pytest.

    blender --factory-startup --python tests/window/convert_clicks.py

Needs X11 (or Xvfb) and xdotool, and the mouse for a minute. Each row has the image and the degrees by which the
new map differs from a bake at the 99th percentile, after the press and after Redo. Blender exits with 1 if a row is wrong.
"""

import sys
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2]), str(Path(__file__).resolve().parent)]

import addon  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.jobs import bake_pair  # noqa: E402
from tests.support import angles, window, zoo  # noqa: E402
from tests.support.maps import pixels  # noqa: E402

SIZE = 128
PATIENCE = 20.0
"""Seconds to wait for a map."""
EXACT, EXACT_16, EXACT_8 = 0.002, 0.01, 0.5
"""Degrees at the 99th percentile, by the depth of the image."""
SOURCES = {
    "floats": ({"storage": "MEMORY", "depth": 32}, EXACT),
    "packed": ({"storage": "PACK", "depth": 8}, EXACT_8),
    "file of 8 bits": ({"storage": "FILE", "depth": 8, "output": "eight.png"}, EXACT_8),
    "file of 16 bits": ({"storage": "FILE", "depth": 16, "output": "sixteen.png"}, EXACT_16),
    "UDIM tiles": ({"storage": "FILE", "depth": 16, "output": "tiles.<UDIM>.png", "udim": True}, EXACT_16),
    "packed tiles": ({"storage": "PACK", "depth": 16, "udim": True}, EXACT_16),
}
NEW = "converted"


def step():
    """Run all cases. Yields the seconds to wait."""
    addon.register()
    addon.unregister()
    window.open_alone("IMPRINT_PT_bake", "IMPRINT_PT_convert")
    addon.register()
    folder = Path(tempfile.mkdtemp())
    expected, sources = prepare(folder)
    yield 1.0
    wrong = []
    print(f"{'image':16} {'pressed':>8} {'redone':>8}", flush=True)
    for name, image in sources.items():
        bpy.context.scene.imprint.convert_image = bpy.data.images[image]
        with window.at_view():
            bpy.ops.ed.undo_push(message="before")
        yield 0.5
        yield from window.press("imprint.convert")
        first = yield from off(expected)
        yield from window.keys("ctrl+z")
        yield 1.0
        if NEW in bpy.data.images or shown() is not None:
            wrong.append(f"{name}: Undo leaves the map")
        yield from window.keys("ctrl+shift+z")
        again = yield from off(expected)
        print(f"{name:16} {first:8.4f} {again:8.4f}", flush=True)
        if not max(first, again) < SOURCES[name][1]:
            wrong.append(f"{name}: the map differs")
        yield from window.keys("ctrl+z")
        yield 1.0
    print(wrong or "as promised", flush=True)
    addon.unregister()
    if wrong:
        raise SystemExit(1)


def prepare(folder):
    """Make a pair and its maps. Returns the map in object space, and the names of the images to convert."""
    with window.at_view():
        bpy.ops.object.select_all(action="SELECT")
        bpy.ops.object.delete()
        low, high = zoo.terrain("lo", 9, height=0.3), zoo.terrain("hi", 64, height=0.3)
        high.hide_set(True)
        common = {
            "method": "FLATTEN",
            "width": SIZE,
            "height": SIZE,
            "margin": 0,
            "material": False,
            "basis": "MIKKTSPACE",
        }
        sources = {}
        for name, (stored, _) in SOURCES.items():
            own = stored | ({"output": str(folder / stored["output"])} if "output" in stored else {})
            report = bake_pair(bpy.context, low, [high], Settings(image=name, **common, **own))
            sources[name] = report.image  # Undo makes new datablocks
        in_memory = {"storage": "MEMORY", "depth": 32, "space": "OBJECT"}
        bake_pair(bpy.context, low, [high], Settings(image="expected", **common, **in_memory))
    settings = bpy.context.scene.imprint
    settings.low, settings.space, settings.image, settings.depth, settings.margin = low, "OBJECT", NEW, "16", 0
    window.view()[1].spaces.active.show_region_ui = True
    return pixels(bpy.data.images["expected"]), sources


def shown():
    """The image of the low object's normal map, or None."""
    material = bpy.data.objects["lo"].active_material
    nodes = material.node_tree.nodes if material else ()
    return next((node.image for node in nodes if node.type == "TEX_IMAGE"), None)


def off(expected):
    """Degrees at the 99th percentile between the new map and a bake."""
    end = time.monotonic() + PATIENCE
    while (NEW not in bpy.data.images or shown() is None) and time.monotonic() < end:
        yield 0.2
    yield 0.5
    if NEW not in bpy.data.images:
        return np.inf
    texels = pixels(bpy.data.images[NEW])
    if texels.shape != expected.shape:
        return np.inf
    return np.percentile(angles.degrees(angles.decode(texels), angles.decode(expected)), 99)


if __name__ == "__main__":  # otherwise, another script calls step()
    window.start(step())
