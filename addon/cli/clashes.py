# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that the bakes of a call read and write, all checked before the first bake: none may be overwritten by mistake."""

import argparse
import os
import re
import stat
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from ..core import naming, udim
from ..core.errors import WrongPlace, reason
from ..core.file_formats import OPENED
from ..core.file_structure import blend_files, mesh_references
from ..core.naming import ATLAS
from ..output import map_names
from ..output.path_clashes import Places
from . import arguments, plans, run_report, untrusted
from .options import RunOptions
from .plans import Plan
from .records import record_files
from .run_report import LINES, STDOUT
from .untrusted import Bounds


class InputFiles:
    """Files of a run, each of which is looked at once."""

    def __init__(self):
        self.problem = cache(_problem_of_input)
        self.references = cache(_references)


def _references(path: str) -> tuple[str, ...]:
    return tuple(map(str, mesh_references.of(path)))


def _problem_of_input(path: str) -> str:
    """Why a file to read, or a tile of it, cannot be read, as a sentence, or ""."""
    return _problem_of_tiles(path) if udim.is_tiled(path) else _problem(path)


def _problem_of_tiles(path: str) -> str:
    """As `_problem`, of the files of all tiles."""
    tiles = list(map(_problem, udim.files(path).values()))
    return next(filter(None, tiles), "") if tiles else f"There is no file {os.path.abspath(path)!r}."


def _problem(path: str) -> str:
    try:
        state = os.stat(path)
    except FileNotFoundError:
        return f"There is no file {os.path.abspath(path)!r}."
    except (OSError, ValueError) as error:
        return f"{path!r} cannot be read: {reason(error)}."
    if not stat.S_ISREG(state.st_mode):
        return f"There is no file {os.path.abspath(path)!r}."  # as the bake says
    return "" if os.access(path, os.R_OK) else f"{path!r} cannot be read: Permission denied."


def map_files(options: argparse.Namespace, low: str, of_frames: Sequence[int] = ()) -> Iterator[tuple[str, str]]:
    """The files that a bake of the object `low` writes, as map_names.planned_files returns them."""
    settings = arguments.settings(options)
    if not of_frames:
        output = naming.fill(settings.storing.output, low, low_suffix=settings.storing.low_suffix)
        yield from map_names.planned_files(settings.stored(output=output))
    for frame in of_frames:
        yield from map_names.planned_files(map_names.of_frame(map_names.with_low_name(settings, low), frame))


_UNKNOWN = re.compile(f"({'|'.join(map(re.escape, (naming.LOW, naming.NAME, naming.MATERIAL, udim.TOKEN)))})")
"""What stands for a name or number in a planned path. A group, so that splitting keeps it."""
_OF_RUN = "the run"
"""By whom the files of the run itself are written, where it is not a bake."""


