# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's door to the extension.

Nothing is imported until Blender asks for it: the repository's root is this package, and pytest, which imports it on
its way to the tests, must not load the add-on with it.
"""


def register():
    """Register the add-on with Blender."""
    from . import addon

    addon.register()


def unregister():
    """Take the add-on out of Blender again."""
    from . import addon

    addon.unregister()
