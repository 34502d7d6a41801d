# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares the detail of parts of a low mesh that share texels: all of them show that of one."""

import numpy as np

from ..core.declarations.choices import Space
from ..core.settings import Settings
from ..engine.bands import Band
from ..engine.hidden_parts import HiddenParts
from ..engine.maps.sampling import SampledMaps
from ..engine.method_choice import Plan
from ..passes import target
from .severity import MUCH_OVERLAP, Check

SIDE = 256
"""Texels a side, at most, on which detail is compared."""
DIFFERENT = 2.0
"""Degrees, in tangent space, above which parts do not have the same detail."""


def check(
    plan: Plan, hidden: HiddenParts, drawn: SampledMaps, settings: Settings, materials: np.ndarray | None = None
) -> Check:
    """What Report.checks has of hidden parts, for the check "overlap". drawn: the maps of the bake. materials (T,) int: the
    number of each low triangle's material; None to leave them out."""
    found = {"hidden": hidden.triangles, "under_others": 0, "differing": 0.0}
    if hidden.share <= MUCH_OVERLAP:  # decimation leaves slivers on other triangles
        return found | {"hidden": 0}
    if settings.map.space != Space.TANGENT or not settings.map.normal:  # each part has other normals in other spaces
        return found
    if materials is not None:
        found["under_others"] = hidden.under_others(materials)
    compared = differing = 0
    size = min(settings.sampling.width, SIDE), min(settings.sampling.height, SIDE)
    with target.using(target.TargetPool()):
        for tile in plan.tiles:
            band = Band(0, size[1], size, 0, tile)
            shown, is_shown = _detail(drawn, band)
            for layer in hidden.layers:
                own, is_known = _detail(layer.maps, band)
                both = is_known & is_shown & hidden.is_hidden(layer, band)
                cosines = (shown[both] * own[both]).sum(axis=1)
                compared += len(cosines)
                differing += int(np.count_nonzero(cosines < np.cos(np.radians(DIFFERENT))))
    return found | {"differing": differing / max(1, compared)}


def _detail(maps: SampledMaps, band: Band) -> tuple[np.ndarray, np.ndarray]:
    """The normals of the high surface (height, width, 3) in tangent space, and where they are known (height, width) bool."""
    texels = np.empty((band.height, band.width, 4), np.float32)
    target.read(maps.space.of_sample(maps.high_normals(band), band), texels)
    return texels[..., :3], texels[..., 3] > 0.0
