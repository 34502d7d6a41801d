# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes the README's pictures of Imprint at work, in a Blender with a window:

blender --window-geometry 0 0 1600 1000 --python scripts/dev/pictures.py -- DIR

Panel, before and after, split and deviation, as .jpg in DIR, of the demo's terrain. Needs Blender 5.2 and a screen; where
Blender's own screenshots stay empty, as under some virtual screens, ImageMagick's `import` takes them.
"""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import addon  # noqa: E402
from addon.ui.viewport.progress_display import display  # noqa: E402
from scripts import demo  # noqa: E402

SIZE = 2048
WIDTH = 900
"""Of the pictures."""


def view() -> tuple[bpy.types.Window, bpy.types.Area, bpy.types.Region]:
    """The largest 3D viewport."""
    window = bpy.context.window_manager.windows[0]
    area = max((a for a in window.screen.areas if a.type == "VIEW_3D"), key=lambda a: a.width * a.height)
    return window, area, next(region for region in area.regions if region.type == "WINDOW")


def override():
    """The context of that viewport."""
    window, area, region = view()
    return bpy.context.temp_override(window=window, area=area, region=region, screen=window.screen)


def shot(path: Path) -> None:
    """Take a picture of the viewport with its sidebar."""
    whole = path.with_suffix(".png")
    with override():
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
        bpy.ops.screen.screenshot_area(filepath=str(whole))
    image = bpy.data.images.load(str(whole))
    try:
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        if np.ptp(pixels.reshape(-1, 4)[:, :3]) == 0.0:
            image = _taken_from_screen(whole, image)
        image.scale(WIDTH, WIDTH * image.size[1] // image.size[0])
        scene = bpy.context.scene
        before, scene.view_settings.view_transform = (
            scene.view_settings.view_transform,
            "Standard",
        )  # the screen as it is
        settings = scene.render.image_settings
        settings.file_format, settings.quality, settings.color_mode = "JPEG", 88, "RGB"
        image.save_render(str(path))
        scene.view_settings.view_transform = before
    finally:
        bpy.data.images.remove(image)
        whole.unlink()
    print(path)


def _taken_from_screen(path: Path, empty: bpy.types.Image) -> bpy.types.Image:
    if shutil.which("import") is None:
        raise RuntimeError("Blender's screenshots are empty here, and there is no ImageMagick to take them.")
    bpy.data.images.remove(empty)
    window, area, _ = view()
    place = f"{area.width}x{area.height}+{area.x}+{window.height - area.y - area.height}"
    subprocess.run(["import", "-silent", "-window", "root", "-crop", place, "+repage", str(path)], check=True)
    return bpy.data.images.load(str(path))


def pictures(folder: Path) -> Iterator[float]:
    """Set the scene and take one picture after the other; yields the seconds that Blender is to go on for between."""
    high, low, *others = demo.build_terrains()
    for obj in others:
        bpy.data.objects.remove(obj)
    high.name, low.name = "high", "low"
    settings, shown = bpy.context.scene.imprint, bpy.context.scene.imprint_view
    settings.low = low
    settings.highs.add().object = high
    settings.width = settings.height = SIZE
    high.hide_set(True)
    window, area, region = view()
    space = area.spaces.active
    space.show_region_ui, space.overlay.show_floor, space.overlay.show_cursor = True, False, False
    space.overlay.show_axis_x = space.overlay.show_axis_y = False
    with override():
        bpy.ops.view3d.view_axis(type="TOP")
        bpy.ops.view3d.view_all()
    space.region_3d.view_perspective = "PERSP"
    space.region_3d.view_rotation = (0.86, 0.42, 0.12, 0.26)
    yield 0.5
    for side in area.regions:
        if side.type == "UI":
            side.active_panel_category = "Imprint"
    yield 0.5
    shot(folder / "before.jpg")
    with override():
        bpy.ops.imprint.bake()
    yield 0.5
    with override():  # what is drawn asks for the small picture, which Blender makes meanwhile
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
    yield 3.0
    shot(folder / "panel.jpg")
    for mode, name in (
        ("MAP", "after"),
        ("SPLIT", "split"),
        ("DEVIATION", "deviation"),
        ("BARE_DEVIATION", "without_map"),
    ):
        shown.mode, shown.limit = mode, 40.0
        while display.current is not None:  # the first one draws a map of its own
            yield 0.2
        yield 2.0  # panels slide to their places
        shot(folder / f"{name}.jpg")
    shown.mode = "OFF"


def main() -> None:
    if bpy.app.background:
        raise SystemExit("pictures.py takes pictures of Blender's window: start it without --background.")
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    folder = Path(arguments[0] if arguments else ROOT / "out" / "pictures").absolute()
    folder.mkdir(parents=True, exist_ok=True)
    bpy.context.preferences.view.show_splash = False
    if not hasattr(bpy.types.Scene, "imprint"):
        addon.register()
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    steps = pictures(folder)

    def tick() -> float | None:
        try:
            return next(steps)
        except StopIteration:
            with override():
                bpy.ops.wm.quit_blender()
            return None

    bpy.app.timers.register(tick, first_interval=0.5)


main()
