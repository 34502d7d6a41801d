# SPDX-License-Identifier: GPL-3.0-or-later
"""Loads Blender when the first bake needs it."""

from ...core.timings import startup
from .. import standard_streams
from . import lean_blender


def load_blender() -> None:
    """Load Blender where it is a Python package. In Blender this does nothing."""
    with standard_streams.silence(1), startup.spent("bpy"):
        lean_blender.load()
