# SPDX-License-Identifier: GPL-3.0-or-later
"""One bake of the command line, and many: each fails alone, and all are told of in the end."""

import argparse
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import gpu

from ..core import file_names, progress
from ..core.errors import BakeError, sentence
from ..core.progress import Progress
from ..core.report import Report
from ..core.settings import Settings
from ..jobs import sequence, several
from ..jobs.job import Job, jobs_by_name
from ..output.atomic_file import check_writable, replacing, together
from ..scene import bake_objects
from . import interruption, mesh_import, run_clashes, standard_streams
from .mesh_import import Stage
from .terminal_progress import Meter
from .usage import arguments
from .usage.options import STDOUT


@dataclass(frozen=True)
class Plan:
    """A bake to come: how it is called, what it is to do, and why it cannot be done, if that is known."""

    name: str
    options: argparse.Namespace
    problem: str = ""


@dataclass
class Result:
    """What became of a plan: reports, or an error."""

    name: str
    reports: list[Report] = field(default_factory=list)
    maps: list[str] = field(default_factory=list)
    """The files that were written."""
    problems: list[str] = field(default_factory=list)
    """What was found to be wrong with names."""
    error: str = ""
    seconds: float = 0.0
    are: str = ""
    """What several reports are of: "pairs" or "frames"."""
    is_stopped: bool = False
    """Whether somebody stopped it; pairs and frames that were done by then are kept."""

    @property
    def warnings(self) -> list[str]:
        """Sentences."""
        return [*self.problems, *(warning for report in self.reports for warning in report.warnings)]

    def to_json(self) -> dict | None:
        """Plain data for json.dump: of one bake its report, of pairs and frames all of theirs; None if there is none."""
        reports = [report.to_dict() for report in self.reports]
        if self.are:
            return {self.are: reports, "problems": self.problems}
        return reports[0] if reports else None


def plans(sets: Sequence[argparse.Namespace]) -> tuple[list[Plan], list[str]]:
    """The bakes of several sets, where a folder of pairs is one for each pair, and sentences about files left over."""
    result, problems = [], []
    for number, options in enumerate(sets, 1):
        label = "{}" if len(sets) == 1 else f"set {number} ({{}})"
        name = label.format(subject(options))
        if not arguments.is_folder(options):
            result.append(Plan(name, options))
            continue
        try:
            found, left = mesh_import.pairs(options.pairs, options.suffixes)
        except BakeError as error:
            result.append(Plan(name, options, str(error)))
            continue
        problems += left
        for pair, problem in found:
            own = copy(options)
            own.report = None  # which is of all
            own.pairs, own.low_file, own.high_file, own.cage_file = None, pair.low, pair.highs, pair.cage
            result.append(Plan(label.format(subject(own)), own, problem))
    return result, problems


def subject(options: argparse.Namespace) -> str:
    """What a person would call the thing that is baked."""
    if options.low or options.low_file:
        return options.low or Path(options.low_file).stem
    place = options.pairs if arguments.is_folder(options) else (*options.file, bpy.data.filepath)[0]
    return os.path.basename(os.path.abspath(place))  # a folder may be called "."


def bake_all(
    planned: Sequence[Plan], files: run_clashes.Run, meter: Meter, tell: Callable[[list[Result]], None]
) -> list[Result]:
    """Bake one plan after the other; `files` knows them, and `tell` hears of all so far as each ends.

    The last may have been stopped.
    """
    results, stage = [], Stage()
    for number, plan in enumerate(planned, 1):
        meter.place = f"{number}/{len(planned)} "
        start = time.perf_counter()
        try:
            interruption.check()
            result = bake(plan, stage, files, meter)
        except interruption.Stopped:
            result = Result(plan.name, is_stopped=True)
        except (BakeError, MemoryError) as error:
            result = Result(plan.name, error=sentence(error))
            stage = Stage()  # what the bake has changed before it failed is nothing for the next one
        result.seconds = time.perf_counter() - start
        results.append(result)
        meter.clear()
        tell(results)
        if result.is_stopped:
            break
    return results


def bake(plan: Plan, stage: Stage, files: run_clashes.Run, meter: Meter) -> Result:
    """Do what the plan says, which `files` knows. Raises BakeError."""
    if plan.problem:
        raise BakeError(plan.problem)
    options = plan.options
    interruption.note(plan.name or subject(options))
    settings = arguments.settings(options)
    report = Path(options.report).absolute() if options.report not in (None, STDOUT) else None
    scene = Path(options.save_blend).absolute() if options.save_blend else None
    # Before a file is opened, which may take long: what could go wrong at the end.
    for path in (Path(settings.output), report, scene):
        if path is not None and file_names.LOW not in str(path):
            check_writable(path)
    if meter.is_on:
        meter.tell(subject(options), Progress("Opening", 0.0))
    jobs, problems = _jobs(options, stage)
    lows = [several.ATLAS] if _share_image(options) else [job.low.name for job in jobs]
    files.opened(plan.name, options, lows)
    _start_gpu()
    with together():  # a bake of which a pair or a frame fails has failed, and so has one without its scene or report
        reports, is_stopped = _baked(options, jobs, settings, meter)
        for told in reports:
            told.warnings += [*stage.notes, *_refused_scripts()]
        are = "pairs" if options.pairs else "frames" if options.frames else ""
        result = Result(plan.name, reports, written(reports), problems, are=are, is_stopped=is_stopped)
        if scene is not None and not is_stopped:
            with stage.let_go():
                _save(scene, {bpy.data.images[report.image] for report in reports})
        if report is not None:
            write_json(report, result.to_json())
    return result


