# SPDX-License-Identifier: GPL-3.0-or-later
"""The means of samples. Each map keeps one texture on the GPU, however many samples it has."""

from collections.abc import Callable

import gpu

from ...passes import target
from ...passes.bake import samples
from ..bands import Band
from .family import Sample

Draw = Callable[[target.Target], gpu.types.GPUTexture]
"""Draws one sample of a map into a target (RGBA32F; alpha 1 known, 0 empty, -1 missed). Returns its texture."""


class Mean:
    """The mean of the samples of one map.

    is_direction: whether the mean is normalized. is_summed: whether passes add to `sums` themselves; otherwise a single sample
    is drawn straight into the texture of the map.
    """

    def __init__(self, name: str, count: int, *, is_direction: bool = False, is_summed: bool = False):
        self.name, self.is_direction = name, is_direction
        self.is_summed = is_summed or count > 1

    def sums(self, band: Band) -> target.Target:
        """The sums, or the only sample."""
        return target.get(f"sums of {self.name}" if self.is_summed else self.name, band.width, band.height, "RGBA32F")

    def add(self, sample: Sample, draw: Draw) -> gpu.types.GPUTexture:
        """Add a sample. Returns its texture."""
        band = sample.band
        if not self.is_summed:
            return draw(self.sums(band))
        drawn = draw(target.get("sample", band.width, band.height, "RGBA32F"))
        samples.add(self.sums(band), drawn, range(band.height), is_first=sample.number == 0)
        return drawn

    def texture(self, band: Band) -> gpu.types.GPUTexture:
        """The mean. Valid until the next mean is asked for."""
        if not self.is_summed:
            return self.sums(band).texture
        into = target.get("mean", band.width, band.height, "RGBA32F")
        samples.average(into, self.sums(band), is_direction=self.is_direction)
        return into.texture


class Central(Mean):
    """The sample nearest to the center of each texel, for labels, which have no mean."""

    def __init__(self, name: str):
        super().__init__(name, 1)

    def add(self, sample: Sample, draw: Draw) -> gpu.types.GPUTexture:
        """As Mean has it; samples that are not central are drawn for other maps only."""
        return super().add(sample, draw) if sample.is_central else self.sums(sample.band).texture
