# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures how far the low mesh with its map deviates from the high meshes: the angles between their normals."""

from collections.abc import Callable, Iterable
from functools import cached_property

import gpu
import numpy as np

from ..core.map_types import WRITTEN, Map
from ..core.settings import Settings
from ..engine import bands, normal_channels, uv_agreement
from ..engine.bands import Band
from ..engine.hidden_parts import HiddenParts, Layer
from ..engine.maps.sampling import SampledMaps
from ..engine.method_choice import Plan
from ..mesh.inputs import Meshes
from ..passes import lit, mesh_upload, target, viewport
from .angle_counts import AngleCounts
from .pictures.bake_pictures import BakePictures


class _Drawn:
    """What is measured together: the low mesh, or a layer of hidden parts. meshes, highs: of these triangles."""

    def __init__(self, meshes: Meshes, highs: SampledMaps, layer: Layer | None = None):
        self.meshes, self.highs, self.layer = meshes, highs, layer
        self.low = meshes.basis or meshes.low

    @cached_property
    def uploaded(self) -> gpu.types.GPUBatch:
        """The low mesh as viewport.measure_deviation takes it."""
        return mesh_upload.upload(self.low.triangles, **self.low.tangent_space)


class Deviations:
    """The angles at the centers of texels, with the map as it is kept, and read by its own basis.

    Each triangle of the low mesh counts at its own place, also where it shares texels that were drawn for another one. Texels
    on which Flatten draws another place of the high surface are left out. is_wanted: whether anything is measured. It takes
    about as long as one sample. pictures: receives them. kept: what images and files keep of rows of the map
    (rows, width, 4) float32. hidden: the parts of the low mesh that others hide.
    """

    def __init__(
        self,
        plan: Plan,
        highs: SampledMaps,
        settings: Settings,
        pictures: BakePictures | None = None,
        *,
        kept: Callable[[np.ndarray], np.ndarray],
        is_wanted: bool,
        hidden: HiddenParts,
    ):
        self._kept = kept
        self._plan, self._settings, self._pictures = plan, settings, pictures
        self._counts = AngleCounts() if is_wanted else None
        self._hidden, self._pool = hidden, target.TargetPool()
        self._whole = _Drawn(plan.meshes, highs)

    def add(self, tile: int, stored: Map) -> None:
        """Measure a UDIM tile of the normal map as it is stored, before rounding."""
        if self._counts is None:
            return
        size = stored[1].shape[::-1]
        self._add(tile, stored, bands.bands(*size, 0, tile), self._whole)
        with target.using(self._pool):
            for drawn in self._layers:
                self._add(tile, stored, drawn.layer.bands(size, tile), drawn)
        self._pool.free()

    @cached_property
    def _layers(self) -> list[_Drawn]:
        return [_Drawn(layer.meshes, layer.maps, layer) for layer in self._hidden.layers]

    def _add(self, tile: int, stored: Map, of_tile: Iterable[Band], drawn: _Drawn) -> None:
        """Measure some bands of a tile."""
        texels, state = stored
        elsewhere = self._elsewhere(tile, drawn.meshes)
        for band in of_tile:
            rows = slice(band.start, band.stop)
            part = np.arange(band.start, band.stop) * len(elsewhere) // len(state)
            texels_of_band = np.ascontiguousarray(self._kept(np.ascontiguousarray(texels[rows], np.float32)))
            angles = self._angles(band.without_halo, texels_of_band, elsewhere[part], drawn)
            is_drawn = state[rows] == WRITTEN
            if drawn.layer is not None:
                is_drawn &= (angles[..., 3] != 0.0) & self._hidden.is_hidden(drawn.layer, band)
            is_known = is_drawn & (angles[..., 3] > 0.0)
            self._counts.add(angles[is_known][:, 0])
            if self._pictures is not None:
                self._pictures.add_degrees(tile, band.start, angles[..., 0], is_known, is_drawn)

    def add_raw(self, tile: int, normals: np.ndarray) -> None:
        """Measure a tile of normals as rendering.Renderer.raw returns them."""
        if self._counts is not None:
            self.add(tile, normal_channels.stored(normals, self._settings))

    def results(self) -> dict[str, float | int]:
        """The figures as Report.deviation has them; empty if no texel was measured."""
        found = self._counts.results() if self._counts else {}
        return found if found.get("texels") else {}

    def _elsewhere(self, tile: int, meshes: Meshes) -> np.ndarray:
        """Where the high surface that is drawn is another place, as viewport.measure_deviation takes it."""
        if self._plan.casts_rays or meshes.is_own_base:
            return np.zeros((1, 1), bool)
        return uv_agreement.mismatched(meshes.low, meshes.drawn_highs, tile)

    def _angles(self, band: Band, texels: np.ndarray, elsewhere: np.ndarray, drawn: _Drawn) -> np.ndarray:
        """What viewport.measure_deviation writes, (height, width, 4) float32."""
        low, settings = drawn.low, self._settings
        data = gpu.types.Buffer("FLOAT", texels.shape, texels)
        normal_map = gpu.types.GPUTexture((band.width, band.height), format="RGBA32F", data=data)
        read = normal_channels.reading(settings.map)
        measured = target.get("deviation", band.width, band.height, "RGBA32F")
        viewport.measure_deviation(
            measured,
            drawn.uploaded,
            normal_map,
            drawn.highs.high_normals(band),
            lit.shading(low.normal_matrix, read=read),
            elsewhere=elsewhere,
            stretch=low.stretch,
            uv_to_clip=band.uv_to_clip,
        )
        values = np.empty((band.height, band.width, 4), np.float32)
        measured.read(values)
        return values
