# SPDX-License-Identifier: GPL-3.0-or-later
"""Hides objects in 3D viewports while a view draws in their place, and shows them again.

It uses Local View, which belongs to a viewport: the objects do not change, and Undo cannot leave them hidden. Undo does
restore which objects are in Local View, so a Local View of the user stays as it is. A viewport makes its request while it is
being drawn. The request is done soon after, because drawing must not change a viewport.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import bpy

from .callbacks import Timer, events

Place = tuple[bpy.types.Window, bpy.types.Screen, bpy.types.Area, bpy.types.SpaceView3D]


@dataclass(frozen=True)
class _Request:
    """A request of a viewport: the objects to hide, by session_uid, and their view layer."""

    out: frozenset[int]
    scene: int
    layer: str


class ObjectHiding:
    """Keeps the request of each viewport, and what was done. Viewports are identified by their address."""

    def __init__(self):
        self.timer = Timer(self.catch_up)
        events.hear(save_pre=self.give_back, undo_post=self._after_undo, redo_post=self._after_undo)
        self._requests: dict[int, _Request] = {}
        self._taken: dict[int, _Request | None] = {}
        """Viewports in Local View by this class, with their requests; None if Undo may have changed it."""
        self._left: set[int] = set()
        """Viewports whose Local View the user has left, or that can have none."""

    @property
    def is_off(self) -> bool:
        """Whether no viewport and no timer is affected."""
        return not (self._requests or self._taken or self._left or self.timer.is_running)

    def ask(self, context: bpy.types.Context, objects: list[bpy.types.Object]) -> None:
        """Request that `objects`, and no others, are hidden in the viewport that is being drawn."""
        space = context.space_data
        key = space.as_pointer()
        if key in self._taken and space.local_view is None:
            del self._taken[key]
            self._left.add(key)
        if key in self._left or (key not in self._taken and space.local_view is not None):
            return
        out = frozenset(obj.session_uid for obj in objects)
        request = _Request(out, context.scene.session_uid, context.view_layer.name)
        is_done = self._taken[key] == request if key in self._taken else not out
        if not is_done:
            self._requests[key] = request
            self.timer.start()

    def are_out(self, space: bpy.types.SpaceView3D, objects: list[bpy.types.Object]) -> bool:
        """Whether none of `objects` is visible in a viewport."""
        done = self._taken.get(space.as_pointer())
        return done is not None and space.local_view is not None and {obj.session_uid for obj in objects} <= done.out

    def catch_up(self) -> None:
        """Do what the viewports have requested."""
        for place in list(_places()):
            request = self._requests.pop(place[3].as_pointer(), None)
            if request is not None:
                self._settle(place, request)
        self._requests.clear()

    def stop(self) -> None:
        """Restore all viewports. No timer remains."""
        self.give_back()
        self._left.clear()

    def give_back(self, *_) -> None:
        """Restore all viewports until they are drawn again."""
        self._requests.clear()
        self.timer.stop()
        for place in list(_places()) if self._taken else ():
            self._restore(place)
        self._taken.clear()

    def _after_undo(self, *_) -> None:
        """Undo restores Local View as it was, and may leave it. The user has not left it, so the next draw requests it
        again."""
        for *_, space in list(_places()) if self._taken else ():
            key = space.as_pointer()
            if key in self._taken:
                self._taken[key] = None
                if space.local_view is None:
                    del self._taken[key]

    def _settle(self, place: Place, request: _Request) -> None:
        window, *_, space = place
        key = space.as_pointer()
        if not request.out:
            self._restore(place)
            return
        if key not in self._taken and not _enter(place):
            self._left.add(key)
            return
        self._taken[key] = request
        for obj in window.view_layer.objects:
            obj.local_view_set(space, obj.session_uid not in request.out)

    def _restore(self, place: Place) -> None:
        space = place[3]
        key = space.as_pointer()
        if key in self._taken:
            del self._taken[key]
            if space.local_view is not None:
                _switch(place)


def _places() -> Iterator[Place]:
    """All viewports, also those of workspaces and editors that are not in view."""
    windows = {window.screen: window for window in bpy.context.window_manager.windows}
    for screen in bpy.data.screens:
        window = windows.get(screen) or next(iter(windows.values()), None)
        for area in screen.areas if window is not None else ():
            yield from ((window, screen, area, space) for space in area.spaces if space.type == "VIEW_3D")


def _enter(place: Place) -> bool:
    """Enter Local View, for which Blender needs a selected object. Returns whether it did."""
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
    """Enter or leave Local View without framing. Returns whether it did: Blender has at most 16 Local Views."""
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


hiding = ObjectHiding()
