# SPDX-License-Identifier: GPL-3.0-or-later
"""Averages finished maps over what they cover, down to one texel: their mip levels, each with a margin of its own."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...core.declarations.choices import MarginType
from ...core.map_types import BY_NAME, MISSED, NORMAL, WIDENED_ROUGHNESS, WRITTEN, Kind, Map
from ...core.progress import Progress, Task, finish
from ...core.settings import MapSettings, Run
from .. import margins
from ..normal_channels import channels
from ..rendering import DrawnMaps, Renderer
from .block_sums import halved, slabs
from .rough_levels import RoughLevels


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
        own = replace(settings, width=width, height=height, maps=tuple(raw)[1:], margin_type=MarginType.EXTEND)
        renderer = Renderer(DrawnMaps(raw), replace(run, settings=own))
        levels.append(finish(renderer.texels(tile, margins.for_maps([], own))))
    return levels


def _names(settings: MapSettings) -> list[str]:
    """The normal map, and the other maps that have a mean."""
    return [NORMAL.name, *(name for name in settings.drawn_maps if BY_NAME[name].kind in (Kind.NORMAL, Kind.VALUE))]


class Mean:
    """The mean of what is written of a map, level by level. Level 0 is read where it is, a few rows at a time."""

    def __init__(self, name: str, finished: Map, settings: MapSettings):
        self.texels, self.state = finished
        self.is_normal = BY_NAME[name].kind is Kind.NORMAL
        self.decode = (2.0 * np.linalg.inv(channels(settings))).T.astype(np.float32)
        self._sums: Sums | None = None

    def halve(self) -> None:
        """Go to the next level."""
        if self._sums is None:
            parts = [[halved(values) for values in self._written(rows)] for rows in slabs(len(self.state))]
            self._sums = Sums(*map(np.concatenate, zip(*parts, strict=True)))
        else:
            self._sums = Sums(*map(halved, self._sums))

    def raw(self) -> np.ndarray:
        """The level (height, width, 4) float32, as Renderer.raw has maps: alpha 1 known, 0 empty, -1 missed."""
        values, hits, misses = self._sums
        weights = np.linalg.norm(values, axis=-1) if self.is_normal else hits
        is_known = (hits > 0.0) & (weights > 0.0)
        result = np.zeros((*is_known.shape, 4), np.float32)
        np.divide(values, weights[..., None], out=result[..., :3], where=is_known[..., None])
        result[..., 3] = np.where(is_known, 1.0, -np.sign(misses))
        return result

    def first(self, rows: slice) -> np.ndarray:
        """These rows of level 0, as `raw` has them."""
        values, hits, misses = self._written(rows)
        return np.concatenate([values, (hits - misses)[..., None]], axis=-1)

    def _written(self, rows: slice) -> "Sums":
        hits = (self.state[rows] == WRITTEN).astype(np.float32)
        misses = (self.state[rows] == MISSED).astype(np.float32)
        values = self.texels[rows, :, :3]
        return Sums(((values - 0.5) @ self.decode if self.is_normal else values) * hits[..., None], hits, misses)


class Sums(NamedTuple):
    """Of each texel of a level: the sum (height, width, 3) of the written values, and how many texels hit and missed."""

    values: np.ndarray
    hits: np.ndarray
    misses: np.ndarray
