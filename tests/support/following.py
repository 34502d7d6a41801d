# SPDX-License-Identifier: GPL-3.0-or-later
"""Live in tests: on and off by its button, its timer run by hand, and its map beside that of a new bake."""

from collections.abc import Callable

import bpy
import numpy as np

from addon.core.settings import Settings
from addon.jobs import bake_pair
from addon.ui.live import live
from tests.support.maps import pixels


def switch(on: bool) -> None:
    """Press the button."""
    assert live.is_on != on
    assert bpy.ops.imprint.live() == {"FINISHED"}
    assert live.is_on == on


def follow(until: Callable[[], bool] = lambda: live.is_resting) -> int:
    """Run the timer until there is nothing to do. Returns the ticks that it took."""
    bpy.context.view_layer.update()
    for tick in range(2000):
        live.tick()
        if not live.is_on or until():
            return tick
    raise AssertionError("Live does not come to rest")


def shown(name: str = "lo_normal") -> np.ndarray:
    """The texels of an image."""
    return pixels(bpy.data.images[name])


def fresh(**changes) -> np.ndarray:
    """The texels of a new bake with the settings of the panel and viewport modifiers."""
    settings = bpy.context.scene.imprint
    chosen = settings.chosen(bpy.context)
    own = {"image": "fresh", "storage": "MEMORY", "material": False, "modifiers": "VIEWPORT"}
    values = settings.to_settings().flat() | own | changes
    bake_pair(bpy.context, chosen.low, chosen.highs, Settings(**values), settings.cage)
    return shown("fresh")


def is_fresh(**changes) -> bool:
    """Whether the map of Live is that of a new bake."""
    return np.array_equal(shown(), fresh(**changes))


def follows(*changes: Callable[[], object], **of_bake) -> None:
    """Make each change, and check that the map changes with it into that of a new bake. of_bake: as for `fresh`."""
    for change in changes:
        before = shown()
        change()
        follow()
        assert not np.array_equal(shown(), before)
        assert is_fresh(**of_bake)


def move(obj: bpy.types.Object, seed: int) -> None:
    """Move the vertices, as a sculpt stroke does."""
    points = np.empty(len(obj.data.vertices) * 3, np.float32)
    position = obj.data.attributes["position"].data
    position.foreach_get("vector", points)
    points[2::3] += np.random.default_rng(seed).normal(0, 0.02, len(points) // 3)
    position.foreach_set("vector", points)
    obj.data.update()
