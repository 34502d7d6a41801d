# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes objects out of 3D viewports for as long as something is drawn there in their place, and gives them back.

It is done by local views, which belong to a viewport: the objects stay as they are, selected or not, and no undo step brings
them back hidden. An undo step does hold which objects are in the local views of its time, so that a local view of the artist's
own stays as it is. A viewport is asked for when it is drawn, and changed soon after: not while it is being drawn.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import bpy

Place = tuple[bpy.types.Window, bpy.types.Screen, bpy.types.Area, bpy.types.SpaceView3D]


@dataclass(frozen=True)
class _Asked:
    """What a viewport is to show: the objects, by session_uid, that are out of it, and of which view layer."""

    out: frozenset[int]
    scene: int
    layer: str


_asked: dict[int, _Asked] = {}
"""By the address of the viewport, as the others."""
_taken: dict[int, _Asked | None] = {}
"""Viewports that are in a local view of ours, with what they show; None where an undo may have changed it."""
_left: set[int] = set()
"""Viewports whose local view the artist has left, or that can have none."""


def ask(context: bpy.types.Context, objects: list[bpy.types.Object]) -> None:
    """Have `objects`, and no others, out of the viewport that is being drawn."""
    space = context.space_data
    key = space.as_pointer()
    if key in _taken and space.local_view is None:
        del _taken[key]
        _left.add(key)
    if key in _left or (key not in _taken and space.local_view is not None):
        return
    out = frozenset(obj.session_uid for obj in objects)
    asked = _Asked(out, context.scene.session_uid, context.view_layer.name)
    is_done = _taken[key] == asked if key in _taken else not out
    if not is_done:
        _asked[key] = asked
        if not bpy.app.timers.is_registered(catch_up):
            bpy.app.timers.register(catch_up, first_interval=0.0)


def are_out(space: bpy.types.SpaceView3D, objects: list[bpy.types.Object]) -> bool:
    """Whether none of `objects` is to be seen in a viewport."""
    done = _taken.get(space.as_pointer())
    return done is not None and space.local_view is not None and {obj.session_uid for obj in objects} <= done.out


def catch_up() -> None:
    """Do what the viewports were asked for."""
    for save_or_undo, handler in _handlers():
        if handler not in save_or_undo:
            save_or_undo.append(handler)
    for place in list(_places()):
        asked = _asked.pop(place[3].as_pointer(), None)
        if asked is not None:
            _settle(place, asked)
    _asked.clear()


def stop() -> None:
    """Give all viewports back as they were. Nothing stays behind."""
    give_back()
    _left.clear()
    for save_or_undo, handler in _handlers():
        if handler in save_or_undo:
            save_or_undo.remove(handler)


def give_back(*_) -> None:
    """Give all viewports back as they were, until they are drawn again."""
    _asked.clear()
    if bpy.app.timers.is_registered(catch_up):
        bpy.app.timers.unregister(catch_up)
    for place in list(_places()) if _taken else ():
        _give_back(place)
    _taken.clear()


def _after_undo(*_) -> None:
    """What is in a local view is as it was then, and Blender leaves one that was not there yet: the artist has not left it.
    The next draw asks anew."""
    for *_, space in list(_places()):
        key = space.as_pointer()
        if key in _taken:
            _taken[key] = None
            if space.local_view is None:
                del _taken[key]


def _handlers() -> list[tuple[list, Callable]]:
    handlers = bpy.app.handlers
    return [(handlers.save_pre, give_back), (handlers.undo_post, _after_undo), (handlers.redo_post, _after_undo)]


def _places() -> Iterator[Place]:
    """All viewports, also those of workspaces and editors that are not in view."""
    windows = {window.screen: window for window in bpy.context.window_manager.windows}
    for screen in bpy.data.screens:
        window = windows.get(screen) or next(iter(windows.values()), None)
        for area in screen.areas if window is not None else ():
            yield from ((window, screen, area, space) for space in area.spaces if space.type == "VIEW_3D")


def _settle(place: Place, asked: _Asked) -> None:
    window, *_, space = place
    key = space.as_pointer()
    if not asked.out:
        _give_back(place)
        return
    if key not in _taken and not _enter(place):
        _left.add(key)
        return
    _taken[key] = asked
    for obj in window.view_layer.objects:
        obj.local_view_set(space, obj.session_uid not in asked.out)


def _enter(place: Place) -> bool:
    """Go into local view, for which Blender needs a selected object. Returns whether it did."""
    window, *_, space = place
    for obj in window.view_layer.objects:
        if not obj.visible_get(view_layer=window.view_layer, viewport=space):
            continue
        was_selected = obj.select_get(view_layer=window.view_layer)
        obj.select_set(True, view_layer=window.view_layer)
        try:
            if obj.select_get(view_layer=window.view_layer):  # some cannot be selected
                return _switch(place)
        finally:
            obj.select_set(was_selected, view_layer=window.view_layer)
    return False


def _switch(place: Place) -> bool:
    """Go into local view or out of it, with nothing framed. Returns whether it did: there are 16 local views at most."""
    window, screen, area, space = place
    kind = area.type
    area.type = "VIEW_3D"  # it may have become another editor meanwhile
    region = next(region for region in area.regions if region.type == "WINDOW")
    try:
        with bpy.context.temp_override(window=window, screen=screen, area=area, region=region):
            return bpy.ops.view3d.localview(frame_selected=False) == {"FINISHED"}
    except RuntimeError:  # what Blender reports as an error
        return False
    finally:
        area.type = kind


def _give_back(place: Place) -> None:
    space = place[3]
    key = space.as_pointer()
    if key in _taken:
        del _taken[key]
        if space.local_view is not None:
            _switch(place)
