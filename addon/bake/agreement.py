# SPDX-License-Identifier: GPL-3.0-or-later
"""Do high and low share their UV layout? Measured: do the points of the same texel lie close in space?"""

from collections.abc import Sequence

import numpy as np

from ..mesh.arrays import Mesh, frame_of
from ..passes import batch, gbuffer, target
from . import apart
from .apart import PROBE

CLOSE = 0.05
"""Of the low mesh's radius: points of one texel that lie nearer than this, along the surface, belong together."""
SHARE = 0.96
"""How many of the low mesh's texels must have such a point on the high meshes."""


def choose(low: Mesh, highs: Sequence[Mesh], tiles: Sequence[int]) -> tuple[str, str, np.ndarray | None]:
    """The method for these meshes on these UDIM tiles, FLATTEN or CAST, why, as a clause, and, for FLATTEN, what
    apart.probe sees of a large map."""
    without = [high.name for high in highs if high.uv is None]
    if without:
        return "CAST", f"{without[0]!r} has no UV layer", None
    texels = apart.probe(apart.flattened(low, highs), (PROBE, PROBE), tiles)
    on_low, both = texels[..., 3] != 0.0, texels[..., 3] > 0.0
    if not both.any():
        return "CAST", "the UV layouts have no texel in common", None
    # Artists put the two side by side to look at them: what they differ by as a whole does not count.
    between = (texels[both][:, :3] - apart.offset(texels, "FLATTEN")) / frame_of([low]).size
    # Nor does detail, which stands up from the low surface; a layout that differs shows along it.
    away = _directions(low, tiles)[both]
    between -= (between * away).sum(axis=1, keepdims=True) * away
    share = np.count_nonzero(np.linalg.norm(between, axis=1) < CLOSE) / np.count_nonzero(on_low)
    if share >= SHARE:
        return "FLATTEN", f"the UV layouts agree: on {share:.1%} of the texels the meshes' points lie close", texels
    return "CAST", f"the UV layouts differ: on {share:.1%} of the texels alone the meshes' points lie close", None


def _directions(low: Mesh, tiles: Sequence[int]) -> np.ndarray:
    """The unit normals (tiles, PROBE, PROBE, 3) of `low` in UV space."""
    uploaded = batch.upload(low.triangles, uv=low.uv, position=low.normals, direction=low.to_world_normals(low.normals))
    drawn = target.get("audit rays", PROBE, PROBE, "RGBA32F", "RGBA32F")
    result = np.empty((len(tiles), PROBE, PROBE, 4), np.float32)
    for number, tile in enumerate(tiles):
        gbuffer.draw(drawn, uploaded, target.window(tile))
        drawn.read(result[number], slot=1)
    return result[..., :3]
