# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps of which only every so many texels are looked at."""

from dataclasses import dataclass

from ..core import udim
from ..core.udim import UvToClip


@dataclass(frozen=True)
class Sparse:
    """A map of `size` (width, height) in texels, of which every `steps`-th is looked at along u and along v."""

    size: tuple[int, int]
    steps: tuple[int, int]

    @property
    def small(self) -> tuple[int, int]:
        """How many texels along u and v are looked at."""
        return tuple(-(-side // step) for side, step in zip(self.size, self.steps, strict=True))

    def uv_to_clip(self, tile: int) -> UvToClip:
        """As udim.uv_to_clip. Texel i of the small map lies on texel i * step of the map."""
        (step_u, step_v), (count_u, count_v) = self.steps, self.small
        start = (1 - step_u) / 2, (1 - step_v) / 2
        return udim.uv_to_clip(tile, self.size, start, (step_u * count_u, step_v * count_v))


def at_most(size: tuple[int, int], most: int) -> Sparse:
    """A map of which at most so many texels a side are looked at."""
    return Sparse(size, tuple(-(-side // most) for side in size))
