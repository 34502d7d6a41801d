# SPDX-License-Identifier: GPL-3.0-or-later
"""Callbacks of Blender: events, timers, drawing in editors, keys. Each class adds its callbacks and removes them."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import ExitStack
from types import MappingProxyType
from typing import Any

import bpy
from bpy.app.handlers import persistent


class Events:
    """What Blender tells, and who hears it: Blender has one handler for each event, from registering the add-on on.

    Besides those of bpy.app.handlers, there are four of our own. "end": what belongs to the open file has to go, since another
    one is opened or the add-on is disabled. "free": so has what is on the GPU. "live": Live has a new map or message. "baked":
    a low object, whose session_uid it passes, has another last result.
    """

    OF_BLENDER = (
        "depsgraph_update_post",
        "frame_change_post",
        "undo_post",
        "redo_post",
        "save_pre",
        "save_post",
        "load_post",
    )

    def __init__(self):
        self._heard: dict[str, list[Callable[..., object]]] = {"end": [], "free": [], "live": [], "baked": []}
        self._handlers = {name: self._handler(name) for name in self.OF_BLENDER}

    def hear(self, **functions: Callable[..., object]) -> None:
        """Call functions at events, by their names, with what Blender passes its handlers."""
        for name, function in functions.items():
            self._heard[name].append(function)

    def tell(self, name: str, *arguments: object) -> None:
        """Call the functions of an event: of Blender's in the order in which they were added, of our own in the reverse one,
        as what ends may depend on what was there before. If one raises, the rest is called, too."""
        functions = self._heard[name]
        with ExitStack() as calls:
            for function in reversed(functions) if name in self.OF_BLENDER else functions:
                calls.callback(function, *arguments)

    def register(self) -> None:
        """Hear Blender's events from now on."""
        for name, handler in self._handlers.items():
            getattr(bpy.app.handlers, name).append(handler)

    def unregister(self) -> None:
        for name, handler in self._handlers.items():
            handlers = getattr(bpy.app.handlers, name)
            if handler in handlers:  # scripts clear such lists
                handlers.remove(handler)

    def _handler(self, name: str) -> Callable[..., None]:
        self._heard[name] = []

        @persistent  # it stays for the next file
        def handler(*arguments: object) -> None:
            self.tell(name, *arguments)

        return handler


events = Events()
register, unregister = events.register, events.unregister


class UntilChange:
    """What was found the last time, until an object or the file changes: panels ask for it at each redraw.

    Blender updates its dependency graph before it draws, and before operators run.
    """

    def __init__(self):
        self._known: dict[str, tuple[Hashable, Any]] = {}
        names = ("depsgraph_update_post", "frame_change_post", "undo_post", "redo_post", "load_post", "baked", "end")
        events.hear(**dict.fromkeys(names, self.drop))

    def get(self, name: str, key: Hashable, find: Callable[[], Any]) -> Any:
        """What was found for `name` and the same key, or else what `find` finds. It must hold no datablocks."""
        known = self._known.get(name)
        if known is None or known[0] != key:
            known = self._known[name] = key, find()
        return known[1]

    def drop(self, *_) -> None:
        self._known.clear()


until_change = UntilChange()


class Timer:
    """A function that Blender calls later, again after as many seconds as it returns, and never again after None.

    It stops at the event "end". Blender identifies a timer by its function. Each look-up of a bound method makes a new object,
    so this one is stored.
    """

    def __init__(self, function: Callable[[], float | None], *, is_lasting: bool = False):
        """is_lasting: it goes on when another file is opened."""
        self._function, self._is_lasting = function, is_lasting
        if not is_lasting:
            events.hear(end=self.stop)

    @property
    def is_running(self) -> bool:
        return bpy.app.timers.is_registered(self._function)

    def start(self, seconds: float = 0.0) -> None:
        """Call the function after `seconds`, unless the timer is already running."""
        if not self.is_running:
            bpy.app.timers.register(self._function, first_interval=seconds, persistent=self._is_lasting)

    def stop(self) -> None:
        if self.is_running:
            bpy.app.timers.unregister(self._function)


class DrawCallbacks:
    """Functions that draw into editors, as (type of the editor, function, event) where event is POST_VIEW or POST_PIXEL."""

    def __init__(self, *callbacks: tuple[type[bpy.types.Space], Callable[[], None], str]):
        self._callbacks = callbacks
        self._handles: list[tuple[type[bpy.types.Space], object]] = []

    @property
    def are_added(self) -> bool:
        return bool(self._handles)

    def add(self) -> None:
        """Draw from now on. A second call does nothing."""
        if not self._handles:
            for space, draw, event in self._callbacks:
                self._handles.append((space, space.draw_handler_add(draw, (), "WINDOW", event)))

    def remove(self) -> None:
        while self._handles:
            space, handle = self._handles.pop()
            space.draw_handler_remove(handle, "WINDOW")


class Key:
    """A key that calls an operator, in one of Blender's keymaps, given by its name and space type."""

    def __init__(self, operator: str, key: str, keymap: str, space_type: str = "EMPTY", **modifiers: bool):
        self._operator, self._key, self._modifiers = operator, key, modifiers
        self._keymap, self._space_type = keymap, space_type
        self._added: list[tuple[bpy.types.KeyMap, bpy.types.KeyMapItem]] = []

    def add(self) -> None:
        keys = bpy.context.window_manager.keyconfigs.addon
        if keys is not None:  # in the background, Blender has no keymaps
            keymap = keys.keymaps.new(self._keymap, space_type=self._space_type)
            item = keymap.keymap_items.new(self._operator, self._key, "PRESS", **self._modifiers)
            self._added.append((keymap, item))

    def remove(self) -> None:
        while self._added:
            keymap, item = self._added.pop()
            keymap.keymap_items.remove(item)


def registering(
    classes: Sequence[type], *, properties: Mapping[str, Any] = MappingProxyType({}), keys: Sequence[Key] = ()
) -> tuple[Callable[[], None], Callable[[], None]]:
    """The functions register and unregister of a module.

    Args:
        classes: Of Blender's types, in the order in which they need each other.
        properties: Of Blender's types, as "Scene.imprint".
        keys: In keymaps.
    """
    add, remove = bpy.utils.register_classes_factory(classes)
    places = [(getattr(bpy.types, name.partition(".")[0]), name.partition(".")[2]) for name in properties]

    def register() -> None:
        add()
        for (owner, name), value in zip(places, properties.values(), strict=True):
            setattr(owner, name, value)
        for key in keys:
            key.add()

    def unregister() -> None:
        for key in keys:
            key.remove()
        for owner, name in reversed(places):
            delattr(owner, name)
        remove()

    return register, unregister


def redraw(*kinds: str, region: str = "") -> None:
    """Draw the editors of these kinds again, in all windows; without a kind, 3D viewports. region: only this part of them, as
    "UI" for the sidebar."""
    kinds = kinds or ("VIEW_3D",)
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in kinds:
                for part in [part for part in area.regions if part.type == region] if region else [area]:
                    part.tag_redraw()
