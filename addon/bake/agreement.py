# SPDX-License-Identifier: GPL-3.0-or-later
"""Do high and low share their UV layout? Measured: do the points of the same texel lie close in space?"""

from collections.abc import Sequence

import numpy as np

from ..mesh.arrays import Frame, Mesh, frame_of
from ..passes import batch, gbuffer, target

PROBE = 128
"""Texels a side of the two small maps of positions that are compared."""
CLOSE = 0.05
"""Of the low mesh's radius: points of one texel that lie nearer than this, along the surface, belong together."""
SHARE = 0.96
"""How many of the low mesh's texels must have such a point on the high meshes."""


def choose(low: Mesh, highs: Sequence[Mesh], tiles: Sequence[int]) -> tuple[str, str]:
    """The method for these meshes on these UDIM tiles, FLATTEN or CAST, and why, as a clause."""
    without = [high.name for high in highs if high.uv is None]
    if without:
        return "CAST", f"{without[0]!r} has no UV layer"
    frame = frame_of([low])
    (low_points, away), (high_points, _) = (_positions(meshes, frame, tiles) for meshes in ([low], highs))
    on_low = low_points[..., 3] > 0.0
    both = on_low & (high_points[..., 3] > 0.0)
    if not both.any():
        return "CAST", "the UV layouts have no texel in common"
    apart = (high_points - low_points)[both][:, :3]
    # Artists put the two side by side to look at them: what they differ by as a whole does not count.
    apart -= np.median(apart, axis=0)
    # Nor does detail, which stands up from the low surface; a layout that differs shows along it.
    away = away[both][:, :3]
    apart -= (apart * away).sum(axis=1, keepdims=True) * away
    share = np.count_nonzero(np.linalg.norm(apart, axis=1) < CLOSE) / np.count_nonzero(on_low)
    if share >= SHARE:
        return "FLATTEN", f"the UV layouts agree: on {share:.1%} of the texels the meshes' points lie close"
    return "CAST", f"the UV layouts differ: on {share:.1%} of the texels alone the meshes' points lie close"


def _positions(meshes: Sequence[Mesh], frame: Frame, tiles: Sequence[int]) -> list[np.ndarray]:
    """Positions and unit normals (tiles, PROBE, PROBE, 4) of `meshes` in UV space, alpha 0 where there are none."""
    probe = target.get("rays", PROBE, PROBE, "RGBA32F", "RGBA32F")
    result = [np.zeros((len(tiles), PROBE, PROBE, 4), np.float32) for _ in range(2)]
    drawn = np.empty((PROBE, PROBE, 4), np.float32)
    for mesh in meshes:
        uploaded = batch.upload(
            mesh.triangles,
            uv=mesh.uv,
            position=frame.points(mesh)[mesh.vertices],
            direction=mesh.to_world_normals(mesh.normals),
        )
        for number, tile in enumerate(tiles):
            gbuffer.draw(probe, uploaded, target.window(tile))
            for slot, texels in enumerate(result):
                probe.read(drawn, slot)
                np.copyto(texels[number], drawn, where=drawn[..., 3:] > 0.0)
    return result
