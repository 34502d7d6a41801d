# SPDX-License-Identifier: GPL-3.0-or-later
"""The engine's door: meshes as arrays in, maps as arrays out, without files and without Blender's data."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import gpu
import numpy as np

from ..core.declarations.choices import Hit, Wrap
from ..core.errors import BakeError, NoGpuMemory
from ..core.map_types import NORMAL, WRITTEN, Map
from ..core.progress import Task, part
from ..core.settings import Run
from ..mesh.inputs import Meshes
from ..passes import mesh_upload, target
from . import margins
from .bands import LEAST_ROWS, Band, BandMaps, DrawnMaps, bands
from .margins import PostProcess
from .planning import Plan, nothing_drawn, plan_of
from .ray_casting import RayCast
from .sampling import SampledMaps, maps_of_bake
from .sources import Source, normal_source
from .wrapping import Around

Keep = Callable[[str, Band, gpu.types.GPUTexture], None]
"""Takes the name of a map, a band of it, and its texture."""
READY = 0.2
"""The share of a bake that is done when drawing begins."""


def bake(meshes: Meshes, run: Run) -> Task[dict[int, dict[str, Map]]]:
    """Bake the normal map and the maps in the settings. `core.progress.finish` runs it to its end.

    Args:
        meshes: for a map in tangent space, with `basis`.
        run: its settings need no names, files or formats.

    Returns:
        The maps by UDIM tile (1001 without UDIM) and name: texels (H, W, 4) float32 with row 0 at v = 0, and their states
        (H, W) uint8, see core.map_types.
    """
    plan = plan_of(meshes, run.settings, run.timings)
    drawing = yield from part(draw(plan, run), 0.0, READY)
    maps = {}
    for tile, start, stop in shares_of_tiles(plan):
        maps[tile] = yield from part(drawing.texels(tile), start, stop)
    if not any(state.any() for of_tile in maps.values() for _, state in of_tile.values()):
        raise BakeError(nothing_drawn(plan))
    return maps


def shares_of_tiles(plan: Plan) -> Iterator[tuple[int, float, float]]:
    """Each UDIM tile, with the share of the bake that is done before and after it."""
    share = (1.0 - READY) / len(plan.tiles)
    for number, tile in enumerate(plan.tiles):
        yield tile, READY + number * share, READY + (number + 1) * share


def draw(
    plan: Plan,
    run: Run,
    *,
    uploads: mesh_upload.UploadCache | None = None,
    processes: dict[str, PostProcess] | None = None,
) -> Task["Drawing"]:
    """Make ready to draw a plan: upload its high meshes, or measure its rays, which the drawing's plan has.

    Args:
        uploads: a cache of uploaded meshes.
        processes: as margins.for_maps returns them, for a caller that keeps them; None to make them if they are needed.

    Raises BakeError for more triangles than the GPU takes, and for meshes that are far apart, if most rays miss.
    """
    source = yield from normal_source(plan, run, uploads=uploads)
    if source.ray_cast is not None:
        plan = replace(plan, rays=source.ray_cast.lengths)
    return Drawing(plan, source, run, uploads=uploads, processes=processes)


def draw_own_hits(
    plan: Plan, run: Run, like: "Drawing | None" = None, *, uploads: mesh_upload.UploadCache | None = None
) -> Task["Drawing"]:
    """As `draw`, for normals alone of the hits that belong to their texels, whichever hits the settings choose.

    like: a drawing of this plan, which is returned if it has these hits.
    """
    settings = run.settings.without_other_maps()
    if not (plan.casts_rays and settings.tracing.hit != Hit.OWN):
        return like or (yield from draw(plan, replace(run, settings=settings), uploads=uploads))
    return (yield from draw(plan, replace(run, settings=settings.traced(hit=Hit.OWN)), uploads=uploads))


class Drawing:
    """Draws a plan, tile by tile or band by band. Made by `draw`.

    source: of its normals and hits.
    """

    def __init__(
        self,
        plan: Plan,
        source: Source,
        run: Run,
        *,
        uploads: mesh_upload.UploadCache | None = None,
        processes: dict[str, PostProcess] | None = None,
    ):
        self.plan, self.source, self.run = plan, source, run
        self._uploads, self._processes = uploads, processes

    @property
    def ray_cast(self) -> RayCast | None:
        """Its rays; None if it casts none."""
        return self.source.ray_cast

    @cached_property
    def maps(self) -> SampledMaps:
        """What draws its bands."""
        return maps_of_bake(self.plan.meshes, self.source, self.run, uploads=self._uploads)

    @cached_property
    def processes(self) -> dict[str, PostProcess]:
        """What draws the margins of its maps, by name."""
        return self._processes or margins.for_maps([self.plan.meshes.low], self.run.settings)

    @cached_property
    def renderer(self) -> "Renderer":
        """What draws its tiles."""
        return Renderer(self.maps, self.run)

    def texels(self, tile: int) -> Task[dict[str, Map]]:
        """The maps of a tile by name, as they are stored."""
        return self.renderer.texels(tile, self.processes)

    def with_settings(self, run: Run) -> "Drawing":
        """The same source, for maps of other settings that take the same rays."""
        return Drawing(self.plan, self.source, run, uploads=self._uploads)

    def of_part(self, meshes: Meshes, is_drawn: np.ndarray | None, run: Run) -> "Drawing":
        """The same for some triangles of the low mesh: arguments as in Source.of_part."""
        return Drawing(self.plan.of_part(meshes), self.source.of_part(meshes, is_drawn, run), run)


def texels_of(maps: BandMaps, tile: int, run: Run, processes: dict[str, PostProcess]) -> Task[dict[str, Map]]:
    """The maps of a tile by name, as they are stored, with their margins. processes: as margins.for_maps returns them."""
    return Renderer(maps, run).texels(tile, processes)


class Renderer:
    """Draws the maps of one bake, tile by tile: the normal map and the maps in the settings.

    stopped: how many texels that were written took fewer samples than the settings say, so far.
    """

    def __init__(self, maps: BandMaps, run: Run):
        self.maps, self.stopped = maps, 0
        self.settings, self.timings, self.pace, self._run = run.settings, run.timings, run.pace, run

    def texels(self, tile: int, post_processes: dict[str, PostProcess]) -> Task[dict[str, Map]]:
        """The maps of a tile by name, as they are stored."""
        if self.settings.sampling.wrap != Wrap.NONE:
            return (yield from self._wrapped(tile, post_processes))
        return (yield from self._texels(tile, post_processes))

    def _wrapped(self, tile: int, post_processes: dict[str, PostProcess]) -> Task[dict[str, Map]]:
        """`texels` with margins that wrap around, one map after another."""
        maps, around = (yield from self.raw(tile, tuple(post_processes))), Around(self.settings.sampling)
        finished = {}
        for name, process in post_processes.items():
            values = around.of(maps.pop(name))
            wider = replace(self._run, settings=self.settings.sampled(**around.size))
            drawn = yield from Renderer(DrawnMaps({name: values}), wider)._texels(tile, {name: process})
            finished[name] = around.inner(drawn[name])
        return finished

    def _texels(self, tile: int, post_processes: dict[str, PostProcess]) -> Task[dict[str, Map]]:
        size = self.settings.sampling.height, self.settings.sampling.width
        maps = {name: (np.empty((*size, 4), np.float32), np.empty(size, np.uint8)) for name in post_processes}

        def keep(name: str, band: Band, drawn: gpu.types.GPUTexture) -> None:
            with self.timings.timed("draw"):
                stored = post_processes[name].draw(band, drawn)
                stored.finish()
            with self.timings.timed("read"):
                texels, state = (array[band.start : band.stop] for array in maps[name])
                stored.read(texels)
                stored.read(state, 1)
            self._count(name, state, WRITTEN)

        yield from self._banded(tile, self.settings.sampling.margin, keep)
        with self.timings.timed("draw"):
            for name, process in post_processes.items():
                process.complete(tile, *maps[name])
        return maps

    def values(self, tile: int) -> Task[gpu.types.GPUTexture]:
        """The values of a bake of one map that is one band, without encoding and margin. The texture is in the current pool."""
        bands = []
        (band,) = self._bands(tile, self.settings.sampling.margin)
        yield from self._draw(band, lambda _name, _band, drawn: bands.append(drawn))
        (drawn,) = bands
        return drawn

    def raw(self, tile: int, names: Sequence[str] = ()) -> Task[dict[str, np.ndarray]]:
        """The maps of a tile by name, without encoding and margin: (height, width, 4) float32, alpha as in sources.Source.

        names: of the maps; empty for those in the settings.
        """
        settings = self.settings
        maps = {
            name: np.empty((settings.sampling.height, settings.sampling.width, 4), np.float32)
            for name in names or (NORMAL.name, *settings.map.drawn_maps)
        }

        def keep(name: str, band: Band, drawn: gpu.types.GPUTexture) -> None:
            with self.timings.timed("read"):
                texels = maps[name][band.start : band.stop]
                target.read(drawn, texels)
            self._count(name, texels[..., 3], 1.0)

        yield from self._banded(tile, 0, keep)
        return maps

    def _count(self, name: str, known: np.ndarray, written: float) -> None:
        """Count the texels of a band that are `written` among `known` (rows, width)."""
        if name == NORMAL.name and self.maps.stopped is not None:
            self.stopped += int(np.count_nonzero((known == written) & self.maps.stopped))

    def _banded(self, tile: int, margin: int | None, keep: Keep) -> Task[None]:
        """Draw the bands of a tile, once more in bands of half as many rows if the GPU refuses memory."""
        if self.pace.has_listener and self.pace.has_picture and self.maps.takes_time:
            yield from part(self.maps.coarse(tile), 0.0, 0.0)
        before, parts = self.stopped, self._bands(tile, margin)
        try:
            yield from self._draw_all(parts, keep)
        except NoGpuMemory:
            rows = parts[0].stop - parts[0].start
            if self.maps.most_rows is not None or rows <= LEAST_ROWS:
                raise
            self.maps.most_rows = -(-rows // 2)
        else:
            return
        target.free_current()
        self.stopped = before
        yield from self._draw_all(self._bands(tile, margin), keep)

    def _bands(self, tile: int, margin: int | None) -> list[Band]:
        size = self.settings.sampling.size
        return list(bands(*size, margin, tile, texel_bytes=self.maps.texel_bytes, most_rows=self.maps.most_rows))

    def _draw_all(self, parts: list[Band], keep: Keep) -> Task[None]:
        for number, band in enumerate(parts):
            yield from part(self._draw(band, keep), number / len(parts), (number + 1) / len(parts))

    def _draw(self, band: Band, keep: Keep) -> Task[None]:
        """Draw a band, and give its maps to `keep`."""
        maps = yield from self.maps.of(band)
        for name, drawn in maps:
            keep(name, band, drawn)
