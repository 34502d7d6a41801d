# SPDX-License-Identifier: GPL-3.0-or-later
"""The progress of a running task: text over a viewport, and panels whose button becomes a bar and whose settings look off."""

import time
from typing import Any

import blf
import bpy
import gpu
from gpu_extras.batch import batch_for_shader
from gpu_extras.presets import draw_texture_2d

from ..core.progress import Progress, Redraws
from .callbacks import DrawCallbacks, redraw
from .texts import SidebarPanel, label, message

TEXT_SIZE = 12.0
"""Font size, in pixels at a scale of 1."""
WHITE = (1.0, 1.0, 1.0, 1.0)
BACKGROUND = (0.08, 0.08, 0.08, 0.7)
"""Color of the box behind the text."""
PAD = (0.5, 0.35)
"""Padding of the box at the sides, and above and below, in font sizes."""


def text_width(text: str, scale: float) -> float:
    """The width of a line in pixels, without its box."""
    blf.size(0, TEXT_SIZE * scale)
    return blf.dimensions(0, text)[0]


def write_text(text: str, x: float, y: float, scale: float, share: float = 0.0) -> None:
    """Write a line in a dark box, with `share` of its width to the left of x. Call it from a POST_PIXEL draw callback."""
    x -= text_width(text, scale) * share
    letter = TEXT_SIZE * scale
    left, right = x - PAD[0] * letter, x + text_width(text, scale) + PAD[0] * letter
    # Capitals are 0.7 of the font size high. Descenders get as much room below as there is above.
    below, above = y - PAD[1] * letter, y + (0.7 + PAD[1]) * letter
    program = gpu.shader.from_builtin("UNIFORM_COLOR")
    corners = [(left, below), (right, below), (left, above), (right, above)]
    before = gpu.state.blend_get()
    gpu.state.blend_set("ALPHA")
    program.uniform_float("color", BACKGROUND)
    batch_for_shader(program, "TRI_STRIP", {"pos": corners}).draw(program)
    gpu.state.blend_set(before)
    blf.color(0, *WHITE)
    blf.position(0, x, y, 0)
    blf.draw(0, text)


SIDE = 256
"""The longer side of the picture on screen, in pixels at a scale of 1."""
EDGE = 24
"""Between the picture and the corner of the editor, in pixels at a scale of 1."""
NAMED = 0.5
"""Seconds between two texts in the panel and the status bar."""
MAIN, OF_SETS = "imprint.bake", "imprint.bake_sets"
"""The operators of the main button, which bakes the selection or a set."""
KNOWN = 0.05
"""Share of a bake that must be done before the remaining time is shown."""


