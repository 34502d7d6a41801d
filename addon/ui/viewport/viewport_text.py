# SPDX-License-Identifier: GPL-3.0-or-later
"""Words over a viewport, readable over whatever is shown there."""

import blf
import gpu
from gpu_extras.batch import batch_for_shader

SIZE = 12.0
"""Of the letters, in pixels at a scale of 1."""
WHITE = (1.0, 1.0, 1.0, 1.0)
GROUND = (0.08, 0.08, 0.08, 0.7)
"""Of the box behind the words."""
PAD = (0.5, 0.35)
"""Of the box around the words at the sides, above and below, in letters."""


def width(text: str, scale: float) -> float:
    """The width of a line in pixels, without its box."""
    blf.size(0, SIZE * scale)
    return blf.dimensions(0, text)[0]


def write(text: str, x: float, y: float, scale: float, share: float = 0.0) -> None:
    """Write a line of which this share lies left of x, in a dark box. To be called where a region draws pixels."""
    x -= width(text, scale) * share
    letter = SIZE * scale
    left, right = x - PAD[0] * letter, x + width(text, scale) + PAD[0] * letter
    # Capitals are 0.7 of a letter high; what hangs below the line has as much room as there is above them.
    below, above = y - PAD[1] * letter, y + (0.7 + PAD[1]) * letter
    program = gpu.shader.from_builtin("UNIFORM_COLOR")
    corners = [(left, below), (right, below), (left, above), (right, above)]
    before = gpu.state.blend_get()
    gpu.state.blend_set("ALPHA")
    program.uniform_float("color", GROUND)
    batch_for_shader(program, "TRI_STRIP", {"pos": corners}).draw(program)
    gpu.state.blend_set(before)
    blf.color(0, *WHITE)
    blf.position(0, x, y, 0)
    blf.draw(0, text)
