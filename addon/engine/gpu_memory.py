# SPDX-License-Identifier: GPL-3.0-or-later
"""What bakes keep on the GPU for the next one, and how long."""

from ..passes import target
from . import ray_casting


def let_go(after: float) -> None:
    """Free trees and targets if nothing was drawn for so many seconds; the next bake makes them anew."""
    if target.idle() > after:
        ray_casting.free()
        target.free()
