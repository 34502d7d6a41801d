# SPDX-License-Identifier: GPL-3.0-or-later
"""Frees the trees and render targets that bakes cache on the GPU."""

import atexit
from collections.abc import Iterator
from contextlib import contextmanager

from .. import passes
from ..core.errors import NoGpuMemory
from ..passes import target
from . import tree_cache

IDLE_SECONDS = 60.0
"""So long after the last bake, what it cached is freed."""


@contextmanager
def trimmed() -> Iterator[None]:
    """At the end of the block, free trees or targets that hold more than their bounds; all, if the GPU refused memory."""
    try:
        yield
    except NoGpuMemory:
        free()
        raise
    finally:
        target.common.trim()
        tree_cache.trees.trim()


def free() -> None:
    """Free trees and targets; the next bake makes new ones."""
    target.common.free()
    tree_cache.trees.free()


def free_if_idle() -> None:
    """Free trees and targets if no bake has drawn for IDLE_SECONDS."""
    if target.common.idle_seconds > IDLE_SECONDS:
        free()


# Python crashes on exit while GPU objects live, with or without the add-on's registering.
atexit.register(passes.free)
atexit.register(free)
