# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures what the programs that the settings name would show of a tangent-space map: by how many degrees they are off."""

import gpu
import numpy as np

from ..core.declarations import bases, readers
from ..core.declarations.choices import Space
from ..core.map_types import WRITTEN, Map
from ..core.settings import Settings
from ..engine import bands, normal_channels
from ..mesh import stretch
from ..mesh.triangle_mesh import Mesh
from ..passes import audit, mesh_upload
from .angle_counts import AngleCounts


class OtherReaders:
    """The angles between the normals that a map means, before it is rounded, and those that programs show of it.

    low: the low mesh with its tangents; None for a map in another space, which has no readers. warnings: names the programs
    that cannot be measured, as they make other tangents of an unevenly scaled mesh.
    """

    def __init__(self, low: Mesh | None, settings: Settings):
        is_measured = low is not None and settings.map.space == Space.TANGENT and settings.map.normal
        wanted = [readers.BY_NAME[name] for name in settings.map.readers] if is_measured else []
        own = bases.of_name(settings.map.basis)
        is_uneven = bool(wanted) and stretch.is_uneven(low.to_world)
        self.readers = [reader for reader in wanted if not is_uneven or reader.basis.has_tangents_of(own)]
        unlike = ", ".join(reader.label for reader in wanted if reader not in self.readers)
        self.warnings = []
        if unlike:
            self.warnings.append(
                f"{unlike}: of {low.name!r}, which is scaled more along one axis than along another, other tangents are made "
                "there than the map is for. Apply the scale (Object > Apply > Scale) and bake again."
            )
        self.low, self.settings = low, settings
        self._counts = {reader.name: AngleCounts() for reader in self.readers}
        self._uploaded: gpu.types.GPUBatch | None = None

    def add(self, tile: int, stored: Map) -> None:
        """Measure a UDIM tile of the normal map as it is stored, before rounding."""
        if not self.readers:
            return
        texels, state = stored
        if self._uploaded is None:
            low = self.low
            self._uploaded = mesh_upload.upload(low.triangles, uv=low.uv, normal=low.normals, tangent=low.tangents)
        own = normal_channels.reading(self.settings.map)
        for band in bands.bands(state.shape[1], state.shape[0], 0, tile):
            rows = np.ascontiguousarray(texels[band.start : band.stop], np.float32)
            data = gpu.types.Buffer("FLOAT", rows.shape, rows)
            texture = gpu.types.GPUTexture((band.width, len(rows)), format="RGBA32F", data=data)
            is_written = state[band.start : band.stop] == WRITTEN
            to_clip = band.without_halo.uv_to_clip
            for reader in self.readers:
                other = normal_channels.reading_by(reader, self.settings)
                angles = audit.measure_reader_angles(self._uploaded, texture, to_clip, own, other)
                self._counts[reader.name].add(angles[is_written & (angles >= 0.0)])

    def add_raw(self, tile: int, normals: np.ndarray) -> None:
        """Measure a tile of normals as rendering.Renderer.raw returns them."""
        if self.readers:
            self.add(tile, normal_channels.stored(normals, self.settings))

    def results(self, backwards: int) -> dict[str, dict[str, float | int]]:
        """The figures by the names of the programs, as Report.readers has them. backwards: the texels with a z of 0 or less."""
        return {
            reader.name: {
                **self._counts[reader.name].results(),
                "rebuilt": backwards if reader.rebuilds_z else 0,
            }
            for reader in self.readers
        }


def warnings(results: dict[str, dict[str, float | int]]) -> list[str]:
    """A sentence for the programs that show texels wrong because they make z of x and y."""
    wrong = {readers.BY_NAME[name].label: found["rebuilt"] for name, found in results.items() if found["rebuilt"]}
    if not wrong:
        return []
    count = max(wrong.values())
    return [
        f"{', '.join(wrong)}: z is made of x and y there, and {count:,} texels with a z of 0 or less come out wrong."
    ]
