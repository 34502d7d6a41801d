# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes all pictures of the manual, in a Blender 5.2 with a window:

blender --factory-startup --window-geometry 0 0 1280 800 --python scripts/dev/pictures.py -- [PART ...]

PART is one of those in WINDOW or RENDERED below; without one, all are made. "panels" and "findings" need a window 1600 pixels
high. The pictures go into docs/images/ and docs/extension/. A virtual screen will do (xvfb-run);
ImageMagick then takes the screenshots. With --background, the parts in RENDERED are made alone, by Cycles.
"""

import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import bpy

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import addon  # noqa: E402
from scripts.dev.manual import faults, map_pictures, near_layers, pages, screens, window  # noqa: E402

IMAGES = ROOT / "docs" / "images"
WINDOW = {
    "steps": screens.steps,
    "views": screens.views,
    "findings": screens.findings,
    "panels": screens.panels,
}
RENDERED = {
    "faults": faults.pictures,
    "layers": near_layers.pictures,
    "gallery-layers": near_layers.gallery,
    "start": near_layers.start,
    "plate": map_pictures.plate,
    "maps": map_pictures.heads,
    "gallery-asset": map_pictures.asset,
    "map-settings": map_pictures.settings,
    "terrain": pages.terrain,
    "extension": pages.extension,
}


def make(parts: list[str]) -> Iterator[float]:
    """Make the pictures of these parts, or of all; yields the seconds for which Blender is to go on in between."""
    if not hasattr(bpy.types.Scene, "imprint"):
        addon.register()
    bpy.context.scene.render.engine = "CYCLES"
    IMAGES.mkdir(parents=True, exist_ok=True)
    yield 0.5
    known = RENDERED if bpy.app.background else WINDOW | RENDERED
    for part in parts or known:
        for made in known[part]():
            if isinstance(made, float):
                yield made
                continue
            name, pixels = made
            window.save(IMAGES / (name if "." in name else f"{name}.jpg"), pixels)
            yield 0.01


def main(parts: list[str]) -> None:
    bpy.context.preferences.view.show_splash = False  # before Blender shows it
    work = make(parts)
    if bpy.app.background:
        import gpu

        gpu.init()
        try:
            for _ in work:
                pass
        finally:
            addon.free()
        return

    def tick() -> float | None:
        seconds = None
        try:
            seconds = next(work, None)
        finally:  # after an error too, or the window would stay open
            if seconds is None:
                with window.override():
                    bpy.ops.wm.quit_blender()
        return seconds

    bpy.app.timers.register(tick, first_interval=0.5)


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [])
elif "ARGS" in globals():  # run by a program that drives Blender's window and takes up what step() yields
    step = partial(make, globals()["ARGS"])
