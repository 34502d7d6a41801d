# SPDX-License-Identifier: GPL-3.0-or-later
"""The triangles of a mesh that lie near some texels of a map, found once for all samples of these texels."""

from dataclasses import replace

import numpy as np

from ...mesh import uv_blocks
from ...mesh.triangle_mesh import Mesh
from ...passes import adaptive
from ...passes.adaptive import Active
from ..bands import Band

MOST_PARTS = 256
"""The most ranges of triangles that are drawn one after the other: with more, drawing them takes longer than what they save."""


class NearTriangles:
    """The triangles of `mesh` near the texels that were asked for last."""

    def __init__(self, mesh: Mesh):
        self.mesh = mesh
        self._some: Active | None = None
        self._parts: list[tuple[int, int]] = []

    def parts(self, band: Band, some: Active | None) -> list[tuple[int, int]] | None:
        """As mesh_upload.draw takes them, for a batch with the triangles of the mesh in their order."""
        if some is None:
            return None
        if some is not self._some:
            self._some, self._parts = some, uv_blocks.runs(near(self.mesh, band, some), MOST_PARTS)
        return self._parts


def near(mesh: Mesh, band: Band, some: Active) -> np.ndarray:
    """Which triangles (T,) bool may cover a sample of these texels."""
    size = band.width, band.height
    return uv_blocks.touching(mesh, replace(band, offset=(0.0, 0.0)).uv_to_clip, size, some.blocks, adaptive.BLOCK)
