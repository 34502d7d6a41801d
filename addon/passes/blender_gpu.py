# SPDX-License-Identifier: GPL-3.0-or-later
"""Stands for Blender's gpu module, which it imports when it is first used: shaders are declared without Blender."""

from typing import Any


def __getattr__(name: str) -> Any:
    import gpu

    return getattr(gpu, name)
