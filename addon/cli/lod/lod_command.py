# SPDX-License-Identifier: GPL-3.0-or-later
"""The command `lod`: a chain of levels of detail from one mesh, each with its map."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import bpy

from ... import older_blender
from ...core import progress
from ...core.errors import BakeError, WrongPlace, sentence
from ...core.levels import level_report
from ...core.levels.level_report import ChainReport, Limit
from ...core.names import file_names
from ...jobs import bake_jobs
from ...jobs.lod import level_chain
from ...output.files.atomic_file import all_or_none, check_writable
from ...scene import object_refs
from .. import batch, interruption, scene_files, side_files
from ..mesh_files.importers import Space
from ..plan import run_clashes
from ..results import report_file
from ..results.exit_codes import DONE, FAILED, WRONG_USAGE
from ..scene_files import Stage
from ..starting import lean_blender
from ..terminal_progress import Meter
from ..usage import arguments
from ..usage.arguments import WrongUsage
from ..usage.options import STDOUT
from ..usage.run_options import RUN_OPTIONS

_OF_BAKES = ("jobs", "high", "cage", "pairs", "high_file", "cage_file", "frames", "high_up", "convert", "strict")
_REFUSED = (*_OF_BAKES, *(name.replace("-", "_") for name in RUN_OPTIONS))
"""Options that a chain has no use for: some of a bake, and all of many bakes."""


def run(words: Sequence[str], program: str) -> int:
    """Make the levels that `words` ask for. Returns the exit code; errors and warnings go to stderr, a line each."""
    try:
        limits, options = _read(words, program)
        files = _check_files(options, limits)
    except SystemExit as stop:  # argparse has printed the help
        return stop.code
    except WrongUsage as error:
        print(f"{program}: {error}. See --help.", file=sys.stderr)
        return WRONG_USAGE
    except WrongPlace as error:
        print(f"{program}: {error}", file=sys.stderr)
        return WRONG_USAGE
    with Meter(sys.stderr) as meter:
        try:
            report = _make(options, limits, files, meter)
        except interruption.Stopped:
            problem = "stopped, nothing was changed."
        except (BakeError, MemoryError) as error:
            problem = sentence(error)
        else:
            meter.clear()
            _print(report, options, program)
            return DONE
        meter.clear()
    print(f"{program}: {problem}", file=sys.stderr)
    return FAILED


def _parser(program: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=program,
        usage="%(prog)s [FILE ...] --low NAME --output MAP [--degrees 1,2,4] [--distance 1] [option ...]\n"
        "       %(prog)s --low-file FILE --output MAP [--degrees 1,2,4] [--distance 1] [option ...]",
        description="Make levels of detail of one mesh: for each limit the coarsest mesh with the same UV layout that, with "
        "its map, stays within the limit on 99 % of the map's texels.",
        epilog="Other options are those of a bake, as --size, --basis, --save-blend and --report: see `bake --help`. --output "
        "has {low}, which stands for the level's name.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--degrees",
        default=None,
        metavar="1,2,4",
        help="The largest angles between the normals that each level shows with its map and those of the mesh (default: "
        "1,2,4, without --distance)",
    )
    parser.add_argument(
        "--distance",
        default=None,
        metavar="0.5,1,2",
        help="The largest distances of each level from the mesh, in percent of the longest side of its box; one for all "
        "levels, or one for each (default: 1)",
    )
    return parser


def _read(words: Sequence[str], program: str) -> tuple[list[Limit], argparse.Namespace]:
    """The limits, and the options of the maps. Raises WrongUsage."""
    own, rest = _parser(program).parse_known_args(words)
    options = arguments.parse(rest, program)
    usual = vars(arguments.parse([]))
    wrong = next((name for name in _REFUSED if getattr(options, name) != usual[name]), None)
    if wrong:
        raise WrongUsage(f"--{wrong.replace('_', '-')} is not for lod, which makes coarser meshes of one mesh")
    arguments.check(options)
    degrees = own.degrees if own.degrees is not None else "" if own.distance else level_report.DEGREES
    try:
        limits = level_report.limits(degrees, level_report.PERCENT if own.distance is None else own.distance)
    except BakeError as error:
        raise WrongUsage(str(error).rstrip(".")) from error
    if len(limits) > 1 and file_names.LOW not in options.output:
        raise WrongUsage(f"each level has a map: put {file_names.LOW} into --output")
    is_one_file = bool(options.export) and file_names.LOW not in options.export
    if len(limits) > 1 and is_one_file and Path(options.export).suffix.lower() != ".glb":
        raise WrongUsage(f"only .glb has levels in one file: put {file_names.LOW} into --export")
    return limits, options


def _check_files(options: argparse.Namespace, limits: Sequence[Limit]) -> run_clashes.Run:
    """The files of the chain. Raises WrongPlace, with a line for each file that would be harmed."""
    files = run_clashes.Run(bpy.data.filepath)
    if problems := files.add([("", options)]):
        raise WrongPlace("\n".join(problems))
    if options.save_blend:
        lean_blender.complete()  # before a file is opened
    return files


def _make(options: argparse.Namespace, limits: Sequence[Limit], files: run_clashes.Run, meter: Meter) -> ChainReport:
    settings, report_path = arguments.settings(options), report_file.path_of(options.report)
    for path in (settings.output, options.export, options.save_blend, report_path):
        if path and file_names.LOW not in str(path):
            check_writable(Path(path).absolute())
    stage = Stage()
    source = _source(options, stage)
    interruption.note(source.name)
    files.opened("", options, level_chain.names(source, len(limits)), scene_files.used(options))
    batch.start_gpu()

    def on_step(step: progress.Progress) -> None:
        interruption.check()
        meter.show(source.name, step)

    pace = progress.Pace(bake_jobs.PROGRESS_SECONDS, has_picture=False)
    with all_or_none():
        work = level_chain.work(bpy.context, source, limits, settings, pace)
        report = older_blender.with_gpu(lambda: progress.finish(work, on_step))
        if options.export:
            bakes = side_files.export(
                [level.bake for level in report.levels], options.export, partial(files.exported, ""), are_levels=True
            )
            levels, notes = [], dict.fromkeys(report.warnings)
            for level, bake in zip(report.levels, bakes, strict=True):
                levels.append(replace(level, bake=bake))
                notes |= dict.fromkeys(text for text in bake.warnings if text not in level.bake.warnings)
            report = replace(report, levels=levels, warnings=list(notes))
        if options.save_blend:
            with stage.let_go():
                side_files.save_scene(Path(options.save_blend).absolute(), [level.bake for level in report.levels])
        if report_path:
            report_file.write(report_path, report.to_dict())
    return report


def _source(options: argparse.Namespace, stage: Stage) -> bpy.types.Object:
    """The object to make levels of. Raises BakeError."""
    if options.low_file:
        return stage.job(options.low_file, [], space=Space(options.origin)).low
    if options.file:
        stage.open(options.file, Space(options.origin))
    elif not bpy.data.filepath:
        raise BakeError("There is no scene to bake: give a FILE, or a mesh file with --low-file.")
    else:
        stage.take()
    return object_refs.by_name(options.low)


def _print(report: ChainReport, options: argparse.Namespace, program: str) -> None:
    out = sys.stderr if options.report == STDOUT else sys.stdout
    for warning in report.warnings:
        print(f"{program}: warning: {warning}", file=sys.stderr)
    print("\n".join([*report.table(), report.summary()[-1]]), file=out)
    written = [path for level in report.levels for path in level.bake.output]
    written += [path for level in report.levels for path in level.bake.export.get("files", ())]
    written += [str(path) for path in (options.save_blend, report_file.path_of(options.report)) if path]
    print(f"Wrote {', '.join(dict.fromkeys(written))}", file=out)
    if options.report == STDOUT:
        print(report_file.as_text(report.to_dict()))
