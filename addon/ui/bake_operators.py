# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that make maps: of one pair, of all pairs by name, of a sequence, of levels of detail, of another map, and Live.

Here are also the panels of pairs, sequences, levels and conversions, and the button that sends job files to a render farm.
"""

from dataclasses import fields
from pathlib import Path

import bpy
from bpy.props import CollectionProperty, IntProperty, StringProperty

from .. import flamenco
from ..core import levels, naming
from ..core.asset import AUTO, Wanted
from ..core.declarations.choices import Method, Space, Storage
from ..core.errors import BakeError, in_window
from ..core.levels import ChainReport
from ..core.progress import Pace, Progress, Task, relay
from ..core.report import Report
from ..core.settings import Settings
from ..core.stored_normals import ConversionReport, StoredNormals
from ..export import engine_files
from ..jobs import asset, atlas, bake_jobs, convert, lod, weights
from ..jobs.bake_jobs import work_on_frames
from ..jobs.convert import Conversion
from ..jobs.job import Job, Wants, jobs_by_name
from ..scene import object_checks, reading
from ..scene.object_checks import object_by_name
from . import bake_results, modal, object_pairs, results
from .fixes import draw_fixable
from .live import live
from .modal import QuickOperator
from .preferences import flamenco_address
from .progress_display import SettingsPanel, display
from .properties import Chosen, Options
from .results import Batch
from .texts import SidebarPanel, draw_paragraphs, label, labeled, message, split_layout, tooltip


class _Bake(modal.MapOperator):
    """An operator that bakes maps; `task` returns their reports."""

    def finish(self, context: bpy.types.Context, result: list[Report]) -> None:
        lines = [line for report in result for line in report.summary(reading.lengths_of(context.scene))]
        self.show(context, lines, [warning for report in result for warning in report.warnings])
        results.remember(result)
        if self.options.is_invoke and context.window is not None and context.scene.imprint.show_result:
            bake_results.show_bake(context, result)


class _OnePair(_Bake, Options):
    """Bakes one low object, from the panel or from the arguments."""

    # Names are not remembered for the next call: the button bakes what the panel shows.
    low: labeled(
        StringProperty, "Low", "Name of the low object; empty for the slot or the active object", options={"SKIP_SAVE"}
    )
    high: labeled(
        CollectionProperty,
        "High",
        'Names of the high objects, as [{"name": "sculpt"}]; empty for the slots or the selection',
        type=bpy.types.OperatorFileListElement,
        options={"SKIP_SAVE"},
    )
    cage: labeled(
        StringProperty, "Cage", "Name of the cage; empty for the slot, which only rays use", options={"SKIP_SAVE"}
    )

    def task(self, context: bpy.types.Context, pace: Pace) -> Task:
        job, settings, wants = self.request(context)
        return (yield from bake_jobs.work(context, [job], settings, pace, wants=wants))

    def request(self, context: bpy.types.Context) -> tuple[Job, Settings, Wants]:
        """The objects and settings from the arguments, or from the panel where an argument is missing."""
        panel = context.scene.imprint
        chosen = panel.chosen(context, object_by_name(self.low) if self.low else None)
        if self.high:  # a script that names the high objects makes another pair, with the settings of the scene
            chosen = Chosen(panel, chosen.low, [object_by_name(item.name) for item in self.high])
        chosen.check(context)
        settings = self.to_settings(panel, chosen.rays, object_pairs.CHOSEN)
        cage = None if settings.tracing.method == Method.FLATTEN else chosen.rays.cage
        job = Job(chosen.low, chosen.highs, object_by_name(self.cage) if self.cage else cage)
        return job, settings, Wants(exported=bool(panel.export))


class IMPRINT_OT_bake(_OnePair, bpy.types.Operator):
    """Bake the detail of the high-poly objects into a normal map for the low-poly object"""

    bl_idname = "imprint.bake"
    bl_label = "Bake Maps"
    bl_options = {"REGISTER", "UNDO"}


class IMPRINT_OT_bake_sequence(_OnePair, bpy.types.Operator):
    """Bake each frame of the scene's range into a numbered file, for example for wrinkle maps"""

    bl_idname = "imprint.bake_sequence"
    bl_label = "Bake Sequence"
    bl_options = {"REGISTER", "UNDO"}

    first: labeled(IntProperty, "First", "First frame; below 0 for that of the scene", default=-1)
    last: labeled(IntProperty, "Last", "Last frame; below 0 for that of the scene", default=-1)

    def task(self, context: bpy.types.Context, pace: Pace) -> Task:
        job, settings, wants = self.request(context)
        scene = context.scene
        first = self.first if self.first >= 0 else scene.frame_start
        last = self.last if self.last >= 0 else scene.frame_end
        return (yield from work_on_frames(context, job, settings, range(first, last + 1), pace, wants=wants))


