# SPDX-License-Identifier: GPL-3.0-or-later
"""Live's maps, which are drawn again when their objects change. Only objects that changed are read and uploaded again."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial

import bpy
import gpu
import numpy as np

from ..audit.checks import audit
from ..audit.stacked_checks import check_stacked
from ..audit.tally import Tally
from ..core import progress, udim
from ..core.declarations.choices import ExactMaterials, Modifiers, VertexDomain
from ..core.errors import BakeError, Length
from ..core.map_types import BY_NAME, NORMAL, Labeled, Map
from ..core.progress import Pace, Progress, Task, Timings, part
from ..core.report import Report
from ..core.sentences import Sentence
from ..core.settings import Run, Settings
from ..engine import baking, live_redraw, margins, orienting, sampling
from ..engine.baking import READY, Drawing
from ..engine.bands import Band
from ..engine.planning import Plan, nothing_drawn, plan_of
from ..engine.ray_casting import RayLengths
from ..engine.stacked_uvs import StackedParts
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..output import datablocks, materials, outputs
from ..passes import data_texture, target
from ..passes.mesh_upload import UploadCache
from ..scene import evaluation, mesh_reader, object_checks, reading
from ..scene.materials.material_reading import CUT_OUTS, read_materials
from ..scene.textures import ImageTextures
from . import bake_jobs, shared_image, state_pieces
from .baked import Baked
from .job import Job, Request, check_clashes, check_job, files_kept, set_numbers

FOLLOWED = (
    "{name} has {shown} triangles in the viewport, which Live follows, and {rendered} in renders, which the bake follows: make "
    "them equal, or set Modifiers to Viewport."
)
"""A sentence about an object whose shape differs."""


class LiveMaps:
    """Draws and stores the maps of a session beside its normal map.

    settings: those of the bake, with names filled in. pool: their textures, apart from those of the normal map. drawn: the last
    maps by name, before they are encoded.
    """

    def __init__(self, settings: Settings):
        self.settings = settings
        self.pool = target.TargetPool()
        self.drawn: dict[str, Map] = {}
        self._is_stored = False

    @property
    def are_any(self) -> bool:
        return bool(self.settings.map.drawn_maps)

    @property
    def show_materials(self) -> bool:
        """Whether a map changes with the materials of the high objects."""
        return any(BY_NAME[name].family.shows_materials for name in self.settings.map.drawn_maps)

    def work(self, drawing: Drawing | None, plan: Plan, uploads: UploadCache, pace: Pace) -> Task[None]:
        """Draw the maps. plan: of the session's last normal map. drawing: of that map; None if its memory was freed. Raises
        BakeError."""
        run = Run(self.settings.traced(method=plan.method), pace)
        if drawing is None or not plan.casts_rays:  # that of Flatten may have no surface, and no tree
            drawing = yield from part(baking.draw(plan, run, uploads=uploads), 0.0, READY)
        else:
            drawing = drawing.with_settings(run)
        maps = yield from part(drawing.texels(udim.FIRST), READY, 1.0)
        del maps[NORMAL.name]
        self.drawn = maps

    def copies(self) -> dict[str, Map]:
        """Copies of the maps, since storing them encodes them in place."""
        return {name: (texels.copy(), state) for name, (texels, state) in self.drawn.items()}

    def store(self, normals: Map, labels: dict[Labeled, Sequence[str]], low: bpy.types.Object, meshes: Meshes) -> None:
        """Put the maps into their image datablocks, but into no file. The first time, also into the materials of `low`, if the
        settings say so. normals, labels: as outputs.Outputs takes them. meshes: of the session."""
        settings = self.settings.without_file().mapped(normal=False)
        with outputs.Outputs(settings) as writers:
            writers.add(udim.FIRST, {NORMAL.name: normals, **self.copies()})
            stored = writers.commit(labels, [low])
        if not self._is_stored:
            materials.into_materials(low, stored, meshes.uv_layer, settings, is_own_base=meshes.is_own_base)
        self._is_stored = True


class Session:
    """Follows the objects of a job, as the viewport shows them in their modes, or has them as a bake reads them.

    plan: of the last map's bake. settings: of the normal map, which is drawn for the views also if it is not stored. others:
    the other maps. drawn: how many normal maps were drawn. meshes: the objects as they were last read, with the low mesh in the
    order in which it is drawn. differences: sentences about objects that a bake would have otherwise, see `note_differences`.
    """

    def __init__(
        self, context: bpy.types.Context, job: Job, settings: Settings, pace: Pace, *, is_followed: bool = True
    ):
        """is_followed: False to read the objects as a bake does, by the setting Modifiers.

        Raises BakeError for objects or settings that cannot be baked, or not live.
        """
        if settings.sampling.udim:
            raise BakeError("Live draws only one tile: turn UDIM Tiles off.")
        self.job, self._is_followed = job, is_followed
        self._bakes_renders = settings.map.modifiers == Modifiers.RENDER and is_followed
        self.differences: list[str] = []
        settings.check()
        if settings.map.texture_sets:
            raise BakeError("Live draws one image for all materials: turn Texture Sets off.")
        settings = settings.read_by(context.scene.render.engine).stored(
            vertex_domain=VertexDomain.NONE, one_material=False
        )
        settings = settings.mapped(
            modifiers=Modifiers.VIEWPORT if is_followed else settings.map.modifiers,
            mask=False,
            exact_materials=ExactMaterials.OFF,  # Cycles would take seconds after each stroke
        )
        self._unnamed = bake_jobs.beside_materials(settings, job)
        settings = bake_jobs.for_low(self._unnamed, job.low.name)
        self._all_settings = settings
        self.settings = settings.without_other_maps()
        self.others = LiveMaps(settings)
        check_clashes(settings.storing, [settings], [job.low.name], files_kept([job], settings.storing))
        check_job(context, job, settings)
        shared_image.check_alone(context, job, settings.without_file(), "Live")
        self.pace = pace
        self.drawn = 0
        self._timings = Timings()
        """The seconds of the last normal map."""
        self.plan: Plan | None = None
        self.meshes: Meshes | None = None
        self._as_read: Meshes | None = None
        self._post_processes: dict[str, margins.PostProcess] = {}
        self._uploads = UploadCache()
        self._drawing: Drawing | None = None
        """Of the last map; None where only a part of it was drawn."""
        self._own_hits: Drawing | None = None
        """The same with the hits that belong to the texels, once it was asked for."""
        self._pool = target.TargetPool()
        self._coarse_pool = target.TargetPool()
        self._coarse: gpu.types.GPUTexture | None = None
        self._adopted: gpu.types.GPUTexture | None = None
        self._kept = live_redraw.kept_map(self.settings)
        self._is_stored = False
        self._shown_by: dict[int, set[int]] = {}

    @property
    def uids(self) -> set[int]:
        """The session_uid of each object of the job, and of the objects that they show as instances."""
        return {ref.uid for ref in self.job.refs} | self._shown_by.keys()

    def work(self, context: bpy.types.Context, changed: Collection[int] | None = None) -> Task[None]:
        """Draw the map again. changed: session_uid of the objects that changed since the last time; None for all.

        Raises BakeError.
        """
        self._timings = Timings()
        yield from self._timings.counted(self._draw(context, changed))

    def _draw(self, context: bpy.types.Context, changed: Collection[int] | None) -> Task[None]:
        run = Run(self.settings.traced(method=self._method), self.pace, self._timings)
        length = reading.lengths_of(context.scene)
        yield Progress(f"Reading {self.job.low.name}", 0.0)
        plan = self._planned(context, changed, length)
        if self._kept.redraw(plan, self._post_processes[NORMAL.name], self._uploads):
            self._finish(plan, None)
            return
        drawing = yield from progress.part(baking.draw(plan, run, uploads=self._uploads), 0.0, READY)
        if drawing.source.takes_time and self.pace.has_listener:
            yield self._draw_coarse(drawing)
        steps = self._kept.draw(drawing, self._post_processes[NORMAL.name])
        if not (yield from progress.part(steps, READY, 1.0)):
            raise BakeError(nothing_drawn(plan, length))
        self._finish(drawing.plan, drawing)

    def adopt(self, context: bpy.types.Context, texels: np.ndarray) -> None:
        """Take a normal map that was baked before as the last one, instead of drawing it. Nothing is drawn.

        Args:
            context: whose objects are read.
            texels: (height, width, 4) float32 as it is stored, of the size in the settings.

        Raises BakeError for objects that cannot be baked.
        """
        plan = self._planned(context, None, reading.lengths_of(context.scene))
        self._adopted = data_texture.image(texels)
        self._finish(plan, None)

    def _finish(self, plan: Plan, drawing: Drawing | None) -> None:
        """Note what the map that is done was drawn with; None where only a part was drawn."""
        self.plan, self._drawing, self._own_hits = plan, drawing, None
        self.drawn += 1
        self._coarse = None

    @property
    def normals(self) -> Map | None:
        """The last normal map that was drawn, as it is before it is rounded or encoded, or None."""
        return self._kept.map

    @property
    def texels(self) -> np.ndarray | None:
        """The last normal map, (height, width, 4) float32 as it is stored, or None. It is read when it is first asked for."""
        return self._kept.texels

    @property
    def _method(self) -> str:
        """That of the settings, or which was chosen; AUTO if texels choose."""
        is_chosen = self.plan is not None and not self.plan.has_rays
        return self.plan.method if is_chosen else self.settings.tracing.method

    def _planned(self, context: bpy.types.Context, changed: Collection[int] | None, length: Length) -> Plan:
        """Read the objects that changed, and decide how their map is drawn; `changed` as in `work`."""
        settings, before = self.others.settings.traced(method=self._method), self._as_read
        self._as_read = meshes = self._read(context, changed, settings)
        plan = plan_of(meshes, settings, before=self.plan, length=length)
        self.meshes = plan.listed
        if not self._post_processes or before is None or meshes.low is not before.low:
            self._post_processes = margins.for_maps([plan.meshes.low], settings)
        return plan

    def _read(self, context: bpy.types.Context, changed: Collection[int] | None, settings: Settings) -> Meshes:
        """Read the objects that changed; `changed` as in `work`."""
        if not self._is_followed:
            return reading.read(context, *self._objects, settings)
        low, highs, cage = self._objects
        reason = object_checks.problem(context, low, highs, cage, self._method)
        if reason:
            raise BakeError(reason)
        if low in highs and low.mode == "EDIT":
            raise BakeError(f"The map will follow when {low.name!r}, which is its own high object, leaves Edit Mode.")
        hidden = next(filter(evaluation.hides_detail, highs), None)
        if hidden is not None:
            raise BakeError(
                f"The map will follow when {hidden.name!r} leaves Sculpt Mode, which keeps Multires detail."
            )
        before = None if changed is None else self._as_read
        changed = {uid for changed_uid in changed or () for uid in (changed_uid, *self._shown_by.get(changed_uid, ()))}
        self._shown_by = object_checks.shown_by(highs)
        return reading.read_again(context, low, highs, cage, settings, before=before, changed=changed)

    @property
    def _objects(self) -> tuple[bpy.types.Object, list[bpy.types.Object], bpy.types.Object | None]:
        return self.job.low, self.job.highs, self.job.cage

    def _draw_coarse(self, drawing: Drawing) -> Progress:
        """Draw a coarse map to show until the whole one is done."""
        settings = drawing.run.settings
        width, height = (max(16, texels // sampling.COARSE) for texels in settings.sampling.size)
        small = settings.sampled(width=width, height=height, samples=1)
        # It has its own pool, so that the targets of the whole map keep their size.
        with target.using(self._coarse_pool):
            progress.finish(drawing.with_settings(Run(small)).texels(udim.FIRST))
        self._coarse = self._coarse_pool.find("map").texture
        return Progress("Drawing", READY, self._coarse)

    def note_differences(self, context: bpy.types.Context) -> None:
        """Look for `differences`. This evaluates objects that may differ as renders do: that can take as long as for a bake."""
        if not self._bakes_renders:
            return
        low, highs, cage = self._objects
        try:
            differing = reading.differences(context, [*highs, low, *([cage] if cage else [])])
        except BakeError as error:
            self.differences = [str(error)]
            return
        self.differences = [
            FOLLOWED.format(name=repr(obj.name), shown=f"{shown:,}", rendered=f"{rendered:,}")
            for obj, shown, rendered in differing
        ]

    def other_steps(self) -> Task[None]:
        """Draw the other maps again, with their own textures, so that other bakes can run in between. Raises BakeError."""
        return progress.relay(self._draw_others(), within=partial(target.using, self.others.pool))

    def _draw_others(self) -> Task[None]:
        return self.others.work(self._drawing, self.plan, self._uploads, self.pace)

    def shows(self, changed: bpy.types.ID) -> bool:
        """Whether maps of the session show this datablock: a material of the high objects. Blender reports a change of an image
        as one of the materials that show it."""
        read = self._as_read
        if read is None or not isinstance(changed, bpy.types.Material):
            return False
        if changed.session_uid not in {material.key for material in read.materials}:
            return False
        if self.others.show_materials or read.has_detail or read.has_cutouts:
            return True
        return (
            self.settings.tracing.cut_outs
            and read_materials([changed], ImageTextures(), {CUT_OUTS})[0].cutout is not None
        )

    def is_moved(self, uid: int) -> bool:
        """Whether vertices of the object with this session_uid have moved since they were last read."""
        meshes = self._as_read
        if meshes is None:
            return True
        known = [meshes.low, *meshes.highs, *([meshes.cage] if meshes.cage else [])]
        by_uid = {ref.uid: (ref.find(), mesh) for ref, mesh in zip(self.job.refs, known, strict=True)}
        obj, mesh = by_uid.get(uid, (None, None))
        if obj is None:  # it was deleted, or is shown as an instance: instances are read as one mesh
            return True
        with mesh_reader.evaluated(obj, bpy.context.evaluated_depsgraph_get()) as data:
            return not np.array_equal(mesh_reader.points(data), mesh.positions)

    def run(self, context: bpy.types.Context, changed: Collection[int] | None = None) -> None:
        """Do all of `work` at once."""
        progress.finish(self.steps(context, changed))

    def steps(self, context: bpy.types.Context, changed: Collection[int] | None = None) -> Task[None]:
        """As `work`, but with the session's own textures, so that other bakes can run in between."""
        return progress.relay(self.work(context, changed), within=partial(target.using, self._pool))

    def free(self) -> None:
        """Free all GPU memory of the session."""
        self._kept.free()
        self._pool.free()
        self._coarse_pool.free()
        self.others.pool.free()
        self._coarse = self._adopted = None
        self._post_processes = {}
        self._uploads, self._drawing, self._own_hits = UploadCache(), None, None

    def advance(self, work: Task[None], seconds: float) -> Progress:
        """As progress.run_for, but with the session's own textures, so that other bakes can run in between."""
        with target.using(self._pool):
            return progress.run_for(work, seconds)

    @property
    def rays(self) -> RayLengths | None:
        """Those of the last map; None for Flatten and before the first map."""
        return self._drawing.plan.rays if self._drawing is not None else None

    @property
    def map(self) -> gpu.types.GPUTexture | None:
        """The last map on the GPU: one that was adopted, or a coarse one while rays for the whole map are being cast.

        None before the first map, and for a map that is drawn in bands.
        """
        return self._adopted or self._coarse or self._kept.texture

    def upload(self, key: str, mesh: Mesh, **attributes: np.ndarray) -> gpu.types.GPUBatch:
        """As UploadCache.upload, in the cache of the session."""
        return self._uploads.upload(key, mesh.triangles, **attributes)

    def high_normals(self) -> gpu.types.GPUTexture:
        """The normals of the high surface at the centers of the last map's texels, as sources.Source draws them, with the hits
        that belong to the texels.

        The texture is in the current pool.
        """
        size = self.settings.sampling.width, self.settings.sampling.height
        return self._with_own_hits().maps.high_normals(Band(0, size[1], size, 0))

    def hidden_parts(self) -> StackedParts:
        """The parts of the low mesh that show texels of other parts on the last map."""
        return StackedParts(self._with_own_hits(), self.settings)

    def _with_own_hits(self) -> Drawing:
        """What draws a whole map, with the hits that belong to the texels; for the last map, it is made once."""
        if self._own_hits is None:
            making = baking.draw_own_hits(self.plan, Run(self.settings), self._drawing, uploads=self._uploads)
            self._own_hits = progress.finish(making)
            if self._own_hits.run.settings.tracing == self.settings.tracing:
                self._drawing = self._own_hits
        return self._own_hits

    def store(self) -> None:
        """Put the last normal map into its image datablock, and the image into the material if it is new."""
        settings = self.settings
        if not self._all_settings.map.normal:
            return
        is_new = datablocks.get(settings.storing.image) is None
        image = datablocks.fill(settings.storing.image, self.texels, is_float=settings.storing.depth > 8, pack=False)
        datablocks.set_source_objects(image, self._high_names, [self.job.low_ref.name])
        if is_new or not self._is_stored:
            datablocks.note_maps(self.job.low, [image])
        if settings.storing.material and (is_new or not self._is_stored):
            layer, is_own_base = self._as_read.uv_layer, self._as_read.is_own_base
            materials.show_normal_map(self.job.low, image, layer, settings, is_own_base=is_own_base)
        self._is_stored = True

    def store_others(self) -> None:
        """Put the other maps into their image datablocks and, the first time, into the material if the settings say so."""
        self.others.store(self._kept.map, self._labels, self.job.low, self._as_read)

    def commit(self) -> outputs.Stored | None:
        """Store the last maps as a bake does: in their files, or packed. Returns None if there is none. Raises BakeError."""
        low = self.job.low_ref.find()
        settings = self._stored_settings
        if self.texels is None or low is None or not (self._all_settings.map.normal or self.others.drawn):
            return None
        with outputs.Outputs(settings) as writers:
            writers.add(udim.FIRST, {NORMAL.name: self._kept.map, **self.others.copies()})
            stored = writers.commit(self._labels, [low])
            layer, is_own_base = self._as_read.uv_layer, self._as_read.is_own_base
            materials.into_materials(low, stored, layer, settings, is_own_base=is_own_base)
        return stored

    @property
    def _stored_settings(self) -> Settings:
        """The settings of the maps that there are to store."""
        return self._all_settings if self.others.drawn else self._all_settings.without_other_maps()

    def report(self, context: bpy.types.Context, stored: outputs.Stored) -> Report:
        """The report of the last maps, as a bake of them has it. stored: from `commit`, with the same maps."""
        tally = Tally()
        tally.add(self._kept.map, self.settings.map)
        with target.using(self._pool):
            own, hidden = self._with_own_hits(), self.hidden_parts()
            drawing = self._drawing or own
            numbers = set_numbers(self.job.low, self.plan.meshes)
            stacked = check_stacked(hidden, own, self.settings, numbers)
            length = reading.lengths_of(context.scene)
            findings = audit(self.plan, tally, self.settings, drawing.ray_cast, length=length, stacked=stacked)
        unnamed = self._unnamed if self.others.drawn else self._unnamed.without_other_maps()
        request = Request(self.job, self._stored_settings, unnamed=unnamed)
        baked = Baked(request, drawing.plan, findings, self._timings, self._warnings())
        baked = replace(baked, state=state_pieces.of_read(request, self._as_read))
        return Report.of(baked.stored_as(stored, stored.warnings))

    def _warnings(self) -> list[Sentence]:
        """Those about the objects, as a bake has them."""
        read = self.plan.read
        texts = [*self.differences, *read.lacks, *object_checks.warnings(self.job.low, self.job.highs)]
        return list(map(Sentence.of, (*texts, *orienting.notes(read, self.plan.told))))

    @property
    def _labels(self) -> dict[Labeled, list[str]]:
        """As Outputs.commit takes them."""
        materials = [material.name for material in self._as_read.materials]
        return {Labeled.OBJECTS: self._high_names, Labeled.MATERIALS: materials, Labeled.PARTS: self._as_read.parts}

    @property
    def _high_names(self) -> list[str]:
        return [high.name for high in self._as_read.highs]
