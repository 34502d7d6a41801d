# SPDX-License-Identifier: GPL-3.0-or-later
"""Judges low meshes of game assets: by what a viewer sees of them with their map, and by their distance from the high mesh."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...audit import appearance
from ...audit.appearance import Appearance, SeenHighs, SeenPlaces, ShownMap
from ...audit.pictures import square_means
from ...core import asset_limits, udim
from ...core.asset_limits import Wanted
from ...core.declarations.choices import Method, Space, Stacked
from ...core.errors import NoGpu, NothingDrawn
from ...core.map_types import NORMAL
from ...core.progress import Pace, Progress, Task, Timings, part, relay
from ...core.settings import Run, Settings
from ...core.simplify import Limit
from ...engine import normal_space
from ...mesh import corner_normals, uv_stretch
from ...mesh.fitting import Samples
from ...mesh.triangle_mesh import Mesh
from ...mesh.triangles import face_areas
from ...output.outputs import kept
from ...scene import mesh_reader
from ...scene.object_checks import ObjectRef
from .. import unwrapping
from ..bake import draw_raw
from ..baked import Baked
from ..job import Request, check_job, closed, read_meshes
from ..temporary import TEMPORARY
from . import skins
from .decimation import UvMesh
from .high_surface import HighSurface
from .low_meshes import LowMesh

QUICK_SIDE, SIDE = 1024, 2048
"""The most texels a side of the maps by which ways to make a low mesh are compared, and of those by which a limit is kept."""
NOT_DRAWN = 100.0
"""The excess of a low mesh that cannot be judged: it is far beyond any limit."""
SILHOUETTE_PENALTY_DEGREES = 90.0
"""The degrees for which a pixel of the high or the low mesh alone, or of a back face, counts, where ways to make a low mesh are
compared."""
AFAR = 4
"""Texels along a side of the square that is one texel where a map with 8 bits is seen from afar: its second mip level."""
BENT = 0.05
"""The degrees for which a degree counts between the normals of corners and their faces: renderers correct what is far off, and
shadows grow from there. For hard surfaces alone: others have no flat sides on which that shows."""


@dataclass(frozen=True)
class Seen:
    """How a low mesh with its map differs from the high mesh.

    Attributes:
        appearance: What a viewer sees; None if it was not looked at, or shows nothing.
        distance: As HighSurface.distance; 0 if it has no limit.
        is_drawn: Whether a texel of its map shows the high mesh: on a small map, none may be left between the margins of
            islands.
        afar: What a viewer sees of a hard surface from afar, by the mip level AFAR; None for others.
        bent: The mean angle in degrees between the normals of corners and their faces, by area, of a hard surface in tangent
            space; 0 of others.
    """

    appearance: Appearance | None
    distance: float = 0.0
    is_drawn: bool = True
    afar: Appearance | None = None
    bent: float = 0.0

    def excess(self, limit: Limit) -> float:
        """As simplify.Deviation.excess."""
        if not self.is_drawn:
            return NOT_DRAWN
        return limit.excess(self.appearance.percentile_99 if self.appearance is not None else 0.0, self.distance)

    @property
    def cost(self) -> float:
        """How wrong it looks, in degrees."""
        if self.appearance is None:
            return 0.0 if self.is_drawn else math.inf
        wrong, mean = min(1.0, self.appearance.silhouette + self.appearance.backs), self.appearance.mean
        if self.afar is not None:
            mean = (mean + self.afar.mean) / 2.0 + BENT * self.bent
        return (1.0 - wrong) * mean + SILHOUETTE_PENALTY_DEGREES * wrong


class AppearanceJudge:
    """Measures low meshes of one high surface. timings: get the time of its stages, "unwrap", "draw" and "look"."""

    def __init__(self, context: bpy.types.Context, request: Request, pace: Pace, high: HighSurface, timings: Timings):
        self._context, self._request, self._pace, self._high, self._timings = context, request, pace, high, timings
        settings = request.settings.read_by(context.scene.render.engine).without_file().without_materials()
        self._settings = settings.without_other_maps().traced(method=Method.CAST)
        self._quick_settings = self._settings.of_at_most(QUICK_SIDE).sampled(samples=1)
        self._places: tuple[Samples, SeenHighs, SeenPlaces] | None = None
        """The samples of a source, and where they were last seen."""

    def quickly(self, low: LowMesh) -> Task[Seen]:
        """What a viewer sees of a low mesh, on a small map with one sample."""
        with self._object_of(low) as obj:
            return (yield from self._seen(obj, low, self._quick_settings, is_quick=True))

    def within(self, wanted: Wanted, low: LowMesh) -> Task[Seen]:
        """What has a limit, of a low mesh with the samples and the size of the finished one. Raises NoGpu."""
        with self._object_of(low) as obj:
            distance, seen = self._high.distance(obj) if wanted.distance < math.inf else 0.0, Seen(None)
            if wanted.degrees < math.inf:
                texel = texel_side(wanted, self._context, lambda: self._high.edge) if wanted.finds_size else None
                seen = yield from self._seen(obj, low, self._settings, texel)
                if seen.appearance is None and seen.is_drawn:
                    raise NoGpu(
                        "This GPU cannot measure the shading error: give a number of triangles in place of degrees."
                    )
        return replace(seen, distance=distance)

    def normal_map(self, low: bpy.types.Object, size: int | None = None) -> Task[np.ndarray | None]:
        """The normal map of a low object with UVs as it is stored, (rows, columns, 4) float32; None if it shows nothing.

        size: the side that it has at most; None for a small map with one sample.
        """
        settings = self._settings.of_at_most(size) if size else self._quick_settings
        request = replace(self._request, job=self._request.job.but(low=low), settings=settings)
        try:
            drawing = self._timed(draw_raw(self._context, request, Run(settings, self._pace)), "draw")
            _, maps = yield from drawing
        except NothingDrawn:
            return None
        texels, _ = normal_space.stored(maps[udim.FIRST][NORMAL.name], settings)
        return kept(texels, settings)

    def with_map(self, low: bpy.types.Object, texels: np.ndarray, *, is_quick: bool = False) -> Task[Appearance | None]:
        """What a viewer sees of a low object that shows the normal map of another one.

        Args:
            texels: as `normal_map` returns them.
            is_quick: whether fewer pixels do.
        """
        request = replace(self._request, job=self._request.job.but(low=low))
        meshes = closed(read_meshes(self._context, request), request.job)
        mesh = meshes.basis or meshes.low
        shown = ShownMap({udim.FIRST: texels}, normal_space.reading(self._settings.map))
        looking = appearance.measure(meshes.highs, mesh, shown, is_quick=is_quick)
        return (yield from self._timed(looking, "look"))

    def shared(self, wanted: Wanted, low: UvMesh, texels: np.ndarray) -> Task[Seen]:
        """What has a limit, of a level that shows the map of the low object. texels: as `normal_map` returns them."""
        with self._object_of(low) as obj:
            skins.put_in_place_of(obj, bpy.data.objects[low.name])
            self._context.view_layer.update()
            distance = self._high.distance(obj) if wanted.distance < math.inf else 0.0
            seen = (yield from self.with_map(obj, texels)) if wanted.degrees < math.inf else None
        return Seen(seen, distance)

    @contextmanager
    def _object_of(self, low: LowMesh | UvMesh) -> Iterator[bpy.types.Object]:
        """An object of the scene with a low mesh, which is removed again."""
        obj = self._high.new_object(self._context, TEMPORARY, low.data)
        ref = ObjectRef.of(obj)
        try:
            yield obj
        finally:
            if ref.find() is not None:
                bpy.data.objects.remove(ref.find())

    def _seen(
        self,
        obj: bpy.types.Object,
        low: LowMesh,
        settings: Settings,
        texel: float | None = None,
        *,
        is_quick: bool = False,
    ) -> Task[Seen]:
        """Give a low mesh a UV map, bake its normals, and look at it. texel: the side of one; None for the size that is set.
        is_quick: whether fewer pixels do."""
        yield Progress(f"Unwrapping {low.triangles:,} triangles", 0.0)
        yield from part(self._timed(unwrapping.work(obj, settings, is_quick=True), "unwrap"), 0.0, 0.1)
        if texel is not None:
            side = map_side(obj, texel)
            settings = settings.sampled(width=side, height=side)
        # In the reverse order, where islands share texels, high meshes would be others for all that is kept of them.
        settings = settings.of_at_most(SIDE).sampled(stacked=Stacked.LAST)
        request = replace(self._request, job=self._request.job.but(low=obj), settings=settings)
        check_job(self._context, request.job, settings)
        try:
            drawing = self._timed(draw_raw(self._context, request, Run(settings, self._pace)), "draw")
            baked, maps = yield from part(drawing, 0.1, 0.5)
        except NothingDrawn:
            return Seen(None, is_drawn=False)
        looking = self._looked_at(baked, maps[udim.FIRST][NORMAL.name], low.source.samples, is_quick=is_quick)
        return (yield from part(self._timed(looking, "look"), 0.5, 1.0))

    def _timed(self, work: Task, stage: str) -> Task:
        """`work`, with its time added to a stage. The time between its steps does not count."""
        return relay(work, within=lambda: self._timings.timed(stage))

    def _looked_at(self, baked: Baked, normals: np.ndarray, samples: Samples, *, is_quick: bool) -> Task[Seen]:
        """The shading error of a low mesh, if it can be measured, and what is seen of samples of the surface.

        normals: as baking.Renderer.raw returns them.
        """
        settings, meshes = baked.settings, baked.plan.meshes
        if appearance.why_not(baked.plan, settings):
            return Seen(None)
        low = meshes.basis or meshes.low
        seen = yield from part(appearance.seen_highs(baked.plan.drawn_highs, [low]), 0.0, 0.5)
        seen = seen.half if is_quick else seen
        if self._places is None or self._places[0] is not samples or self._places[1] is not seen:
            in_world = replace(samples, points=samples.points + self._high.origin)
            self._places = samples, seen, seen.places(in_world)
        texels, states = normal_space.stored(normals, settings)
        shown, places = kept(texels, settings), self._places[2]
        near = yield from part(self._compared(seen, low, shown, settings, places), 0.5, 0.75)
        if not self._high.is_hard:
            return Seen(near)
        means, is_known = square_means(np.rint(255.0 * shown) / np.float32(255.0), states != 0, AFAR)
        small = np.dstack([means, is_known.astype(np.float32)])
        afar = yield from part(self._compared(seen, low, small, settings), 0.75, 1.0)
        is_in_tangent_space = settings.map.space == Space.TANGENT
        return Seen(near, afar=afar, bent=corner_normals.bent(low) if is_in_tangent_space else 0.0)

    @staticmethod
    def _compared(
        seen: SeenHighs, low: Mesh, texels: np.ndarray, settings: Settings, places: SeenPlaces | None = None
    ) -> Task[Appearance | None]:
        """What is seen of a low mesh with a map."""
        shown = ShownMap({udim.FIRST: texels}, normal_space.reading(settings.map))
        return (yield from seen.compare(low, shown, places=places))


def texel_side(wanted: Wanted, context: bpy.types.Context, edge: Callable[[], float]) -> float:
    """The side of a texel that is wanted, in scene units. edge: returns that of the high mesh's triangles."""
    if wanted.fits_size:
        return edge()
    return 1.0 / (wanted.density * context.scene.unit_settings.scale_length)


def map_side(low: bpy.types.Object, texel: float) -> int:
    """The side in texels of the maps at which a texel is not larger than this, in scene units."""
    layer = mesh_reader.active_uv_layer(low.data)
    mesh = mesh_reader.surface(low.data, layer, low.name, mesh_reader.matrix(low))
    points = mesh.positions.astype(np.float64) @ mesh.to_world[:3, :3].T
    used = uv_stretch.measure(points[mesh.vertices[mesh.triangles]], mesh.uv[mesh.triangles]).used
    area = float(face_areas(points, mesh.vertices[mesh.triangles]).sum())
    return asset_limits.size_for(texel, area, min(used, 1.0))
