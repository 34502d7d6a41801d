# SPDX-License-Identifier: GPL-3.0-or-later
"""Callbacks are added only once, and removed completely."""

import bpy
import pytest

from addon.ui.callbacks import DrawCallbacks, Handlers, Key, Timer


class Listener:
    """Each look-up of its method makes a new object, as for the add-on's classes."""

    def on_update(self, *_):
        return None


def test_a_timer_of_a_method_is_found_after_another_look_up():
    timer = Timer(Listener().on_update)
    assert not timer.is_running
    for _ in range(2):
        timer.start(60.0)
        assert timer.is_running
    timer.stop()
    timer.stop()
    assert not timer.is_running


def test_handlers_are_added_once_and_removed():
    listener = Listener()
    before = list(bpy.app.handlers.undo_post)
    handlers = Handlers(("undo_post", listener.on_update), ("save_pre", listener.on_update))
    for _ in range(2):
        handlers.add()
        assert bpy.app.handlers.undo_post == [*before, listener.on_update]
    assert handlers.are_added
    bpy.app.handlers.save_pre.remove(listener.on_update)  # Blender does this when it opens another file
    for _ in range(2):
        handlers.remove()
        assert bpy.app.handlers.undo_post == before
    assert not handlers.are_added


def test_draw_callbacks_are_added_once_and_removed(monkeypatch):
    added = []

    class Editor:
        @staticmethod
        def draw_handler_add(*arguments):
            added.append(arguments)
            return arguments

        @staticmethod
        def draw_handler_remove(handle, region):
            assert region == "WINDOW"
            added.remove(handle)

    on_update = Listener().on_update
    callbacks = DrawCallbacks((Editor, on_update, "POST_VIEW"), (Editor, on_update, "POST_PIXEL"))
    for _ in range(2):
        callbacks.add()
        assert added == [(on_update, (), "WINDOW", "POST_VIEW"), (on_update, (), "WINDOW", "POST_PIXEL")]
    for _ in range(2):
        callbacks.remove()
        assert added == []
    assert not callbacks.are_added


@pytest.mark.parametrize(("keymap", "space_type"), [("Window", "EMPTY"), ("3D View", "VIEW_3D")])
def test_a_key_is_added_once_and_removed(keymap, space_type):
    def items():
        found = bpy.context.window_manager.keyconfigs.addon.keymaps.find(keymap, space_type=space_type)
        kinds = found.keymap_items if found else ()
        return [(item.idname, item.type, item.ctrl) for item in kinds if item.idname == "wm.search_menu"]

    key = Key("wm.search_menu", "F13", keymap, space_type, ctrl=True)
    key.add()
    assert items() == [("wm.search_menu", "F13", True)]
    key.remove()
    assert items() == []
