# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes a game asset of high objects: a low mesh with a UV map, as coarse as its limit allows, and its maps.

Each low mesh that the search tries is baked and looked at from all sides, so that the limit is on what a viewer sees.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ..audit import appearance
from ..audit.appearance import Appearance, SeenHighs, ShownMap
from ..core import asset, levels, naming, udim
from ..core.asset import Wanted
from ..core.declarations.choices import Method
from ..core.errors import BakeError, NoGpu, NothingDrawn
from ..core.map_types import NORMAL
from ..core.naming import Suffixes
from ..core.progress import Pace, Progress, Task, Timings, part, relay
from ..core.report import Report
from ..core.settings import Run, Settings
from ..engine import normal_space
from ..mesh import uv_stretch
from ..mesh.fitting import Samples
from ..mesh.triangles import face_areas, transformed
from ..output.atomic_file import all_or_none
from ..output.outputs import kept
from ..scene import mesh_reader
from . import asset_highs, bake_jobs, lod, temporary, unwrapping
from .asset_highs import Base
from .bake import draw_raw
from .baked import Baked
from .job import NOTHING_ELSE, Job, Request, Wants, check_gpu, check_job
from .temporary import TEMPORARY, TemporaryMeshes

SEARCHED = 0.8
"""The share of the work that is done before the maps are baked."""
QUICK_SIDE, SIDE = 1024, 2048
"""The most texels a side of the maps by which ways to make a low mesh are compared, and of those by which a limit is kept."""
SHARE, FEWEST = 0.1, 500
"""The share of the high triangles with which a search begins, and how many it begins with at least."""
KEPT = 0.97
"""The share of a limit in degrees that meshes of a search keep: the UV map of the finished one differs from theirs."""
NOT_DRAWN = 100.0
"""The excess of a low mesh that cannot be judged: it is far beyond any limit."""
ALONE = 90.0
"""The degrees for which a pixel of the high or the low mesh alone counts, where ways to make a low mesh are compared."""
SHARP = math.radians(100.0)
"""The angle between faces from which the edge between them is sharp: normals that are shared there point behind faces."""
CLEARLY = 1.03
"""By which factor collapsing by quadrics must be better than Decimate: quick looks differ by less from the finished asset."""
LITTLE = 0.1
"""The share of a map below which it is hardly used."""
WHOLE = 1.1
"""By which factor a surface with faults or walls inside must be better than its remeshed one: they may show later."""
CORRECTIONS = 3
"""How often edges collapse anew by the errors that were seen: after that, hardly anything changes."""


@dataclass(frozen=True)
class Tried:
    """A low object that was measured. limit: what it may have. distance: as High.distance has it; 0 if it has no limit.
    triangles, excess, spent: as levels.Measured has them. is_drawn: whether a texel of its map shows the high mesh: on a small
    map, none may be left between the margins of many islands. nearest: as Base.fitted returns it."""

    low: bpy.types.Object
    base: Base
    limit: Wanted
    seen: Appearance | None
    distance: float = 0.0
    spent: float = 0.0
    is_drawn: bool = True
    nearest: np.ndarray | None = None

    @property
    def triangles(self) -> int:
        return len(self.low.data.polygons)

    @property
    def excess(self) -> float:
        if not self.is_drawn:
            return NOT_DRAWN
        degrees = self.seen.percentile_99 if self.seen is not None else 0.0
        return max(degrees / (KEPT * self.limit.degrees), self.distance / self.limit.distance)

    @property
    def cost(self) -> float:
        """How wrong it looks, in degrees."""
        if self.seen is None:
            return 0.0 if self.is_drawn else math.inf
        return (1.0 - self.seen.silhouette) * self.seen.mean + ALONE * self.seen.silhouette


@dataclass(frozen=True)
class Low:
    """A low object of an asset, without its final UV map. limit: what it may have. how: as Report.asset has it, so far."""

    obj: bpy.types.Object
    limit: Wanted
    how: dict[str, Any]


