# SPDX-License-Identifier: GPL-3.0-or-later
"""Which texels low meshes cover: those on which a bake of them may write."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core.settings import SamplingSettings
from ..mesh.triangle_mesh import Mesh
from ..passes import low_in_uv, mesh_upload, samples, target
from .bands import bands

TEXEL_BYTES = 2 * 16
"""Of the targets."""


def covered(lows: Sequence[Mesh], tile: int, sampling: SamplingSettings) -> np.ndarray:
    """The texels (height, width) bool of a tile that one of the samples of a bake of these meshes, with UVs, is on."""
    covered_texels = np.zeros(sampling.size[::-1], bool)
    for low in lows:
        points = np.take(low.positions, low.vertices, axis=0)
        batch = mesh_upload.upload(low.triangles, uv=low.uv, position=points, direction=low.normals)
        for band in bands(*sampling.size, 0, tile, texel_bytes=TEXEL_BYTES):
            drawn = target.get("covered", band.width, band.height, "RGBA32F", "RGBA32F")
            for offset in samples.offsets(sampling.samples):
                low_in_uv.draw_points(drawn, batch, replace(band, offset=offset).uv_to_clip)
                covered_texels[band.start : band.stop] |= drawn.texels()[..., 3] > 0.0
    return covered_texels
