# SPDX-License-Identifier: GPL-3.0-or-later
"""Turns the normals of a source into the space of the settings."""

import gpu

from ...core.declarations import bases
from ...core.settings import Settings
from ...mesh.triangle_mesh import Mesh
from ...passes import target
from ...passes.adaptive import active
from ...passes.adaptive.active import Active
from ...passes.bake import tangent
from ..bands import Band
from ..dense.near_triangles import NearTriangles
from ..roles import role


class NormalSpace:
    """The space of the normals of a bake. basis: the low mesh with tangents; None for normals that keep the source's space.
    mesh: what was uploaded as `basis`."""

    def __init__(self, basis: gpu.types.GPUBatch | None, mesh: Mesh | None, settings: Settings):
        self.basis, self.mesh = basis, mesh
        self._near = NearTriangles(mesh)
        self.flags = bases.of_name(settings.basis).flags

    def draw(
        self,
        normals: gpu.types.GPUTexture,
        band: Band,
        rows: range | None = None,
        *,
        slot: int = 0,
        some: Active | None = None,
    ) -> gpu.types.GPUTexture:
        """The same normals in this space. rows: that are drawn. slot: as sources.Source has it. some: the texels that are
        drawn, beside those of the slots; None for all."""
        if self.basis is None:
            return normals
        into = target.get("low of some texels" if some else role("low", slot), band.width, band.height, "RGBA32F")
        if some:
            active.clear(into, some)
        tangent.draw(
            into,
            self.basis,
            normals,
            band.uv_to_clip,
            basis_flags=self.flags,
            rows=rows,
            clear=not some,
            stopped=some and some.stopped,
            parts=self._near.parts(band, some),
        )
        return into.texture