def _baked(
    options: argparse.Namespace, jobs: Sequence[Job], settings: Settings, meter: Meter
) -> tuple[list[Report], bool]:
    """The reports of all jobs or frames, or of those that were done when it was stopped; and whether it was.

    Raises Stopped where nothing was done yet, or BakeError.
    """
    share_image = _share_image(options)

    def tell(step: Progress) -> None:
        interruption.check()
        if meter.is_on:
            job = jobs[0 if options.frames else step.finished]
            meter.tell("the atlas" if share_image else job.low.name, step)

    speed, reports = progress.Pace(several.PROGRESS_SECONDS, looks=False), []
    if options.frames:
        work = sequence.work(bpy.context, jobs[0], settings, run_clashes.frames(options), speed, reports=reports)
    else:
        work = several.work(bpy.context, jobs, settings, speed, share_image=share_image, reports=reports)
    try:
        return progress.finish(work, tell), False
    except interruption.Stopped:
        if not reports:
            raise
        return reports, True


def _share_image(options: argparse.Namespace) -> bool:
    """Whether all pairs go into one map, which has no low object's name."""
    return bool(options.pairs) and file_names.LOW not in options.output


def _refused_scripts() -> list[str]:
    """What Blender has not run of the open file, which may move a mesh."""
    if not bpy.app.autoexec_fail:
        return []
    return [f"Scripts of the file were not run, and what they drive stays as saved: {bpy.app.autoexec_fail_message}."]


def written(reports: Sequence[Report]) -> list[str]:
    """The files of several bakes, each once."""
    return list(dict.fromkeys(path for report in reports for path in report.output))


def write_json(path: Path, value) -> None:
    """Write plain data to a file. Raises BakeError."""
    with replacing(path) as partial:
        partial.write_text(as_text(value) + "\n", encoding="utf-8")


def as_text(value) -> str:
    """Plain data as JSON."""
    return json.dumps(value, indent=2)


class ReportFile:
    """The report of many bakes, written anew as they go on: a crash loses no more than the bakes of a moment."""

    SHARE = 0.1
    """Of the time, at most, that is spent on it: it grows with the number of bakes."""

    def __init__(self, path: Path):
        """Raises BakeError if it could not be written in the end."""
        check_writable(path)
        self._path, self._next = path, 0.0

    def update(self, results: Sequence[Result]) -> None:
        """Write it if it is time to, and it can be: the last one counts."""
        start = time.perf_counter()
        if start >= self._next:
            with suppress(BakeError):
                self.write(results)
            stop = time.perf_counter()
            self._next = stop + (stop - start) / self.SHARE

    def write(self, results: Sequence[Result]) -> None:
        """Raises BakeError."""
        write_json(self._path, to_json(results))


def table(results: Sequence[Result], planned: int) -> Iterator[str]:
    """A line for each, and one for all; `planned` is how many there were to be."""
    width = max((len(result.name) for result in results), default=0)
    for result in results:
        state = "stopped" if result.is_stopped else "failed" if result.error else "done"
        said = result.error or ", ".join(result.maps)
        yield f"{state:7} {result.seconds:8.2f} s  {result.name:{width}}  {said}".rstrip()
    failed = sum(1 for result in results if result.error)
    done = sum(1 for result in results if not result.error and not result.is_stopped)
    left = f", {planned - failed - done} stopped or not begun" if planned > failed + done else ""
    yield f"{done} done, {failed} failed{left}, {sum(result.seconds for result in results):.2f} s"


def to_json(results: Sequence[Result]) -> list[dict]:
    """Plain data for json.dump; one that was stopped is told of where some of its pairs or frames are done."""
    return [
        {
            "name": result.name,
            "ok": not result.error and not result.is_stopped,
            "error": "It was stopped." if result.is_stopped else result.error,
            "seconds": result.seconds,
            "maps": result.maps,
            "report": result.to_json(),
        }
        for result in results
        if result.reports or not result.is_stopped
    ]


def _start_gpu() -> None:
    """Without the window system's complaints of EGL, after which it goes on; what stops it is told by check_job."""
    if interruption.is_launched():  # else nobody could tell of a crash but those lines
        with suppress(SystemError, RuntimeError), standard_streams.silence():
            gpu.init()


def _jobs(options: argparse.Namespace, stage: Stage) -> tuple[list[Job], list[str]]:
    """What to bake, ready in the scene, and what was found to be wrong with names."""
    if options.low_file:
        return [stage.job(options.low_file, options.high_file, options.cage_file)], []
    if options.file:
        stage.open(options.file)
    elif not bpy.data.filepath:
        raise BakeError("There is no scene to bake: give a FILE.")
    else:
        stage.take()
    if options.pairs:
        return jobs_by_name(bpy.context, options.suffixes)
    low = bake_objects.named(options.low)
    highs = [bake_objects.named(name) for name in options.high] or [low]
    return [Job(low, highs, bake_objects.named(options.cage) if options.cage else None)], []


def _save(path: Path, maps: set[bpy.types.Image]) -> None:
    """Save the scene; the paths of its maps become relative."""
    for image in maps:
        output = Path(bpy.path.abspath(image.filepath))
        if output.is_relative_to(path.parent):
            # So that the files can be moved together. Relative to the file that is open: saving takes all such paths
            # along to the new place.
            image.filepath = bpy.path.relpath(str(output), start=str(Path(bpy.data.filepath or path).parent))
    with replacing(path) as partial, standard_streams.silence():
        # As a copy: relative paths are those of the final place, which is in the same folder.
        bpy.ops.wm.save_as_mainfile(filepath=str(partial), copy=True, compress=False, relative_remap=True)
