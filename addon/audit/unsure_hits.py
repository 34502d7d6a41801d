# SPDX-License-Identifier: GPL-3.0-or-later
"""Counts the texels of a map whose hit may be on the wrong layer of the high mesh."""

import numpy as np

from ..core.settings import SamplingSettings
from ..engine.method_choice import Plan
from ..engine.rays.ray_casting import RayCast
from ..engine.rays.unsure_texels import REASONS, Explorer
from .severity import Check
from .sparse_maps import at_most

SAMPLES_A_SIDE = 128
"""Texels a side, at most, whose rays are followed farther."""


def check(plan: Plan, settings: SamplingSettings, ray_cast: RayCast | None) -> tuple[Check, np.ndarray]:
    """The check "unsure" of Report.checks, without its severity, and the distances (N,) float32 of the hits, in scene units.

    ray_cast: the rays of the bake, or None: then both are empty.
    """
    names = "count", "of", "not_owned", *REASONS
    counts, distances = dict.fromkeys(names, 0), [np.empty(0, np.float32)]
    if ray_cast is not None:
        explorer = Explorer(ray_cast, plan.meshes.whole_low)
        sparse = at_most(settings.size, SAMPLES_A_SIDE)
        for tile in plan.tiles:
            doubts, far = explorer.sample(sparse.small, sparse.uv_to_clip(tile), sparse.uv_to_clip(tile, shift=1))
            found = doubts.unsure, doubts.on_low, doubts.not_owned, *(getattr(doubts, reason) for reason in REASONS)
            for name, texels in zip(names, found, strict=True):
                counts[name] += int(np.count_nonzero(texels))
            distances.append(far)
    return counts | {"share": counts["count"] / max(1, counts["of"])}, np.concatenate(distances)
