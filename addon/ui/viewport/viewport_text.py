# SPDX-License-Identifier: GPL-3.0-or-later
"""Text over a viewport, in a dark box so that it is readable over any color."""

import blf
import gpu
from gpu_extras.batch import batch_for_shader

SIZE = 12.0
"""Font size, in pixels at a scale of 1."""
WHITE = (1.0, 1.0, 1.0, 1.0)
BACKGROUND = (0.08, 0.08, 0.08, 0.7)
"""Color of the box behind the text."""
PAD = (0.5, 0.35)
"""Padding of the box at the sides, and above and below, in font sizes."""


def width(text: str, scale: float) -> float:
    """The width of a line in pixels, without its box."""
    blf.size(0, SIZE * scale)
    return blf.dimensions(0, text)[0]


def write(text: str, x: float, y: float, scale: float, share: float = 0.0) -> None:
    """Write a line in a dark box, with `share` of its width to the left of x. Call it from a POST_PIXEL draw callback."""
    x -= width(text, scale) * share
    letter = SIZE * scale
    left, right = x - PAD[0] * letter, x + width(text, scale) + PAD[0] * letter
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
