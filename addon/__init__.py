# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on: what Blender registers, in order, and takes back in reverse."""


def register() -> None:
    """Called by Blender when the extension is enabled."""
    import atexit

    from . import commands, operators, panels, passes, properties

    for module in (properties, operators, panels, commands):
        module.register()
    atexit.register(passes.free)


def unregister() -> None:
    """Called by Blender when the extension is disabled."""
    import atexit

    from . import commands, operators, panels, passes, properties

    for module in (commands, panels, operators, properties):
        module.unregister()
    atexit.unregister(passes.free)
    passes.free()
