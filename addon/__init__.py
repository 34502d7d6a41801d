# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on: what Blender registers, in order, and removes in reverse order; and the program of an installed package."""

import sys
from contextlib import ExitStack
from types import ModuleType


def register() -> None:
    """Called by Blender when the extension is enabled. If it raises, nothing stays registered."""
    import atexit

    import bpy

    from .cli import set_options

    set_options.read = scene_sets
    with ExitStack() as undo:
        for module in modules():
            with ExitStack() as undo_failed:
                undo_failed.callback(_unregister_classes, module)
                module.register()
                undo_failed.pop_all()
            undo.callback(module.unregister)
        undo.pop_all()
    bpy.app.handlers.load_pre.append(bpy.app.handlers.persistent(before_loading))  # it stays for the next file
    atexit.register(free)


def _unregister_classes(module: ModuleType) -> None:
    """Remove the classes of a module that has failed to register, which may lack some of them."""
    import bpy

    for each in reversed(list(vars(module).values())):
        if isinstance(each, type) and each.__module__ == module.__name__ and getattr(each, "is_registered", False):
            bpy.utils.unregister_class(each)


def unregister() -> None:
    """Called by Blender when the extension is disabled."""
    import atexit

    import bpy

    from .ui.callbacks import events

    events.tell("end")
    for module in reversed(modules()):
        module.unregister()
    if before_loading in bpy.app.handlers.load_pre:  # scripts clear such lists
        bpy.app.handlers.load_pre.remove(before_loading)
    atexit.unregister(free)
    free()


def run(words: list[str]) -> int:
    """Do what `words`, the arguments, say in a process that does nothing else. Returns the exit code.

    scripts/bake.py calls it, inside Blender and outside.
    """
    from .cli import command, interruption, set_options, standard_streams
    from .core.progress import startup

    startup.add_launcher()
    set_options.read = scene_sets
    standard_streams.reserve()
    interruption.listen()  # before bpy is loaded, which takes a second and crashes on exceptions
    try:
        code = command.run(words, may_start_processes=True)
    finally:
        free()  # Blender crashes on exit while GPU objects exist
    return interruption.leave() or code


def main() -> None:
    """The program `imprint` of an installed package."""
    from .cli import blender_process

    words = sys.argv[1:]
    code = run(words[1:] if words[:1] == ["bake"] else words)  # as scripts/imprint.py names it
    blender_process.end(code)
    sys.exit(code)


def scene_sets() -> list:
    """The sets of the open file, as core.scene_sets.SceneSet, also where the add-on is not enabled: for the command line."""
    from .ui import set_description

    with set_description.registered():
        return set_description.described()


def free() -> None:
    """Free what is kept on the GPU between bakes. Blender crashes on exit while such objects live."""
    if "gpu" not in sys.modules:
        return
    from . import passes
    from .engine import gpu_memory

    if callbacks := sys.modules.get(f"{__name__}.ui.callbacks"):  # not without a window
        callbacks.events.tell("free")
    gpu_memory.free()
    passes.free()


def modules() -> tuple[ModuleType, ...]:
    """What has something to register, in this order: a panel after its parent. Imported only when Blender asks for it."""
    from .cli import command
    from .ui import (
        bake_operators,
        bake_panel,
        bake_queue,
        bake_results,
        cage_overlay,
        callbacks,
        check_panel,
        findings,
        fix_buttons,
        gpu_button,
        held_files,
        job_files,
        modal,
        more_panels,
        object_pairs,
        pair_operators,
        preferences,
        presets,
        properties,
        results_panel,
        set_lists,
        set_operators,
        sets,
        sets_panel,
        settings_panels,
        texts,
        view_gizmos,
        view_panel,
    )

    return (
        callbacks,
        texts,
        object_pairs,
        properties,
        sets,
        set_lists,
        held_files,
        preferences,
        presets,
        sets_panel,
        bake_panel,
        settings_panels,
        results_panel,
        check_panel,
        findings,
        fix_buttons,
        view_panel,
        view_gizmos,
        gpu_button,
        bake_operators,
        set_operators,
        job_files,
        bake_queue,
        pair_operators,
        more_panels,
        bake_results,
        cage_overlay,
        command,
        modal,
    )


def before_loading(*_) -> None:
    """Called by Blender before it opens another file."""
    from .ui.callbacks import events

    events.tell("end")
    free()
