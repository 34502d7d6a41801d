# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on: what Blender registers, in order, and takes back in reverse."""


def register() -> None:
    """Called by Blender when the extension is enabled."""
    import atexit

    import bpy

    from . import commands, operators, panels, properties

    for module in (properties, operators, panels, commands):
        module.register()
    handlers = bpy.app.handlers
    handlers.load_pre.append(handlers.persistent(_before_loading))  # it outlives the file that is left
    atexit.register(free)


def unregister() -> None:
    """Called by Blender when the extension is disabled."""
    import atexit

    import bpy

    from . import commands, operators, panels, preview, properties

    preview.show(False)
    for module in (commands, panels, operators, properties):
        module.unregister()
    bpy.app.handlers.load_pre.remove(_before_loading)
    atexit.unregister(free)
    free()


def free() -> None:
    """Free what is kept on the GPU between bakes. Blender crashes on exit while such objects live."""
    from . import passes
    from .bake import casting

    casting.free()
    passes.free()


def _before_loading(*_) -> None:
    from . import preview

    preview.show(False)
    free()
