# SPDX-License-Identifier: GPL-3.0-or-later
"""Averages finished maps over what they cover, down to one texel: their mip levels, each with a margin of its own."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from ..core.declarations.choices import MarginType
from ..core.map_types import BY_NAME, FILLED, MISSED, NORMAL, WIDENED_ROUGHNESS, WRITTEN, Kind, Map
from ..core.progress import Progress, Task, finish
from ..core.settings import MapSettings, Run
from . import margins
from .baking import texels_of
from .bands import DrawnMaps
from .normal_space import channels


def of(maps: Mapping[str, Map], tile: int, run: Run) -> Task[list[dict[str, Map]]]:
    """The levels from 1 on of the maps of a tile, by name. maps: as Renderer.texels returns them; they do not change.

    Each texel is the mean of what is written below it, never of the background or the margin; normals have length 1 again.
    Roughness that is widened keeps what the mean of the normals loses. Maps of labels have no mean, and no levels.
    """
    settings, levels = run.settings, []
    sizes = settings.mip_sizes
    if not sizes:
        return levels
    with run.timings.timed("draw"):
        means = {name: Mean(name, maps[name], settings.map) for name in _names(settings.map)}
        widened = means.pop(WIDENED_ROUGHNESS.name, None)
        rough = widened and RoughLevels(means[NORMAL.name].first, widened.first, settings.sampling.height)
    for number, (width, height) in enumerate(sizes, start=1):
        yield Progress("Averaging", number / len(sizes))
        with run.timings.timed("draw"):
            for mean in means.values():
                mean.halve()
            raw = {name: mean.raw() for name, mean in means.items()}
            if rough:
                raw[WIDENED_ROUGHNESS.name] = rough.next(raw[NORMAL.name])
        # Seams between islands are finer than a texel: the nearest texels are enough.
        of_size = settings.sampled(width=width, height=height, margin_type=MarginType.EXTEND)
        own = of_size.mapped(maps=tuple(raw)[1:])
        steps = texels_of(DrawnMaps(raw), tile, replace(run, settings=own), margins.for_maps([], own))
        levels.append(finish(steps))
    return levels


def _names(map_settings: MapSettings) -> list[str]:
    """The normal map, and the other maps that have a mean."""
    return [NORMAL.name, *(name for name in map_settings.drawn_maps if BY_NAME[name].kind in (Kind.NORMAL, Kind.VALUE))]


class Mean:
    """The mean of what is written of a map, level by level. Level 0 is read where it is, a few rows at a time."""

    def __init__(self, name: str, finished: Map, map_settings: MapSettings):
        self.texels, self.state = finished
        self.is_normal = BY_NAME[name].kind is Kind.NORMAL
        self.decode = (2.0 * np.linalg.inv(channels(map_settings))).T.astype(np.float32)
        self._sums: Sums | None = None

    def halve(self) -> None:
        """Go to the next level."""
        if self._sums is None:
            parts = [[halved(values) for values in self._counted(rows)] for rows in slabs(len(self.state))]
            values, hits, misses = map(np.concatenate, zip(*parts, strict=True))
            self._sums = Sums(self._decoded(values), hits, misses)
        else:
            self._sums = Sums(*map(halved, self._sums))

    def raw(self) -> np.ndarray:
        """The level (height, width, 4) float32, as Renderer.raw has maps: alpha 1 known, 0 empty, -1 missed."""
        if self._sums is None:
            raise ValueError("level 0 is the map itself")
        values, hits, misses = self._sums
        weights = np.sqrt(np.einsum("ijk,ijk->ij", values, values)) if self.is_normal else hits
        is_known = (hits > 0.0) & (weights > 0.0)
        result = np.empty((*is_known.shape, 4), np.float32)
        np.divide(values, np.where(is_known, weights, np.float32(np.inf))[..., None], out=result[..., :3])
        result[..., 3] = np.where(is_known, 1.0, -np.sign(misses))
        return result

    def first(self, rows: slice) -> np.ndarray:
        """These rows of level 0, as `raw` has them."""
        values, hits, misses = self._counted(rows)
        return np.concatenate([self._decoded(values), (hits - misses)[..., None]], axis=-1)

    def _counted(self, rows: slice) -> "Sums":
        """These rows of level 0, whose values `_decoded` takes: sums are decoded, as they are fewer."""
        state = self.state[rows]
        hits = (state == WRITTEN).astype(np.float32)
        misses = ((state == MISSED) | (state == FILLED)).astype(np.float32)
        # In memory, channels lie apart: numpy is slow where the last axis has three elements.
        values = np.subtract(np.moveaxis(self.texels[rows, :, :3], 2, 0), np.float32(0.5 * self.is_normal), order="C")
        values *= hits
        return Sums(np.moveaxis(values, 0, 2), hits, misses)

    def _decoded(self, values: np.ndarray) -> np.ndarray:
        return values @ self.decode if self.is_normal else values


class Sums(NamedTuple):
    """Of each texel of a level: the sum (height, width, 3) of the written values, and how many texels hit and missed."""

    values: np.ndarray
    hits: np.ndarray
    misses: np.ndarray


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
        sums = [weights * (roughness[..., 0] ** 4 + 1.0 / cosines**2 - 1.0), weights, (state < 0.0).astype(np.float32)]
        for _ in range(steps):
            sums = [halved(values) for values in sums]
        return sums


LEVELS = 7
"""A part of a map has 2 ^ LEVELS rows."""


def halved(values: np.ndarray) -> np.ndarray:
    """The sums (height // 2, width // 2, ...), at least one of each, over the blocks of `values` (height, width, ...).

    Of an odd number of rows or columns, the last three share a block.
    """
    for axis in (0, 1):
        values = np.moveaxis(_halved_rows(np.moveaxis(values, axis, 0)), 0, axis)
    return np.ascontiguousarray(values)


def _halved_rows(values: np.ndarray) -> np.ndarray:
    count = len(values) // 2
    if count == 0:
        return values
    sums = values[0 : 2 * count : 2] + values[1 : 2 * count : 2]
    if len(values) % 2:
        sums[-1] += values[-1]
    return sums


def slabs(height: int) -> Iterator[slice]:
    """The rows of a map in parts, so that memory does not grow with it. Up to LEVELS times, halving a part gives what halving
    the map gives."""
    count = max(1, height >> LEVELS)
    for number in range(count):
        yield slice(number << LEVELS, height if number + 1 == count else number + 1 << LEVELS)


def spread(values: np.ndarray, size: tuple[int, int], levels: int, rows: slice) -> np.ndarray:
    """The texels of `values`, a map that was `halved` so many times, on some rows of the map of `size` (height, width)."""
    across, along = (
        np.minimum(np.arange(full) >> levels, small - 1) for full, small in zip(size, values.shape[:2], strict=True)
    )
    return values[across[rows, None], along]
