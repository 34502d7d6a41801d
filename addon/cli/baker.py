# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs bakes in this process: opens their files, bakes, and saves what their options name."""

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .. import older_blender
from ..core import file_formats, levels, naming, progress, udim
from ..core.errors import BakeError, Incomplete, WrongPlace, shorten_list
from ..core.levels import ChainReport
from ..core.naming import printable
from ..core.progress import Pace, Task, startup
from ..core.report import Report, smooth_sentences
from ..core.settings import Settings
from ..core.stored_normals import ConversionReport
from ..jobs import bake_jobs, one_material, pair_checks
from ..jobs.job import Job, Wants, files_read_by
from ..jobs.sequence import work_on_frames
from ..output import png_writer
from ..output.atomic_file import all_or_none, check_writable, replacing
from ..scene import addons, object_checks
from ..scene.reading import lengths_of
from . import (
    arguments,
    blender_process,
    changed_parts,
    clashes,
    input_checks,
    interruption,
    limits,
    plans,
    run_report,
    scene_files,
    scene_jobs,
    standard_streams,
    terminal,
)
from .changed_parts import Kept
from .options import RunOptions
from .plans import Plan, subject
from .records import Assignment, Content, Contents, finish_record, read_record
from .run_report import STDOUT, Entry, State, Totals, report_path
from .scene_files import SceneLoader
from .terminal import Meter
from .work_queue import Chains, WorkQueue

addons.load = blender_process.complete


def need_all(planned: Iterable[Plan]) -> bool:
    """Whether these plans write files in which Blender's add-ons keep settings."""
    return any(plan.options.save_blend or plan.options.export for plan in planned)


@dataclass(frozen=True)
class _Opened:
    """A bake whose files are open."""

    plan: Plan
    jobs: Sequence[Job]
    wants: Wants
    problems: list[str]
    """What is wrong with names."""
    notes: list[str]
    """Sentences about files that are missing, and about coordinates that were rounded."""
    named: list[Content]
    """The files that its options name. Empty if neither a report nor a record wants them."""
    found: list[Content]
    """The other files that it reads. Empty likewise."""
    not_followed: list[str]
    """Why other files that it reads are not known, in clauses."""
    smooth_files: dict[str, int]
    """As Report has it."""
    only: frozenset[int] | None = None
    """The session_uids of the low objects that are baked; None for all."""
    kept: Kept = changed_parts.NONE
    """What is left out as its maps are true."""

    @property
    def name(self) -> str:
        return self.plan.name or subject(self.plan.options, bpy.data.filepath)


