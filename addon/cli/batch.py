# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs a bake of the command line in this process: opens its files, bakes, and saves what its options name."""

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import bpy

from .. import older_blender
from ..core import levels, naming, progress
from ..core.errors import BakeError, Incomplete, WrongPlace
from ..core.levels import ChainReport
from ..core.naming import printable
from ..core.progress import startup
from ..core.report import Report
from ..core.settings import Settings
from ..jobs import bake_jobs, sequence
from ..jobs.job import Job, files_read_by, jobs_by_name
from ..output.files.atomic_file import all_or_none, check_writable
from ..scene import object_refs
from . import (
    arguments,
    bake_result,
    blender_process,
    clashes,
    gates,
    input_checks,
    interruption,
    memory_check,
    plans,
    read_files,
    report_file,
    run_report,
    side_files,
    standard_streams,
    terminal,
)
from .bake_result import Result
from .contents import Content, Contents
from .importers import Space
from .options import STDOUT
from .plans import Plan, subject
from .run_options import RunOptions
from .scene_files import SceneLoader
from .terminal import Meter


def need_all(planned: Sequence[Plan]) -> bool:
    """Whether these plans write files in which Blender's add-ons keep settings."""
    return any(plan.options.save_blend or plan.options.export for plan in planned)


@dataclass(frozen=True)
class Opened:
    """A bake whose files are open."""

    name: str
    options: argparse.Namespace
    settings: Settings
    jobs: Sequence[Job]
    problems: list[str]
    """What is wrong with names."""
    notes: list[str]
    """Sentences about files that are missing, and about coordinates that were rounded."""
    begun: float
    """When it began, by time.perf_counter."""
    hints: list[str]
    """Why low and high meshes may not fit, in sentences. Meshes that share their UV layout need not."""
    declared: list[Content]
    """The files that its options name. Empty if neither a report nor a record wants them."""
    found: list[Content]
    """The other files that it reads. Empty likewise."""
    not_followed: list[str]
    """Why other files that it reads are not known, in clauses."""
    hashes: Contents | None
    """For the files that it writes. None likewise."""

    @property
    def report(self) -> Path | None:
        """The file of its report."""
        return report_file.report_path(self.options.report)

    @property
    def scene(self) -> Path | None:
        """The .blend to save."""
        return Path(self.options.save_blend).absolute() if self.options.save_blend else None


@dataclass(frozen=True)
class _Baked:
    """The reports of all jobs, frames or levels that were finished, and whether a signal stopped the bake. chain: of levels."""

    reports: list[Report]
    is_stopped: bool = False
    chain: ChainReport | None = None


def open_files(
    plan: Plan,
    loader: SceneLoader,
    files: clashes.RunFiles,
    meter: Meter,
    hashes: Contents | None = None,
    *,
    is_pictured: bool = False,
) -> Opened:
    """Check what can be checked, and open what the plan names. files: must have the plan. hashes: for what is read, if a report
    or a record wants it. is_pictured: whether its reports shall have pictures.

    Raises BakeError, or WrongPlace if the bake would harm a file.
    """
    if plan.problem:
        raise BakeError(plan.problem)
    begun = time.perf_counter()
    options, name = plan.options, plan.name or subject(plan.options, bpy.data.filepath)
    interruption.note(name)
    settings = arguments.settings(options)
    # Opening a file can take long, so check first that the results can be written.
    for path in (settings.storing.output, options.export, options.save_blend, report_file.report_path(options.report)):
        if path and naming.LOW not in str(path):
            check_writable(Path(path).absolute())
    if meter.is_on:
        meter.show(subject(options, bpy.data.filepath), progress.Progress("Opening", 0.0))
    with startup.spent("opening"):
        jobs, problems = _jobs(options, loader)
        if not plan.chain and loader.reopen_if_changed(high.name for job in jobs for high in job.highs):
            jobs, problems = _jobs(options, loader)  # a bake does not depend on those before it
    for job in jobs:
        job.is_exported, job.must_be_whole = bool(options.export), not options.allow_missing_pages
        job.is_measured, job.is_pictured = gates.DEVIATION in gates.needs(options.strict), is_pictured
    # In a chain, a bake may read the maps of those before it.
    read = files_read_by([*jobs, *_rival_jobs(plan)], has_maps=not plan.chain)
    used = [*read_files.used(options), *read]
    files.opened(plan.name, options, _lows(options, jobs), used)
    notes = input_checks.check_pages(options, settings.map, jobs)
    hints = input_checks.fit_hints(options, jobs)
    for job in jobs:
        job.hints = hints
    notes += input_checks.rounded_coordinates(options, jobs)
    hashes = hashes or (Contents() if options.report else None)
    reading = hashes.checking(interruption.check) if hashes else None
    declared = reading.all_of(plans.input_paths(options, bpy.data.filepath)) if reading else []
    found = reading.all_of(read_files.read_by(options, jobs)) if reading else []
    not_followed = read_files.not_followed(options, jobs)
    return Opened(name, options, settings, jobs, problems, notes, begun, hints, declared, found, not_followed, hashes)