def work(
    context: bpy.types.Context,
    job: Job,
    wanted: Wanted,
    settings: Settings,
    pace: Pace,
    *,
    suffixes: Suffixes,
    wants: Wants = NOTHING_ELSE,
) -> Task[list[Report]]:
    """Make the low object of a job, if it has none, give it a UV map, if it has none, and bake all maps of the settings.

    If the generator is closed early, or raises BakeError, nothing has changed.

    Args:
        job: of the high objects; its low object is one of them if there is none yet.
        wanted: how coarse the low mesh may be, and how many levels of detail follow.
        suffixes: of the names of objects.
        wants: besides the maps.

    Returns:
        The reports of the low object and of its levels, from the finest.
    """
    start, timings = time.perf_counter(), Timings(asset.STAGES)
    wanted.check()
    settings.check()
    if settings.sampling.udim or settings.map.texture_sets:
        raise BakeError("An asset has one texture: turn UDIM Tiles and Texture Sets off.")
    is_made = job.low in job.highs
    if not is_made and job.low.type != "MESH":
        raise BakeError(f"{job.low.name!r} is no mesh: choose a mesh as the low object.")
    with temporary.only_if_finished(), all_or_none(), TemporaryMeshes() as meshes, ExitStack() as unwrapped:
        maker = None
        if is_made or wanted.levels or wanted.distance < math.inf:
            check_gpu()
            yield Progress("Reading the high objects", 0.0)
            with timings.timed("read"):
                maker = _Maker(context, job, settings, pace, meshes, timings=timings, wants=Wants(whole=wants.whole))
        lows = [] if is_made else [Low(job.low, wanted, {"is_made": False})]
        if maker is not None:
            lows = yield from part(maker.lows(lows, wanted, suffixes), 0.05, SEARCHED)
        jobs, is_new = [], []
        for low in lows:
            unwrapped.enter_context(_uv_map_of(low.obj))
            is_new.append(not low.obj.data.uv_layers)
            with timings.timed("unwrap"):
                low.how["unwrapped"] = unwrapping.unwrap(low.obj, settings) if is_new[-1] else ""
            size = 0
            if wanted.finds_size:
                edge = maker.edge if maker else partial(asset_highs.edge_of, context, job, settings)
                size = _size(low.obj, _texel(wanted, context, edge))
            jobs.append(job.but(low=low.obj, size=size))
        own_settings = settings.stored(connect_maps=True)
        if all(is_new):  # no high mesh has these UVs
            own_settings = own_settings.traced(method=Method.CAST)
        try:
            baking = bake_jobs.work(context, jobs, own_settings, pace, wants=replace(wants, seen=True))
            reports = yield from bake_jobs.all_or_nothing(part(baking, SEARCHED, 1.0))
        except NothingDrawn as error:
            if not is_made:
                raise
            raise BakeError(
                f"So coarse a mesh shows nothing of {job.highs[0].name!r} on so small a map: allow more triangles, or set a "
                "larger map."
            ) from error
        found = []
        for low, report in zip(lows, reports, strict=True):
            distance = maker.distance(low.obj) if wanted.distance < math.inf else 0.0
            how = low.how | {"missed": _missed(report, low, distance)}
            if distance:
                how["distance"] = distance
            found.append(replace(report, asset=how).with_warnings([*how["missed"], *_unused(report, low)]))
        for low in lows[1:]:
            low.obj.hide_set(True)  # it lies in the first one
    before = time.perf_counter() - start - sum(report.seconds["total"] for report in found)
    found[0].asset["seconds"] = timings.seconds | {"total": before}
    seconds = found[0].seconds | {"total": found[0].seconds["total"] + before}
    return [replace(found[0], seconds=seconds), *found[1:]]


def known_low(
    context: bpy.types.Context, highs: Sequence[bpy.types.Object], suffixes: Suffixes
) -> bpy.types.Object | None:
    """The low object that belongs to the first of these by its name; None without one."""
    context.view_layer.update()  # a script may have made objects
    found = context.view_layer.objects.get(naming.low_name_of(highs[0].name, suffixes))
    return found if found is not None and found.type == "MESH" and found not in highs else None


def names(low: str, count: int) -> list[str]:
    """The names of a low object and of `count` levels, unless other objects have them."""
    return [low, *(f"{low}{lod.ENDING}{number}" for number in range(1, count + 1))]


