# SPDX-License-Identifier: GPL-3.0-or-later
"""Do high and low share their UV layout? Measured: do the points of the same texel lie close in space?"""

from collections.abc import Sequence

import numpy as np

from ..mesh.arrays import Mesh, frame_of
from ..passes import batch, gbuffer, target

PROBE = 128
"""Texels a side of the two small maps of positions that are compared."""
CLOSE = 0.3
"""Of the low mesh's radius: points of one texel that lie nearer than this belong together."""
SHARE = 0.9
"""How many of the low mesh's texels must have such a point on the high meshes."""


def choose(low: Mesh, highs: Sequence[Mesh]) -> tuple[str, str]:
    """The method for these meshes, FLATTEN or CAST, and why, as a clause."""
    without = [high.name for high in highs if high.uv is None]
    if without:
        return "CAST", f"{without[0]!r} has no UV layer"
    frame = frame_of([low])
    low_points, high_points = (_positions(meshes, frame) for meshes in ([low], highs))
    on_low = low_points[..., 3] > 0.0
    both = on_low & (high_points[..., 3] > 0.0)
    if not both.any():
        return "CAST", "the UV layouts have no texel in common"
    apart = (high_points - low_points)[both][:, :3]
    # Artists put the two side by side to look at them: what they differ by as a whole does not count.
    apart -= np.median(apart, axis=0)
    share = np.count_nonzero(np.linalg.norm(apart, axis=1) < CLOSE) / np.count_nonzero(on_low)
    if share >= SHARE:
        return "FLATTEN", f"the UV layouts agree: on {share:.1%} of the texels the meshes' points lie close"
    return "CAST", f"the UV layouts differ: on {share:.1%} of the texels alone the meshes' points lie close"


def _positions(meshes: Sequence[Mesh], frame) -> np.ndarray:
    """Positions (PROBE, PROBE, 4) of `meshes` in UV space, alpha 0 where there are none."""
    probe = target.get("rays", PROBE, PROBE, "RGBA32F", "RGBA32F")
    result = np.zeros((PROBE, PROBE, 4), np.float32)
    drawn = np.empty_like(result)
    for mesh in meshes:
        uploaded = batch.upload(
            mesh.triangles, uv=mesh.uv, position=frame.points(mesh)[mesh.vertices], direction=np.ones_like(mesh.normals)
        )
        gbuffer.draw(probe, uploaded, (2.0, 2.0, -1.0, -1.0))
        probe.read(drawn)
        np.copyto(result, drawn, where=drawn[..., 3:] > 0.0)
    return result
