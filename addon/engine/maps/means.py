# SPDX-License-Identifier: GPL-3.0-or-later
"""The means of samples. Each map keeps one texture on the GPU, however many samples it has."""

from collections.abc import Callable

import gpu

from ...passes import target
from ...passes.bake import samples
from ..bands import Band
from .family import Sample

Draw = Callable[[target.Target], None]
"""Draws one sample of a map into a target (RGBA32F; alpha 1 known, 0 empty, -1 missed)."""


class Mean:
    """The mean of the samples of one map.

    is_summed: whether passes add to `sums` themselves; otherwise a single sample is drawn straight into the texture of the map.
    """

    def __init__(self, name: str, count: int, *, is_summed: bool = False):
        self.name = name
        self.is_summed = is_summed or count > 1

    def sums(self, band: Band) -> target.Target:
        """The sums, or the only sample."""
        return target.get(f"sums of {self.name}" if self.is_summed else self.name, band.width, band.height, "RGBA32F")

    def add(self, sample: Sample, draw: Draw) -> None:
        """Add a sample."""
        band = sample.band
        if not self.is_summed:
            draw(self.sums(band))
            return
        drawn = target.get("sample", band.width, band.height, "RGBA32F")
        draw(drawn)
        samples.add(self.sums(band), drawn.texture, range(band.height), is_first=sample.number == 0)

    def texture(self, band: Band) -> gpu.types.GPUTexture:
        """The mean. Valid until the next mean is asked for."""
        if not self.is_summed:
            return self.sums(band).texture
        into = target.get("mean", band.width, band.height, "RGBA32F")
        samples.average(into, self.sums(band), is_direction=False)
        return into.texture


class Central(Mean):
    """The sample nearest to the center of each texel, for labels, which have no mean."""

    def __init__(self, name: str):
        super().__init__(name, 1)

    def add(self, sample: Sample, draw: Draw) -> None:
        """As Mean has it; samples that are not central are drawn for other maps only."""
        if sample.is_central:
            super().add(sample, draw)