class Baker:
    """Bakes one plan after the other in this process. A bake that fails does not stop the others."""

    def __init__(
        self,
        files: clashes.RunFiles,
        meter: Meter,
        options: RunOptions,
        *,
        needs_all: bool,
        folders: Sequence[str] = (),
    ):
        """Start without a scene.

        Args:
            files: Must have all plans.
            options: Of the run.
            needs_all: As `need_all` returns it for all plans.
            folders: As in SceneLoader.
        """
        self._files, self._meter, self._folders, self._loader = files, meter, folders, SceneLoader(folders)
        self._options, self._contents = options, Contents()
        self._states: dict[str, str] = {}
        """What the last bake has read, as in Record."""
        if needs_all:
            blender_process.complete()  # before a file is opened: Cycles brings its settings in old files up to date

    def bake(self, assigned: Assignment) -> Entry:
        """Bake, save what the options name, and write the record. Returns the entry, also of a bake that failed.

        Raises WrongPlace if the only bake of a run would harm a file, before it has begun.
        """
        plan, start, opened = assigned.plan, time.perf_counter(), None
        is_hashed = self._options.has_hashes or assigned.record is not None or bool(plan.options.report)
        try:
            interruption.check()
            opened = self._open(plan, is_hashed=is_hashed)
            self._states = {}
            if self._options.changed:
                opened = self._without_true(opened, assigned.record)
            is_true = opened.only is not None and not opened.only  # some are, and the others are off
            entry = self._of_true(opened) if is_true else self._run(opened, start, is_hashed=is_hashed)
        except interruption.Stopped:
            entry = Entry(plan.number, plan.name, State.STOPPED, STOPPED, is_listed=False)
        except (BakeError, MemoryError) as error:
            if isinstance(error, WrongPlace) and opened is None and not self._options.has_table:
                raise
            name = plan.name or subject(plan.options, bpy.data.filepath)
            entry = Entry.failed(plan.number, name, error)
            self._loader = SceneLoader(self._folders)  # the failed bake may have changed the open scene
        entry.seconds = time.perf_counter() - start
        self._meter.clear()
        if opened is not None:
            finish_record(
                assigned,
                entry,
                opened.found,
                self._contents,
                is_pictured=bool(self._options.pictures),
                not_followed=opened.not_followed,
                states=self._states,
            )
            if not opened.only and opened.kept.lows and entry.state == State.DONE:
                entry.state = State.RESUMED
        return entry

    def _of_true(self, opened: _Opened) -> Entry:
        """The entry of a bake all of whose maps are true."""
        self._states, reports = opened.kept.states, opened.kept.reports
        facts = {"inputs": [each.facts() for each in (*opened.named, *opened.found)], "reports": reports}
        files = list(self._written(reports, "", is_hashed=True))
        plan = opened.plan
        return Entry(plan.number, opened.name, files=files, are=_kind(plan.options), problems=opened.problems, **facts)

    def _open(self, plan: Plan, *, is_hashed: bool) -> _Opened:
        """Check what can be checked, and open what the plan names.

        Raises BakeError, or WrongPlace if the bake would harm a file.
        """
        if plan.problem:
            raise BakeError(plan.problem)
        options, loader = plan.options, self._loader
        name = subject(options, bpy.data.filepath)
        interruption.note_bake(plan.name or name)
        settings = arguments.settings(options)
        # Opening a file can take long, so check first that the results can be written.
        for path in (settings.storing.output, options.export, options.save_blend, report_path(options.report)):
            if path and not naming.has_low(str(path)):
                check_writable(Path(path).absolute())
        if self._meter.is_on:
            self._meter.show(name, progress.Progress("Opening", 0.0))
        with startup.spent("opening"):
            jobs, problems = scene_jobs.opened(options, loader)
            if not plan.chain and loader.reopen_if_changed(high.name for job in jobs for high in job.highs):
                jobs, problems = scene_jobs.opened(options, loader)  # a bake does not depend on those before it
            smooth_files = loader.smooth(jobs, options.smooth_files, scene_jobs.made(options, jobs))
        # In a chain, a bake may read the maps of those before it.
        read = files_read_by([*jobs, *scene_jobs.of_rivals(plan)], has_maps=not plan.chain)
        self._files.opened(plan.name, options, _lows(options, jobs), [*scene_files.used(options), *read])
        problems = [*problems, *options.notes]
        notes = input_checks.check_textures(options, settings.map, jobs)
        needed = limits.needs(options.strict)
        wants = Wants(
            exported=bool(options.export),
            whole=not options.allow_missing_files,
            measured=limits.DEVIATION in needed,
            seen=limits.APPEARANCE in needed,
            pictured=self._options.has_pictures,
            hints=tuple(input_checks.fit_hints(options, jobs)),
        )
        notes += input_checks.rounded_coordinates(options, jobs)
        named, found = [], []
        if is_hashed:
            reading = self._contents.checking(interruption.check)
            named = reading.all_of(plans.input_paths(options, bpy.data.filepath))
            found = reading.all_of(scene_files.read_by(options, jobs))
        not_followed = scene_files.not_followed(options, jobs)
        opened = _Opened(plan, jobs, wants, problems, notes, named, found, not_followed, smooth_files)
        return replace(opened, only=scene_jobs.only(options, jobs))

    def _without_true(self, opened: _Opened, record: Path | None) -> _Opened:
        """Leave out the low objects whose maps are true."""
        options, jobs = opened.plan.options, opened.jobs
        before = read_record(record) if record is not None else None
        wanted = [job for job in jobs if opened.only is None or job.low_ref.uid in opened.only]
        shared = {"share_image": _share_image(options), "shared_name": _shared_name(options)}
        settings = _for_linked(arguments.settings(options), options, jobs)
        kept = changed_parts.look(options, jobs, settings, before, self._contents, **shared)
        only = frozenset(job.low_ref.uid for job in wanted) - kept.lows
        return replace(opened, only=only if kept.lows else opened.only, kept=kept)

    def _run(self, opened: _Opened, start: float, *, is_hashed: bool) -> Entry:
        """Bake, and save what the options name. start: when the bake began, by time.perf_counter.

        Raises BakeError, or Stopped where nothing was finished.
        """
        plan, options = opened.plan, opened.plan.options
        start_gpu()
        memory = _show_memory(opened, self._meter)
        packed = self._packed(opened)
        # If a pair, a frame, the scene or the report fails, no file of the bake is written.
        with all_or_none(has_parts=arguments.are_several(options) or bool(options.frames)):
            printed: list[str] = []
            baked = older_blender.with_gpu(lambda: _explained(opened, self._meter, printed))
            is_stopped, chain = baked.is_stopped, baked.chain
            notes = [*self._loader.notes, *opened.notes, *input_checks.refused_scripts()]
            smooth = opened.smooth_files
            reports = [
                replace(
                    each, memory=memory, smooth_files={name: smooth[name] for name in each.high if name in smooth}
                ).with_warnings(notes)
                for each in baked.reports
            ]
            if options.export and not is_stopped:
                check_beside = partial(self._files.exported, plan.name)
                are_levels, source = _kind(options) == "levels", _same_file(options, opened.jobs)
                reports = _export(reports, options.export, check_beside, are_levels=are_levels, source=source)
            reports[:1] = [report.with_startup(startup.take()) for report in reports[:1]]
            self._loader.changed(job.low.name for job in opened.jobs)
            scene = os.path.abspath(options.save_blend) if options.save_blend and not is_stopped else ""
            if scene and options.join:
                one_material.join(bpy.context, reports)
            if scene:
                with self._loader.caches_released():
                    _save_scene(Path(scene), reports)
            problems = [*opened.problems, *(chain.left_out if chain else ())]
            warnings = [*problems, *(text for report in reports for text in report.warnings)]
            self._states = opened.kept.states | changed_parts.states_of(reports)
            baked = {report.low for report in reports}  # one with true maps too, if an image had lost its texels
            values = [each for each in opened.kept.reports if each["low"] not in baked]
            values += [report.to_dict() for report in reports]
            over = limits.over(options.strict, values)
            over += [text for report in reports for text in report.asset.get("missed", ())]
            entry = Entry(
                plan.number,
                opened.name,
                State.STOPPED if is_stopped else State.GATE if over else State.DONE,
                STOPPED if is_stopped else "",
                gate=over,
                seconds=time.perf_counter() - start,
                inputs=[each.facts() for each in (*opened.named, *opened.found)],
                files=list(self._written(values, scene, is_hashed=is_hashed)),
                are=_kind(options),
                reports=values,
                chain=chain.to_dict() if chain else {},
                problems=problems,
                warnings=[text for text in warnings if text not in (*printed, *over)],
                summary=[*packed, *_summary(reports, chain, _kind(options))],
                image=_image(reports),
            )
            if path := report_path(options.report):
                run_report.write_report(path, run_report.document([entry], run_report.head(call=self._options.call)))
        return entry

    def _packed(self, opened: _Opened) -> list[str]:
        """Pack the UV maps of the low objects, if the bake asks for it: what that gave, in lines. Raises BakeError or
        Stopped."""
        options = opened.plan.options
        if not options.pack_uvs:
            return []
        from ..jobs import atlas  # here, since a bake does not need it

        lows = [job.low for job in opened.jobs]
        self._loader.changed(low.name for low in lows)  # also if the bake fails

        def on_step(step: progress.Progress) -> None:
            interruption.check()
            if self._meter.is_on:
                self._meter.show("the atlas", step)

        return [progress.finish(atlas.work(lows, arguments.settings(options), is_done_once=True), on_step)]

    def _written(self, reports: Sequence[dict[str, Any]], scene: str, *, is_hashed: bool) -> Iterator[dict[str, Any]]:
        """The files that a bake wrote, each once, as in Entry. scene: the path of the saved scene, or ""."""
        paths = {what: {} for what in (run_report.MAP, run_report.MIP, run_report.EXPORT, run_report.SCENE)}
        for report in reports:
            for what, written in run_report.written_paths(report).items():
                paths[what].update(dict.fromkeys(written))
        if scene:
            paths[run_report.SCENE][scene] = None
        for what, written in paths.items():
            for path in written:
                yield (self._contents.of(path, what) if is_hashed else Content(path, what)).facts()


