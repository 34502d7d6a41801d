# SPDX-License-Identifier: GPL-3.0-or-later
"""The GPU passes. They take arrays and return textures and arrays; of Blender they use the gpu module only."""

from . import shader, target


def free() -> None:
    """Free all GPU objects that are cached between bakes. Blender crashes on exit while such objects exist."""
    shader.load.cache_clear()
    target.common.free()
