# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps of which only every so many texels are looked at."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Sparse:
    """A map of `size` (width, height) in texels, of which every `steps`-th is looked at along u and along v."""

    size: tuple[int, int]
    steps: tuple[int, int]

    @property
    def small(self) -> tuple[int, int]:
        """How many texels along u and v are looked at."""
        return tuple(-(-side // step) for side, step in zip(self.size, self.steps, strict=True))

    def window(self, tile: int) -> tuple[float, float, float, float]:
        """From uv to clip space, as target.window, so that texel i of the small map lies where texel i * step of the map
        does."""
        places = (tile - 1001) % 10, (tile - 1001) // 10
        sides = list(zip(self.size, self.steps, self.small, strict=True))
        scale = [2.0 * side / (step * few) for side, step, few in sides]
        shift = [(step - 1.0) / (step * few) - 1.0 for _, step, few in sides]
        return *scale, *(back - one * place for back, one, place in zip(shift, scale, places, strict=True))


def at_most(size: tuple[int, int], most: int) -> Sparse:
    """A map of which at most so many texels a side are looked at."""
    return Sparse(size, tuple(-(-side // most) for side in size))