STOPPED = "It was stopped."
"""The error of a bake that a signal stopped."""
TURN_WAIT = 0.1
"""Seconds after which signals are checked again, while other processes do all bakes that are left."""


def bake_all(queue: WorkQueue, files: clashes.RunFiles, meter: Meter, options: RunOptions) -> Iterator[Entry]:
    """Do all bakes of the queue. The last entry may be of a bake that was stopped. files, options: as in Baker."""
    count, place, chains = queue.count, 0, Chains()
    baker = Baker(files, meter, options, needs_all=need_all(item.plan for item in queue.left))
    while queue.count:
        item = queue.next()
        if item is None:
            time.sleep(TURN_WAIT)
            if interruption.code():
                queue.stop()
            continue
        place += 1
        if isinstance(item, Entry):
            yield item
            continue
        meter.begin(item.plan, f"{place}/{count} ")
        entry = chains.refusal(item.plan) or baker.bake(item)
        chains.ended(item.plan, entry)
        yield entry
        if entry.state == State.STOPPED:
            queue.stop()


def bake_one(plan: Plan, files: clashes.RunFiles, options: RunOptions, meter: Meter) -> int:
    """Do the only bake of a run, and print its summary. Returns the exit code.

    files, options: as in Baker. Raises WrongPlace if the bake would harm a file.
    """
    own, program = plan.options, options.program
    meter.planned(1, 1)
    meter.begin(Plan(subject(own, bpy.data.filepath), own))
    entry = Baker(files, meter, options, needs_all=need_all([plan])).bake(Assignment(plan))
    if not entry.is_listed:
        print(f"{program}: stopped, nothing was finished.", file=sys.stderr)
        return run_report.FAILED
    for warning in entry.warnings:
        meter.report(f"{program}: warning: {warning}")
    if entry.state == State.STOPPED:
        print(f"{program}: stopped, the {entry.are} before are kept.", file=sys.stderr)
    has_failed = entry.state == State.FAILED
    for text in [entry.error] if has_failed else entry.gate:
        print(printable(f"{program}: {text}"), file=sys.stderr)
    path, report = report_path(own.report), run_report.document([entry], run_report.head(call=options.call))
    if has_failed and path:
        run_report.write_failure(path, report)
    if not has_failed:
        lines = [*terminal.saved(entry), *entry.summary, terminal.wrote(entry, path)]
        print("\n".join(map(printable, lines)), file=terminal.out(options))
    if own.report == STDOUT:
        print(run_report.as_text(report))
    meter.ended(entry)
    return Totals([entry]).exit_code


