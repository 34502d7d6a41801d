"""Every program that the passes declare; found without Blender."""

import importlib
import pkgutil

from addon import passes
from addon.passes.shader import Program


def find_all() -> dict[str, Program]:
    """By module and name, as "bake.cast.TRACE"."""
    modules = [each.name for each in pkgutil.walk_packages(passes.__path__, f"{passes.__name__}.")]
    return {
        f"{module.removeprefix(passes.__name__ + '.')}.{name}": value
        for module in modules
        for name, value in vars(importlib.import_module(module)).items()
        if isinstance(value, Program)
    }
