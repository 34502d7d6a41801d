# SPDX-License-Identifier: GPL-3.0-or-later
"""Drives a real Blender window from scripts in tests/window. Mouse and keys need X11 and xdotool."""

import functools
import math
import subprocess
from collections.abc import Iterator
from pathlib import Path

import bpy

from addon.ui.texts import SidebarPanel

STEP = 18
"""Pixels between the places where `find` looks for a button, which is 20 high."""
SCROLLS = 4
"""How often `find` scrolls down by nearly the height of the sidebar."""
UP, DOWN = 4, 5
"""The wheel's numbers as buttons of the mouse."""


def view() -> tuple[bpy.types.Window, bpy.types.Area, bpy.types.Region]:
    """The largest 3D viewport."""
    window = bpy.context.window_manager.windows[0]
    area = max((a for a in window.screen.areas if a.type == "VIEW_3D"), key=lambda a: a.width * a.height)
    return window, area, next(region for region in area.regions if region.type == "WINDOW")


def at_view():
    """The context of that viewport, for operators."""
    window, area, region = view()
    return bpy.context.temp_override(window=window, area=area, region=region, screen=window.screen)


def open_alone(*names: str) -> None:
    """Only these panels of Imprint are open when they are drawn for the first time. Call it before the add-on is registered."""
    classes = [SidebarPanel]
    for panel in classes:
        classes += panel.__subclasses__()
        if issubclass(panel, bpy.types.Panel):
            panel.bl_options = set() if panel.__name__ in names else {"DEFAULT_CLOSED"}


presses: list[str] = []
"""The clicks and the keys so far, without the wheel and without keys that are held for a click."""
NOTCH = 40.0
"""How far a notch of the wheel moves the sidebar, in pixels at a scale of 1."""


class Wheel:
    """The notches of the wheel that somebody would need who knows where each button is, since `begin`. `find` needs more."""

    def __init__(self):
        self.notches, self._top = 0, 0.0
        self.places: dict[str, float] = {}
        """How far buttons are from the top of all panels, in pixels, where they were pressed last."""

    def begin(self) -> None:
        """Count from now on, with the sidebar at its top."""
        self.notches, self._top = 0, 0.0

    def reach(self, sidebar: bpy.types.Region, button: str, y: int) -> None:
        """Note that a button was used. y: where it is now, in pixels from the lower edge of the sidebar."""
        at = self.places[button] = sidebar.view2d.region_to_view(0, y)[1]
        edge = STEP * bpy.context.preferences.system.ui_scale
        beyond = max(at + edge - self._top, min(0.0, at - edge - (self._top - sidebar.height)), key=abs)
        if at + edge > self._top or at - edge < self._top - sidebar.height:
            number = math.ceil(abs(beyond) / (NOTCH * bpy.context.preferences.system.ui_scale))
            self.notches += number
            self._top = min(0.0, self._top + math.copysign(number * NOTCH, beyond))


wheel = Wheel()


def mouse(*words: object) -> None:
    """Call xdotool."""
    if words[0] == "key" or (words[0] == "click" and words[-1] == 1):
        presses.append(" ".join(map(str, words)))
    subprocess.run(["xdotool", *map(str, words)], check=True)