def look_at(options: argparse.Namespace) -> int:
    """Print what the high meshes of a bake are, and what it will change of them. Returns the exit code. Raises BakeError."""
    start_gpu()
    loader = SceneLoader()
    jobs, problems = scene_jobs.opened(options, loader)
    scene_jobs.check_named(options)
    has_none = arguments.takes_all(options)  # no object is named
    alone = [job for job in jobs if options.asset or (has_none and object_checks.lacks_uvs(job.low))]
    settings, smooth = arguments.settings(options), loader.smooth(jobs, options.smooth_files, alone)
    for job in jobs:
        names = shorten_list(high.name for high in job.highs)
        if job in alone:
            from ..jobs.simplify import high_surface  # here, since a bake does not need it

            title, lines = f"{names}, for an asset:", high_surface.look(bpy.context, job, settings)
        else:
            title = f"{names}, baked onto {'itself' if job.highs == [job.low] else job.low.name}:"
            lines = pair_checks.look_at_high(bpy.context, job, settings).lines(lengths_of(bpy.context.scene))
        lines += smooth_sentences({high.name: smooth[high.name] for high in job.highs if high.name in smooth})
        print("\n".join(map(printable, (title, *(f"  {line}" for line in lines)))))
    for problem in problems:
        print(printable(problem), file=sys.stderr)
    return run_report.DONE