class RunFiles:
    """The files of all bakes of one call."""

    def __init__(
        self,
        open_file: str = "",
        bounds: Bounds | None = None,
        inputs: InputFiles | None = None,
        of_record: Callable[[argparse.Namespace], Iterable[tuple[str, str]]] | None = None,
    ):
        """open_file: the path of the open .blend, which bakes without a file use. bounds: folders that all bakes keep to.
        inputs: what is known of files to read. of_record: the files of a bake's record, and what they are, if bakes have one.
        """
        self._open_file, self.bounds, self._inputs = open_file, bounds, inputs or InputFiles()
        self._of_record = of_record
        self.places = Places()
        self._maps: dict[str, list[str]] = {}
        """The files of the maps of the bakes whose maps are in `places`."""
        self._beside: dict[str, list[str]] = {}
        """The files beside those for engines, by bakes."""
        self.refused: dict[str, str] = {}
        """A sentence for each bake that must not be done, as its files refer to one that the run itself writes. So no input
        decides what becomes of other bakes."""
        self.rivals: dict[str, list[str]] = {}
        """The bakes of the same scene, by the name of a bake that would replace an image that the scene names. Only the open
        scene shows whether one of them reads it."""

    def add(
        self,
        bakes: Sequence[tuple[str, argparse.Namespace]],
        jobs: str | None = None,
        report: str | None = None,
        folders: Iterable[str] = (),
        sheet: str | None = None,
    ) -> list[str]:
        """Add bakes. Returns a sentence for each bake that would overwrite a file, or lose one.

        bakes: unique names and options. jobs: the job file. report: the report of all bakes. folders: of mesh files.
        sheet: the page of results.
        """
        problems = []

        def check(name: str, act: Callable, *more) -> None:
            try:
                act(*more)
            except WrongPlace as problem:
                problems.append(f"{name}: {problem}" if name else str(problem))

        if jobs:
            check("", self.places.read, jobs, "the job file")
        for path in (path for folder in dict.fromkeys(folders) for path in _meshes_in(folder)):
            check("", self._read_file, path, "a mesh in the folder")
        for name, options in bakes:
            check(name, self._read, name, options)
        self._write_of_run(bakes, report, sheet, check)
        for name, path, title, by in self._referred(bakes, report):
            if self._is_of_run(path):
                self._refuse(name, path, title)
            else:
                check(name, self._read_file, path, title, by)
        for name, options in bakes:
            check(name, self._write, name, options)
        for image, name, blend, title in self._images_to_replace(bakes):
            problems.append(f"{name}: {title[:1].upper()}{title[1:]} would overwrite {image!r}, which {blend!r} shows.")
        return problems

    def _write_of_run(
        self,
        bakes: Sequence[tuple[str, argparse.Namespace]],
        report: str | None,
        sheet: str | None,
        check: Callable[..., None],
    ) -> None:
        """Add the files of the run itself: its report, its page and the records of its bakes."""
        if report and report != STDOUT:
            check("", self._write_over, run_report.check_report, report, "the report of all bakes")
            check("", self.places.write, report + LINES, "the report in progress", _OF_RUN)
        if sheet:
            check("", self._write_over, run_report.check_page, sheet, "the page of results")
        for name, options in bakes if self._of_record else ():
            for path, what in self._of_record(options):
                check(name, self.places.write, path, _of(what, name), _OF_RUN)

    def _is_of_run(self, path: str) -> bool:
        return any(by == _OF_RUN for _, by in self.places.written_by(path))

    def _refuse(self, name: str, path: str, title: str) -> None:
        try:
            self.places.read(path, title, name)
        except WrongPlace as problem:
            self.refused.setdefault(name, str(problem))

    def _referred(
        self, bakes: Sequence[tuple[str, argparse.Namespace]], report: str | None
    ) -> Iterator[tuple[str, str, str, Hashable]]:
        """The files that those of the bakes refer to, as far as they are known before: the bake, the path, what it is, and by
        whom it is read."""
        for name, options in bakes:
            for path in plans.scene_paths(options, self._open_file):
                title = _of(f"what {os.path.basename(path)!r} refers to", name)
                yield from ((name, other, title, (name, "")) for other in self._inputs.references(path))
        for path, name in _libraries(bakes, report, is_untrusted=self.bounds is not None):
            yield name, path, _of("a linked library", name), name

    def _images_to_replace(
        self, bakes: Sequence[tuple[str, argparse.Namespace]]
    ) -> Iterator[tuple[str, str, str, str]]:
        """The images that a .blend names and a bake of another file would replace: the path, the first bake of the .blend, it,
        and what would replace it. Fills `rivals`.

        A bake finds the images that it reads once its file is open; by then another one can have replaced them. That is
        possible only if a map is there already. Else no file is read here.
        """
        by_blend: dict[str, list[str]] = {}
        for name, options in bakes if len(bakes) > 1 else ():
            for path in plans.scene_paths(options):
                if path.lower().endswith(".blend"):
                    by_blend.setdefault(os.path.realpath(path), []).append(name)
        if not by_blend or not any(map(_is_there, self._all_written(bakes))):
            return
        for blend, names in by_blend.items():
            for image in _images_of(blend):
                for title, by in self.places.written_by(image):
                    if by not in names:
                        yield image, names[0], blend, title
                    elif len(names) > 1:
                        self.rivals[by] = [name for name in names if name != by]

    def _all_written(self, bakes: Sequence[tuple[str, argparse.Namespace]]) -> Iterator[str]:
        """The files of all bakes as far as their names are known."""
        for name, options in bakes:
            yield from self.outputs(name, options)

    def outputs(self, name: str, options: argparse.Namespace) -> list[str]:
        """The files that a bake writes. LOW and tokens stand for what is only known once its files are open."""
        paths = list(self._maps.get(name, ()))
        low = low_of(options) or naming.LOW if options.export or not paths else ""
        if not paths:
            paths = [path for path, _ in map_files(options, low, plans.frames(options))]
        if options.export:
            paths.append(naming.fill(options.export, low, low_suffix=arguments.low_suffix(options)))
        paths += filter(None, (options.save_blend, options.report if options.report != STDOUT else None))
        return paths

    def unplanned(self, name: str, options: argparse.Namespace, paths: Iterable[str]) -> list[str]:
        """Those of `paths` to which a bake may not have written. Links count as the files that they lead to."""
        planned = {os.path.realpath(path) for path in (*self.outputs(name, options), *self._beside.get(name, ()))}
        patterns = [_pattern(path) for path in planned if _UNKNOWN.search(path)]
        real = {path: os.path.realpath(path) for path in paths}
        return [
            path
            for path, own in real.items()
            if own not in planned and not any(pattern.fullmatch(own) for pattern in patterns)
        ]

    def opened(
        self, name: str, options: argparse.Namespace, lows: Sequence[str], used: Iterable[tuple[str, str]]
    ) -> None:
        """Add what is only known once the files of a bake are open. lows: the names of its low objects. used: the files that
        the open scene uses, and what they are.

        Raises WrongPlace if a file would be overwritten.
        """
        for path, what in used:
            self._read_file(path, _of(what, name), name)
        if name not in self._maps:
            self._write_maps(name, options, lows)

    def exported(self, name: str, path: str) -> None:
        """Add a file beside the file for an engine, whose name is only known once that is made. Raises WrongPlace."""
        self._write_file(path, _of("a texture of the file for an engine", name), name)
        self._beside.setdefault(name, []).append(path)

    def _read(self, name: str, options: argparse.Namespace) -> None:
        for path, what in plans.input_paths(options, self._open_file):  # the saved scene may replace the first one
            self._read_file(path, _of(what, name), (name, "scene" if what == plans.OPENED_FILE else ""))

    def _read_file(self, path: str, title: str, by: Hashable = None) -> None:
        if self.bounds is not None:
            self.bounds.check_read(path, title)
        self.places.read(path, title, by)

    def _write_file(self, path: str, title: str, by: Hashable, *, may_replace: Hashable = None) -> None:
        if self.bounds is not None:
            self.bounds.check_write(path, title)
        self.places.write(path, title, by, may_replace=may_replace)

    def _write_over(self, check: Callable[[str, str], None], path: str, title: str) -> None:
        """Add a file of the whole call, of which `check` says whether it may replace what is there. Raises WrongPlace."""
        self.places.write(path, title, _OF_RUN)
        check(path, title)

    def _write(self, name: str, options: argparse.Namespace) -> None:
        if self.bounds is not None:  # also those whose names are only known once the files are open
            named = (options.output, options.export, options.save_blend)  # a link before .. is followed or not
            for path in (*filter(None, named), *self.outputs(name, options)):
                self.bounds.check_write(path, _of("a file", name))
        if low := low_of(options):
            self._write_maps(name, options, [low])
        if options.report and options.report != STDOUT:
            self._write_file(options.report, _of("the report", name), name)
            run_report.check_report(options.report, _of("the report", name))
        if options.save_blend:
            own = (name, "scene") if len(options.file) < 2 else None
            self._write_file(options.save_blend, _of("the scene to save", name), name, may_replace=own)

    def _write_maps(self, name: str, options: argparse.Namespace, lows: Sequence[str]) -> None:
        several = len(lows) > 1
        files = [(low, list(map_files(options, low, plans.frames(options)))) for low in lows]
        self._maps[name] = [path for _, maps in files for path, _ in maps]
        for low, maps in files:
            for path, what in maps:
                self._write_file(path, _of(f"{what} of {low!r}" if several else what, name), name)
        suffix = arguments.low_suffix(options)
        exports = (naming.fill(options.export, low, low_suffix=suffix) for low in lows) if options.export else ()
        for path in dict.fromkeys(exports):
            self._write_file(path, _of("the file for an engine", name), name)


