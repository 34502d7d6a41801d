# SPDX-License-Identifier: GPL-3.0-or-later
"""A normal map that stays on the GPU between changes of its meshes, so that only what changes is drawn again."""

import gpu
import numpy as np

from ...core import udim
from ...core.map_types import NORMAL, WRITTEN, Map
from ...core.progress import Task, finish
from ...core.settings import Run, Settings
from ...mesh.inputs import Meshes
from ...passes import drawn_part, margin_fill, target
from ...passes.mesh_upload import UploadCache
from ..bands import Band, bands
from ..maps.maps_of_bake import maps_of_bake
from ..margins import PostProcess
from ..method_choice import Plan
from ..rendering import Renderer
from ..sources import Flat
from .changed_parts import DrawnMesh, Part, parts_of

MOST_DRAWN = 0.5
"""Share of the triangles. If the parts have more, drawing the whole map takes as long."""


def of(settings: Settings) -> "KeptMap | MapInBands":
    """What draws the normal map of `settings`, which have no other maps, again and again."""
    is_whole = next(bands(settings.sampling.width, settings.sampling.height, settings.sampling.margin)).is_whole
    return KeptMap(settings) if is_whole else MapInBands()


class MapInBands:
    """As KeptMap, for a map that is never whole on the GPU."""

    texture = None

    def __init__(self):
        self.map: Map | None = None

    @property
    def texels(self) -> np.ndarray | None:
        """As KeptMap has it."""
        return self.map and self.map[0]

    def draw(self, renderer: Renderer, _plan: Plan, process: PostProcess) -> Task[bool]:
        """As KeptMap has it."""
        maps = yield from renderer.texels(udim.FIRST, {NORMAL.name: process})
        texels, state = maps[NORMAL.name]
        is_any = bool((state == WRITTEN).any())
        if is_any:
            self.map = texels, state
        return is_any

    def redraw(self, *_) -> bool:
        """Returns False: the whole map must be drawn."""
        return False

    def free(self) -> None:
        """As KeptMap has it."""