MOST_PICTURES = 4
"""Pairs or frames of a bake that have pictures."""


def _image(reports: Sequence[Report]) -> bytes:
    """The pictures of the first few reports, one above the other, as a PNG file; empty if there are none."""
    pictures = [report.picture for report in reports if report.picture is not None][:MOST_PICTURES]
    return png_writer.small(np.concatenate(pictures)) if pictures else b""


def _summary(reports: Sequence[Report], chain: ChainReport | None, kind: str) -> list[str]:
    """What was baked, in lines. A sequence has one line, since its frames hardly differ."""
    if chain is not None:
        return [*chain.table(), chain.summary()[-1]]
    if kind == "frames":
        seconds = sum(report.seconds["total"] for report in reports)
        return [f"{len(reports)} frames of {reports[0].low!r}, {seconds:.2f} s"]
    return [line for report in reports for line in report.summary()]


def _show_memory(opened: _Opened, meter: Meter) -> dict[str, int]:
    """Print what memory the bake needs, now: a system that lacks it may end the process. Returns it for the report."""
    options = opened.plan.options
    if options.convert:
        return {}
    text, is_much, numbers = input_checks.check_memory(opened.jobs, arguments.settings(options))
    is_one_scan = bool(options.low_file) and not meter.place  # of many bakes, only those that need much
    if text and (is_much or (meter.is_on and is_one_scan)):
        meter.report(f"imprint: {opened.name}: {text}")
    return numbers


@dataclass(frozen=True)
class _Baked:
    """The reports of all jobs, frames or levels that were finished, and whether a signal stopped the bake.

    Attributes:
        chain: Of levels.
    """

    reports: list[Report]
    is_stopped: bool = False
    chain: ChainReport | None = None


def _warn_early(name: str, warnings: Sequence[str], printed: list[str], meter: Meter) -> None:
    """Print warnings before a bake, which can take long.

    Args:
        name: Of the bake, where there are many.
        printed: The warnings that were printed before. These are added.
    """
    for warning in warnings:
        if warning not in printed:
            meter.report(f"imprint: {f'{name}: ' if name else ''}warning: {warning}")
            printed.append(warning)


def _kind(options: argparse.Namespace) -> str:
    """What several reports of one bake are of."""
    if options.levels or (options.asset and options.asset.levels):
        return "levels"
    return "pairs" if arguments.are_several(options) else "frames" if options.frames else ""


def _lows(options: argparse.Namespace, jobs: Sequence[Job]) -> list[str]:
    """The names of the low objects in those of files."""
    if options.asset:
        is_made, low = jobs[0].low in jobs[0].highs, jobs[0].low.name
        low = naming.low_name_of(low, options.suffixes) if is_made else low
        low = naming.of_levels(low, options.suffixes.low)
        count = options.asset.levels if naming.has_low(options.output) else 0
        return [low, *naming.level_names(low, count)]
    if options.levels:
        return naming.level_names(jobs[0].low.name, len(levels.limits(*options.levels)))
    return [_shared_name(options)] if _share_image(options) else [job.low.name for job in jobs]


def _explained(opened: _Opened, meter: Meter, printed: list[str]) -> _Baked:
    """As `_baked`. An error that meshes which do not fit may have caused also says that."""
    try:
        return _baked(opened, meter, printed)
    except WrongPlace:
        raise
    except Incomplete as error:
        raise BakeError(f"{error} --allow-missing-files makes it a warning.") from error
    except BakeError as error:
        if not opened.wants.hints:
            raise
        raise BakeError(" ".join([str(error), *opened.wants.hints])) from error


