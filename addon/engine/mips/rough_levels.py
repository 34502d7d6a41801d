# SPDX-License-Identifier: GPL-3.0-or-later
"""Widens roughness in mip levels by how much the normals differ whose mean a texel shows."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from .block_sums import halved, slabs, spread

SPAN = 4
"""The number of levels that are computed from the same normals. What one level loses is small after so many, so that all
levels take little more time than SPAN of them."""
LEAST_COSINE = 0.1
"""Normals that lean farther than about 84 degrees from the mean count as if they leaned so far: their slopes have no limit."""


Rows: TypeAlias = Callable[[slice], np.ndarray]
"""Returns some rows of a map (height, width, 4) float32, with alpha 1 known, 0 empty, -1 missed."""


class RoughLevels:
    """The levels of widened roughness, one after another.

    normals, roughness: of the whole map, with so many rows (`height`): unit normals in any space, and perceptual roughness in
    red.
    """

    def __init__(self, normals: Rows, roughness: Rows, height: int):
        self.level = 0
        self._start(normals, roughness, height, None)

    def _start(self, normals: Rows, roughness: Rows, height: int, weights: np.ndarray | None) -> None:
        """Compute the next levels from this one. weights (height, width): how many texels of the whole map each has; None for
        the map itself."""
        self.normals, self.roughness, self.height, self.weights = normals, roughness, height, weights

    def next(self, normals: np.ndarray) -> np.ndarray:
        """The roughness (height, width, 4) of the next level, as Renderer.raw has it. normals: the mean normals there.

        alpha ^ 2 of a texel, as of a Beckmann lobe, is the mean of those in it, and of the squares of their slopes against the
        mean normal: tan ^ 2 of the angle to it.
        """
        self.level += 1
        steps = (self.level - 1) % SPAN + 1
        parts = [self._sums(rows, normals[..., :3], steps) for rows in slabs(self.height)]
        sums, counts, misses = map(np.concatenate, zip(*parts, strict=True))
        is_known = counts > 0.0
        squares = np.clip(sums / np.where(is_known, counts, 1.0), 0.0, 1.0)
        result = np.zeros((*is_known.shape, 4), np.float32)
        result[..., :3] = squares[..., None] ** 0.25
        result[..., 3] = np.where(is_known, 1.0, -np.sign(misses))
        if steps == SPAN:
            self._start(normals.__getitem__, result.__getitem__, len(result), counts)
        return result

    def _sums(self, rows: slice, mean: np.ndarray, steps: int) -> list[np.ndarray]:
        """Of the texels that some rows become: the sums of alpha ^ 2, the counts of known texels, and of missed ones."""
        own, roughness = self.normals(rows)[..., :3], self.roughness(rows)
        state = roughness[..., 3]
        weights = (state > 0.0).astype(np.float32) if self.weights is None else self.weights[rows]
        mean = spread(mean, (self.height, own.shape[1]), steps, rows)
        cosines = np.maximum(np.einsum("ijk,ijk->ij", own, mean), LEAST_COSINE)
        found = [weights * (roughness[..., 0] ** 4 + 1.0 / cosines**2 - 1.0), weights, (state < 0.0).astype(np.float32)]
        for _ in range(steps):
            found = [halved(values) for values in found]
        return found
