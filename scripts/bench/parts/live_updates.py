# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures updates of the live map while a mesh is sculpted: its vertices move, its topology stays."""

import statistics
import time

import bpy
import gpu
import numpy as np

from addon.core import progress
from addon.core.settings import Settings
from addon.jobs import Job, live_session
from addon.passes import target
from tests.support import zoo

CASES = ((224, 1024, 1.0), (100, 512, 1.0), (708, 1024, 0.01))
"""Quads per side of the high terrain, two triangles each, texels per side of the map, and the share of vertices that move."""


ROUNDS, UPDATES = 5, 6
"""The number of rounds, and of updates in each."""


def measure() -> list[dict]:
    """Milliseconds until the GPU has the map, and from there to the image: the median of each round."""
    return [_measure(*case) for case in CASES]


def _measure(quads: int, size: int, share: float) -> dict:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    high, low = zoo.terrain("high", n=quads, waves=8), zoo.terrain("low", n=16)
    settings = Settings(method="FLATTEN", width=size, height=size, storage="MEMORY", modifiers="VIEWPORT")
    session = live_session.Session(bpy.context, Job(low, [high]), settings, progress.Pace())
    session.run(bpy.context)
    session.store()
    rng, position = np.random.default_rng(1), high.data.attributes["position"].data
    points = np.empty((len(high.data.vertices), 3), np.float32)
    position.foreach_get("vector", points.reshape(-1))
    touched = near(points, share)
    drawn, stored = [], []
    for _ in range(ROUNDS * UPDATES):
        points[touched, 2] += rng.normal(0, 1e-3, len(touched))
        position.foreach_set("vector", points.reshape(-1))
        high.data.update()
        bpy.context.view_layer.update()
        start = time.perf_counter()
        session.run(bpy.context, {high.session_uid})
        wait_for(session.map)
        between = time.perf_counter()
        session.store()
        drawn.append(1e3 * (between - start))
        stored.append(1e3 * (time.perf_counter() - between))
    session.free()
    return {
        "triangles": 2 * quads * quads,
        "touched": share,
        "size": size,
        "update_ms": _medians(drawn),
        "image_ms": _medians(stored),
    }


def wait_for(texture: gpu.types.GPUTexture) -> None:
    """Read one texel, so that the GPU has drawn all of them."""
    target.read(texture, np.empty((1, 1, 4), np.float32))


def near(points: np.ndarray, share: float) -> np.ndarray:
    """The indices of this share of the points (N, 3), those nearest to a place off the middle, as under a brush."""
    distances = np.linalg.norm(points[:, :2] - (0.3, 0.2), axis=1)
    return np.sort(np.argsort(distances, kind="stable")[: max(1, round(share * len(points)))])


def _medians(values: list[float]) -> list[float]:
    """The median of each round."""
    return [statistics.median(values[start : start + UPDATES]) for start in range(0, len(values), UPDATES)]
