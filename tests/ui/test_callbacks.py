# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender calls is added once however often it is asked for, and removed without a trace."""

import bpy
import pytest

from addon.ui.callbacks import DrawCallbacks, Handlers, Key, Timer


class Listener:
    """Its methods are other objects each time that they are looked up, as those of the add-on's objects are."""

    def hear(self, *_):
        return None


def test_a_timer_of_a_method_is_found_again():
    timer = Timer(Listener().hear)
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
    handlers = Handlers(("undo_post", listener.hear), ("save_pre", listener.hear))
    for _ in range(2):
        handlers.add()
        assert bpy.app.handlers.undo_post == [*before, listener.hear]
    assert handlers.are_added
    bpy.app.handlers.save_pre.remove(listener.hear)  # as when another file is opened
    for _ in range(2):
        handlers.remove()
        assert bpy.app.handlers.undo_post == before
    assert not handlers.are_added


def test_what_draws_is_added_once_and_removed(monkeypatch):
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

    hear = Listener().hear
    callbacks = DrawCallbacks((Editor, hear, "POST_VIEW"), (Editor, hear, "POST_PIXEL"))
    for _ in range(2):
        callbacks.add()
        assert added == [(hear, (), "WINDOW", "POST_VIEW"), (hear, (), "WINDOW", "POST_PIXEL")]
    for _ in range(2):
        callbacks.remove()
        assert added == []
    assert not callbacks.are_added


@pytest.mark.parametrize(("keymap", "space_type"), [("Window", "EMPTY"), ("3D View", "VIEW_3D")])
def test_a_key_comes_and_goes(keymap, space_type):
    def items():
        found = bpy.context.window_manager.keyconfigs.addon.keymaps.find(keymap, space_type=space_type)
        kinds = found.keymap_items if found else ()
        return [(item.idname, item.type, item.ctrl) for item in kinds if item.idname == "wm.search_menu"]

    key = Key("wm.search_menu", "F13", keymap, space_type, ctrl=True)
    key.add()
    assert items() == [("wm.search_menu", "F13", True)]
    key.remove()
    assert items() == []