def _missed(report: Report, low: Low, distance: float) -> list[str]:
    """A sentence for each limit that a finished low mesh does not keep."""
    found, limit = [], low.limit
    most, count = report.appearance.get("percentile_99", 0.0), report.triangles["low"]
    if most > limit.degrees:
        found.append(
            f"The shading error of {report.low!r} is {most:.2f} degrees on 99 % of the pixels, and not {limit.degrees:g}: "
            "allow more degrees or more triangles, or set a larger map."
        )
    if distance > limit.distance:
        found.append(
            f"{report.low!r} is {distance:.2%} of the size away from the high mesh, and not {limit.distance:.2%}: allow more "
            "distance or more triangles."
        )
    if low.how["is_made"] and limit.has_missed(count):
        found.append(
            f"{report.low!r} has {count:,} triangles, not {limit.triangles:,}: the high mesh allows no others."
        )
    return found


def _unused(report: Report, low: Low) -> list[str]:
    """A sentence if hardly anything of a map is used, by a UV map that was made for it."""
    if not low.how["unwrapped"] or report.coverage > LITTLE:
        return []
    return [
        f"{report.low!r} covers only {report.coverage:.1%} of its map: margins around its islands take the rest. Set a larger "
        "map, or fewer levels in Clean Mips."
    ]


