# SPDX-License-Identifier: GPL-3.0-or-later
"""Registering and unregistering leave nothing behind, and each operator and property has a tooltip."""

import atexit

import bpy
import pytest

import addon
from addon.cli import command
from addon.passes import shader, target
from addon.ui import modal, more_panels, preferences, presets, settings_panels, view_gizmos
from addon.ui.callbacks import DrawCallbacks, Events, Key, Timer, events
from tests.support import maps, zoo

MODULES = [module for module in addon.modules() if hasattr(module, "CLASSES")]
OPERATORS = [cls.__name__ for module in MODULES for cls in module.CLASSES if issubclass(cls, bpy.types.Operator)]
PANELS = [
    cls
    for module in MODULES
    for cls in module.CLASSES
    if issubclass(cls, bpy.types.Panel) and cls is not presets.IMPRINT_PT_presets
]


def traces():
    """All data of the add-on in Blender."""
    kinds = (bpy.types.Operator, bpy.types.Panel, bpy.types.UIList, bpy.types.Menu, bpy.types.PropertyGroup)
    kinds += (bpy.types.AddonPreferences,)
    found = {cls.__name__ for kind in kinds for cls in kind.__subclasses__() if cls.is_registered and is_ours(cls)}
    gizmos = {view_gizmos.IMPRINT_GT_split: bpy.types.Gizmo, view_gizmos.IMPRINT_GGT_split: bpy.types.GizmoGroup}
    found |= {cls.__name__ for cls, kind in gizmos.items() if kind.bl_rna_get_subclass_py(cls.__name__)}
    found |= {f"Scene.{name}" for name in dir(bpy.types.Scene) if name.startswith("imprint")}
    keymaps = bpy.context.window_manager.keyconfigs.addon.keymaps
    keys = (key.idname for keymap in keymaps for key in keymap.keymap_items)
    found |= {f"key of {name}" for name in keys if name.startswith("imprint.")}
    return found | {name for name in dir(bpy.types.WindowManager) if name.startswith("imprint")}


def is_ours(cls):
    return cls.__name__.lower().startswith("imprint")


def test_registering_twice_leaves_nothing():
    assert traces() == set()
    for _ in range(2):
        addon.register()
        assert traces() >= {
            *OPERATORS,
            *(cls.__name__ for cls in PANELS),
            "ImprintSettings",
            "Scene.imprint",
            "IMPRINT_GT_split",
            "key of imprint.view_next",
        }
        assert command.is_registered()
        addon.unregister()
        assert traces() == set()
        assert not command.is_registered()


@pytest.mark.usefixtures("gpu_context")
def test_unregistering_frees_gpu_objects():
    """Blender crashes on exit if GPU objects still exist."""
    addon.register()
    maps.bake(zoo.plane("lo"), zoo.plane("hi"))
    assert len(target.common)
    assert shader.load.cache_info().currsize
    addon.unregister()
    assert not len(target.common)
    assert not shader.load.cache_info().currsize


def test_gpu_objects_are_freed_when_blender_ends(monkeypatch):
    at_exit = []
    monkeypatch.setattr(atexit, "register", at_exit.append)
    monkeypatch.setattr(atexit, "unregister", at_exit.remove)
    addon.register()
    assert at_exit == [addon.free]
    addon.unregister()
    assert at_exit == []


@pytest.mark.parametrize("module", [more_panels, settings_panels, modal], ids=lambda module: module.__name__)
def test_errors_while_registering_are_raised_and_leave_nothing(monkeypatch, module):
    """Also where the module has registered some of its classes."""

    def fail():
        bpy.utils.register_class(module.CLASSES[0])
        raise ValueError("already registered as a subclass")

    handlers = bpy.app.handlers.load_pre, bpy.app.handlers.save_pre, bpy.app.handlers.undo_post
    before = [list(each) for each in handlers]
    monkeypatch.setattr(module, "register", fail)
    with pytest.raises(ValueError, match="already registered"):
        addon.register()
    assert traces() == set()
    assert not command.is_registered()
    assert [list(each) for each in handlers] == before


# Callbacks


class Listener:
    """Each look-up of its method makes a new object, as for the add-on's classes."""

    def on_update(self, *_):
        return None


def test_a_timer_of_a_method_is_found_after_another_look_up(registered):
    timer = Timer(Listener().on_update)
    assert not timer.is_running
    for _ in range(2):
        timer.start(60.0)
        assert timer.is_running
    timer.stop()
    timer.stop()
    assert not timer.is_running
    timer.start(60.0)
    events.tell("end")
    assert not timer.is_running


def test_events_are_heard_between_registering_and_unregistering():
    heard, events = [], Events()
    events.hear(undo_post=lambda *_: heard.append("first"), end=lambda: heard.append("end"))
    events.hear(undo_post=lambda *_: heard.append("last"), end=lambda: heard.append("end of the last"))
    before = list(bpy.app.handlers.undo_post)
    events.register()
    (ours,) = (each for each in bpy.app.handlers.undo_post if each not in before)
    ours(bpy.context.scene)
    assert heard == ["first", "last"]
    events.tell("end")  # what came last may depend on what came first
    assert heard[2:] == ["end of the last", "end"]
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert ours in bpy.app.handlers.undo_post
    bpy.app.handlers.redo_post.clear()  # as some scripts do
    events.unregister()
    assert bpy.app.handlers.undo_post == before


def test_an_error_keeps_no_event_from_others():
    heard, events = [], Events()

    def fail():
        raise ValueError("a mistake")

    events.hear(end=lambda: heard.append("end"))
    events.hear(end=fail)
    with pytest.raises(ValueError, match="a mistake"):
        events.tell("end")
    assert heard == ["end"]


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


# First steps


def test_a_button_opens_the_sidebar(registered):
    opened = bpy.context.window_manager.windows[0]
    viewport = max((one for one in opened.screen.areas if one.type == "VIEW_3D"), key=lambda one: one.width)
    viewport.spaces.active.show_region_ui = False
    assert bpy.ops.imprint.show_panel() == {"FINISHED"}
    assert viewport.spaces.active.show_region_ui


def test_the_manual_is_the_site_or_else_a_page_that_is_packed(monkeypatch, tmp_path):
    page = preferences.manual_address()
    assert page.startswith("file:") and page.endswith("/README.md")
    (tmp_path / "blender_manifest.toml").write_text('website = "https://imprint.example"')
    monkeypatch.setattr(preferences, "ROOT", tmp_path)
    assert preferences.manual_address() == "https://imprint.example"