def _baked(opened: _Opened, meter: Meter, printed: list[str]) -> _Baked:
    """Bake. Raises BakeError, or Stopped where nothing was finished."""
    options, jobs, wants = opened.plan.options, opened.jobs, opened.wants
    settings = _for_linked(arguments.settings(options), options, jobs)
    share_image = _share_image(options)
    reports: list[Report] = []

    def on_step(step: progress.Progress) -> None:
        if step.report is not None:  # a signal counts at the next step, if there is one
            reports.append(step.report)
            return
        interruption.check()
        if step.warnings:
            _warn_early(opened.name if meter.place else "", step.warnings, printed, meter)
        if meter.is_on:
            meter.show("the atlas" if share_image else step.low or jobs[0].low.name, step)

    speed = progress.Pace(bake_jobs.PROGRESS_SECONDS, has_picture=False)
    if options.convert:
        return _Baked([progress.finish(_convert_map(bpy.context, jobs[0], options, settings), on_step)])
    if options.asset:
        from ..jobs import asset  # likewise

        making = asset.work(
            bpy.context, jobs[0], options.asset, settings, speed, suffixes=options.suffixes, wants=wants
        )
        return _Baked(progress.finish(making, on_step))
    if options.levels:
        from ..jobs import lod  # likewise

        of_levels = levels.limits(*options.levels)
        chain = progress.finish(lod.work(bpy.context, jobs[0].low, of_levels, settings, speed), on_step)
        return _Baked([level.bake for level in chain.levels], chain=chain)
    if options.frames:
        work = work_on_frames(bpy.context, jobs[0], settings, plans.frames(options), speed, wants=wants)
    else:
        shared = {"share_image": share_image, "shared_name": _shared_name(options), "only": opened.only}
        shared["also"] = opened.kept.lows
        work = bake_jobs.work(bpy.context, jobs, settings, speed, wants=wants, **shared)
    try:
        return _Baked(progress.finish(work, on_step))
    except interruption.Stopped:
        if not reports:
            raise
        return _Baked(reports, is_stopped=True)


def _for_linked(settings: Settings, options: argparse.Namespace, jobs: Sequence[Job]) -> Settings:
    """The settings without the setting Material if a low object cannot have it, and no file would show it."""
    if options.save_blend or settings.storing.connect_maps or not settings.changes_materials:
        return settings
    is_linked = any(not block.is_editable for job in jobs for block in (job.low, job.low.data) if block)
    return settings.stored(material=False) if is_linked else settings


def _share_image(options: argparse.Namespace) -> bool:
    """Whether all low objects share one map, whose path has no low object's name."""
    return arguments.are_several(options) and not naming.has_low(options.output)


def _shared_name(options: argparse.Namespace) -> str:
    """What a map of all low objects is called after: the set."""
    return options.name if options.part and options.name else naming.ATLAS


def start_gpu() -> None:
    """Start the GPU, if it does not run yet. check_job reports a failure."""
    with startup.spent("gpu"), suppress(SystemError, RuntimeError):
        _started_gpu()


@cache
def _started_gpu() -> None:
    """As older_blender.start_gpu, without EGL's messages, which are harmless."""
    # Without the launcher, those lines may be all that explains a crash.
    with standard_streams.silence() if interruption.is_launched() else nullcontext():
        older_blender.start_gpu()


EXPORTERS = {".fbx": ("io_scene_fbx",)}
"""Blender's add-ons that write files, by their ending, beside those that `blender_process.complete` loads."""


def _same_file(options: argparse.Namespace, jobs: Sequence[Job]) -> Path | None:
    """The .glb whose meshes are baked onto themselves and written with their maps, and nothing else changed; None otherwise."""
    names = [*options.file, *filter(None, [options.low_file])]
    ends = {Path(name).suffix.lower().replace(".gltf", ".glb") for name in (*names, options.export)}
    is_made = bool(options.asset or options.levels) or arguments.settings(options).sampling.udim
    is_same = len(names) == 1 and ends == {file_formats.MESHES[0]} and not is_made
    is_same &= all(job.highs == [job.low] for job in jobs) and not naming.has_low(options.export)
    return Path(names[0]).absolute() if is_same else None