def low_of(options: argparse.Namespace) -> str:
    """The name that replaces LOW in the names of files; "" if it is only known once the files are open, as those of levels
    and assets."""
    if (options.levels or options.asset) and naming.has_low(f"{options.output}{options.export}"):
        return ""
    low = arguments.only_low(options) or (plans.stem(options.low_file) if options.low_file else "")
    return low or ("" if naming.has_low(options.output) else ATLAS)


def _pattern(path: str) -> re.Pattern:
    """Matches the paths that a planned one stands for."""
    parts = _UNKNOWN.split(path)
    return re.compile("".join(r"[^/\\]+" if at % 2 else re.escape(part) for at, part in enumerate(parts)))


def _of(what: str, name: str) -> str:
    return f"{what} of {name}" if name else what


def _libraries(
    bakes: Sequence[tuple[str, argparse.Namespace]], report: str | None, *, is_untrusted: bool
) -> Iterator[tuple[str, str]]:
    """The libraries of all files to open, with the first bake that opens each.

    A bake finds its own libraries once its file is open; by then only another bake can have replaced them. That is possible
    only if an existing .blend is to be written. Else no file is read here, since the search reads all of each file, unless
    the files are not trusted.
    """
    written = [report, *(path for _, options in bakes for path in (options.report, options.save_blend))]
    real = (os.path.realpath(path) for path in written if path)
    if not is_untrusted and (
        len(bakes) < 2 or not any(path.endswith(".blend") and os.path.exists(path) for path in real)
    ):
        return
    seen = set()
    for name, options in bakes:
        for path in plans.scene_paths(options):
            if path not in seen and path.endswith(".blend"):
                seen.add(path)
                yield from ((str(library), name) for library in blend_files.libraries(Path(path)))


