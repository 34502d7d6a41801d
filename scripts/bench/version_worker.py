# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes with one version of Imprint: reads requests as lines of JSON, and answers each with a line.

Started by versions.py with the root of the version's files, whose public functions it uses; so it uses only what older
versions have as well. The requests are the functions whose names are in REQUESTS, with their arguments.
"""

import dataclasses
import json
import os
import re
import sys
import time
from pathlib import Path

sys.path.insert(0, sys.argv[1])
# Blender prints to standard output, also while it is loaded. Send that to standard error, and only answers to standard output.
ANSWERS = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)

import bpy  # noqa: E402
import gpu  # noqa: E402
import numpy as np  # noqa: E402

import addon  # noqa: E402
from addon.core.errors import BakeError  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.jobs import bake_pair  # noqa: E402

MAP = "bench"
"""The name of the image that is baked."""


def open_file(path: str) -> dict:
    """Open a .blend."""
    bpy.ops.wm.open_mainfile(filepath=path)
    return {}


def make_grid(quads: list[int], height: float) -> dict:
    """Generate waves of this height of quads[0] x quads[1] quads as 'hi', and a plane as 'lo'."""
    sys.path.insert(0, str(Path(__file__).resolve().parent))
    import large_grid

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    large_grid.build("hi", *quads, height)
    large_grid.build("lo", 1, 1, 0.0)
    return {}


def bake(settings: dict) -> dict:
    """Bake 'hi' onto 'lo', with a new tree for rays. Settings that this version lacks are left out.

    Returns the seconds from the objects to the stored map, those of each stage, and the report.
    """
    kinds = [type(part) for part in vars(Settings()).values()] if hasattr(Settings, "flat") else [Settings]
    known = {field.name for kind in kinds for field in dataclasses.fields(kind)}
    chosen = Settings(**{name: value for name, value in {"image": MAP, **settings}.items() if name in known})
    forget_tree()
    start = time.perf_counter()
    report = bake_pair(bpy.context, bpy.data.objects["lo"], [bpy.data.objects["hi"]], chosen)
    seconds = time.perf_counter() - start
    values = report.to_dict()
    return {"seconds": seconds, "stages": values["seconds"], "stopped_early": values.get("stopped_early")}


def forget_tree() -> None:
    try:
        from addon.engine import tree_cache
    except ImportError:  # versions up to 0.2
        from addon.engine.rays import tree_cache

    tree_cache.trees.free()


def save_map(path: str) -> dict:
    """Save the texels (height, width, 4) float32 of the last map as .npy."""
    image = bpy.data.images[MAP]
    texels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(texels)
    np.save(path, texels.reshape(image.size[1], image.size[0], 4))
    return {}


def forget_peak() -> dict:
    """Let `peak` count from now on, if the system supports it."""
    clear = Path("/proc/self/clear_refs")
    if clear.exists():
        clear.write_text("5", encoding="ascii")
    return {}


def peak() -> dict:
    """The most bytes of memory that this process has held, as the system counts them; None if it does not."""
    status = Path("/proc/self/status")
    found = re.search(r"VmHWM:\s+(\d+) kB", status.read_text(encoding="ascii")) if status.exists() else None
    return {"bytes": int(found[1]) * 1024 if found else None}


REQUESTS = {function.__name__: function for function in (open_file, make_grid, bake, save_map, forget_peak, peak)}
PROBLEMS = (BakeError, RuntimeError, OSError, MemoryError, LookupError, TypeError, ValueError)
"""Of versions that do not support a request: they leave a gap in the table."""


def main() -> None:
    gpu.init()
    for line in sys.stdin:
        request = json.loads(line)
        try:
            answer = REQUESTS[request.pop("do")](**request)
        except PROBLEMS as error:
            answer = {"error": f"{type(error).__name__}: {' '.join(str(error).split())}"}
        print(json.dumps(answer), file=ANSWERS, flush=True)


if __name__ == "__main__":
    try:
        main()
    finally:
        addon.free()  # Blender crashes on exit while GPU objects exist
