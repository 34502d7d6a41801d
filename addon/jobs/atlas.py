# SPDX-License-Identifier: GPL-3.0-or-later
"""One map for several bakes. The margin is drawn last, so that no object's margin covers another object's texels."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..audit import severity
from ..core import progress, texel_state
from ..core.map_types import BY_NAME, NORMAL, Labeled
from ..core.report import Report
from ..core.settings import Run, Settings
from ..core.timings import Timings
from ..engine import gpu_memory, margins
from ..engine.mips import mip_levels
from ..engine.rendering import DrawnMaps, Renderer
from ..output.outputs import Outputs, into_materials
from .report_making import DrawnJob, report_of


class Atlas:
    """Collects the maps of bakes, as Renderer.raw returns them, and stores them as one."""

    def __init__(self, settings: Settings):
        # All samples and the tangent spaces of the objects are already in the maps.
        self.settings = replace(settings, samples=1)
        self.drawn: list[DrawnJob] = []
        self.tiles: dict[int, dict[str, np.ndarray]] = {}
        self.labels: dict[Labeled, list[str]] = {labeled: [] for labeled in Labeled}
        self._warnings: list[list[str]] = []

    def add(self, drawn: DrawnJob, maps: dict[int, dict[str, np.ndarray]]) -> None:
        """Add the maps of one bake, by tile and name. Hits replace misses; among hits, the later bake wins."""
        self._renumber(maps, drawn.labels)
        self.drawn.append(drawn)
        self._warnings.append([])
        for tile, above in maps.items():
            if tile in self.tiles:
                self._lay_over(self.tiles[tile], above)
            else:
                self.tiles[tile] = above

    def store(self) -> list[Report]:
        """Add the margin and store the maps. Returns a report of each bake. Raises BakeError."""
        last = self.drawn[-1].timings
        with last.in_total(), Outputs(self.settings) as outputs:
            lows = [drawn.job.low for drawn in self.drawn]  # before anything changes: it raises if one was deleted
            for low, drawn in zip(lows, self.drawn, strict=True):
                outputs.sample_onto(low, drawn.meshes.uv_layer, is_own_base=drawn.meshes.is_own_base)
            margin = self._fill(outputs, last)
            with last.timed("image"):
                stored = outputs.commit(self.labels, lows)
                self._warnings[0] += stored.warnings
                for low, drawn, warnings in zip(lows, self.drawn, self._warnings, strict=True):
                    warnings.extend(into_materials(low, stored, drawn.meshes.uv_layer, self.settings))
        return [
            report_of(drawn, stored, warnings, margin)
            for drawn, warnings in zip(self.drawn, self._warnings, strict=True)
        ]

    def _fill(self, outputs: Outputs, timings: Timings) -> float:
        """Add all maps with their margin to `outputs`. Returns the share of the texels that is margin."""
        post_processes = margins.for_maps([drawn.meshes.low for drawn in self.drawn], self.settings)
        margin = texels = 0
        with gpu_memory.trimmed():
            for tile, maps in self.tiles.items():
                run = Run(self.settings, timings=timings)
                renderer = Renderer(DrawnMaps(maps), run)
                finished = progress.finish(renderer.texels(tile, post_processes))
                state = finished[NORMAL.name][1]
                margin += int(np.count_nonzero(state == texel_state.MARGIN))
                texels += state.size
                outputs.add(tile, finished, progress.finish(mip_levels.of(finished, tile, run)))
        return margin / texels

    def _lay_over(self, below: dict[str, np.ndarray], above: dict[str, np.ndarray]) -> None:
        """Combine one tile of the last bake with those of the bakes before it."""
        alpha, alpha_below = above[NORMAL.name][..., 3], below[NORMAL.name][..., 3]
        is_hit, was_hit = alpha > 0.0, alpha_below > 0.0
        lost = np.count_nonzero(is_hit & was_hit)
        if lost > severity.MUCH_OVERLAP * max(1, np.count_nonzero(is_hit)):
            self._warnings[-1].append(
                f"{lost:,} texels of {self.drawn[-1].meshes.low.name!r} overlap texels of other objects in the same image: "
                "move their UVs apart, or bake a map for each with {low} in the name."
            )
        wins = is_hit | ((alpha < 0.0) & (alpha_below <= 0.0))
        for name, values in above.items():
            np.copyto(below[name], values, where=wins[..., None])

    def _renumber(self, maps: dict[int, dict[str, np.ndarray]], labels: dict[Labeled, Sequence[str]]) -> None:
        """Give each name in the atlas its own number. Each bake numbers its objects and materials from 1."""
        numbers = {}
        for labeled, names in labels.items():
            known = self.labels[labeled]
            known += [name for name in dict.fromkeys(names) if name not in known]
            numbers[labeled] = np.array([0, *(known.index(name) + 1 for name in names)], np.float32)
        for tile_maps in maps.values():
            for name, values in tile_maps.items():
                labeled = BY_NAME[name].labeled
                if labeled:
                    values[..., :3] = numbers[labeled][values[..., :3].astype(np.int32)]
