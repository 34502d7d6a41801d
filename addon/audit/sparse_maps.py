# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps on which only every n-th texel is checked."""

from dataclasses import dataclass

from ..core import udim
from ..core.udim import UvToClip


@dataclass(frozen=True)
class Sparse:
    """A map of `size` (width, height) in texels, on which every `steps`-th texel along u and v is checked."""

    size: tuple[int, int]
    steps: tuple[int, int]

    @property
    def small(self) -> tuple[int, int]:
        """How many texels along u and v are checked."""
        return tuple(-(-side // step) for side, step in zip(self.size, self.steps, strict=True))

    def uv_to_clip(self, tile: int, shift: int = 0) -> UvToClip:
        """As udim.uv_to_clip. Texel i of the small map lies on texel i * step + shift of the map."""
        (step_u, step_v), (count_u, count_v) = self.steps, self.small
        start = (1 - step_u) / 2 + shift, (1 - step_v) / 2 + shift
        return udim.uv_to_clip(tile, self.size, start, (step_u * count_u, step_v * count_v))


def at_most(size: tuple[int, int], most: int) -> Sparse:
    """A map of `size` on which at most `most` texels a side are checked."""
    return Sparse(size, tuple(-(-side // most) for side in size))
