# SPDX-License-Identifier: GPL-3.0-or-later
"""One map of several bakes: the margin comes last, so that no object's runs over another's texels."""

from collections.abc import Sequence
from dataclasses import replace

import bpy
import numpy as np

from ..audit import checks, severity
from ..core import progress, texel_state
from ..core.map_types import BY_NAME, NORMAL, Labeled
from ..core.report import Report
from ..core.settings import Settings
from ..engine import gpu_memory, post_process
from ..engine.rendering import Renderer
from ..engine.sources import Drawn
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..output.outputs import Outputs


class Atlas:
    """Takes what bakes drew, as Renderer.raw has it, and stores it as one."""

    def __init__(self, settings: Settings):
        # In all their samples and in their own tangent spaces already.
        self.settings = replace(settings, samples=1)
        self.lows: list[Mesh] = []
        self.tiles: dict[int, dict[str, np.ndarray]] = {}
        self.labels: dict[Labeled, list[str]] = {labeled: [] for labeled in Labeled}

    def add(self, drawn: dict[int, dict[str, np.ndarray]], meshes: Meshes, report: Report) -> None:
        """Lay the maps of one bake over those before. Misses yield to hits; else the later one stays."""
        self.lows.append(meshes.low)
        self._renumber(drawn, {Labeled.OBJECTS: report.high, Labeled.MATERIALS: meshes.materials})
        for tile, maps in drawn.items():
            if tile not in self.tiles:
                self.tiles[tile] = maps
                continue
            below, above = self.tiles[tile], maps[NORMAL.name][..., 3]
            hits, were_hits = above > 0.0, below[NORMAL.name][..., 3] > 0.0
            lost = np.count_nonzero(hits & were_hits)
            if lost > severity.MUCH_OVERLAP * max(1, np.count_nonzero(hits)):
                report.warnings.append(
                    f"{lost:,} texels of {report.low!r} lie over those of others in the same image: give each its own "
                    "place, or a map each with {low} in the name."
                )
            wins = hits | ((above < 0.0) & (below[NORMAL.name][..., 3] <= 0.0))
            for name, values in maps.items():
                np.copyto(below[name], values, where=wins[..., None])

    def store(self, lows: Sequence[bpy.types.Object], reports: Sequence[Report]) -> None:
        """Add the margin, and put the maps where the settings want them."""
        tally, last = checks.Tally(), reports[-1]
        with last.in_total(), Outputs(self.settings) as outputs:
            post_processes = post_process.for_maps(self.lows, self.settings)
            try:
                for tile, maps in self.tiles.items():
                    renderer = Renderer(Drawn(maps), None, self.settings, last, progress.Pace())
                    finished = progress.finish(renderer.texels(tile, post_processes))
                    tally.add(finished[NORMAL.name][1], None, 0)
                    outputs.add(tile, finished)
            finally:
                gpu_memory.trim()
            with last.timed("image"):
                outputs.commit(lows, reports, self.labels[Labeled.MATERIALS])
        for report in reports:
            report.margin = tally.margin / tally.texels

    def _renumber(self, drawn: dict[int, dict[str, np.ndarray]], labels: dict[Labeled, Sequence[str]]) -> None:
        """Each bake numbers its objects and materials from 1; here each has a number of its own."""
        numbers = {}
        for labeled, names in labels.items():
            known = self.labels[labeled]
            known += [name for name in dict.fromkeys(names) if name not in known]
            numbers[labeled] = np.array([0, *(known.index(name) + 1 for name in names)], np.float32)
        for maps in drawn.values():
            for name, values in maps.items():
                labeled = BY_NAME[name].labeled
                if labeled:
                    values[..., :3] = numbers[labeled][values[..., :3].astype(np.int32)]


def state(normals: np.ndarray) -> np.ndarray:
    """The state of texels without a margin, from the alpha of their normals (height, width, 4)."""
    alpha = normals[..., 3]
    return np.where(alpha > 0.0, texel_state.WRITTEN, np.where(alpha < 0.0, texel_state.MISSED, 0)).astype(np.uint8)
