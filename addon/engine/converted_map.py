# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws an existing normal map in another space or tangent basis, on the same low mesh."""

from collections.abc import Iterator
from dataclasses import dataclass

import gpu
import numpy as np

from ..core.declarations import bases
from ..core.declarations.choices import Space
from ..core.map_types import NORMAL
from ..core.progress import Task
from ..core.settings import MapSettings
from ..core.stored_normals import StoredNormals
from ..mesh import triangle_mesh
from ..mesh.triangle_mesh import Mesh
from ..passes import data_texture, lit, low_in_uv, mesh_upload, target
from .bands import Band, BandMaps, upload_band
from .normal_space import channels

NEAR_UNIT = 0.25
"""How much the length of a stored normal may differ from 1. Means of normals are shorter."""


@dataclass
class Fit:
    """How the texels of a map fit the low mesh that it was read on: numbers of texels that the mesh covers.

    Attributes:
        directed: Those with a normal.
        missed: With alpha 0.
        unit: With a length near 1.
        away: Whose normal points into the mesh.
        covered: All of them.
    """

    covered: int = 0
    directed: int = 0
    missed: int = 0
    unit: int = 0
    away: int = 0

    def add(self, lengths: np.ndarray) -> None:
        """Count texels. lengths: as the second texture of low_in_uv.draw_map_normals."""
        length = np.abs(lengths[lengths != 0.0])
        is_missed, is_directed = length == low_in_uv.MISSED, length < low_in_uv.NO_DIRECTION
        self.covered += len(length)
        self.missed += int(np.count_nonzero(is_missed))
        self.directed += int(np.count_nonzero(is_directed))
        self.unit += int(np.count_nonzero(np.abs(length - 1.0) <= NEAR_UNIT))
        self.away += int(np.count_nonzero(lengths < 0.0))


class ConvertedMap(BandMaps):
    """The normals of a stored map, in the space and the basis of the settings.

    low: with UVs and normals, and with tangents as they were read if one of the spaces is tangent. before: what the stored map
    means.
    """

    def __init__(self, low: Mesh, before: StoredNormals, map_settings: MapSettings):
        shown = triangle_mesh.with_stretch(low, before.from_basis) if before.from_space == Space.TANGENT else low
        self._wanted = (
            triangle_mesh.with_stretch(low, map_settings.basis) if map_settings.space == Space.TANGENT else low
        )
        self._before = _upload(shown)
        self._after = self._before if self._wanted.stretch is shown.stretch else _upload(self._wanted)
        self._shading = _shading(shown, before, map_settings)
        self._flags = bases.of_name(map_settings.basis).flags if map_settings.space == Space.TANGENT else None
        self.texels = np.zeros((0, 0, 4), np.float32)
        """The stored map of the current tile, (height, width, 4) float32; alpha 0 for texels without a normal."""
        self.fit = Fit()

    def of(self, band: Band) -> Task[Iterator[tuple[str, gpu.types.GPUTexture]]]:
        yield from ()
        return self._drawn(band)

    def _drawn(self, band: Band) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        decoded = target.get("map normals", band.width, band.height, "RGBA32F", "R16F")
        low_in_uv.draw_map_normals(
            decoded, self._before, upload_band(self.texels, band), band.uv_to_clip, self._shading
        )
        self._count(decoded, band)
        if self._flags is None:
            yield NORMAL.name, decoded.texture
            return
        into = target.get("low", band.width, band.height, "RGBA32F")
        how = {"basis_flags": self._flags, "stretch": self._wanted.stretch}
        low_in_uv.draw_in_tangent_space(into, self._after, decoded.texture, band.uv_to_clip, **how)
        yield NORMAL.name, into.texture

    def _count(self, decoded: target.Target, band: Band) -> None:
        self.fit.add(decoded.texels(1)[band.halo : band.height - band.halo])


class DecodedOnLow:
    """Tangent-space normals by the basis of a bake, as its low mesh shows them.

    low: with tangents, as `triangle_mesh.with_stretch` has it for that basis.
    """

    def __init__(self, low: Mesh, map_settings: MapSettings):
        before = StoredNormals(from_space=Space.TANGENT, from_basis=map_settings.basis)
        self._low, self._shading = _upload(low), _shading(low, before, map_settings)

    def texels(self, stored: np.ndarray, band: Band) -> np.ndarray:
        """The normals (rows, columns, 4) in the low object's space, alpha 1, from those that are stored, (rows, columns, 4)."""
        decoded = target.get("map normals", band.width, band.height, "RGBA32F", "R16F")
        low_in_uv.draw_map_normals(decoded, self._low, data_texture.image(stored), band.uv_to_clip, self._shading)
        return decoded.texels()


def _upload(low: Mesh) -> gpu.types.GPUBatch:
    return mesh_upload.upload(low.triangles, **low.tangent_space)


def _shading(low: Mesh, before: StoredNormals, map_settings: MapSettings) -> np.ndarray:
    """How map_lib.glsl decodes the stored map: into the low object's space, or into world space if the settings say that."""
    to_world = map_settings.space == Space.WORLD
    of_low = low.normal_matrix if to_world else np.eye(3) if low.stretch is None else low.stretch.T
    kind = lit.OBJECT
    if before.from_space == Space.TANGENT:
        kind = lit.TANGENT + bases.of_name(before.from_basis).flags
    elif before.from_space == Space.WORLD:
        kind = lit.WORLD if to_world else lit.OBJECT
        of_low = of_low if to_world else low.to_world[:3, :3].T / np.abs(low.to_world[:3, :3]).max()
    light = np.array([float(to_world or low.stretch is not None), 0.0, 0.0, 0.0])
    return lit.shading(of_low, light, read=lit.reading(kind, channels(before.channels)))