def run(opened: Opened, loader: SceneLoader, files: clashes.RunFiles, meter: Meter) -> Result:
    """Bake, and save what the options name. files: must have the plan.

    Raises BakeError, or Stopped where nothing was finished.
    """
    options = opened.options
    start_gpu()
    memory = _say_memory(opened, meter)
    # If a pair, a frame, the scene or the report fails, no file of the bake is written.
    with all_or_none(has_parts=bool(options.pairs or options.frames)):
        printed: list[str] = []
        baked = older_blender.with_gpu(lambda: _explained(opened, meter, printed))
        is_stopped, chain = baked.is_stopped, baked.chain
        notes = [*loader.notes, *opened.notes, *input_checks.refused_scripts()]
        reports = [report.with_memory(memory).with_warnings(notes) for report in baked.reports]
        if options.export and not is_stopped:
            check_beside = partial(files.exported, opened.name)
            reports = side_files.export(reports, options.export, check_beside, are_levels=chain is not None)
        reports[:1] = [report.with_startup(startup.take()) for report in reports[:1]]
        loader.changed(job.low.name for job in opened.jobs)
        problems = [*opened.problems, *(chain.left_out if chain else ())]
        result = Result(opened.name, reports, problems, are=_kind(options), is_stopped=is_stopped, said=printed)
        result.strict, result.chain = options.strict, chain
        if opened.scene is not None and not is_stopped:
            with loader.caches_released():
                side_files.save_scene(opened.scene, reports)
            result.scene = opened.scene
        result.hashes = opened.hashes
        result.inputs = [each.facts() for each in (*opened.declared, *opened.found)]
        result.seconds = time.perf_counter() - opened.begun
        if opened.report is not None:
            report_file.write_report(opened.report, run_report.document([result.entry()]))
    return result


def _say_memory(opened: Opened, meter: Meter) -> dict[str, int]:
    """Print what memory the bake needs, now: a system that lacks it may end the process. Returns it for the report."""
    if opened.options.convert:
        return {}
    text, is_much, numbers = memory_check.check(opened.jobs, opened.settings)
    is_one_scan = bool(opened.options.low_file) and not meter.place  # of many bakes, only those that need much
    if text and (is_much or (meter.is_on and is_one_scan)):
        meter.report(f"imprint: {opened.name}: {text}")
    return numbers


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
    return "pairs" if options.pairs else "frames" if options.frames else "levels" if options.levels else ""


def _lows(options: argparse.Namespace, jobs: Sequence[Job]) -> list[str]:
    """The names of the low objects in those of files."""
    if options.levels:
        from ..jobs import lod  # here, since a bake does not need it

        return lod.names(jobs[0].low, len(levels.limits(*options.levels)))
    return [naming.ATLAS] if _share_image(options) else [job.low.name for job in jobs]


def _explained(opened: Opened, meter: Meter, printed: list[str]) -> _Baked:
    """As `_baked`. An error that meshes which do not fit may have caused also says that."""
    try:
        return _baked(opened, meter, printed)
    except WrongPlace:
        raise
    except Incomplete as error:
        raise BakeError(f"{error} --allow-missing-pages makes it a warning.") from error
    except BakeError as error:
        if not opened.hints:
            raise
        raise BakeError(" ".join([str(error), *opened.hints])) from error


def _baked(opened: Opened, meter: Meter, printed: list[str]) -> _Baked:
    """Bake. Raises BakeError, or Stopped where nothing was finished."""
    options, jobs, settings = opened.options, opened.jobs, opened.settings
    share_image = _share_image(options)

    def on_step(step: progress.Progress) -> None:
        interruption.check()
        if step.warnings:
            _warn_early(opened.name if meter.place else "", step.warnings, printed, meter)
        if meter.is_on:
            job = jobs[0 if options.frames or options.levels else step.finished]
            meter.show("the atlas" if share_image else job.low.name, step)

    speed, reports = progress.Pace(bake_jobs.PROGRESS_SECONDS, has_picture=False), []
    if options.convert:
        from .convert import convert_map  # here, since a bake does not need it

        return _Baked([progress.finish(convert_map(bpy.context, jobs[0], options, settings), on_step)])
    if options.levels:
        from ..jobs import lod  # likewise

        limits = levels.limits(*options.levels)
        chain = progress.finish(lod.work(bpy.context, jobs[0].low, limits, settings, speed), on_step)
        return _Baked([level.bake for level in chain.levels], chain=chain)
    if options.frames:
        work = sequence.work(bpy.context, jobs[0], settings, plans.frames(options), speed, reports=reports)
    else:
        work = bake_jobs.work(bpy.context, jobs, settings, speed, share_image=share_image, reports=reports)
    try:
        return _Baked(progress.finish(work, on_step))
    except interruption.Stopped:
        if not reports:
            raise
        return _Baked(reports, is_stopped=True)


