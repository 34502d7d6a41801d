# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's window for the manual's pictures: its viewport, its sidebar, and what is on the screen."""

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

from scripts.dev.manual import models

Box = tuple[int, int, int, int]
"""Left, bottom, width and height in pixels of the window, from its lower left corner."""


def viewport() -> tuple[bpy.types.Window, bpy.types.Area, bpy.types.Region]:
    """The largest 3D viewport."""
    area = largest("VIEW_3D")
    return bpy.context.window_manager.windows[0], area, region(area, "WINDOW")


def largest(kind: str) -> bpy.types.Area:
    """The largest area of a kind, as "OUTLINER"."""
    areas = bpy.context.window_manager.windows[0].screen.areas
    return max((area for area in areas if area.type == kind), key=lambda area: area.width * area.height)


def region(area: bpy.types.Area, kind: str) -> bpy.types.Region:
    """An area's region of a kind, as "UI" for the sidebar."""
    return next(found for found in area.regions if found.type == kind)


def override():
    """The context of that viewport, for operators."""
    window, area, its_region = viewport()
    return bpy.context.temp_override(window=window, area=area, region=its_region, screen=window.screen)


def box_of(place: bpy.types.Area | bpy.types.Region) -> Box:
    """Where an area or a region is."""
    return place.x, place.y, place.width, place.height


def copy_of(panel: type, **fields: object) -> type:
    """A class like that of a registered panel, with other fields. No subclass: Blender forgets the class of the panel when a
    subclass of it is unregistered."""
    own = {name: value for name, value in vars(panel).items() if name not in {"bl_rna", "__dict__", "__weakref__"}}
    return type(str(fields["bl_idname"]), panel.__bases__, own | fields)


def is_working() -> bool:
    """Whether a bake, or the first map of a view, is going on in slices."""
    with override():
        return not bpy.ops.imprint.bake.poll()


def wait() -> Iterator[float]:
    """Yields until nothing is going on."""
    yield 0.3
    while is_working():
        yield 0.2
    yield 0.3


def screen() -> np.ndarray:
    """What the window shows: (height, width, 3) bytes, row 0 at the top.

    Where Blender's own screenshot is empty, as on some virtual screens, ImageMagick's `import` takes it from the X server.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "screen.png"
        with override():
            bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
            bpy.ops.screen.screenshot(filepath=str(path))
        pixels = models.load(path)
        if np.ptp(pixels) > 0:
            return pixels
        if shutil.which("import") is None:
            raise RuntimeError("Blender's screenshots are empty here, and ImageMagick is missing.")
        subprocess.run(["import", "-silent", "-window", "root", str(path)], check=True)
        return models.load(path)


def crop(box: Box, pixels: np.ndarray | None = None) -> np.ndarray:
    """A part of the window."""
    pixels = screen() if pixels is None else pixels
    left, bottom, width, height = box
    top = len(pixels) - bottom - height
    return pixels[max(top, 0) : top + height, max(left, 0) : left + width]


def trimmed(pixels: np.ndarray, margin: int = 6) -> np.ndarray:
    """Without the rows at the bottom that hold nothing but the background, whose color is that of a row near the lower end."""
    background = pixels[-8, pixels.shape[1] // 2].astype(int)
    is_filled = (np.abs(pixels[:-8].astype(int) - background).max(axis=2) > 4).mean(axis=1) > 0.1
    return pixels[: np.flatnonzero(is_filled)[-1] + 1 + margin]


def save(path: Path, pixels: np.ndarray) -> None:
    """Write bytes of (height, width, 3), row 0 at the top, as .jpg or .png."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(path.stem, width, height)
    try:
        rgba = np.ones((height, width, 4), np.float32)
        rgba[..., :3] = pixels[::-1] / np.float32(255)
        image.pixels.foreach_set(rgba.ravel())
        scene = bpy.context.scene
        transform, scene.view_settings.view_transform = scene.view_settings.view_transform, "Standard"
        settings = scene.render.image_settings
        settings.file_format = "JPEG" if path.suffix == ".jpg" else "PNG"
        settings.color_mode, settings.quality, settings.compression = "RGB", 86, 100
        image.save_render(str(path))
        scene.view_settings.view_transform = transform
    finally:
        bpy.data.images.remove(image)
    print(f"{path} {width} x {height}, {path.stat().st_size / 1024:.0f} KiB")