class KeptMap:
    """The normal map of one low object, which is not larger than a band. Draw with the same pool of targets each time.

    settings: of the bake, with the normal map alone. state (height, width) uint8: as texel_state has it; None before the first
    map.
    """

    def __init__(self, settings: Settings):
        self.settings = settings
        self.band = Band(0, settings.sampling.height, settings.sampling.size, 0)
        self.state: np.ndarray | None = None
        self._stored: target.Target | None = None
        self._texels: np.ndarray | None = None
        self._nearest: margin_fill.Nearest | None = None
        self._meshes: Meshes | None = None
        """Those of the values on the GPU, by Flatten; None while these values are incomplete, or of rays."""
        self._drawn: list[DrawnMesh] = []

    @property
    def texels(self) -> np.ndarray | None:
        """The last map, (height, width, 4) float32 as it is stored. It is read when it is first asked for."""
        if self._texels is None and self._stored is not None:
            self._texels = np.empty((self.settings.sampling.height, self.settings.sampling.width, 4), np.float32)
            self._stored.read(self._texels)
        return self._texels

    @property
    def map(self) -> Map | None:
        """The last map with its state."""
        return None if self.texels is None else (self.texels, self.state)

    def draw(self, renderer: Renderer, plan: Plan, process: PostProcess) -> Task[bool]:
        """Draw the whole map. Returns whether any texel was written; if not, the map is gone."""
        self._meshes = None
        values = yield from renderer.values(udim.FIRST)
        is_any = self._store(values, process)
        if is_any and not plan.casts_rays and not plan.meshes.has_detail:
            self._meshes, before = plan.meshes, dict(enumerate(self._drawn))
            self._drawn = [DrawnMesh(high, before.get(i)) for i, high in enumerate(plan.meshes.highs)]
        return is_any

    @property
    def texture(self) -> gpu.types.GPUTexture | None:
        """The last map on the GPU, if it is there."""
        return self._stored and self._stored.texture

    def redraw(self, plan: Plan, process: PostProcess, uploads: UploadCache) -> bool:
        """Draw only what differs from the last map. Returns False, with nothing changed, if the whole map must be drawn."""
        parts = self._changed_parts(plan)
        if parts is None:
            return False
        left = MOST_DRAWN * sum(len(high.triangles) for high in plan.meshes.highs)
        around = []
        for part in parts:
            highs = [high for drawn in self._drawn if len((high := drawn.within(self._box(part))).triangles)]
            left -= sum(len(high.triangles) for high in highs)
            if left < 0:
                self._meshes = None
                return False
            around.append((part, highs))
        values, run = None, Run(self.settings)
        for part, highs in around:
            with drawn_part.limited_to(part.x, part.y):
                source = Flat(plan.meshes.low, highs, self.settings.map, run.timings)
                drawer = maps_of_bake(plan.meshes, source, run, uploads=uploads)
                ((_, values),) = finish(drawer.of(self.band))
        if values is not None:
            margin = self.settings.sampling.margin
            reach = None if margin is None or process.borders else margin_fill.farthest_texel(margin) + 1
            self._store_parts(values, parts, reach, process)
        return True

    def free(self) -> None:
        """Let go of the GPU memory. The texels stay."""
        self._texels = self.texels
        self._stored = self._nearest = self._meshes = None
        self._drawn = []

    def _changed_parts(self, plan: Plan) -> list[Part] | None:
        """The parts of the map that differ for `plan`, whose meshes are noted; None if all may."""
        before, meshes = self._meshes, plan.meshes
        if before is None or plan.casts_rays or meshes.has_detail:
            return None
        if meshes.low is not before.low or meshes.basis is not before.basis or len(meshes.highs) != len(self._drawn):
            return None
        changed = [drawn.changed(high) for drawn, high in zip(self._drawn, meshes.highs, strict=True)]
        if any(found is None for found in changed):
            return None
        self._meshes = meshes
        boxes = [
            drawn.replace(high, found)
            for drawn, high, found in zip(self._drawn, meshes.highs, changed, strict=True)
            if len(found)
        ]
        return parts_of(np.concatenate(boxes), self.band.size) if boxes else []

    def _box(self, part: Part) -> np.ndarray:
        """The box in UV space, (4,), around a part and a texel more."""
        size = self.band.size
        lowest = (part.x.start - 1) / size[0], (part.y.start - 1) / size[1]
        return np.array([*lowest, (part.x.stop + 1) / size[0], (part.y.stop + 1) / size[1]])

    def _store(self, values: gpu.types.GPUTexture, process: PostProcess) -> bool:
        """Encode all values and fill the margin. Returns whether any texel was written."""
        state = np.empty((self.settings.sampling.height, self.settings.sampling.width), np.uint8)
        if self._nearest is not None:  # where the same texels are written, the margin comes from the same ones
            stored = process.fill(self.band, values, self._nearest)
            stored.read(state, 1)
        if self._nearest is None or not np.array_equal(state, self.state):
            self._nearest = process.search(self.band, values)
            stored = process.fill(self.band, values, self._nearest)
            stored.read(state, 1)
        if not (state == WRITTEN).any():
            self._stored = self._nearest = None  # it was drawn over the last map; what was read of it stays
            return False
        self._stored, self._texels, self.state = stored, None, state
        return True

    def _store_parts(
        self, values: gpu.types.GPUTexture, parts: list[Part], reach: int | None, process: PostProcess
    ) -> None:
        """As `_store`, for some parts. reach: how far around them the margin changes, in texels; None for all of it."""
        size = self.band.size
        filled = (
            [Part(range(size[0]), range(size[1]))] if reach is None else [part.grown(reach, size) for part in parts]
        )
        for part in filled:
            with drawn_part.limited_to(part.x, part.y):
                stored = process.fill(self.band, values, self._nearest)
        for part in filled:
            state = np.empty((len(part.y), len(part.x)), np.uint8)
            stored.read(state, 1, (part.x.start, part.y.start))
            if not np.array_equal(state, self.state[part.y.start : part.y.stop, part.x.start : part.x.stop]):
                self._store(values, process)
                return
        self._stored, self._texels = stored, None
