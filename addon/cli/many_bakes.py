# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs many bakes, in processes of their own or in this one, and says what came of each."""

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, nullcontext
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import BakeError, NoGpu, sentence
from ..core.naming import printable
from ..core.progress import Progress
from ..core.timings import startup
from .blender_process import load_blender
from .bounds import Bounds
from .done.claims import Claims
from .done.turns import Resuming, Turns, TurnsAside
from .plan import clashes, plans
from .plan.plans import Plan
from .results import report_file, run_report, sheet, terminal
from .results.bake_result import Done, Wanted
from .results.report_file import ReportFile
from .results.run_report import Entry, Only, State
from .results.sheet import SheetFile
from .results.terminal import Meter
from .sandbox import MOST_SECONDS, Sandbox, most_memory
from .usage import arguments, run_options
from .usage.options import STDOUT
from .workers.pool import Limits, Supervisor


@dataclass(frozen=True)
class Many:
    """The bakes to do, of `planned` in the job file or folder. options: of the run. program: for messages. only: what --only
    chose."""

    chosen: Sequence[Plan]
    planned: int
    options: argparse.Namespace
    program: str
    only: Only | None = None

    @property
    def shard(self) -> str:
        """The part of the bakes, as K/N; empty for all."""
        return "/".join(map(str, self.options.shard or ()))

    @property
    def has_workers(self) -> bool:
        """Whether the bakes want processes of their own. A single one with a record does not, as one without."""
        return bool(self.options.workers) and (
            arguments.are_many(self.options) or run_options.needs_worker(self.options)
        )

    def turns(self, bounds: Bounds | None, meter: Meter, *, is_here: bool) -> Turns:
        """The bakes, without those that are done if the options say so. bounds: the folders of files that are not trusted.
        is_here: whether this process does them."""
        if not run_options.has_records(self.options):
            return Turns(self.chosen)
        of_run = {"is_forced": self.options.force, "records": self.options.records, "bounds": bounds}
        of_run |= {"pictures": self.options.pictures, "open_file": plans.open_file()}
        shares, name = [0.0], self.options.jobs or self.options.pairs or self.program

        def make(check: Callable[[], None]) -> Turns:
            claims = Claims(is_busy=is_here)
            return Resuming(self.chosen, claims=claims, check=check, on_share=shares.append, **of_run)

        return TurnsAside(make, lambda: meter.show(name, Progress("Comparing with records", shares[-1])))


def run(many: Many, files: clashes.RunFiles, meter: Meter, *, may_start_processes: bool) -> int:
    """Do the bakes, print a table, and write the report of all. files: must have all plans. Returns the exit code.

    Raises WrongPlace if no logs or pictures can be written, and if untrusted files have no sandbox.
    """
    options = many.options
    report_file.prepare_folder("--log", options.log)
    report_file.prepare_folder("--pictures", options.pictures)
    limits = _limits(options)
    box = closing(Sandbox(files.bounds, limits.memory, options.log)) if files.bounds else nullcontext()
    with box as sandbox:
        has_workers = bool(sandbox) or (may_start_processes and many.has_workers)
        return _run(many, files, meter, limits, sandbox, has_workers=has_workers)


def _run(
    many: Many, files: clashes.RunFiles, meter: Meter, limits: Limits, sandbox: Sandbox | None, *, has_workers: bool
) -> int:
    """As `run`, once the folders are made."""
    options = many.options
    wanted = Wanted(hashes=bool(options.report or options.pictures), pictures=bool(options.sheet or options.pictures))
    try:
        meter.planned(many.planned, len(many.chosen), many.shard)
        opened = many.turns(files.bounds, meter, is_here=not has_workers)
        with _Found(many, files, meter) as found, opened as turns, ExitStack() as held:
            meter.clear()
            for done in turns.done:
                found.add(Done.resumed(done.plan, done.result))
            source: Iterable[Done] = ()
            if turns.count and has_workers:
                supervisor = held.enter_context(Supervisor(options.workers, limits, sandbox))
                source = supervisor.bake_all(turns, files, meter, wanted)
            elif turns.count:
                source = _bake_here(turns, files, meter, wanted)
            for done in source:
                meter.clear()
                turns.release(done.entry.number)
                found.add(done)
            meter.clear()
            found.finish()
            return found.tally.code
    except (BakeError, MemoryError) as error:
        meter.clear()
        print(f"{many.program}: {sentence(error)}", file=sys.stderr)
        return run_report.NO_MACHINE if isinstance(error, NoGpu | MemoryError) else run_report.FAILED