def _share_image(options: argparse.Namespace) -> bool:
    """Whether all pairs share one map, whose path has no low object's name."""
    return bool(options.pairs) and naming.LOW not in options.output


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


def _rival_jobs(plan: Plan) -> Iterator[Job]:
    """The jobs of the plan's rivals that the open scene has."""
    for options in plan.rivals:
        with suppress(BakeError):  # each says itself what it lacks
            if options.pairs:
                yield from jobs_by_name(bpy.context, options.suffixes)[0]
            elif options.low:
                low = object_refs.by_name(options.low)
                cage = object_refs.by_name(options.cage) if options.cage else None
                yield Job(low, [object_refs.by_name(name) for name in options.high] or [low], cage)


def _jobs(options: argparse.Namespace, loader: SceneLoader) -> tuple[list[Job], list[str]]:
    """The jobs, ready in the scene, and sentences about what is wrong with names."""
    if options.low_file:
        space = Space(options.origin)
        job = loader.job(options.low_file, options.high_file, options.cage_file, space, options.high_up or "")
        if not (options.high_file or options.convert or options.levels):
            input_checks.check_own_high(job.low, "--high-file")
        return [job], []
    if options.file:
        loader.open(options.file, Space(options.origin))
    elif not bpy.data.filepath:
        raise BakeError("There is no scene to bake: give a FILE, or mesh files with --low-file and --high-file.")
    else:
        loader.take()
    if options.pairs:
        return jobs_by_name(bpy.context, options.suffixes)
    low = object_refs.by_name(options.low)
    highs = [object_refs.by_name(name) for name in options.high] or [low]
    if not (options.high or options.convert or options.levels):
        input_checks.check_own_high(low, "--high")
    return [Job(low, highs, object_refs.by_name(options.cage) if options.cage else None)], []


def run_single(plan: Plan, files: clashes.RunFiles, run_options: RunOptions, meter: Meter) -> int:
    """Bake. files: must have the plan. Returns the exit code. Raises WrongPlace if the bake would harm a file."""
    options, program, loader = plan.options, run_options.program, SceneLoader()
    if need_all([plan]):
        blender_process.complete()  # before a file is opened, as Baker does
    start, is_begun = time.perf_counter(), False
    meter.planned(1, 1)
    meter.begin(Plan(plans.subject(options, bpy.data.filepath), options))
    try:
        opened = open_files(plan, loader, files, meter)
        is_begun = True
        result = run(opened, loader, files, meter)
    except interruption.Stopped:
        meter.clear()
        print(f"{program}: stopped, nothing was finished.", file=sys.stderr)
        return run_report.FAILED
    except (BakeError, MemoryError) as error:
        if isinstance(error, WrongPlace) and not is_begun:
            raise
        meter.clear()
        result = bake_result.failure(plans.subject(options, bpy.data.filepath), error)
        result.seconds = time.perf_counter() - start
        return _report_failure(result, options.report, program, meter)
    meter.clear()
    out, entry = terminal.out(run_options), result.entry()
    for warning in result.unsaid:
        meter.report(f"{program}: warning: {warning}")
    if result.is_stopped:
        print(f"{program}: stopped, the {result.are} before are kept.", file=sys.stderr)
    for sentence in entry.gate:
        print(printable(f"{program}: {sentence}"), file=sys.stderr)
    lines = [
        *terminal.saved(result.maps),
        *terminal.summary(result),
        terminal.wrote(result, opened.report),
    ]
    print("\n".join(map(printable, lines)), file=out)
    if options.report == STDOUT:
        print(report_file.as_text(run_report.document([entry])))
    meter.ended(entry)
    return run_report.exit_code(entry)


def _report_failure(result: Result, report: str | None, program: str, meter: Meter) -> int:
    """Say why a bake failed, on standard error and in its report. Returns the exit code."""
    print(printable(f"{program}: {result.error}"), file=sys.stderr)
    entry = result.entry()
    meter.ended(entry)
    document = run_report.document([entry])
    if path := report_file.report_path(report):
        report_file.write_failure(path, document)
    elif report:
        print(report_file.as_text(document))
    return run_report.exit_code(entry)