class _Maker:
    """Makes low objects of the high ones of a job. count: how many were measured."""

    def __init__(
        self,
        context: bpy.types.Context,
        job: Job,
        settings: Settings,
        pace: Pace,
        meshes: TemporaryMeshes,
        *,
        timings: Timings,
        wants: Wants,
    ):
        self._wants = wants
        self._context, self._job, self._pace, self._meshes, self._timings = context, job, pace, meshes, timings
        self._settings, self.count = settings, 0
        self._seen_highs: tuple[Samples, SeenHighs] | None = None
        """As they were last looked at, and the places of the base then."""
        self.high = asset_highs.read(context, job, settings, meshes)

    def lows(self, known: Sequence[Low], wanted: Wanted, suffixes: Suffixes) -> Task[list[Low]]:
        """`known`, or a new low object in its place, and levels of detail. Raises BakeError."""
        first, found = self._job.high_refs[0].resolve(), list(known)
        name = known[0].obj.name if known else naming.low_name_of(first.name, suffixes)
        home = next(iter(first.users_collection), None)
        base, left = None, range(len(known), 1 + wanted.levels)
        for done, level in enumerate(left):
            limit = wanted.of_level(level, _count(found[-1].obj) if found else 0)
            making = part(self._low(limit, base), done / len(left), (done + 1) / len(left))
            tried = yield from making
            base = tried.base
            how = {
                "is_made": True,
                "is_remeshed": base.is_remeshed,
                "is_collapsed": base.is_collapsed,
                "of": self.high.count,
                "inside": self.high.inside,
                "faults": self.high.faults,
                "measured": self.count,
                "limits": limit.to_dict(),
            }
            self.count = 0
            self._keep(tried.low, names(name, level)[level], home)
            found.append(Low(tried.low, limit, how))
        self._seen_highs = None  # its pictures
        return found

    def edge(self) -> float:
        """As High.edge has it."""
        return self.high.edge

    def distance(self, low: bpy.types.Object) -> float:
        """As High.distance has it."""
        to_world = mesh_reader.matrix(low)
        mesh = mesh_reader.surface(low.data, "", low.name, to_world)
        points = transformed(mesh.positions, to_world) - self.high.origin
        return self.high.distance(points, mesh.vertices[mesh.triangles])

    def _keep(self, low: bpy.types.Object, name: str, home: bpy.types.Collection | None) -> None:
        low.name = low.data.name = name
        low.hide_set(False)
        root = self._context.scene.collection
        if home is not None and home != root:
            home.objects.link(low)
            root.objects.unlink(low)
        for layer in list(low.data.uv_layers):
            low.data.uv_layers.remove(layer)
        self._meshes.release(low.data)

    def _low(self, limit: Wanted, base: Base | None) -> Task[Tried]:
        """A low object within a limit, or as near as can be. base: what it is made of; None for the best."""
        most = max(each.triangles for each in self.high.bases)
        most = min(most, limit.triangles) if limit.triangles else most
        first = most if limit.has_count else min(most, max(FEWEST, round(SHARE * len(self.high.triangles))))
        begin, tried = 0.0, []
        if base is None:
            begin = 0.5
            tried = yield from part(self._compared(first, limit), 0.0, begin)
            base = _best(tried).base
        if not limit.has_count:
            found = yield from part(self._searched(base, limit, first, most), begin, 1.0)
        else:
            yield Progress(f"Decimating to {first:,} triangles", begin)
            known = [each for each in tried if each.base is base]
            found = known[0] if known else Tried(self._made(base, first)[0], base, limit, None)
        self._remove_all_but(found, tried)
        return found

    def _compared(self, triangles: int, limit: Wanted) -> Task[list[Tried]]:
        """Low objects of about this many triangles, in all ways that there are."""
        tried, count = [], len(self.high.bases) + CORRECTIONS

        def attempt(base: Base) -> Task[None]:
            steps = self._tried(base, triangles, limit, is_compared=True)
            tried.append((yield from part(steps, len(tried) / count, (len(tried) + 1) / count)))

        for base in self.high.bases:
            yield from attempt(base)
        last = _best([each for each in tried if each.base.is_collapsed])
        for _ in range(CORRECTIONS):
            if last.seen is None:
                break
            yield from attempt(last.base.corrected(last.nearest, last.seen.places))
            last = tried[-1]
        return tried

    def _searched(self, base: Base, limit: Wanted, first: int, most: int) -> Task[Tried]:
        """The low object of the fewest triangles within a limit, or the nearest to it if none is within it."""
        tried: list[Tried] = []
        left = 1.0

        def attempt(wanted: int) -> Task[Tried]:
            nonlocal left
            begin, left = left, 0.8 * left
            found = yield from part(self._tried(base, wanted, limit), 1.0 - begin, 1.0 - left)
            tried.append(found)
            return found

        within, _ = yield from levels.fewest(first, most, attempt)
        best = within or min(tried, key=lambda each: each.excess)
        self._remove_all_but(best, tried)
        return best

    def _remove_all_but(self, kept: Tried, tried: Sequence[Tried]) -> None:
        for each in tried:
            if each is not kept:
                self._meshes.remove(each.low.data)  # and the object with it

    def _tried(self, base: Base, wanted: int, limit: Wanted, *, is_compared: bool = False) -> Task[Tried]:
        """A low object that was measured with the samples and the size of the finished one.

        is_compared: whether it is looked at, quickly, even if there is no limit in degrees.
        """
        yield Progress(f"Decimating to {wanted:,} triangles", 0.0)
        low, nearest = self._made(base, wanted)
        distance = self.distance(low) if limit.distance < math.inf else 0.0
        seen, is_drawn = None, True
        if is_compared or limit.degrees < math.inf:
            yield Progress(f"Unwrapping {wanted:,} triangles", 0.1)
            settings = _normals_alone(self._settings, self._context)
            if is_compared:
                settings = settings.of_at_most(QUICK_SIDE).sampled(samples=1)
            with self._timings.timed("unwrap"):
                unwrapping.unwrap(low, settings, is_quick=True)
            if limit.finds_size and not is_compared:
                size = _size(low, _texel(limit, self._context, self.edge))
                settings = settings.sampled(width=size, height=size)
            settings = settings.of_at_most(SIDE)
            request = Request(self._job.but(low=low), settings, self._wants)
            check_job(self._context, request.job, settings)
            try:
                drawing = self._timed(draw_raw(self._context, request, Run(settings, self._pace)), "draw")
                baked, maps = yield from part(drawing, 0.2, 0.6)
                looking = self._timed(self._looked_at(baked, maps[udim.FIRST][NORMAL.name], base), "look")
                seen = yield from part(looking, 0.6, 1.0)
            except NothingDrawn:
                is_drawn = False
            if seen is None and is_drawn and limit.degrees < math.inf:
                raise NoGpu(
                    "This GPU cannot measure the shading error: give a number of triangles in place of degrees."
                )
        low.hide_set(True)
        self.count += 1
        return Tried(low, base, limit, seen, distance, is_drawn=is_drawn, nearest=nearest)

    def _timed(self, work: Task[Any], stage: str) -> Task[Any]:
        """`work`, with its time added to a stage. The time between its steps does not count."""
        return relay(work, within=lambda: self._timings.timed(stage))

    def _looked_at(self, baked: Baked, normals: np.ndarray, base: Base) -> Task[Appearance | None]:
        """The shading error of a low mesh, and what is seen of the places of its base. None if it cannot be measured.

        normals: as baking.Renderer.raw returns them.
        """
        settings, meshes = baked.settings, baked.plan.meshes
        if appearance.why_not(baked.plan, settings):
            return None
        low, places = meshes.basis or meshes.low, base.places
        if self._seen_highs is None or self._seen_highs[0] is not places:
            in_world = replace(places, points=places.points + self.high.origin)
            seen = SeenHighs(meshes.highs, [*meshes.highs, low], places=in_world)
            yield from part(seen.draw(), 0.0, 0.5)
            self._seen_highs = places, seen
        texels, _ = normal_space.stored(normals, settings)
        shown = ShownMap({udim.FIRST: kept(texels, settings)}, normal_space.reading(settings.map))
        return (yield from part(self._seen_highs[1].compare(low, shown), 0.5, 1.0))

    def _made(self, base: Base, triangles: int) -> tuple[bpy.types.Object, np.ndarray]:
        """A low object of about this many triangles, and its triangles as Base.fitted returns them."""
        with self._timings.timed("decimate"):
            data = self._meshes.own(self.high.low(base, triangles))
            nearest = base.fitted(data)
        data.polygons.foreach_set("use_smooth", np.ones(len(data.polygons), bool))
        data.update()
        data.set_sharp_from_angle(angle=SHARP)
        low = bpy.data.objects.new(TEMPORARY, data)
        self._context.scene.collection.objects.link(low)
        low.matrix_world = Matrix.Translation(self.high.origin)
        self._context.view_layer.update()
        return low, nearest


