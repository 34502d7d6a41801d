# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes a game asset of high objects: low meshes as coarse as their limits allow, a UV map for each, and its maps.

The search bakes each low mesh and compares it with the high mesh from all sides, so that the limit is on what a viewer sees.
"""

import math
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial

import bpy
import numpy as np

from ..audit.appearance import kept_pictures
from ..core import asset_limits, foreach, naming
from ..core.asset_limits import HowMade, Wanted
from ..core.declarations.choices import Method, Space, Symmetry, Wrap
from ..core.errors import BakeError, NothingDrawn
from ..core.naming import Suffixes
from ..core.progress import Pace, Task, Timings, part, relay
from ..core.report import Report
from ..core.sentences import NOTE, Sentence
from ..core.settings import Settings
from ..core.simplify import LEAST, Candidate, Search
from ..engine import normal_space
from ..output import datablocks
from ..output.atomic_file import all_or_none
from ..scene import evaluation, mesh_reader
from ..scene.object_checks import ObjectRef
from . import bake_jobs, low_material, temporary, unwrapping, uv_density
from .job import NOTHING_ELSE, Job, Request, Wants, check_gpu
from .simplify import appearance_judge, decimation, high_surface, quad_meshes, shared_levels, skins
from .simplify.appearance_judge import AppearanceJudge
from .simplify.high_surface import HighSurface
from .simplify.low_meshes import DecimationSource, LowMesh, Source, arrays
from .simplify.shared_levels import LayoutSource, SharedLevel
from .simplify.skins import Skin

SEARCHED, UNWRAPPED = 0.7, 0.8
"""The share of the work that is done before the low objects get UV maps, and before their maps are baked."""
SHARE, FEWEST = 0.1, 500
"""The share of the high triangles with which a search begins, and how many it begins with at least."""
COLLAPSED = 0.5
"""The share of making levels that share textures that is done before their normals are compared."""
FLAT = 10.0
"""The mean angle in degrees between the normals and the faces of a low mesh of a hard surface below which they stay, so that
its map is flat. Other surfaces have no flat sides. Tried on a crater of 3,000 triangles, whose angle is 9.4: common normals
turn 2.7, 4.9 and 7.9 degrees of error at 1,500, 750 and 375 triangles into 0.5, 0.9 and 1.4."""
STORED = 0.2
"""The degrees that 8 bits alone account for: errors below are alike."""
BETTER, WORSE = 0.9, 1.25
"""The mean factor on the errors of levels below which common normals are taken, and that on those of the low mesh that they
may have."""
SHARED, LOOKED = 0.86, 0.98
"""The shares that are done after levels that share textures are made, and when these are to be looked at."""
FOLDED = 1000.0
"""Degrees for which triangles count that are turned over, where ways to make a low mesh are compared: others are better."""
COARSER = 0.8
"""The most triangles of a level of detail, as a share of those of the one before it: more are not worth a level."""
BROKEN, SEEN = 4.0, 0.5
"""The factor on the error of the low mesh, twice as much with each level, above which a level with its textures is broken, and
the least degrees that this error counts for. Levels that look right have 0.5 to 2.6, one with a folded wall 5.2."""
MIN_COVERAGE = 0.1
"""The share of a map below which it is hardly used."""
CORRECTIONS = 3
"""How often edges collapse anew by the errors that were seen: after that, hardly anything changes."""


@dataclass(frozen=True)
class Low:
    """A low object of an asset.

    Attributes:
        wanted: Its limits.
        how: It was made, so far.
        obj: The object.
    """

    obj: bpy.types.Object
    wanted: Wanted
    how: HowMade


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
    """Make the low object of a job, if it has none and the high one is not kept as such, give it a UV map, if it has none, and
    bake all maps of the settings.

    If the generator is closed early, or raises BakeError, nothing has changed.

    Args:
        job: of the high objects; its low object is one of them if there is none yet.
        wanted: how coarse the low mesh may be, and how many levels of detail follow.
        suffixes: of the names of objects.
        wants: besides the maps.

    Returns:
        The reports of the low object and of its levels, from the finest.
    """
    start, timings = time.perf_counter(), Timings(asset_limits.STAGES)
    settings = settings.stored(low_suffix=suffixes.low)
    _check(job, wanted, settings)
    with (
        _Aside() as aside,  # when new ones are gone, old ones have their names again
        temporary.only_if_finished(),
        all_or_none(),
        temporary.meshes(),
        kept_pictures(),
        ExitStack() as stack,
    ):
        is_there = wanted.keeps or job.low not in job.highs
        high, lows = None, [Low(job.low, wanted, HowMade(is_made=False))] if is_there else []
        skin = Skin.of(job.highs if not lows else [job.low], settings.map.modifiers)
        if not lows or wanted.levels:
            stack.enter_context(skin.at_rest(context, job.highs))
        if not lows or wanted.levels or wanted.distance < math.inf:
            check_gpu()
            reading = _read(context, job, wanted, settings, timings)
            high = yield from part(relay(reading, within=lambda: timings.timed("read")), 0.0, 0.04)
            posing = relay(_posed(context, skin, high), within=lambda: timings.timed("read"))
            high = yield from part(posing, 0.04, 0.05)
            job = job.but(closing=None if lows else high.closing)  # a low mesh that is there may have the holes
            judge = AppearanceJudge(context, Request(job, settings, Wants(whole=wants.whole)), pace, high, timings)
            making = _Making(context, high, judge, settings, suffixes, aside)
            lows = yield from part(making.lows(job, lows, wanted), 0.05, SEARCHED)
        density = partial(_density, context, job, settings)
        unwrapping_all = relay(_all_unwrapped(lows, settings, stack, density), within=lambda: timings.timed("unwrap"))
        lows = yield from part(unwrapping_all, SEARCHED, UNWRAPPED)
        jobs, sharing = [_job_of(low, job, context, settings, high) for low in lows], []
        if wanted.levels > wanted.own_levels:
            sharing = yield from part(making.sharing(lows[0], jobs[0], skin, timings), UNWRAPPED, SHARED)
        carrying = skin.carry(context, [low.obj for low in [*lows, *sharing] if low.how.is_made])
        notes = yield from part(carrying, SHARED, SHARED)
        reports = yield from part(
            _baked(context, jobs, lows, settings, pace, wants=replace(wants, seen=True)), SHARED, LOOKED
        )
        if sharing:
            reports += yield from part(_shown(sharing, reports[0], making), LOOKED, 1.0)
        lows += sharing
        reports = [_judged(report, low, high) for low, report in zip(lows, reports, strict=True)]
        numbered = enumerate(zip(reports, lows, strict=True))
        reports = [report.with_warnings(_broken(report, low, reports[0], level)) for level, (report, low) in numbered]
        reports[0] = reports[0].with_warnings(
            [*notes, *_ended(lows, wanted), *_not_done(lows[0], high, settings), *_staying(lows[0], high)]
        )
        for low in lows[1:]:
            low.obj.hide_set(True)  # it lies in the first one
    before = time.perf_counter() - start - sum(report.seconds["total"] for report in reports)
    reports[0].asset["seconds"] = timings.seconds | {"total": before}
    seconds = reports[0].seconds | {"total": reports[0].seconds["total"] + before}
    return [replace(reports[0], seconds=seconds), *reports[1:]]


def highs_of(
    context: bpy.types.Context, selected: Sequence[bpy.types.Object], suffixes: Suffixes
) -> list[bpy.types.Object]:
    """The high objects of selected ones: in place of a low object that was made, which is selected then, the one it is of."""
    objects = [obj for obj in context.view_layer.objects if obj.type == "MESH"]
    made = {name: obj for obj in objects for name in naming.made_names(obj.name, suffixes, asset_limits.MOST_LEVELS)}
    return list(dict.fromkeys(made.get(obj.name, obj) for obj in selected))


def known_low(
    context: bpy.types.Context, highs: Sequence[bpy.types.Object], suffixes: Suffixes
) -> bpy.types.Object | None:
    """The low object that belongs to the first of these by its name; None without one."""
    context.view_layer.update()  # a script may have made objects
    objects = context.view_layer.objects
    low = next(filter(None, map(objects.get, naming.made_names(highs[0].name, suffixes, 0))), None)
    return low if low is not None and low.type == "MESH" and low not in highs else None


def _read(
    context: bpy.types.Context, job: Job, wanted: Wanted, settings: Settings, timings: Timings
) -> Task[HighSurface]:
    """The surface that low meshes are made of."""
    if not wanted.quads:
        enough = wanted.triangles if wanted.has_count else 0
        return (yield from high_surface.read(context, job, settings, timings, wanted.mending, enough=enough))
    mending = replace(wanted.mending, symmetry=Symmetry.NONE)
    high = yield from high_surface.read(context, job, settings, timings, mending)
    return replace(high, sources=quad_meshes.sources_of(high.sources))


def _posed(context: bpy.types.Context, skin: Skin, high: HighSurface) -> Task[HighSurface]:
    """The surface, whose low meshes are made for the poses of a skin, too."""
    sources = list[Source]()
    for source in high.sources:
        motions = None
        if isinstance(source, DecimationSource) and source.is_collapsed:
            motions = yield from skin.motions(context, *arrays(source.dense), high.origin)
        sources.append(source if motions is None else source.posed(motions))
    return replace(high, sources=sources)


def _check(job: Job, wanted: Wanted, settings: Settings) -> None:
    """Raise BakeError for problems that show before any mesh is read."""
    wanted.check()
    settings.check()
    if settings.sampling.udim or settings.map.texture_sets:
        raise BakeError("An asset has one texture: turn UDIM Tiles and Texture Sets off.")
    if settings.sampling.wrap != Wrap.NONE:
        raise BakeError("An asset gets UV islands of its own, and is no tile: turn Wrap off.")
    if wanted.keeps and job.highs != [job.low]:
        raise BakeError("Only a mesh alone keeps its triangles: choose one high object, and no low one.")
    if job.low not in job.highs and job.low.type != "MESH":
        raise BakeError(f"{job.low.name!r} is no mesh: choose a mesh as the low object.")
    uv_density.check(job.highs if job.low in job.highs else [job.low], wanted.density_group)


class _Aside(ExitStack):
    """The levels of detail of an earlier press, and the materials that they alone wear: without their names as long as new ones
    are made, then removed. If these fail, they have their names again."""

    def put(self, collection: bpy.types.Collection, names: Sequence[str]) -> None:
        """Put the levels of these names in a collection aside."""
        for name in names:
            obj = collection.objects.get(name)
            if obj is not None and obj.type == "MESH" and obj.is_editable:
                before = name, obj.data.name
                obj.name = obj.data.name = temporary.TEMPORARY
                own = next((each for each in obj.data.materials if each and (each.name, each.users) == (name, 1)), None)
                if own is not None:
                    own.name = temporary.TEMPORARY
                self.push(partial(self._end, ObjectRef.of(obj), before, own and own.name))

    @staticmethod
    def _end(
        ref: ObjectRef, names: tuple[str, str], material: str | None, failed: type[BaseException] | None, *_: object
    ) -> None:
        obj = ref.find()
        if obj is None:
            return
        own = [each for each in obj.data.materials if each and each.name == material]
        if failed is not None:
            obj.name, obj.data.name = names
            for each in own:
                each.name = names[0]
        elif obj.data.users > 1:
            bpy.data.objects.remove(obj)
        else:
            bpy.data.meshes.remove(obj.data)  # and the object with it
            bpy.data.batch_remove([each for each in own if not each.users])


@dataclass(frozen=True)
class _Making:
    """Makes low objects of a high surface."""

    context: bpy.types.Context
    high: HighSurface
    judge: AppearanceJudge
    settings: Settings
    suffixes: Suffixes
    aside: _Aside

    def lows(self, job: Job, known: Sequence[Low], wanted: Wanted) -> Task[list[Low]]:
        """`known`, or a new low object in its place, and levels of detail with textures of their own, until one is not coarser.
        Raises BakeError."""
        lows, home = list(known), self._home(known[0].obj if known else job.highs[0])
        name = known[0].obj.name if known else naming.low_name_of(job.highs[0].name, self.suffixes)
        shared_name = naming.of_new_levels(name, self.suffixes.low)
        if wanted.levels and (wanted.owns_textures or not known):
            home = self._collection(shared_name, home)
        names = [name if known or not wanted.levels else name + naming.FIRST_LEVEL]
        names += naming.level_names(shared_name, wanted.own_levels)
        maker, left = None, range(len(known), len(names))
        for done, level in enumerate(left):
            limit = wanted.of_level(level, mesh_reader.count_triangles(lows[-1].obj.data) if lows else 0)
            low, maker, measured = yield from part(self._low(limit, maker), done / len(left), (done + 1) / len(left))
            if level and low.triangles > COARSER * mesh_reader.count_triangles(lows[-1].obj.data):
                low.remove()
                break
            obj = self._object(low.data, names[level], home)
            obj.data.materials.append(
                low_material.new_like(job.highs, naming.of_levels(names[level], self.suffixes.low))
            )
            lows.append(Low(obj, limit, self._how(low.source, measured, limit)))
        return lows

    def sharing(self, low: Low, job: Job, skin: Skin, timings: Timings) -> Task[list[Low]]:
        """Levels of detail that show the textures of a low object, which has its UV map, until one is hardly coarser.

        Args:
            low: the low object.
            job: of its bake.
            skin: in whose poses levels are near the low object, too.
            timings: get the time that it takes.
        """
        wanted, name = low.wanted, naming.of_new_levels(low.obj.name, self.suffixes.low)
        room = unwrapping.margin(self.settings.sampling)
        modifiers = self.settings.map.modifiers
        original = decimation.read_original(
            self.context, low.obj, "", modifiers, with_normals=True, is_own_base=wanted.keeps
        )
        samples = replace(self.high.samples, points=self.high.samples.points + self.high.origin)
        source, texels, result = LayoutSource(original, samples, room), None, list[Low]()
        motions = yield from part(
            skin.motions(self.context, *source.in_world(self.high.origin), self.high.origin), 0.0, 0.0
        )
        source = source.posed(motions, self.high.origin)
        if not wanted.has_count:
            texels = yield from part(self.judge.normal_map(low.obj, job.size or appearance_judge.SIDE), 0.0, 0.3)
        home, meshes = self._home(low.obj), list[SharedLevel]()
        before, begin = source.triangles, 0.0 if texels is None else 0.3
        for number, level_name in enumerate(naming.level_names(name, wanted.levels), start=1):
            limit = wanted.of_level(number, before)
            ends = (begin + (COLLAPSED - begin) * share / wanted.levels for share in (number - 1, number))
            mesh, measured = yield from part(self._shared(source, limit, texels, timings), *ends)
            if mesh.triangles > COARSER * before:
                mesh.remove()
                break
            if not meshes and not low.how.is_made:
                home = self._collection(name, home)
            before = mesh.triangles
            meshes.append(mesh)
            mesh.data.name = level_name
            obj = bpy.data.objects.new(level_name, mesh.data)
            home.objects.link(obj)
            skins.put_in_place_of(obj, low.obj)
            how = HowMade(
                is_made=True, of=self.high.count, measured=measured, limits=limit.to_dict(), shares=low.obj.name
            )
            result.append(Low(obj, limit, how))
        is_free = not self.high.is_hard or source.bend > FLAT
        if meshes and low.how.is_made and self.settings.map.space == Space.TANGENT and is_free:
            self.context.view_layer.update()
            yield from part(self._with_common_normals([low, *result], source, meshes), COLLAPSED, 1.0)
        return result

    def _with_common_normals(
        self, lows: Sequence[Low], source: LayoutSource, levels: Sequence[SharedLevel]
    ) -> Task[None]:
        """Give a low object and its levels normals that differ as little as can be between them, if the levels look better with
        the map that counts from these. levels: their meshes."""
        texels, before = yield from part(self._errors(lows), 0.0, 0.4)
        if not before:
            return
        meshes = [low.obj.data for low in lows]
        own = list(map(shared_levels.custom_normals, meshes))
        common, *others = yield from part(source.common_normals(levels), 0.4, 0.4)
        source.give(meshes[0], common)
        for level, normals in zip(levels, others, strict=True):
            shared_levels.set_normals(level.data, normals)
        other_texels, after = yield from part(self._errors(lows), 0.4, 0.8)
        ratios = np.maximum(after or [np.inf], STORED) / np.maximum(before, STORED)
        if ratios[0] > WORSE or ratios[1:].mean() > BETTER:
            for mesh, normals in zip(meshes, own, strict=True):
                shared_levels.set_normals(mesh, normals)
        else:
            texels, before = other_texels, after
        yield from part(self._with_fitted_normals(lows, source, levels, texels, before), 0.8, 1.0)

    def _with_fitted_normals(
        self,
        lows: Sequence[Low],
        source: LayoutSource,
        levels: Sequence[SharedLevel],
        texels: np.ndarray,
        errors: Sequence[float],
    ) -> Task[None]:
        """Give levels normals with which they show what the low object shows with its map, where that looks better. texels,
        errors: from `_errors`."""
        normals = (2.0 * texels[..., :3] - 1.0) @ normal_space.channels(self.settings.map).astype(np.float32)
        for done, (low, level, error) in enumerate(zip(lows[1:], levels, errors[1:], strict=True)):
            known = shared_levels.custom_normals(level.data)
            source.fit_normals(lows[0].obj.data, level, normals)
            ends = (share / len(levels) for share in (done, done + 1))
            seen = yield from part(self.judge.with_map(low.obj, texels, is_quick=True), *ends)
            if seen is None or seen.mean >= error:
                shared_levels.set_normals(level.data, known)

    def _errors(self, lows: Sequence[Low]) -> Task[tuple[np.ndarray, list[float]]]:
        """The normal map of a low object, quickly, and the mean shading errors of it and its levels with that; empty if it
        shows nothing."""
        texels = yield from part(self.judge.normal_map(lows[0].obj), 0.0, 0.5)
        errors = list[float]()
        if texels is None:
            return np.zeros((0, 0, 4), np.float32), errors
        for done, low in enumerate(lows):
            ends = (0.5 + 0.5 * share / len(lows) for share in (done, done + 1))
            seen = yield from part(self.judge.with_map(low.obj, texels, is_quick=True), *ends)
            if seen is None:
                return texels, []
            errors.append(seen.mean)
        return texels, errors

    def _shared(
        self, source: LayoutSource, limit: Wanted, texels: np.ndarray | None, timings: Timings
    ) -> Task[tuple[SharedLevel, int]]:
        """A level that shows the textures of the low object, and how many were measured. texels: of its normal map."""
        if limit.has_count or texels is None:
            (mesh,) = yield from relay(source.make(limit.triangles), within=lambda: timings.timed("decimate"))
            return mesh, 0
        judge = partial(self.judge.shared, limit, texels=texels)
        search = Search(limit.search_limit, judge, SharedLevel.remove)
        found = yield from search.min_triangles(source, max(LEAST, limit.triangles // 2), limit.triangles)
        return found.mesh, search.count

    def _home(self, obj: bpy.types.Object) -> bpy.types.Collection:
        """The collection in which objects are where another one is, and are seen."""
        shown = evaluation.shown_collections(self.context.view_layer)
        return next((each for each in obj.users_collection if each in shown), self.context.scene.collection)

    def _collection(self, name: str, within: bpy.types.Collection) -> bpy.types.Collection:
        """The collection of the levels of detail of an object: the one that is seen, without the levels of its last bake, or a
        new one."""
        shown = evaluation.shown_collections(self.context.view_layer)
        for known in (within, *within.children):
            if known.name == name + naming.LEVELS and known.is_editable and known in shown:
                self.aside.put(known, naming.level_names(name, asset_limits.MOST_LEVELS))
                return known
        made = bpy.data.collections.new(name + naming.LEVELS)
        within.children.link(made)
        return made

    def _low(self, wanted: Wanted, maker: Source | None) -> Task[tuple[LowMesh, Source, int]]:
        """A low mesh within its limits, or as near as can be, its maker, and how many were measured. maker: None for the
        best."""
        most = max(each.triangles for each in self.high.sources)
        if wanted.has_count and not wanted.is_count_given:
            most = max(min(most, self.high.count), LEAST)  # voxels could have more
        most = min(most, wanted.triangles) if wanted.triangles else most
        first = most if wanted.has_count else min(most, max(FEWEST, round(SHARE * len(self.high.triangles))))
        compared = Search(wanted.search_limit, self.judge.quickly, LowMesh.remove)
        best, begin = None, 0.0
        if maker is None:
            begin = 0.5
            finding = compared.best_of(
                self.high.sources, first, partial(_cost, wanted=first), CORRECTIONS, self.high.symmetric
            )
            best = yield from part(finding, 0.0, begin)
            maker = best.maker
        if not wanted.has_count:
            search = Search(wanted.search_limit, partial(self.judge.within, wanted), LowMesh.remove)
            fewest = yield from part(search.min_triangles(maker, first, most), begin, 1.0)
            compared.keep_only([])
            return fewest.mesh, maker, compared.count + search.count
        if best is not None:
            return best.mesh, maker, compared.count
        (mesh,) = yield from part(maker.make(first), begin, 1.0)
        return mesh, maker, compared.count

    def _object(self, data: bpy.types.Mesh, name: str, home: bpy.types.Collection) -> bpy.types.Object:
        """The object of a finished mesh, without the UV map by which it was judged."""
        data.name = name
        low, root = self.high.new_object(self.context, name, data), self.context.scene.collection
        if home != root:
            home.objects.link(low)
            root.objects.unlink(low)
        for layer in list(data.uv_layers):
            data.uv_layers.remove(layer)
        return low

    def _how(self, source: Source, measured: int, wanted: Wanted) -> HowMade:
        return HowMade(
            is_made=True,
            is_remeshed=source.is_remeshed,
            is_collapsed=source.is_collapsed,
            keeps_planes=source.keeps_planes,
            of=self.high.count,
            inside=self.high.hidden_share,
            faults=self.high.bad_edge_share,
            crumbs=self.high.crumbs.mended + source.left_out,
            holes=self.high.holes.mended,
            symmetry=source.mirror.name if source.mirror is not None else None,
            measured=measured,
            limits=wanted.to_dict(),
        )


def _cost(candidate: Candidate, wanted: int) -> float:
    """How wrong a low mesh looks, by how sure that is: as many times as wrong as it has more triangles than were wanted."""
    over = max(1.0, candidate.triangles / ((1.0 + asset_limits.OFF) * wanted))
    return candidate.deviation.cost * candidate.maker.bias * over + (FOLDED if candidate.mesh.is_folded else 0.0)


def _density(context: bpy.types.Context, job: Job, settings: Settings, low: Low) -> np.ndarray | None:
    """The weights of the vertices of a low mesh by which islands are denser; None for none."""
    group = low.wanted.density_group
    if not group or not low.how.is_made:
        return uv_density.of_mesh(low.obj, group)
    return uv_density.of_highs(context, job.highs, group, low.obj, modifiers=settings.map.modifiers)


def _all_unwrapped(
    lows: Sequence[Low], settings: Settings, stack: ExitStack, density: Callable[[Low], np.ndarray | None]
) -> Task[list[Low]]:
    """The low objects with UV maps. stack: removes those that are new if it fails. density: returns weights of vertices."""
    unwrapped = []
    for done, low in enumerate(lows):
        work = _unwrapped(low, settings, stack, density)
        unwrapped.append((yield from part(work, done / len(lows), (done + 1) / len(lows))))
    return unwrapped


def _unwrapped(
    low: Low, settings: Settings, stack: ExitStack, density: Callable[[Low], np.ndarray | None]
) -> Task[Low]:
    layers = low.obj.data.uv_layers
    if unwrapping.is_unwrapped(low.obj, settings.map.uv_layer):
        return low
    before = layers.active.name if layers else ""
    ref, weights = ObjectRef.of(low.obj), density(low)
    text = yield from unwrapping.work(low.obj, settings, stacks=low.wanted.stacks_mirrored, weights=weights)
    name = low.obj.data.uv_layers.active.name

    def undo(kind: type[BaseException] | None, *_: object) -> None:
        obj = ref.find()
        if kind is not None and obj is not None:
            obj.data.uv_layers.remove(obj.data.uv_layers[name])
            if before:
                obj.data.uv_layers.active = obj.data.uv_layers[before]

    stack.push(undo)
    return replace(low, how=replace(low.how, unwrapped=text))


def _job_of(low: Low, job: Job, context: bpy.types.Context, settings: Settings, high: HighSurface | None) -> Job:
    """The job that bakes a low object."""
    if not low.wanted.finds_size:
        return job.but(low=low.obj)
    edge = partial(high_surface.edge_of, context, job, settings) if high is None else lambda: high.edge
    side = appearance_judge.map_side(low.obj, appearance_judge.texel_side(low.wanted, context, edge))
    return job.but(low=low.obj, size=side)


def _baked(
    context: bpy.types.Context,
    jobs: Sequence[Job],
    lows: Sequence[Low],
    settings: Settings,
    pace: Pace,
    *,
    wants: Wants,
) -> Task[list[Report]]:
    """Bake the maps of all low objects."""
    settings = settings.stored(connect_maps=True)
    if all(low.how.unwrapped for low in lows):  # no high mesh has these UVs
        settings = settings.traced(method=Method.CAST)
    try:
        return (yield from bake_jobs.all_or_nothing(bake_jobs.work(context, jobs, settings, pace, wants=wants)))
    except NothingDrawn as error:
        if not lows[0].how.is_made:
            raise
        name = jobs[0].highs[0].name
        if not error.is_covered:
            raise BakeError(
                f"Margins around the UV islands of {name!r} take all of so small a map: set a larger map, or fewer levels in "
                "Clean Mips."
            ) from error
        raise BakeError(
            f"So coarse a mesh shows nothing of {name!r} on so small a map: allow more triangles, or set a larger map."
        ) from error


def _shown(sharing: Sequence[Low], report: Report, making: _Making) -> Task[list[Report]]:
    """The reports of levels that show the textures of the low object. report: its own."""
    image, slots = datablocks.get(report.image), report.refs[0].resolve().material_slots
    shown = foreach.pixels(image) if image is not None and report.appearance else None
    reports = []
    for done, low in enumerate(sharing):
        for slot in slots:
            low.obj.data.materials.append(slot.material)
        seen = None
        if shown is not None:
            looking = making.judge.with_map(low.obj, shown)
            seen = yield from part(looking, done / len(sharing), (done + 1) / len(sharing))
        reports.append(
            replace(
                report,
                low=low.obj.name,
                refs=[ObjectRef.of(low.obj), *report.refs[1:]],
                triangles=report.triangles | {"low": len(low.obj.data.polygons)},
                appearance=seen.to_dict() if seen is not None else {},
                seconds=Timings().seconds,
                warnings=[],
                ratings={},
                state=None,
            )
        )
    return reports


def _judged(report: Report, low: Low, high: HighSurface | None) -> Report:
    """The report with how the low mesh was made, and a warning for each limit that it does not keep."""
    distance = high.distance(low.obj) if low.wanted.distance < math.inf else None
    missed = _missed(report, low, distance or 0.0)
    how = replace(low.how, missed=missed, distance=distance or None)
    return replace(report, asset=how.to_dict()).with_warnings([*missed, *_unused(report, low)])


def _missed(report: Report, low: Low, distance: float) -> list[str]:
    """A sentence for each limit that a finished low mesh does not keep."""
    sentences, limit = [], low.wanted
    most, count = report.appearance.get("percentile_99", 0.0), report.triangles["low"]
    more = " or more triangles" if low.how.is_made else ""
    other = (
        "" if low.how.is_made or limit.keeps else " The low mesh that was there is kept: give one with more triangles."
    )
    if most > limit.degrees:
        sentences.append(
            f"The shading error of {report.low!r} is {most:.2f} degrees on 99 % of the pixels, and not {limit.degrees:g}: "
            f"allow more degrees{more}, or set a larger map.{other}"
        )
    if distance > limit.distance:
        sentences.append(
            f"{report.low!r} is {distance:.2%} of the size away from the high mesh, and not {limit.distance:.2%}: allow more "
            f"distance{more}.{other}"
        )
    if low.how.is_made and limit.has_missed(count):
        why = "the high mesh allows no others."
        if low.how.shares and count > limit.triangles:
            why = f"fewer with the UVs of {low.how.shares!r} would fold its surface. Turn Own Textures on to get fewer."
        sentences.append(f"{report.low!r} has {count:,} triangles, not {limit.triangles:,}: {why}")
    return sentences


def _broken(report: Report, low: Low, first: Report, level: int) -> list[str]:
    """A sentence if the textures of the low mesh, whose report is the first, do not suit a level of detail."""
    own, shown = (each.appearance.get("mean", 0.0) for each in (first, report))
    if not low.how.shares or shown <= BROKEN * 2**level * max(own, SEEN):
        return []
    return [
        f"{report.low!r} has a shading error of {shown:.1f} degrees with the textures of {first.low!r}, which has {own:.1f}: "
        "turn Own Textures on, or have fewer levels of detail."
    ]


def _ended(lows: Sequence[Low], wanted: Wanted) -> list[str]:
    """A sentence if there are fewer levels of detail than were wanted."""
    count = len(lows) - 1
    if count >= wanted.levels:
        return []
    with_what = "of it." if wanted.owns_textures else "with its UVs. Own Textures may allow more."
    return [
        f"{lows[0].obj.name!r} has {count} of {wanted.levels} levels of detail: hardly anything coarser can be made {with_what}"
    ]


def _not_done(low: Low, high: HighSurface | None, settings: Settings) -> list[str]:
    """A sentence for each option that has no effect, or a bad one."""
    sentences = []
    asked = {"Stack Mirrored": low.wanted.stacks_mirrored, "Density Group": low.wanted.density_group}
    for label in (label for label, is_set in asked.items() if is_set and not low.how.unwrapped):
        sentences.append(f"{label} changes no UV map that is there: remove that of {low.obj.name!r} to get one.")
    if low.how.unwrapped and settings.tracing.method == Method.FLATTEN:
        sentences.append(
            f"Flatten is for UVs that the high mesh has, and those of {low.obj.name!r} are new: rays were cast."
        )
    if high is not None and low.how.is_made and high.loses_planes:
        sentences.append(
            f"{low.obj.name!r} equals its mirror image, and its flat sides are not kept exactly: set Symmetry to None for flat "
            "ones."
        )
    return sentences


def _staying(low: Low, high: HighSurface | None) -> list[str]:
    """A sentence about small parts, and one about small holes, that stay and may not be meant."""
    if high is None or not low.how.is_made:
        return []
    too_many = low.how.crumbs - high.crumbs.mended  # for the triangles, so that these are gone, too
    of_each = (
        ("parts", high.crumbs.stay - too_many, high.crumbs.largest, "Crumbs", "leave them out"),
        ("holes", high.holes.stay, high.holes.largest, "Holes", "fill them"),
    )
    return [
        Sentence(
            f"Small {what} that stay: {count:,}, of at most {size:.1%} of the size. "
            f"Set {setting} to {_above(size):g} to {cure}.",
            NOTE,
        )
        for what, count, size, setting, cure in of_each
        if count > 0
    ]


def _above(share: float) -> float:
    """The percentage with one decimal that is above a share."""
    return math.floor(1000.0 * share + 1.0) / 10.0


def _unused(report: Report, low: Low) -> list[str]:
    """A sentence if hardly anything of a map is used, by a UV map that was made for it."""
    if not low.how.unwrapped or report.coverage > MIN_COVERAGE:
        return []
    return [
        f"{report.low!r} covers only {report.coverage:.1%} of its map: margins around its islands take the rest. Set a larger "
        "map, or fewer levels in Clean Mips."
    ]