def keys(*combinations: str) -> Iterator[float]:
    """Press keys, as "ctrl+s", with the mouse in the viewport."""
    whole, _, region = view()
    mouse("mousemove", region.x + 300, whole.height - region.y - region.height // 2)
    yield 0.2
    for combination in combinations:
        mouse("key", combination)
        yield 0.5


def press(button: str) -> Iterator[float]:
    """Click a button of the sidebar, as "imprint.bake" for an operator, also with its first arguments, or "imprint.low"
    for a property."""
    yield from find(button)
    whole, area, _ = view()
    sidebar = next(region for region in area.regions if region.type == "UI")
    wheel.reach(sidebar, button, whole.height - _seen[button][1] - sidebar.y)
    mouse("click", 1)
    yield 0.3


def press_beside(button: str, *, right: int = 0, below: int = 0) -> Iterator[float]:
    """Click what is so many pixels beside a button, at a scale of 1: headers and menus, which have no name to be found by."""
    yield from find(button)
    scale = bpy.context.preferences.system.ui_scale
    mouse("mousemove_relative", "--", round(right * scale), round(below * scale))
    yield 0.3
    mouse("click", 1)
    yield 0.7


HEADER = 13
"""How far the middle of the last header is above the end of the sidebar, in pixels at a scale of 1."""


def press_last_header() -> Iterator[float]:
    """Click the header of the last panel, which is closed, in a sidebar that the panels fill."""
    yield from open_tab()
    whole, area, _ = view()
    sidebar = next(region for region in area.regions if region.type == "UI")
    mouse("mousemove", sidebar.x + sidebar.width // 2, whole.height - sidebar.y - sidebar.height // 2)
    yield 0.3
    mouse("click", "--repeat", 100, "--delay", 10, DOWN)
    yield 1.0
    above = HEADER * bpy.context.preferences.system.ui_scale
    mouse("mousemove", sidebar.x + sidebar.width // 2, round(whole.height - sidebar.y - above))
    yield 0.3
    mouse("click", 1)
    yield 0.7


MENU = 21, 20
"""How far the first item of a menu is below its button, and the height of an item, in pixels at a scale of 1."""


def choose(index: int) -> Iterator[float]:
    """Click the item of this index in the menu that a click on its button has just opened below it."""
    yield 1.0
    below = (MENU[0] + MENU[1] * index) * bpy.context.preferences.system.ui_scale
    mouse("mousemove_relative", "--", 0, round(below))
    yield 0.3
    mouse("click", 1)
    yield 0.7


def open_tab() -> Iterator[float]:
    """Open the sidebar at the tab Imprint."""
    _, area, _ = view()
    area.spaces.active.show_region_ui = True
    yield 0.5
    _, area, _ = view()  # again: another file brings other areas
    next(region for region in area.regions if region.type == "UI").active_panel_category = "Imprint"
    yield 1.0


_seen: dict[str, tuple[int, int]] = {}
"""Where the mouse has met buttons, in pixels. They may have moved since."""


def find(button: str) -> Iterator[float]:
    """Move the mouse to a button of the sidebar's tab Imprint, which is shown. Where it was seen before comes first; then the
    wheel goes to the top, and down as far as it takes. Raises LookupError if there is no such button."""
    yield from open_tab()
    whole, area, _ = view()
    sidebar = next(region for region in area.regions if region.type == "UI")
    if button in _seen:
        mouse("mousemove", *_seen[button])
        yield 0.3
        if _is_under_mouse(button, sidebar, _seen[button]):
            return
    left, top = sidebar.x + 4, whole.height - sidebar.y - sidebar.height
    for direction, turns in ((UP, 100), *[(DOWN, sidebar.height // 50)] * SCROLLS):
        mouse("mousemove", left, top + sidebar.height // 2)
        yield 0.2
        mouse("click", "--repeat", turns, "--delay", 10, direction)
        yield 1.5
        for part in (0.7, 0.25, 0.84):
            for y in range(top + STEP, top + sidebar.height, STEP):
                at = round(sidebar.x + sidebar.width * part), y
                mouse("mousemove", *at)
                yield 0.06  # with less, a busy machine has not noticed it
                if _is_under_mouse(button, sidebar, at):
                    return
    raise LookupError(f"{button} is not in the sidebar")


def _is_under_mouse(button: str, sidebar: bpy.types.Region, at: tuple[int, int]) -> bool:
    """Whether the mouse, which is `at` a place, is over a button."""
    found = _under_mouse(sidebar).removeprefix("bpy.ops.")
    name = found.partition("(")[0]
    is_wanted = found.startswith(button) if "(" in button else name == button
    if is_wanted or name:
        _seen[button if is_wanted else name] = at
    return is_wanted


def _under_mouse(region: bpy.types.Region) -> str:
    """What Blender copies of the button below the mouse: the call of its operator, or the path of its property."""
    whole, area, _ = view()
    with bpy.context.temp_override(window=whole, area=area, region=region, screen=whole.screen):
        for copy in (bpy.ops.ui.copy_python_command_button, bpy.ops.ui.copy_data_path_button):
            if copy.poll() and copy() == {"FINISHED"}:
                return bpy.context.window_manager.clipboard
    return ""


def click_row(name: str, *held: str) -> Iterator[float]:
    """Click an object of the scene's only collection in the Outliner, with keys held down."""
    whole = bpy.context.window_manager.windows[0]
    area = max((a for a in whole.screen.areas if a.type == "OUTLINER"), key=lambda a: a.height)
    region = next(region for region in area.regions if region.type == "WINDOW")
    row = 2 + sorted(bpy.context.scene.objects.keys(), key=str.lower).index(name)  # below the scene and the collection
    height = 20 * bpy.context.preferences.system.ui_scale
    y = whole.height - region.y - region.height + height * (row + 0.5)
    mouse("mousemove", region.x + region.width // 3, round(y))
    yield 0.2
    for key in held:
        mouse("keydown", key)
    yield 0.2
    mouse("click", 1)
    yield 0.3
    for key in held:
        mouse("keyup", key)
    yield 0.2


def select_only(*objects: bpy.types.Object) -> None:
    """Select these objects; the first one becomes the active one."""
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj in objects)
    bpy.context.view_layer.objects.active = objects[0] if objects else None


def screenshot(path: Path) -> None:
    """A picture of the screen, by ImageMagick: Blender's own is empty on some virtual screens."""
    subprocess.run(["import", "-silent", "-window", "root", str(path)], check=True)


def start(steps: Iterator[float]) -> None:
    """Run `steps` in Blender's event loop, which wait as many seconds as they yield. Quits Blender after the last."""
    bpy.context.preferences.view.show_splash = False
    bpy.app.timers.register(functools.partial(_run, steps), first_interval=1.0, persistent=True)


def _run(steps: Iterator[float]) -> float | None:
    seconds = next(steps, None)
    if seconds is None:
        with at_view():
            bpy.ops.wm.quit_blender()
    return seconds