def _best(tried: Sequence[Tried]) -> Tried:
    """The one that looks best, by how sure that is."""
    is_remeshed = any(each.base.is_remeshed for each in tried)

    def cost(each: Tried) -> float:
        factor = WHOLE if is_remeshed and not each.base.is_remeshed else 1.0
        return each.cost * factor * (CLEARLY if each.base.is_collapsed else 1.0)

    return min(tried, key=cost)


def _count(low: bpy.types.Object) -> int:
    """The triangles of an object's own mesh."""
    low.data.calc_loop_triangles()
    return len(low.data.loop_triangles)


def _normals_alone(settings: Settings, context: bpy.types.Context) -> Settings:
    """The settings by which low meshes are measured: for the normal map alone, which is not kept."""
    settings = settings.read_by(context.scene.render.engine).without_file().without_materials()
    return settings.without_other_maps().traced(method=Method.CAST)


@contextmanager
def _uv_map_of(low: bpy.types.Object) -> Iterator[None]:
    """Remove the UV maps that the block gives to an object, if it fails."""
    uid, before = low.session_uid, {layer.name for layer in low.data.uv_layers}
    is_finished = False
    try:
        yield
        is_finished = True
    finally:
        if not is_finished:
            for obj in [obj for obj in bpy.data.objects if obj.session_uid == uid]:
                for name in [layer.name for layer in obj.data.uv_layers if layer.name not in before]:
                    obj.data.uv_layers.remove(obj.data.uv_layers[name])


def _texel(wanted: Wanted, context: bpy.types.Context, edge: Callable[[], float]) -> float:
    """The side of a texel that is wanted, in scene units. edge: returns that of the high mesh's triangles."""
    if wanted.fits_size:
        return edge()
    return 1.0 / (wanted.density * context.scene.unit_settings.scale_length)


def _size(low: bpy.types.Object, edge: float) -> int:
    """The side of the maps at which a texel is not larger than an edge of this length in scene units."""
    layer = mesh_reader.active_uv_layer(low.data)
    mesh = mesh_reader.surface(low.data, layer, low.name, mesh_reader.matrix(low))
    points = mesh.positions.astype(np.float64) @ mesh.to_world[:3, :3].T
    used = uv_stretch.measure(points[mesh.vertices[mesh.triangles]], mesh.uv[mesh.triangles]).used
    area = float(face_areas(points, mesh.vertices[mesh.triangles]).sum())
    return asset.size_for(edge, area, min(used, 1.0))
