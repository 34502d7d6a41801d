# SPDX-License-Identifier: GPL-3.0-or-later
"""The stored map that is converted: what its channels hold, and what their rounding costs."""

from collections.abc import Iterator, Mapping

import numpy as np

from ...core import conversion
from ...core.conversion import StoredNormals
from ...output import value_encoding


class SourceMap:
    """The texels of a stored normal map by UDIM tile, (height, width, 4) float32 each. They change: z is rebuilt if the map has
    no z, and alpha is 1 if it holds other data than coverage.

    depth, loss: as ConversionReport has them. notes: sentences about such channels.
    """

    def __init__(self, name: str, tiles: Mapping[int, np.ndarray], stored: StoredNormals):
        self.tiles = tiles
        some = np.concatenate([value_encoding.sample_texels(values) for values in tiles.values()])
        self._is_coverage = conversion.is_coverage(some)
        self._lacks_z = conversion.lacks_z(some, stored)
        self.notes = list(self._notes(name, stored))
        self.depth, self.loss = self._rounding(some, stored)
        for values in tiles.values():
            self._complete(values, stored)

    def _complete(self, values: np.ndarray, stored: StoredNormals) -> None:
        if not self._is_coverage:
            values[..., 3] = 1.0
        if self._lacks_z:
            conversion.rebuild_z(values, stored)

    def _rounding(self, some: np.ndarray, stored: StoredNormals) -> tuple[int, dict[str, float]]:
        depth = conversion.bits(some[:, :3])
        if depth == 32:
            return depth, {}
        before = some.copy()
        before[:, :3] = conversion.moved(some[:, :3], depth)
        for values in (before, some):
            self._complete(values, stored)
        angles = value_encoding.angles_between(before, some)
        return depth, {"median": float(np.median(angles)), "maximum": float(angles.max())} if len(angles) else {}

    def _notes(self, name: str, stored: StoredNormals) -> Iterator[str]:
        if self._lacks_z:
            channel = conversion.z_channel(stored)
            yield f"The {channel} channel of {name!r} is the same everywhere: z is rebuilt from the other two."
        if not self._is_coverage:
            yield (
                f"The alpha of {name!r} has values between 0 and 1, as other data than coverage has: it is not used, and the "
                "new map does not contain it."
            )
