# SPDX-License-Identifier: GPL-3.0-or-later
"""Disables the extension, and opens another file, in a real Blender window while Live, a view, the cage or a bake is on, and
prints what remains. Not collected by pytest.

    blender --factory-startup --python tests/window/nothing_remains.py

Blender exits with 1 if anything remains.
"""

import gc
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import addon  # noqa: E402
from addon.engine import tree_cache  # noqa: E402
from addon.passes import target  # noqa: E402
from addon.ui.cage_overlay import overlay  # noqa: E402
from addon.ui.live import LiveState, live  # noqa: E402
from addon.ui.local_view import hiding  # noqa: E402
from addon.ui.modal import runner  # noqa: E402
from addon.ui.progress_display import display  # noqa: E402
from addon.ui.view_shading import Mode  # noqa: E402
from addon.ui.views import viewer  # noqa: E402
from tests.support import window  # noqa: E402

HANDLERS = (
    "depsgraph_update_post",
    "frame_change_post",
    "undo_post",
    "redo_post",
    "save_pre",
    "save_post",
    "load_pre",
    "load_post",
)
PATIENCE = 20.0
"""Seconds to wait."""


def step():
    """Run all cases. Yields the seconds to wait."""
    before = handlers()
    is_well = True
    for begin in (live_view_and_cage, own_view, view_after_live, running_bake):
        for end in (switch_off, open_another_file):
            addon.register()
            yield 0.5
            prepare()
            yield 0.5
            began = yield from begin()
            yield 0.3
            end()
            yield 0.5
            stays = left() + ([] if handlers() == before or end is open_another_file else ["handlers"])
            if end is open_another_file:
                addon.unregister()
                yield 0.3
                stays += [] if handlers() == before else ["handlers after it was switched off"]
            is_well &= began and not stays
            verdict = ", ".join(stays) or "nothing" if began else "it did not begin  <-- WRONG"
            print(f"{begin.__name__:20} {end.__name__:20} stays: {verdict}", flush=True)
    print("nothing stays" if is_well else "SOMETHING stays", flush=True)
    if not is_well:
        raise SystemExit(1)


def live_view_and_cage():
    """Live with a view of its map, and the cage."""
    press("live")
    is_live = yield from wait(lambda: live.state is LiveState.IDLE and runner.run is None)
    press("view_show", mode="DEVIATION")
    press("show_cage")
    is_drawn = yield from wait(lambda: viewer.deviations is not None and not hiding.is_off)
    return is_live and is_drawn and overlay.is_on


def own_view():
    """A view with its own map."""
    press("view_show", mode="SPLIT")
    return (yield from wait(lambda: viewer.mode is Mode.SPLIT and viewer.own is not None and not hiding.is_off))


def view_after_live():
    """A view that showed Live's map, after Live was turned off."""
    began = yield from own_view()
    press("live")
    taken = yield from wait(lambda: live.state is LiveState.IDLE and viewer.own is None and runner.run is None)
    press("live")
    # The map of Live is in the file by then, which the view shows.
    given_back = yield from wait(lambda: not live.is_on and viewer.stored and runner.run is None)
    return began and taken and given_back


def running_bake():
    """A bake with its progress bar."""
    settings = bpy.context.scene.imprint
    settings.width = settings.height = 4096
    settings.samples = "16"
    press("bake")
    return (yield from wait(lambda: runner.run is not None and display.is_drawn))


def switch_off():
    addon.unregister()


def open_another_file():
    with window.at_view():
        bpy.ops.wm.read_homefile(use_factory_startup=True)


def prepare():
    """Make a scene with a low grid and a high one, in the slots."""
    with window.at_view():
        for obj in list(bpy.data.objects):
            bpy.data.objects.remove(obj)
        for name, cuts in (("lo", 10), ("hi", 60)):
            bpy.ops.mesh.primitive_grid_add(x_subdivisions=cuts, y_subdivisions=cuts, size=4)
            bpy.context.object.name = name
        bpy.data.objects["hi"].data.vertices[1700].co.z = 0.3
        settings = bpy.context.scene.imprint
        settings.low = bpy.data.objects["lo"]
        settings.highs.clear()
        settings.highs.add().object = bpy.data.objects["hi"]
        settings.method, settings.width, settings.height, settings.samples = "CAST", 256, 256, "1"


def left():
    """The names of the parts that are still on."""
    gc.collect()
    is_on = {
        "Live": live.is_on or live.timer.is_running,
        "the view": not viewer.is_idle,
        "the cage": overlay.is_on or overlay.timer.is_running,
        "hidden objects": not hiding.is_off,
        "the bake": runner.run is not None,
        "the progress bar": display.current is not None or display.is_drawn,
        "targets": len(target.common) > 0,
        "trees": len(tree_cache.trees) > 0,
        "GPU objects": any(type(found).__module__ == "gpu.types" and is_large(found) for found in gc.get_objects()),
    }
    return [name for name, stays in is_on.items() if stays]


def is_large(found):
    return type(found).__name__ in {"GPUTexture", "GPUFrameBuffer", "GPUOffScreen"}


def handlers():
    """The number of handlers."""
    return [len(getattr(bpy.app.handlers, name)) for name in HANDLERS]


def press(operator, **arguments):
    with window.at_view():
        getattr(bpy.ops.imprint, operator)("INVOKE_DEFAULT", **arguments)


def wait(is_there):
    """Wait for it. Returns whether it happened."""
    for _ in range(int(PATIENCE / 0.05)):
        if is_there():
            return True
        yield 0.05
    return False


if __name__ == "__main__":  # otherwise, another script calls step()
    window.start(step())
