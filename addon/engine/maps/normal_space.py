# SPDX-License-Identifier: GPL-3.0-or-later
"""Turns the normals of a source into the space of the settings."""

import math
from dataclasses import replace

import gpu
import numpy as np

from ...core.declarations import bases
from ...core.settings import Settings
from ...core.udim import UvToClip
from ...mesh import uv_blocks
from ...mesh.triangle_mesh import Mesh
from ...passes import mesh_upload, target
from ...passes.bake import samples, tangent
from ..bands import Band

CENTER = (0.0, 0.0)
BLOCK = 8
"""The side of the squares of texels in which triangles are looked for."""


class NormalSpace:
    """The space of the normals of a bake. basis: the low mesh with tangents; None for normals that keep the source's
    space. mesh: what was uploaded as `basis`."""

    def __init__(self, basis: gpu.types.GPUBatch | None, mesh: Mesh | None, settings: Settings):
        self.basis, self.mesh = basis, mesh
        self.flags = bases.of_name(settings.map.basis).flags
        # The last one that is drawn over a texel stays: the one closest to the center.
        beside = [offset for offset in samples.offsets(settings.sampling.samples) if offset != CENTER]
        self._beside = sorted(beside, key=lambda offset: -math.hypot(*offset))

    def of_sample(self, normals: gpu.types.GPUTexture, band: Band) -> gpu.types.GPUTexture:
        """The normals of one sample in this space, by the tangents at its place."""
        return normals if self.basis is None else self._drawn("low", normals, band).texture

    def of_texels(self, normals: gpu.types.GPUTexture, band: Band, role: str = "low") -> gpu.types.GPUTexture:
        """The means of all samples in this space, by the tangents at the centers of texels, where programs read them.

        Where the low mesh covers samples but not the center, by those at the sample closest to it. role: of the target.
        """
        if self.basis is None:
            return normals
        into = self._drawn(role, normals, replace(band, offset=CENTER))
        if self._beside:
            self._draw_beside(into, normals, band)
        return into.texture

    def _draw_beside(self, into: target.Target, normals: gpu.types.GPUTexture, band: Band) -> None:
        """Turn the texels whose center the low mesh does not cover."""
        stopped, places = tangent.left(normals, into)
        size, blocks = (band.width, band.height), np.zeros((-(-band.height // BLOCK), -(-band.width // BLOCK)), bool)
        blocks[tuple(places.T // BLOCK)] = True
        near = uv_blocks.touching(self.mesh, replace(band, offset=CENTER).uv_to_clip, size, blocks, BLOCK)
        if not near.any():
            return
        mesh, corners = self.mesh, self.mesh.triangles[near].reshape(-1)
        low = mesh_upload.upload_corners(
            uv=mesh.uv[corners], normal=mesh.normals[corners], tangent=mesh.tangents[corners]
        )
        for offset in self._beside:
            to_clip = replace(band, offset=offset).uv_to_clip
            self._turn(into, low, normals, to_clip, clear=False, stopped=stopped)

    def _drawn(self, role: str, normals: gpu.types.GPUTexture, band: Band) -> target.Target:
        into = target.get(role, band.width, band.height, "RGBA32F")
        self._turn(into, self.basis, normals, band.uv_to_clip)
        return into

    def _turn(
        self, into: target.Target, low: gpu.types.GPUBatch, normals: gpu.types.GPUTexture, to_clip: UvToClip, **how
    ) -> None:
        tangent.draw(into, low, normals, to_clip, basis_flags=self.flags, stretch=self.mesh.stretch, **how)