def _limits(options: argparse.Namespace) -> Limits:
    seconds, memory = (MOST_SECONDS, most_memory()) if options.untrusted else (None, None)
    return Limits(options.timeout or seconds, options.max_memory or memory, options.log)


def _bake_here(turns: Turns, files: clashes.RunFiles, meter: Meter, wanted: Wanted) -> Iterator[Done]:
    load_blender()
    with startup.spent("imprint"):
        from .workers import worker  # needs Blender

    yield from worker.bake_all(turns, files, meter, wanted)


class _Found:
    """The results so far: their lines on the terminal, and their entries in the report."""

    def __init__(self, many: Many, files: clashes.RunFiles, meter: Meter):
        """Raises BakeError if the report cannot be written."""
        self._files = files
        self._meter, self._out = meter, terminal.out(many.options)
        self._many, self._program, self._report = many, many.program, many.options.report
        self._width = max((len(plan.name) for plan in many.chosen), default=0)
        self._path = report_file.report_path(self._report)
        self._file = ReportFile(self._path, many.planned, many.shard, many.only) if self._path else None
        self._sheet = None
        if sheet := many.options.sheet:
            self._sheet = SheetFile(Path(sheet).absolute(), run_report.head(many.planned, many.shard, many.only))
        self._pictures = many.options.pictures
        self._entries: list[Entry] = []
        """Those for a report on standard output."""
        self._lines: list[tuple[int, str]] = []
        """The number of each bake, and its line of the table."""
        self._counted = run_report.summary(())
        self.tally = run_report.Tally()

    def __enter__(self) -> "_Found":
        return self

    def __exit__(self, *_) -> None:
        for file in filter(None, (self._file, self._sheet)):
            file.close()

    def add(self, done: Done) -> None:
        """Tell what came of a bake, and add it to the report."""
        entry = done.entry
        if entry.state == State.FAILED:
            self._say(entry, entry.error)
        for warning in done.warnings:
            if not self._meter.is_quiet:
                self._say(entry, f"warning: {warning}")
        for text in entry.gate:
            self._say(entry, text)
        for line in terminal.saved(entry.maps):
            print(line, file=self._out, flush=True)
        self._meter.ended(entry)
        self.tally.add(entry)
        run_report.count(self._counted, entry)
        self._lines.append((entry.number, terminal.line(entry, self._width)))
        picture = self._keep(done) if self._pictures else done.picture
        if self._files.is_harmful:
            return
        if done.is_listed and self._sheet:
            self._sheet.add(entry, picture)
        if done.is_listed and self._file:
            self._file.add(entry)
        elif done.is_listed and self._report:
            self._entries.append(entry)

    def _keep(self, done: Done) -> bytes:
        try:
            return sheet.keep_picture(self._pictures, done)
        except BakeError as error:
            self._say(done.entry, f"warning: {error}")
            return done.picture

    def _say(self, entry: Entry, text: str) -> None:
        print(printable(f"{self._program}: {entry.name}: {text}"), file=sys.stderr)

    def finish(self) -> None:
        """Print the table, and write the report. Raises BakeError."""
        finished = len(self._lines) - int(self._counted[State.STOPPED])
        wanted = len(self._many.chosen)
        if finished < wanted:
            print(f"{self._program}: stopped, {finished} of {wanted} were finished.", file=sys.stderr)
        lines = [line for _, line in sorted(self._lines)]
        print("\n".join([*lines, terminal.total(self._counted, wanted)]), file=self._out)
        if self._files.is_harmful:
            print(f"{self._program}: no report and no page was written over a file that a bake reads.", file=sys.stderr)
            return
        if self._file:
            self._file.finish()
            print(f"Wrote {self._path}", file=self._out)
        elif self._report == STDOUT:
            many = self._many
            entries = sorted(self._entries, key=lambda entry: entry.number)
            print(report_file.as_text(run_report.document(entries, many.planned, many.shard, many.only)))
        if self._sheet:
            self._sheet.finish()
            print(f"Wrote {self._sheet.path}", file=self._out)