def _images_of(blend: str) -> list[str]:
    """The images that a .blend and the libraries that it links name."""
    return [image for path in (Path(blend), *blend_files.libraries(Path(blend))) for image in blend_files.images(path)]


def _is_there(path: str) -> bool:
    """Whether a file exists, or one of its tiles."""
    return bool(udim.files(path)) if udim.is_tiled(path) else os.path.exists(path)


def _meshes_in(folder: str) -> list[str]:
    try:
        names = os.listdir(folder)
    except OSError:  # the bake will report it
        return []
    return [os.path.join(folder, name) for name in names if name.lower().endswith(OPENED)]


def plan_call(
    options: RunOptions, sets: Sequence[argparse.Namespace], inputs: InputFiles
) -> tuple[list[Plan], list[str], RunFiles, list[str]]:
    """The bakes, sentences about unpaired files, the files of all bakes, and a sentence for each bake that would harm a file.

    sets: the options of each set. inputs: as in RunFiles. Raises WrongPlace for folders that an
    untrusted call cannot use.
    """
    open_file, within = plans.open_file(), untrusted.bounds_of(options, sets[0])
    if within is not None:
        within.check_sets(sets)
    warnings: list[str] = []
    if options.may_have_many:
        planned, warnings = plans.plans_of(sets, open_file)
    elif options.has_table:
        own = copy(sets[0])
        own.report = None  # it is that of the call
        planned = [Plan(plans.subject(own, open_file), own)]
    else:
        planned = [Plan("", sets[0])]
    of_record = partial(record_files, records=options.records) if options.has_records else None
    files = RunFiles(open_file, within, inputs, of_record)
    harmed = files.add(
        [(each.name, each.options) for each in planned],
        options.jobs,
        options.report if options.has_table else None,
        [own.pairs for own in sets if arguments.is_folder(own)],
        options.sheet,
    )
    if files.refused and not options.has_table:
        harmed = [*harmed, *files.refused.values()]
    elif files.refused:
        planned = [replace(each, problem=each.problem or files.refused.get(each.name, "")) for each in planned]
    options_of = {each.name: each.options for each in planned} if files.rivals else {}
    for place, each in enumerate(planned if files.rivals else ()):
        rivals = tuple(options_of[name] for name in files.rivals.get(each.name, ()))
        planned[place] = replace(each, rivals=rivals)
    return planned, warnings, files, harmed
