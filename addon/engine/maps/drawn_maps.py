# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps that were drawn before, as the maps of a band."""

from collections.abc import Iterator

import gpu
import numpy as np

from ...core.progress import Task
from ..bands import Band


class DrawnMaps:
    """Maps by name, (height, width, 4) float32, as rendering.Renderer.raw returns them. See rendering.BandMaps."""

    takes_time = False
    stopped = None

    def __init__(self, maps: dict[str, np.ndarray]):
        self.maps = maps

    def of(self, band: Band) -> Task[Iterator[tuple[str, gpu.types.GPUTexture]]]:
        """As BandMaps has it."""
        yield from ()
        return ((name, upload_band(values, band)) for name, values in self.maps.items())

    def coarse(self, _tile: int) -> Task[None]:
        """As BandMaps has it."""
        yield from ()


def upload_band(values: np.ndarray, band: Band) -> gpu.types.GPUTexture:
    """The rows of a map (height, width, 4) float32 that a band shows, with its halo. Rows outside the map are 0."""
    texels = np.zeros((band.height, band.width, 4), np.float32)
    first, last = band.start - band.halo, band.stop + band.halo
    rows = slice(max(0, first), min(last, len(values)))
    texels[rows.start - first : rows.stop - first] = values[rows]
    data = gpu.types.Buffer("FLOAT", texels.shape, texels)
    return gpu.types.GPUTexture((band.width, band.height), format="RGBA32F", data=data)
