# SPDX-License-Identifier: GPL-3.0-or-later
"""Sends a job by Flamenco's own panel, in a Blender with a window. try_flamenco_panel.py starts it:

blender --factory-startup --python scripts/dev/farms/flamenco_panel.py -- URL JOBS SHARDS COMMAND BLEND PICTURE

Flamenco's add-on comes from the manager at URL. BLEND is where the scene is saved, which the add-on demands first.
"""

import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from scripts.dev.manual import window  # noqa: E402

URL, JOBS, SHARDS, COMMAND, BLEND, PICTURE = sys.argv[sys.argv.index("--") + 1 :]
JOB_TYPE = "imprint-bake"


def send() -> Iterator[float]:
    """Install the add-on, fill its form in, take a picture of it and send it. Yields the seconds for which Blender goes on."""
    archive = Path(BLEND).with_name("flamenco-addon.zip")
    with urllib.request.urlopen(f"{URL}/flamenco-addon.zip") as answer:
        archive.write_bytes(answer.read())
    bpy.ops.preferences.addon_install(filepath=str(archive))
    bpy.ops.preferences.addon_enable(module="flamenco")
    bpy.context.preferences.addons["flamenco"].preferences.manager_url = URL
    bpy.ops.wm.save_as_mainfile(filepath=BLEND)
    bpy.ops.flamenco.ping_manager()
    scene = bpy.context.scene
    scene.flamenco_job_type = JOB_TYPE
    form = scene.flamenco_job_settings
    form.jobs, form.shards, form.command = JOBS, int(SHARDS), COMMAND
    yield from photograph()
    with window.override():
        bpy.ops.flamenco.submit_job("INVOKE_DEFAULT", job_name=scene.flamenco_job_name)
    while bpy.context.window_manager.flamenco_bat_status not in ("DONE", "ABORTED", "IDLE"):
        yield 0.2


def photograph() -> Iterator[float]:
    """Take a picture of the form, which is below Blender's own panels."""
    with window.override():
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.5)
    area = window.largest("VIEW_3D")
    area.type = "PROPERTIES"
    area.spaces.active.context = "OUTPUT"
    yield 1.0
    place = window.region(area, "WINDOW")
    with window.override(), bpy.context.temp_override(area=area, region=place):
        for _ in range(40):
            bpy.ops.view2d.scroll_down()
    window.viewport()[0].cursor_warp(1, 1)  # where it shows no tooltip
    yield 1.0
    window.save(Path(PICTURE), window.trimmed(window.crop(window.box_of(place))))


def main() -> None:
    """Do the steps while the window lives, and quit."""
    bpy.context.preferences.view.show_splash = False
    steps = send()

    def tick() -> float | None:
        seconds = None
        try:
            seconds = next(steps, None)
        finally:  # after an error too, or the window would stay open
            if seconds is None:
                with window.override():
                    bpy.ops.wm.quit_blender()
        return seconds

    bpy.app.timers.register(tick, first_interval=1.0)


main()
