# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs bakes in this process: opens their files, bakes, and saves what their options name."""

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import bpy

from .. import older_blender
from ..core import levels, naming, progress, udim
from ..core.conversion import ConversionReport
from ..core.errors import BakeError, Incomplete, WrongPlace
from ..core.levels import ChainReport
from ..core.naming import printable
from ..core.progress import Pace, Task, startup
from ..core.report import Report
from ..core.settings import Settings
from ..jobs import bake_jobs
from ..jobs.bake_jobs import work_on_frames
from ..jobs.job import Job, files_read_by, jobs_by_name
from ..output.atomic_file import all_or_none, check_writable, replacing
from ..scene import object_checks
from ..scene.object_checks import object_by_name
from . import (
    arguments,
    bake_result,
    blender_process,
    clashes,
    gates,
    input_checks,
    interruption,
    plans,
    report_file,
    run_report,
    scene_files,
    standard_streams,
    terminal,
)
from .bake_result import Result
from .importers import Space
from .options import STDOUT, RunOptions
from .plans import Plan, subject
from .records import Content, Contents
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
        job.is_exported, job.must_be_whole = bool(options.export), not options.allow_missing_files
        job.is_measured, job.is_pictured = gates.DEVIATION in gates.needs(options.strict), is_pictured
    # In a chain, a bake may read the maps of those before it.
    read = files_read_by([*jobs, *_rival_jobs(plan)], has_maps=not plan.chain)
    used = [*scene_files.used(options), *read]
    files.opened(plan.name, options, _lows(options, jobs), used)
    notes = input_checks.check_textures(options, settings.map, jobs)
    hints = input_checks.fit_hints(options, jobs)
    for job in jobs:
        job.hints = hints
    notes += input_checks.rounded_coordinates(options, jobs)
    hashes = hashes or (Contents() if options.report else None)
    reading = hashes.checking(interruption.check) if hashes else None
    declared = reading.all_of(plans.input_paths(options, bpy.data.filepath)) if reading else []
    found = reading.all_of(scene_files.read_by(options, jobs)) if reading else []
    not_followed = scene_files.not_followed(options, jobs)
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
            reports = export(reports, options.export, check_beside, are_levels=chain is not None)
        reports[:1] = [report.with_startup(startup.take()) for report in reports[:1]]
        loader.changed(job.low.name for job in opened.jobs)
        problems = [*opened.problems, *(chain.left_out if chain else ())]
        result = Result(opened.name, reports, problems, are=_kind(options), is_stopped=is_stopped, said=printed)
        result.strict, result.chain = options.strict, chain
        if opened.scene is not None and not is_stopped:
            with loader.caches_released():
                save_scene(opened.scene, reports)
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
    text, is_much, numbers = input_checks.check_memory(opened.jobs, opened.settings)
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
        raise BakeError(f"{error} --allow-missing-files makes it a warning.") from error
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
        return _Baked([progress.finish(convert_map(bpy.context, jobs[0], options, settings), on_step)])
    if options.levels:
        from ..jobs import lod  # likewise

        limits = levels.limits(*options.levels)
        chain = progress.finish(lod.work(bpy.context, jobs[0].low, limits, settings, speed), on_step)
        return _Baked([level.bake for level in chain.levels], chain=chain)
    if options.frames:
        work = work_on_frames(bpy.context, jobs[0], settings, plans.frames(options), speed, reports=reports)
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
                low = object_by_name(options.low)
                cage = object_by_name(options.cage) if options.cage else None
                yield Job(low, [object_by_name(name) for name in options.high] or [low], cage)


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
    low = object_by_name(options.low)
    highs = [object_by_name(name) for name in options.high] or [low]
    if not (options.high or options.convert or options.levels):
        input_checks.check_own_high(low, "--high")
    return [Job(low, highs, object_by_name(options.cage) if options.cage else None)], []


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


EXPORTERS = {".fbx": ("io_scene_fbx",)}
"""Blender's add-ons that write files, by their ending, beside those that `blender_process.complete` loads."""


def export(
    reports: Sequence[Report], output: str, check_beside: Callable[[str], None], *, are_levels: bool = False
) -> list[Report]:
    """Write the low meshes of `reports` with their maps to `output`, with a file for each if it has LOW.

    check_beside: as in engine_files.export. are_levels: whether those in one file are levels of detail of one object, from the
    finest. Returns the reports with what the files show. Raises BakeError.
    """
    from ..export import engine_files  # here, since a bake without exports does not need it

    blender_process.complete(*EXPORTERS.get(Path(output).suffix.lower(), ()))
    by_low: dict[int, list[Report]] = {}
    for report in reports:
        by_low.setdefault(report.refs[0].uid, []).append(report)
    lows = list(by_low.values())
    together = [[low] for low in lows] if naming.LOW in output else [lows]
    found = {}
    for bakes in together:
        path = Path(naming.fill(output, bakes[0][0].low)).absolute()
        with standard_streams.silence():
            are_linked = are_levels and len(bakes) > 1
            done = engine_files.export_files(bpy.context, bakes, path, are_levels=are_linked, check_beside=check_beside)
        found |= {bake[0].refs[0].uid: one for bake, one in zip(bakes, done, strict=True)}
    result = []
    for report in reports:
        one = found[report.refs[0].uid]
        result.append(report.with_export(one.to_dict()).with_warnings(one.warnings))
    return result


def _image_names(reports: Sequence[Report]) -> set[str]:
    """The names of the images that hold the maps. A sequence keeps only that of the normal map."""
    return {name for report in reports for name in (report.image, *(how["image"] for how in report.maps.values()))}


def save_scene(path: Path, reports: Sequence[Report]) -> None:
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


def convert_map(
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
