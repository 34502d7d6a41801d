# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on: what Blender registers, in order, and takes back in reverse."""


def register() -> None:
    """Called by Blender when the extension is enabled."""
    import atexit

    import bpy

    from . import checks, commands, conventions, idle, modal, operators, panels, preview, properties, sizes

    for module in (properties, operators, sizes, conventions, panels, checks, preview, commands, idle, modal):
        module.register()
    handlers = bpy.app.handlers
    handlers.load_pre.append(handlers.persistent(_before_loading))  # it outlives the file that is left
    atexit.register(free)


def unregister() -> None:
    """Called by Blender when the extension is disabled."""
    import atexit

    import bpy

    from . import (
        cages,
        checks,
        commands,
        conventions,
        idle,
        live,
        modal,
        operators,
        panels,
        preview,
        properties,
        results,
        sizes,
    )

    modal.stop(bpy.context)
    live.stop()
    results.forget()
    cages.show(False)
    for module in (modal, idle, commands, preview, checks, panels, conventions, sizes, operators, properties):
        module.unregister()
    bpy.app.handlers.load_pre.remove(_before_loading)
    atexit.unregister(free)
    free()


def free() -> None:
    """Free what is kept on the GPU between bakes. Blender crashes on exit while such objects live."""
    from . import live, passes, preview
    from .bake import casting

    live.free()
    preview.free()
    casting.free()
    passes.free()


def _before_loading(*_) -> None:
    import bpy

    from . import cages, live, modal, preview, results

    modal.stop(bpy.context)
    live.stop()
    results.forget()
    cages.show(False)
    preview.off()
    free()