class IMPRINT_OT_live(modal.WaitingOperator, modal.SlicedOperator, bpy.types.Operator):
    """Bake again whenever the high or low objects change, until it is switched off"""

    bl_idname = "imprint.live"
    bl_label = "Live"
    bl_options = {"UNDO"}

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[None]:
        if live.is_on:
            yield from live.finishing()
            return
        job, settings = context.scene.imprint.chosen(context).job(context)
        yield from live.starting(context, job, settings, pace)


class IMPRINT_OT_bake_pairs(_Bake, bpy.types.Operator):
    """Bake each low object of the scene against the high objects with a matching name. Leaves out what cannot be baked"""

    bl_idname = "imprint.bake_pairs"
    bl_label = "Bake Pairs by Name"
    bl_options = {"REGISTER", "UNDO"}

    def task(self, context: bpy.types.Context, pace: Pace) -> Task:
        settings = context.scene.imprint
        found, problems = jobs_by_name(context, settings.suffixes())
        jobs = [_with_own(job) for job in found if job.low.imprint_is_baked]
        if not jobs:
            raise BakeError("No pair is checked: check those to bake in the list of pairs.")
        values = settings.to_settings()
        left_out = [("", problem) for problem in problems]
        if settings.share_image:  # an atlas is whole, or is not baked
            reports = yield from bake_jobs.work(context, jobs, values, pace, share_image=True)
            return reports, left_out
        jobs = _ready(context, jobs, weights.settings_by_job(jobs, values), left_out)
        reports: list[Report] = []

        def noted(step: Progress) -> Progress:
            reports.extend([step.report] if step.report else [])
            left_out.extend([step.failure] if step.failure else [])
            return step

        try:
            yield from relay(bake_jobs.work(context, jobs, values, pace, goes_on=True), noted)
        except GeneratorExit:  # the maps that are done stay
            results.remember(reports)
            raise
        return reports, left_out

    def finish(self, context: bpy.types.Context, result: tuple[list[Report], list[tuple[str, str]]]) -> None:
        reports, left_out = result
        super().finish(context, reports)
        results.keep_batch(Batch(left_out, sorted({report.low for report in reports})))
        for _, reason in left_out:
            self.report({"WARNING"}, in_window(reason)[0])


class IMPRINT_OT_pack_uvs(QuickOperator, bpy.types.Operator):
    """Give the checked low objects a UV map in which the islands of all lie side by side, at one texel density"""

    bl_idname = "imprint.pack_uvs"
    bl_label = "Pack UV Maps"
    bl_options = {"REGISTER", "UNDO"}

    def apply(self, context: bpy.types.Context) -> str:
        settings = context.scene.imprint
        jobs, _ = jobs_by_name(context, settings.suffixes())
        lows = [job.low for job in jobs if job.low.imprint_is_baked]
        if not lows:
            raise BakeError("No pair is checked: check those to bake in the list of pairs.")
        return atlas.pack(lows, settings.to_settings())


def _with_own(job: Job) -> Job:
    """The job with the size and the distance that its low object has in the list of pairs."""
    return job.but(size=int(job.low.imprint_size), distance=job.low.imprint_distance)


def _ready(
    context: bpy.types.Context, jobs: list[Job], settings: list[Settings], left_out: list[tuple[str, str]]
) -> list[Job]:
    """The jobs that can be baked. The others are added to `left_out`. Raises BakeError if none can be."""
    context.view_layer.update()
    reasons = [
        object_checks.problem(context, job.low, job.highs, job.cage, of_job.tracing.method)
        for job, of_job in zip(jobs, settings, strict=True)
    ]
    if all(reasons):
        raise BakeError(reasons[0])
    left_out += [(job.low.name, reason) for job, reason in zip(jobs, reasons, strict=True) if reason]
    return [job for job, reason in zip(jobs, reasons, strict=True) if not reason]


