# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows in the 3D viewport where rays start and end: two shells around the low mesh that follow the two numbers."""

import bpy
import gpu

from ...core.errors import BakeError
from ...jobs import cage_shells
from ...scene import bake_objects

OUTER, INNER = (0.1, 0.45, 1.0, 0.25), (1.0, 0.45, 0.1, 0.25)
"""Colours of where rays start and where they end."""

_handle = None
_wanted: tuple[bake_objects.ObjectRef, str] | None = None
"""The low object and the directions whose shells were asked for when a view was last drawn."""
_uploaded: tuple[tuple[bake_objects.ObjectRef, str], gpu.types.GPUBatch | None] | None = None
"""What was wanted when the low mesh was last read, and that mesh; None in its place where it cannot be read."""
_is_outdated = False
"""Whether the low mesh has changed since."""


def is_on() -> bool:
    """Whether the shells are drawn."""
    return _handle is not None


def show(on: bool) -> None:
    """Start or stop drawing. Nothing stays behind when it is off."""
    global _handle, _uploaded, _wanted  # noqa: PLW0603 - Blender gives a handle to take the drawing back with
    if on and _handle is None:
        _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")
        for changes, handler in _handlers():
            changes.append(handler)
    elif not on and _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        for changes, handler in _handlers():
            changes.remove(handler)
        _handle = _uploaded = _wanted = None
        if bpy.app.timers.is_registered(catch_up):
            bpy.app.timers.unregister(catch_up)


def _handlers() -> list[tuple[list, object]]:
    handlers = bpy.app.handlers
    return [
        (handlers.depsgraph_update_post, _on_update),
        (handlers.frame_change_post, _on_update),
        (handlers.undo_post, _on_undo),
        (handlers.redo_post, _on_undo),
    ]


def _on_update(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Only a change of the low object counts: another one may be moved or sculpted for minutes."""
    if _uploaded is None:
        return
    low = _uploaded[0][0].uid
    if any(
        (update.is_updated_geometry or update.is_updated_transform) and update.id.original.session_uid == low
        for update in depsgraph.updates
        if isinstance(update.id, bpy.types.Object)
    ):
        _on_undo()


def _on_undo(*_) -> None:
    global _is_outdated  # noqa: PLW0603 - handlers are plain functions
    _is_outdated = True


def catch_up() -> None:
    """Read the low mesh. Not while a view is being drawn: reading evaluates the scene."""
    global _uploaded, _is_outdated  # noqa: PLW0603 - see _on_undo
    low = _wanted[0].find() if _wanted is not None else None
    if low is None:
        return
    try:
        mesh = cage_shells.upload(low, bpy.context.evaluated_depsgraph_get(), _wanted[1])
    except BakeError:
        mesh = None
    _uploaded, _is_outdated = (_wanted, mesh), False
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def _ready(low: bpy.types.Object, directions: str) -> gpu.types.GPUBatch | None:
    """The low mesh as it was last read, to be read anew where that is not it; None where it was not read yet."""
    global _wanted  # noqa: PLW0603 - see _on_undo
    _wanted = bake_objects.hold(low), directions
    is_it = _uploaded is not None and (_uploaded[0][0].uid, _uploaded[0][1]) == (low.session_uid, directions)
    if (not is_it or _is_outdated) and not bpy.app.timers.is_registered(catch_up):
        bpy.app.timers.register(catch_up, first_interval=0.0)
    return _uploaded[1] if is_it else None


def _draw() -> None:
    context = bpy.context
    settings = context.scene.imprint
    low, _ = settings.subjects(context)
    if low is None or low.type != "MESH" or low.mode != "OBJECT" or not low.data.polygons:
        return
    mesh = _ready(low, settings.directions)
    if mesh is None:
        return
    extrusion, reach = settings.distances(context)
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("LESS_EQUAL")
    view = context.region_data.perspective_matrix
    for away, colour in ((extrusion, OUTER), (extrusion - reach, INNER)):
        cage_shells.draw(mesh, view, away, colour)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")
