# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything that is measured of the maps of one bake, while they are drawn tile by tile."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from ..core.errors import Length
from ..core.map_types import NORMAL, Map
from ..core.progress import Task, relay
from ..core.settings import Settings
from ..engine import baking, normal_space
from ..engine.baking import Drawing
from ..engine.planning import Plan
from ..engine.stacked_uvs import StackedParts
from .appearance import SeenBake
from .checks import Findings, audit
from .deviations import BetweenTexels, Deviations, OtherEngines
from .pictures import BakePictures
from .stacked_checks import check_stacked
from .tally import Tally


def measuring(
    drawing: Drawing,
    settings: Settings,
    *,
    kept: Callable[[int, Map], np.ndarray],
    is_measured: bool,
    is_seen: bool,
    is_pictured: bool,
) -> Task["Measures"]:
    """Make ready to measure a bake. Raises BakeError as baking.draw.

    Args:
        drawing: of the bake.
        kept: what images and files keep of a UDIM tile of the normal map, from its number and the map: a new array
            (height, width, 4) float32.
        is_measured: whether deviations from the high meshes are measured.
        is_seen: whether the shading error is measured.
        is_pictured: whether there is a picture of the maps.
    """
    truth = drawing
    has_deviations = (is_measured or is_pictured) and settings.map.normal
    if has_deviations:
        truth = yield from baking.draw_own_hits(drawing.plan, drawing.run, drawing)
    found = Measures(drawing, truth, settings, kept)
    low = found.plan.meshes.basis or found.plan.meshes.low
    if is_pictured:
        found.pictures = BakePictures(low, found.plan.tiles, settings)
    if has_deviations:
        found.deviations = Deviations(truth, settings, found.pictures, hidden=found.hidden)
    if is_measured and settings.map.normal:
        found.between = BetweenTexels(truth, settings)
    if is_seen:
        found.seen = SeenBake(found.plan, settings)
    return found


class Measures:
    """What is measured of a bake. Made by `measuring`.

    Attributes:
        drawing: Of the bake.
        truth: The same with own hits, if deviations are measured.
        hidden: The parts of the low mesh that others hide.
        tally: The texels by their states.
        others, deviations, between, seen, pictures: What measures; None where that is not asked for.
    """

    def __init__(self, drawing: Drawing, truth: Drawing, settings: Settings, kept: Callable[[int, Map], np.ndarray]):
        self.drawing, self.truth, self._settings, self.tally = drawing, truth, settings, Tally()
        self._kept = kept
        self.hidden = StackedParts(truth, settings)
        self.others = OtherEngines(self.plan.meshes.basis, settings)
        self.deviations: Deviations | None = None
        self.between: BetweenTexels | None = None
        self.seen: SeenBake | None = None
        self.pictures: BakePictures | None = None

    @property
    def plan(self) -> Plan:
        return self.drawing.plan

    def add(self, tile: int, maps: Mapping[str, Map]) -> None:
        """Measure a UDIM tile with its maps as they are stored, before rounding."""
        self.tally.add(maps[NORMAL.name], self._settings.map)
        with self.drawing.run.timings.timed("audit"):
            self._add(tile, maps)

    def add_raw(self, tile: int, normals: np.ndarray) -> None:
        """Measure a tile of normals as baking.Renderer.raw returns them."""
        self.tally.add_raw(normals, self._settings.map)
        if self.others.engines or any((self.deviations, self.between, self.seen, self.pictures)):
            with self.drawing.run.timings.timed("audit"):
                self._add(tile, {NORMAL.name: normal_space.stored(normals, self._settings)})

    def _add(self, tile: int, maps: Mapping[str, Map]) -> None:
        texels, state = maps[NORMAL.name]
        measuring_kept = list(filter(None, (self.deviations, self.between, self.seen)))
        if self.others.engines or measuring_kept:
            kept = self._kept(tile, (texels, state))
            self.others.add(tile, (texels, state), kept)
            for each in measuring_kept:
                each.add(tile, (kept, state))
        if self.pictures:
            self.pictures.add(tile, maps)

    def findings(self, length: Length, materials: np.ndarray | None) -> Task[Findings]:
        """What is found, after all tiles. length: a length in scene units as text. materials: as check_stacked takes them."""
        drawing, plan, timed = self.drawing, self.plan, self.drawing.run.timings.timed
        appearance = (yield from relay(self.seen.measured(), within=partial(timed, "audit"))) if self.seen else None
        with timed("audit"):
            stacked = check_stacked(self.hidden, self.truth, self._settings, materials)
            found = audit(plan, self.tally, self._settings, drawing.ray_cast, length=length, stacked=stacked)
            return replace(
                found,
                stopped_early=drawing.renderer.stopped / self.tally.written,
                rays=drawing.source.share_of_rays if plan.has_rays else 0.0,
                targets=self.others.results(self.tally.backwards),
                deviation=self.deviations.results() if self.deviations else {},
                between=self.between.results() if self.between else {},
                appearance=appearance,
                picture=self.pictures.result() if self.pictures else None,
            )
