# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the maps beside the normal map: height, position, displacement, distance, coverage and IDs, in scene units."""

import gpu
import numpy as np

from ..core.declarations.choices import Space
from ..core.map_types import BY_NAME
from ..core.settings import Settings
from ..mesh.local_space import LocalSpace
from ..mesh.triangle_mesh import Mesh
from ..passes import mesh_upload, target
from ..passes.bake import gbuffer, other_map_pass
from .bands import Band


class OtherMaps:
    """Draws maps from the points of the low mesh and of the high meshes. Both are in `local_space`."""

    def __init__(self, low: Mesh, local_space: LocalSpace, settings: Settings):
        self.local_space = local_space
        self.low = mesh_upload.upload(
            low.triangles,
            uv=low.uv,
            position=local_space.points(low)[low.vertices],
            direction=low.to_world_normals(low.normals),
        )
        # Positions and vectors are in the space of the normals: the low object's, or the world's.
        from_world = np.eye(4) if settings.space == Space.WORLD else np.linalg.inv(low.to_world)
        self.to_space = from_world[:3, :3] * local_space.size
        self.origin = from_world[:3, :3] @ local_space.origin + from_world[:3, 3]

    def start(self, band: Band) -> None:
        """Select the band that `draw` draws."""
        self.low_points = target.get("low points", band.width, band.height, "RGBA32F", "RGBA32F")
        gbuffer.draw(self.low_points, self.low, band.uv_to_clip)

    def draw(
        self, into: target.Target, name: str, normals: gpu.types.GPUTexture, points: target.Target
    ) -> gpu.types.GPUTexture:
        """Draw the map of this name into `into` (RGBA32F), with the alpha of `normals`. Returns its texture."""
        other_map_pass.draw(
            into,
            BY_NAME[name],
            normals,
            points,
            self.low_points,
            to_space=self.to_space,
            origin=self.origin,
            scale=self.local_space.size,
        )
        return into.texture
