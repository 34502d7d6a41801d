# SPDX-License-Identifier: GPL-3.0-or-later
"""Widens roughness in mip levels by how much the normals differ whose mean a texel shows."""

import numpy as np

from .block_sums import halved, spread

SPAN = 4
"""The number of levels that are computed from the same normals. What one level loses is small after so many, so that all
levels take little more time than SPAN of them."""
LEAST_COSINE = 0.1
"""Normals that lean farther than about 84 degrees from the mean count as if they leaned so far: their slopes have no limit."""


class RoughLevels:
    """The levels of widened roughness, one after another.

    normals, roughness (height, width, 4) float32: of the whole map, unit normals in any space, and perceptual roughness in red;
    alpha above 0 where they are known.
    """

    def __init__(self, normals: np.ndarray, roughness: np.ndarray):
        self.level = 0
        self._start(normals, roughness, (roughness[..., 3] > 0.0).astype(np.float32))
        self.misses = (roughness[..., 3] < 0.0).astype(np.float32)

    def _start(self, normals: np.ndarray, roughness: np.ndarray, weights: np.ndarray) -> None:
        """Compute the next levels from this one. weights (height, width): how many texels of the whole map each has."""
        self.normals, self.squares = normals[..., :3], roughness[..., 0] ** 4
        self.weights = weights
        self.counts = weights

    def next(self, normals: np.ndarray) -> np.ndarray:
        """The roughness (height, width, 4) of the next level, as Renderer.raw has it. normals: the mean normals there.

        alpha ^ 2 of a texel, as of a Beckmann lobe, is the mean of those in it, and of the squares of their slopes against the
        mean normal: tan ^ 2 of the angle to it.
        """
        self.level += 1
        steps = (self.level - 1) % SPAN + 1
        mean = spread(normals[..., :3], self.weights.shape, steps)
        cosines = np.maximum(np.einsum("ijk,ijk->ij", self.normals, mean), LEAST_COSINE)
        sums = self.weights * (self.squares + 1.0 / cosines**2 - 1.0)
        for _ in range(steps):
            sums = halved(sums)
        self.counts, self.misses = halved(self.counts), halved(self.misses)
        is_known = self.counts > 0.0
        squares = np.clip(sums / np.where(is_known, self.counts, 1.0), 0.0, 1.0)
        result = np.zeros((*is_known.shape, 4), np.float32)
        result[..., :3] = squares[..., None] ** 0.25
        result[..., 3] = np.where(is_known, 1.0, np.where(self.misses > 0.0, -1.0, 0.0))
        if steps == SPAN:
            self._start(normals, result, self.counts)
        return result
