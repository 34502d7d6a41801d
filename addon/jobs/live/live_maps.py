# SPDX-License-Identifier: GPL-3.0-or-later
"""The maps beside the normal map in a live session. They take longer, so they are drawn when editing pauses."""

from collections.abc import Sequence
from dataclasses import replace

import bpy

from ...core import udim
from ...core.map_types import BY_NAME, NORMAL, Labeled
from ...core.progress import Pace, Task, part
from ...core.settings import Settings
from ...core.texel_state import Map
from ...core.timings import Timings
from ...engine import margins, rendering, sources
from ...engine.maps.family import Run
from ...engine.maps.maps_of_bake import maps_of_bake
from ...engine.method_choice import Plan
from ...output import outputs
from ...passes import target
from ...passes.mesh_upload import UploadCache
from ..bake import READY


class LiveMaps:
    """Draws and stores the maps of a session beside its normal map.

    settings: those of the bake, with names filled in. drawing: with all maps to draw, also those that are only packed. pool:
    their textures, apart from those of the normal map. drawn: the last maps by name, before they are encoded.
    """

    def __init__(self, settings: Settings):
        self.settings, self.drawing = settings, settings.for_drawing()
        self.pool = target.TargetPool()
        self.drawn: dict[str, Map] = {}
        self._is_stored = False

    @property
    def are_any(self) -> bool:
        return bool(self.drawing.maps)

    @property
    def show_materials(self) -> bool:
        """Whether a map changes with the materials of the high objects."""
        return any(BY_NAME[name].family.shows_materials for name in self.drawing.maps)

    def work(self, source: sources.Source | None, plan: Plan, uploads: UploadCache, pace: Pace) -> Task[None]:
        """Draw the maps. source, plan: of the session's last normal map; the source is None if its memory was freed. Raises
        BakeError."""
        settings, timings = replace(self.drawing, method=plan.method), Timings()
        if source is None or not plan.casts_rays:  # that of Flatten may have no surface, and no tree
            preparing = sources.normal_source(plan, settings, timings, pace, uploads=uploads)
            source = yield from part(preparing, 0.0, READY)
        run = Run(settings, timings, pace)
        renderer = rendering.Renderer(maps_of_bake(plan.meshes, source, run, uploads=uploads), run)
        maps = yield from part(renderer.texels(udim.FIRST, margins.for_maps([plan.meshes.low], settings)), READY, 1.0)
        del maps[NORMAL.name]
        self.drawn = maps

    def copies(self) -> dict[str, Map]:
        """Copies of the maps, since storing them encodes them in place."""
        return {name: (texels.copy(), state) for name, (texels, state) in self.drawn.items()}

    def store(self, normals: Map, labels: dict[Labeled, Sequence[str]], low: bpy.types.Object, uv_layer: str) -> None:
        """Put the maps into their image datablocks, but into no file. The first time, also into the materials of `low`, if the
        settings say so. normals, labels: as outputs.Outputs takes them."""
        settings = replace(self.settings.without_file(), normal=False)
        with outputs.Outputs(settings) as writers:
            writers.add(udim.FIRST, {NORMAL.name: normals, **self.copies()})
            stored = writers.commit(labels, [low])
        if not self._is_stored:
            outputs.into_materials(low, stored, uv_layer, settings)
        self._is_stored = True
