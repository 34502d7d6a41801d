# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on: what Blender registers, in order, and takes back in reverse."""


def register() -> None:
    """Called by Blender when the extension is enabled."""
    import atexit

    import bpy

    from .cli import command
    from .ui import check_panel, idle_memory, map_size, modal, operators, panels, presets, properties
    from .ui.viewport import view_mode

    for module in (
        properties,
        operators,
        map_size,
        presets,
        panels,
        check_panel,
        view_mode,
        command,
        idle_memory,
        modal,
    ):
        module.register()
    handlers = bpy.app.handlers
    handlers.load_pre.append(handlers.persistent(_before_loading))  # it outlives the file that is left
    atexit.register(free)


def unregister() -> None:
    """Called by Blender when the extension is disabled."""
    import atexit

    import bpy

    from .cli import command
    from .ui import (
        check_panel,
        idle_memory,
        live_mode,
        map_size,
        modal,
        operators,
        panels,
        presets,
        properties,
        results,
    )
    from .ui.viewport import cage_overlay, view_mode

    modal.stop(bpy.context)
    live_mode.stop()
    results.forget()
    cage_overlay.show(False)
    for module in (
        modal,
        idle_memory,
        command,
        view_mode,
        check_panel,
        panels,
        presets,
        map_size,
        operators,
        properties,
    ):
        module.unregister()
    bpy.app.handlers.load_pre.remove(_before_loading)
    atexit.unregister(free)
    free()


def free() -> None:
    """Free what is kept on the GPU between bakes. Blender crashes on exit while such objects live."""
    from . import passes
    from .engine import gpu_memory
    from .ui import live_mode
    from .ui.viewport import view_mode

    live_mode.free()
    view_mode.free()
    gpu_memory.free()
    passes.free()


def _before_loading(*_) -> None:
    import bpy

    from .ui import live_mode, modal, results
    from .ui.viewport import cage_overlay, view_mode

    modal.stop(bpy.context)
    live_mode.stop()
    results.forget()
    cage_overlay.show(False)
    view_mode.off()
    free()