class ProgressDisplay:
    """The progress of the running bake.

    current: its last step, or None if no bake is running. picture: the last one that a step had. operator: the one whose button
    started it.
    """

    def __init__(self):
        self.current: Progress | None = None
        self.operator = MAIN
        self._buttons = {MAIN}
        self.picture: gpu.types.GPUTexture | None = None
        self._began = self._named = 0.0
        self._redraws = Redraws()
        self._draw_callbacks = DrawCallbacks(
            (bpy.types.SpaceView3D, self._draw, "POST_PIXEL"), (bpy.types.SpaceImageEditor, self._draw, "POST_PIXEL")
        )

    @property
    def is_drawn(self) -> bool:
        """Whether anything is drawn into the editors."""
        return self._draw_callbacks.are_added

    def show(self, context: bpy.types.Context, step: Progress) -> None:
        """Show `step` until `hide` is called. The bar follows a few times a second, and the picture in the editors as often
        as their drawing leaves time for the bake."""
        now = time.monotonic()
        if self.current is None:
            self._began, self._named, self._redraws = now, now - NAMED, Redraws()
        self.current = step
        self.picture = step.picture or self.picture
        self._draw_callbacks.add()
        if now - self._named >= NAMED:
            self._named = now
            context.workspace.status_text_set(f"{self.text()}   {message('Esc: stop')}")
            redraw("VIEW_3D", "IMAGE_EDITOR", region="UI")
            redraw("PREFERENCES")  # the bar of the test of the GPU
        if self.picture is not None and self._redraws.are_due():
            redraw("VIEW_3D", "IMAGE_EDITOR", region="WINDOW")

    def draw_operator(
        self, layout: bpy.types.UILayout, name: str, *, enabled: bool = True, **how: Any
    ) -> bpy.types.OperatorProperties | None:
        """Draw the button of an operator, or the bar in its place while its task runs, so that nothing moves under the mouse.

        The bar of a button that was never drawn is at the main one. how: as for UILayout.operator. Returns the operator's
        properties, or None for a bar.
        """
        self._buttons.add(name)
        is_main = self.operator in {MAIN, OF_SETS} or self.operator not in self._buttons
        if self.current is not None and (name in {MAIN, OF_SETS} if is_main else name == self.operator):
            layout.progress(factor=self.current.done, text=self.short_text(), translate=False)
            return None
        part = layout.row()
        part.enabled = enabled and self.current is None
        return part.operator(name, **how)

    def note_drawn(self) -> None:
        """Call this before the work of a tick: Blender has drawn by now what `show` asked for."""
        self._redraws.note_done()

    def hide(self, context: bpy.types.Context) -> None:
        """Remove everything from the screen."""
        self.current = self.picture = None
        self.operator = MAIN
        self._draw_callbacks.remove()
        for window in context.window_manager.windows:  # a bake may be stopped from another window
            window.workspace.status_text_set(None)
        redraw("VIEW_3D", "IMAGE_EDITOR", "PREFERENCES")

    def text(self) -> str:
        """The current step in a line: its name, its progress, and the remaining time."""
        return f"{label(self.current.what)}, {self.short_text()}"

    def short_text(self) -> str:
        """The progress of the current step and, if it is known, the remaining time."""
        return f"{self.current.done:.0%}{time_left(self.current.done, time.monotonic() - self._began)}"

    def _draw(self) -> None:
        picture, context = self.picture, bpy.context
        if picture is None or context.area is None or not is_first(context.area, context.region):
            return
        scale = context.preferences.system.ui_scale
        longer = max(picture.width, picture.height)
        width, height = (SIDE * scale * side / longer for side in (picture.width, picture.height))
        left = visible_columns(context.area, context.region)[0] + EDGE * scale
        draw_texture_2d(picture, (left, EDGE * scale), width, height)
        write_text(self.text(), left, EDGE * scale + height + 8 * scale, scale)


def is_first(area: bpy.types.Area, region: bpy.types.Region) -> bool:
    """Whether a part of an editor is that at the lower left: Quad View has four."""
    parts = [part for part in area.regions if part.type == "WINDOW" and part.width > 1]
    return not parts or region == min(parts, key=lambda part: (part.x, part.y))


def visible_columns(area: bpy.types.Area, region: bpy.types.Region) -> tuple[int, int]:
    """The first and last x, in pixels of the region, between the toolbar and the sidebar that lie over it."""
    left, right = 0, region.width
    for other in area.regions:
        if other.type in {"TOOLS", "UI"} and other.width > 1:  # 1 where it is hidden
            if other.alignment == "LEFT":
                left = max(left, min(region.width, other.x + other.width - region.x))
            elif other.alignment == "RIGHT":
                right = min(right, max(0, other.x - region.x))
    return left, right


def time_left(done: float, seconds: float) -> str:
    """The remaining time at the same speed: `seconds` for a share `done`. Rounded so that it does not flicker, and empty
    if it is too early for an estimate."""
    if done < KNOWN or seconds < 1.0:
        return ""
    left = seconds * (1.0 - done) / done
    if left >= 60.0:
        return f", {message('{} min left').format(f'{left / 60.0:.0f}')}"
    seconds_left = left if left < 10.0 else 5.0 * round(left / 5.0)
    return f", {message('{} s left').format(f'{seconds_left:.0f}')}"


display = ProgressDisplay()


class SettingsPanel(SidebarPanel):
    """A panel of settings, which look off while a task runs, and the button below them, which does not."""

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column()
        column.enabled = display.current is None
        self.draw_settings(column, context)
        self.draw_button(self.layout, context)

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        """Draw the settings."""
        raise NotImplementedError

    def draw_button(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        """Draw the button; by default none."""
