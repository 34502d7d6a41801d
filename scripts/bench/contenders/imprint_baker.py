# SPDX-License-Identifier: GPL-3.0-or-later
"""Imprint as one of the bakers."""

import statistics
import time

import bpy
import numpy as np

from addon.core.settings import Settings
from addon.engine.rays import tree_cache
from addon.jobs import bake_pair
from scripts.bench.contenders.blender_bakers import normals_of
from scripts.bench.contenders.racing import Contender
from scripts.bench.scenes import Pair


class Imprint(Contender):
    """Imprint, from the objects to an image in the low object's material. keep: whether bakes reuse the ray tree."""

    def __init__(self, name: str, pair: Pair, size: int, *, keep: bool = False, **settings):
        self.pair, self.size, self.keep, self.stages = pair, size, keep, []
        if settings["method"] == "CAST":
            settings |= {"extrusion": pair.extrusion, "max_distance": 2.0 * pair.extrusion}
        settings = {"image": name, **settings}
        self.image = settings["image"]
        self.settings = Settings(width=size, height=size, depth=32, storage="MEMORY", **settings)
        super().__init__(name, self._bake, self._normals)

    def _bake(self) -> float:
        if not self.keep:
            tree_cache.trees.free()
        start = time.perf_counter()
        report = bake_pair(bpy.context, self.pair.low, [self.pair.high], self.settings)
        seconds = time.perf_counter() - start
        self.stages.append(report.seconds)
        return seconds

    def _normals(self) -> np.ndarray:
        return normals_of(bpy.data.images[self.image], self.size)

    def median_stages(self) -> dict[str, float]:
        return {name: statistics.median(s[name] for s in self.stages[1:]) for name in self.stages[0]}