def _export(
    reports: Sequence[Report],
    output: str,
    check_beside: Callable[[str], None],
    *,
    are_levels: bool = False,
    source: Path | None = None,
) -> list[Report]:
    """Write the low meshes of `reports` with their maps to `output`, with a file for each if it has LOW.

    check_beside, source: as in engine_files.work. are_levels: whether those in one file are levels of detail of one object,
    from the finest. Returns the reports with what the files show. Raises BakeError.
    """
    from ..export import engine_files  # here, since a bake without exports does not need it

    blender_process.complete(*EXPORTERS.get(Path(output).suffix.lower(), ()))
    by_low: dict[int, list[Report]] = {}
    for report in reports:
        by_low.setdefault(report.refs[0].uid, []).append(report)
    lows = list(by_low.values())
    together = [[low] for low in lows] if naming.has_low(output) else [lows]
    by_uid = {}
    for bakes in together:
        report = bakes[0][0]
        path = Path(naming.fill(output, report.low, low_suffix=report.settings.get("low_suffix", ""))).absolute()
        with standard_streams.silence():
            are_linked = are_levels and len(bakes) > 1
            done = engine_files.export_files(
                bpy.context, bakes, path, are_levels=are_linked, check_beside=check_beside, source=source
            )
        by_uid |= {bake[0].refs[0].uid: one for bake, one in zip(bakes, done, strict=True)}
    result = []
    for report in reports:
        one = by_uid[report.refs[0].uid]
        result.append(report.with_export(one.to_dict()).with_warnings(one.warnings))
    return result


def _image_names(reports: Sequence[Report]) -> set[str]:
    """The names of the images that hold the maps. A sequence keeps only that of the normal map."""
    return {name for report in reports for name in (report.image, *(how["image"] for how in report.maps.values()))}


def _save_scene(path: Path, reports: Sequence[Report]) -> None:
    """Save the scene; the paths of the maps of `reports` become relative."""
    maps = set(map(bpy.data.images.get, _image_names(reports))) - {None}
    folder = path.parent.resolve()  # it may have been named with ".."
    for image in maps:
        output = Path(bpy.path.abspath(image.filepath))
        if output.parent.resolve().is_relative_to(folder):
            # So that the files can be moved together. Relative to the file that is open: saving takes all such paths
            # along to the new place.
            image.filepath = bpy.path.relpath(str(output), start=str(Path(bpy.data.filepath or path).parent))
    with replacing(path) as partial, standard_streams.silence():
        # As a copy: relative paths are those of the final place, which is in the same folder.
        bpy.ops.wm.save_as_mainfile(filepath=str(partial), copy=True, compress=False, relative_remap=True)


def _convert_map(
    context: bpy.types.Context, job: Job, options: argparse.Namespace, settings: Settings
) -> Task[ConversionReport]:
    """Convert the image file that the options name, a map of the job's low object. Raises BakeError.

    A low object without other high ones is its own if its modifiers add detail; then the map is of its base mesh, as in bakes.
    """
    from ..jobs import convert  # here, since a bake does not need it

    low = job.low
    is_own_base = job.highs == [low] == object_checks.own_highs(low)
    image = _loaded(options.convert)
    try:
        conversion = convert.Conversion(low, image, arguments.stored_normals(options), is_own_base=is_own_base)
        pace = Pace(bake_jobs.PROGRESS_SECONDS, has_picture=False)
        return (yield from convert.work(context, conversion, settings, pace))
    finally:
        bpy.data.images.remove(image)


def _loaded(path: str) -> bpy.types.Image:
    """A new image datablock of a file, or of the files of all tiles. Raises BakeError."""
    full = Path(path).absolute()
    is_tiled = udim.is_tiled(str(full))
    if not (udim.files(str(full)) if is_tiled else full.is_file()):
        raise BakeError(f"{path!r} does not exist.")
    image = bpy.data.images.new(full.name, 1, 1)
    image.source, image.filepath = "FILE", str(full)
    if is_tiled:
        image.source = "TILED"  # looks for the files
    return image
