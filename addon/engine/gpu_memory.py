# SPDX-License-Identifier: GPL-3.0-or-later
"""What bakes keep on the GPU for the next one, and how long."""

from ..passes import target
from . import ray_casting


def trim() -> None:
    """Free trees or targets that hold more than their bounds, at the end of a bake."""
    target.common.trim()
    ray_casting.trees.trim()


def free() -> None:
    """Free trees and targets; the next bake makes them anew."""
    target.common.free()
    ray_casting.trees.free()


def free_if_idle(seconds: float) -> None:
    """Free trees and targets if no bake has drawn for so many seconds."""
    if target.common.idle_seconds > seconds:
        free()
