# SPDX-License-Identifier: GPL-3.0-or-later
"""The GPU passes: plain arrays in, textures and arrays out. Nothing here knows of Blender's data, only of its gpu module."""

from . import shader, target


def free() -> None:
    """Free every GPU object that is kept between bakes. Blender crashes on exit while such objects live."""
    shader.load.cache_clear()
    target.common.free()
