# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension, and the package `imprint` for other programs: `imprint.bake(low, high, maps=..., size=...)`.

What works on meshes alone, as `imprint.weld(points, triangles)`, needs no Blender.

Nothing is imported until Blender or a program asks for it: the repository's root is this package, and pytest, which
imports it on its way to the tests, must not load the add-on with it.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .addon.api import Asset, BakeError, Encoded, NoGpu, Progress, Result, Surface, asset, bake, encode, unwrap

__all__ = [
    "Asset",
    "BakeError",
    "Encoded",
    "NoGpu",
    "Progress",
    "Result",
    "Surface",
    "asset",
    "bake",
    "encode",
    "unwrap",
]


def register() -> None:
    """Register the add-on with Blender."""
    from . import addon

    addon.register()


def unregister() -> None:
    """Take the add-on out of Blender again."""
    from . import addon

    addon.unregister()


def __getattr__(name: str) -> Any:
    from .addon.mesh import verbs

    if name in verbs.__all__:
        return getattr(verbs, name)
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        import bpy  # noqa: F401
    except ModuleNotFoundError as error:
        from .addon.core.errors import NO_BLENDER

        raise ImportError(NO_BLENDER) from error
    from .addon import api

    return getattr(api, name)
