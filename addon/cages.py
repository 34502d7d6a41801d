# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows in the 3D viewport where rays start and end: two shells around the low mesh that follow the two numbers."""

import bpy
import gpu

from .bake import shells

OUTER, INNER = (0.1, 0.45, 1.0, 0.25), (1.0, 0.45, 0.1, 0.25)
"""Colours of where rays start and where they end."""

_handle = None
_uploaded: dict[tuple[str, str], gpu.types.GPUBatch] = {}
"""The low mesh as it was when it was last drawn, by its name and directions; emptied when the scene changes."""


def is_on() -> bool:
    """Whether the shells are drawn."""
    return _handle is not None


def show(on: bool) -> None:
    """Start or stop drawing. Nothing stays behind when it is off."""
    global _handle  # noqa: PLW0603 - Blender gives a handle to take the drawing back with
    handlers = bpy.app.handlers
    if on and _handle is None:
        _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")
        for changes in (handlers.depsgraph_update_post, handlers.frame_change_post):
            changes.append(_forget)
    elif not on and _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        for changes in (handlers.depsgraph_update_post, handlers.frame_change_post):
            changes.remove(_forget)
        _handle = None
        _uploaded.clear()


def _forget(*_) -> None:
    _uploaded.clear()


def _draw() -> None:
    context = bpy.context
    settings = context.scene.imprint
    low, _ = settings.subjects(context)
    if low is None or low.type != "MESH" or low.mode != "OBJECT" or not low.data.polygons:
        return
    extrusion, reach = settings.distances(context)
    key = low.name, settings.directions
    if key not in _uploaded:
        _uploaded[key] = shells.upload(low, context.evaluated_depsgraph_get(), settings.directions)
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("LESS_EQUAL")
    view = context.region_data.perspective_matrix
    for away, colour in ((extrusion, OUTER), (extrusion - reach, INNER)):
        shells.draw(_uploaded[key], view, away, colour)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")