class IMPRINT_OT_send_to_flamenco(modal.FileOperator, bpy.types.Operator):
    """Send a job file to the Flamenco Manager in the add-on's preferences. All its machines must see the file"""

    bl_idname = "imprint.send_to_flamenco"
    bl_label = "Send to Flamenco"

    filepath: labeled(
        StringProperty,
        "Job File",
        "Job file with the bakes, .toml or .json",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    filter_glob: modal.file_filter("*.toml;*.json")
    shards: labeled(
        IntProperty, "Parts", "Number of parts of about the same cost, each a task", default=16, min=1, max=1000
    )

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if not bpy.app.online_access:
            cls.poll_message_set(tooltip("Allow online access in Blender's preferences first"))
            return False
        return True

    def apply(self, context: bpy.types.Context) -> str:
        path = Path(bpy.path.abspath(self.filepath)).absolute()
        job = flamenco.Job(path.stem, {"jobs": str(path), "shards": self.shards})
        if not path.is_file():
            raise BakeError(f"There is no file {str(path)!r}: choose a job file.")
        return f"Sent: {flamenco.submit(flamenco_address(context), job)}"


def _draw_pair(layout: bpy.types.UILayout, context: bpy.types.Context, pair: naming.Pair) -> None:
    objects, settings = object_checks.by_name(context.view_layer.objects), context.scene.imprint
    low, highs, cage = objects[pair.low], [objects[name] for name in pair.highs], objects.get(pair.cage or "")
    layout.prop(low, "imprint_is_baked", text=pair.low, translate=False)
    column = layout.column()
    column.active = low.imprint_is_baked
    draw_paragraphs(column, context, [", ".join(pair.highs)], "BLANK1")
    row = column.row(align=True)
    size = row.row(align=True)
    size.active = not settings.share_image
    size.prop(low, "imprint_size", text="")
    distance = row.row(align=True)
    distance.active = settings.method != Method.FLATTEN
    distance.prop(low, "imprint_distance", text="")
    reason = object_checks.problem(context, low, highs, cage, settings.method)
    if reason and low.imprint_is_baked:
        draw_fixable(column, context, reason, "ERROR", pair.low)


class IMPRINT_PT_pairs(SettingsPanel, bpy.types.Panel):
    """Bakes many low objects at once: pairs of objects by name."""

    bl_idname = "IMPRINT_PT_pairs"
    bl_label = "Pairs by Name"
    bl_order = 3
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        settings = context.scene.imprint
        row = layout.row(align=True)
        for name in ("low_suffix", "high_suffix", "cage_suffix"):
            row.prop(settings, name, text="")
        try:
            found, problems = settings.pairs_by_name(context)
        except BakeError as error:
            found, problems = [], [str(error)]
        box = layout.box()
        for pair in found:
            _draw_pair(box, context, pair)
        draw_paragraphs(box, context, problems, "ERROR")
        if not found and not problems:
            draw_paragraphs(box, context, [message("No object name ends with one of these suffixes.")], "INFO")
        layout.prop(settings, "share_image")
        if settings.share_image:
            layout.operator("imprint.pack_uvs", icon="GROUP_UVS")
        if flamenco_address(context):
            layout.operator("imprint.send_to_flamenco", icon="EXPORT")

    def draw_button(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        try:
            found = bool(context.scene.imprint.pairs_by_name(context)[0])
        except BakeError:  # the box says it
            found = False
        display.draw_operator(layout, "imprint.bake_pairs", enabled=found, icon="RENDER_STILL")


class IMPRINT_PT_more(SidebarPanel, bpy.types.Panel):
    """What is needed now and then."""

    bl_idname = "IMPRINT_PT_more"
    bl_label = "More"
    bl_order = 4
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, _context: bpy.types.Context) -> None:
        """The panels in it draw the rest."""


class IMPRINT_PT_sequence(SettingsPanel, bpy.types.Panel):
    """Bakes a map for each frame."""

    bl_idname = "IMPRINT_PT_sequence"
    bl_parent_id = "IMPRINT_PT_more"
    bl_label = "Sequence"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        row = layout.row(align=True)
        row.prop(context.scene, "frame_start", text=label("First"))
        row.prop(context.scene, "frame_end", text=label("Last"))
        if not _writes_files(context):
            draw_paragraphs(layout, context, [message("Set Store to File to bake a sequence.")], "INFO")

    def draw_button(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        is_possible = _writes_files(context)
        display.draw_operator(layout, "imprint.bake_sequence", enabled=is_possible, icon="RENDER_ANIMATION")


def _writes_files(context: bpy.types.Context) -> bool:
    return context.scene.imprint.storage == Storage.FILE


class IMPRINT_OT_make_levels(modal.MapOperator, bpy.types.Operator):
    """Make coarser copies of the active mesh with the same UV layout, each with its own map, as coarse as the limits allow"""

    bl_idname = "imprint.make_levels"
    bl_label = "Make Levels of Detail"
    bl_options = {"REGISTER", "UNDO"}

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[ChainReport]:
        settings = context.scene.imprint
        if context.active_object is None:
            raise BakeError("No object is active: select the mesh to make levels of.")
        limits = levels.limits(settings.level_degrees, settings.level_distance, settings.level_triangles)
        if settings.export:
            engine_files.check_levels(settings.export, len(limits))
        return (yield from lod.work(context, context.active_object, limits, settings.to_settings(), pace))

    def finish(self, context: bpy.types.Context, result: ChainReport) -> None:
        lines, warnings = result.summary(), list(result.warnings)
        if context.scene.imprint.export:
            try:
                done = engine_files.export_levels(
                    context, [level.bake for level in result.levels], context.scene.imprint.export
                )
            except BakeError as error:  # the levels are made
                warnings.append(str(error))
            else:
                warnings += dict.fromkeys(text for each in done for text in each.warnings)
                paths = dict.fromkeys(path for each in done for path in each.paths)
                lines.append(f"Wrote {', '.join(paths)}")
        if context.scene.imprint.level_beside:  # after the export, where all levels have one place
            lod.put_beside(context, result)
        self.show(context, lines, warnings)


class IMPRINT_PT_levels(SettingsPanel, bpy.types.Panel):
    """Makes coarser meshes with the UV layout of the active one."""

    bl_idname = "IMPRINT_PT_levels"
    bl_parent_id = "IMPRINT_PT_more"
    bl_label = "Levels of Detail"

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        column, settings = split_layout(layout.column()), context.scene.imprint
        column.prop(settings, "level_triangles")
        by_deviation = column.column()
        by_deviation.active = not settings.level_triangles.strip()
        for name in ("level_degrees", "level_distance"):
            by_deviation.prop(settings, name)
        column.prop(settings, "level_beside")
        column.prop(settings, "export")

    def draw_button(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        display.draw_operator(layout, "imprint.make_levels", icon="MOD_DECIM")


class IMPRINT_OT_make_asset(_Bake, bpy.types.Operator):
    """Make a low mesh with a UV map of the selected objects, and bake all chosen maps for it"""

    bl_idname = "imprint.make_asset"
    bl_label = "Make Game Asset"
    bl_options = {"REGISTER", "UNDO"}

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[list[Report]]:
        settings, suffixes = context.scene.imprint, context.scene.imprint.suffixes()
        wanted = Wanted.of_texts(
            settings.asset_degrees,
            settings.asset_triangles,
            AUTO if settings.asset_fits_size else "",
            settings.asset_distance,
            settings.asset_levels,
            is_count_given=settings.is_property_set("asset_triangles"),
        )
        active, highs = context.active_object, list(context.selected_objects)
        if active is not None and active.select_get():
            highs = [active, *(obj for obj in highs if obj != active)]
        if not highs:
            raise BakeError("No object is selected: select the high-poly objects to make an asset of.")
        job = Job(asset.known_low(context, highs, suffixes) or highs[0], highs)
        if settings.export:
            engine_files.check_levels(settings.export, 1 + wanted.levels)
        wants = Wants(exported=bool(settings.export))
        values = settings.to_settings()
        return (yield from asset.work(context, job, wanted, values, pace, suffixes=suffixes, wants=wants))

    def finish(self, context: bpy.types.Context, result: list[Report]) -> None:
        path = context.scene.imprint.export
        if path:
            try:
                done = engine_files.export_levels(context, result, path)
            except BakeError as error:  # the asset is made
                result = [report.with_warnings([str(error)]) for report in result]
            else:
                pairs = zip(result, done, strict=True)
                result = [report.with_export(one.to_dict()).with_warnings(one.warnings) for report, one in pairs]
        super().finish(context, result)
        low = context.view_layer.objects.get(result[0].low)
        if low is not None:
            for obj in list(context.selected_objects):
                obj.select_set(False)
            low.select_set(True)
            context.view_layer.objects.active = low


class IMPRINT_PT_asset(SettingsPanel, bpy.types.Panel):
    """Makes a game asset of high objects that have no low one."""

    bl_idname = "IMPRINT_PT_asset"
    bl_parent_id = "IMPRINT_PT_more"
    bl_label = "Game Asset"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        column, settings = split_layout(layout.column()), context.scene.imprint
        for name in ("asset_triangles", "asset_degrees", "asset_distance", "asset_fits_size", "asset_levels", "export"):
            column.prop(settings, name)

    def draw_button(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        is_possible = bool(context.selected_objects)
        display.draw_operator(layout, "imprint.make_asset", enabled=is_possible, icon="MESH_ICOSPHERE")


class IMPRINT_OT_convert(modal.MapOperator, bpy.types.Operator):
    """Make a new normal map for the low-poly object of the chosen one, in the space and the basis of the panel Map"""

    bl_idname = "imprint.convert"
    bl_label = "Convert"
    bl_options = {"REGISTER", "UNDO"}

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[ConversionReport]:
        settings = context.scene.imprint
        chosen = settings.chosen(context)
        if chosen.low is None:
            raise BakeError("No low object: select it, or fill the slot.")
        if settings.convert_image is None:
            raise BakeError("No map to convert: choose an image.")
        before = StoredNormals(**{field.name: getattr(settings, field.name) for field in fields(StoredNormals)})
        conversion = Conversion(chosen.low, settings.convert_image, before, is_own_base=chosen.low in chosen.highs)
        return (yield from convert.work(context, conversion, settings.to_settings(), pace))

    def finish(self, context: bpy.types.Context, result: ConversionReport) -> None:
        self.show(context, result.summary(), result.warnings)


class IMPRINT_PT_convert(SettingsPanel, bpy.types.Panel):
    """Converts an existing map into the space and the basis of the panel Map."""

    bl_idname = "IMPRINT_PT_convert"
    bl_parent_id = "IMPRINT_PT_more"
    bl_label = "Convert Map"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        layout = split_layout(layout)
        settings = context.scene.imprint
        layout.template_ID(settings, "convert_image", open="image.open", text=label("Map"), translate=False)
        layout.prop(settings, "from_space")
        if settings.from_space == Space.TANGENT:
            layout.prop(settings, "from_basis")
        column = layout.column(align=True)
        for name in ("from_red", "from_green", "from_blue"):
            column.prop(settings, name)

    def draw_button(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        is_possible = context.scene.imprint.convert_image is not None
        display.draw_operator(layout, "imprint.convert", enabled=is_possible, icon="FILE_REFRESH")


# Blender draws panels of one order in that of registration.
CLASSES = (
    IMPRINT_OT_bake,
    IMPRINT_OT_bake_sequence,
    IMPRINT_OT_live,
    IMPRINT_OT_bake_pairs,
    IMPRINT_OT_pack_uvs,
    IMPRINT_OT_send_to_flamenco,
    IMPRINT_PT_pairs,
    IMPRINT_PT_more,
    IMPRINT_OT_make_levels,
    IMPRINT_PT_levels,
    IMPRINT_OT_make_asset,
    IMPRINT_PT_asset,
    IMPRINT_OT_convert,
    IMPRINT_PT_convert,
    IMPRINT_PT_sequence,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
