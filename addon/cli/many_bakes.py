# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs many bakes, in processes of their own or in this one, and reports the result of each."""

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..core.errors import BakeError, NoGpu, sentence
from ..core.naming import printable
from ..core.progress import Progress, startup
from . import clashes, plans, report_file, run_report, sheet, terminal
from .bake_result import Done
from .blender_process import load_blender
from .claims import Claims
from .options import STDOUT, RunOptions
from .plans import Plan
from .pool import Supervisor
from .report_file import ReportFile
from .run_report import Entry, State
from .sheet import SheetFile
from .terminal import Meter
from .turns import Resuming, Turns, TurnsAside
from .untrusted import MOST_SECONDS, Bounds, Sandbox, most_memory


def run(
    options: RunOptions,
    chosen: Sequence[Plan],
    head: dict[str, Any],
    files: clashes.RunFiles,
    meter: Meter,
    *,
    may_start_processes: bool,
) -> int:
    """Do bakes, print a table, and write the report of all. Returns the exit code.

    Raises WrongPlace if no logs or pictures can be written, and if untrusted files have no sandbox.

    Args:
        chosen: The bakes of this call.
        head: What the report has before its bakes, as run_report.head returns it.
        files: Must have all plans of the job.
        may_start_processes: Whether bakes may have processes of their own.
    """
    report_file.prepare_folder("--log", options.log)
    report_file.prepare_folder("--pictures", options.pictures)
    if options.untrusted:
        limits = {"timeout": options.timeout or MOST_SECONDS, "max_memory": options.max_memory or most_memory()}
        options = replace(options, **limits)
    box = closing(Sandbox(files.bounds, options.max_memory, options.log)) if files.bounds else nullcontext()
    with box as sandbox:
        try:
            meter.planned(head["planned"], len(chosen), options.part)
            found = _Found(options, chosen, head, files, meter)
            return _run(found, sandbox, has_workers=bool(sandbox) or (may_start_processes and options.has_workers))
        except (BakeError, MemoryError) as error:
            meter.clear()
            print(f"{options.program}: {sentence(error)}", file=sys.stderr)
            return run_report.NO_MACHINE if isinstance(error, NoGpu | MemoryError) else run_report.FAILED


def _run(found: "_Found", sandbox: Sandbox | None, *, has_workers: bool) -> int:
    """As `run`, once the folders are made. Raises BakeError."""
    options, files, meter = found.options, found.files, found.meter
    with (
        found,
        _turns(options, found.chosen, files.bounds, meter, is_here=not has_workers) as turns,
        ExitStack() as held,
    ):
        meter.clear()
        for done in turns.done:
            found.add(Done.resumed(done.plan, done.result))
        source: Iterable[Done] = ()
        if turns.count and has_workers:
            source = held.enter_context(Supervisor(options, sandbox)).bake_all(turns, files, meter)
        elif turns.count:
            source = _bake_here(turns, files, meter, options)
        for done in source:
            meter.clear()
            turns.release(done.entry.number)
            found.add(done)
        meter.clear()
        found.finish()
        return found.tally.code


def _turns(
    options: RunOptions, chosen: Sequence[Plan], bounds: Bounds | None, meter: Meter, *, is_here: bool
) -> Turns | TurnsAside:
    """The bakes, without those that are done if the options say so. bounds: the folders of files that are not trusted.
    is_here: whether this process does them."""
    if not options.has_records:
        return Turns(chosen)
    of_run = {"is_forced": options.force, "records": options.records, "bounds": bounds}
    of_run |= {"pictures": options.pictures, "open_file": plans.open_file()}
    shares, name = [0.0], options.jobs or options.folder or options.program

    def make(check: Callable[[], None]) -> Turns:
        claims = Claims(is_busy=is_here)
        return Resuming(chosen, claims=claims, check=check, on_share=shares.append, **of_run)

    return TurnsAside(make, lambda: meter.show(name, Progress("Comparing with records", shares[-1])))


def _bake_here(turns: Turns, files: clashes.RunFiles, meter: Meter, options: RunOptions) -> Iterator[Done]:
    load_blender()
    with startup.spent("imprint"):
        from . import worker  # needs Blender

    yield from worker.bake_all(turns, files, meter, options)


class _Found:
    """The results so far: their lines on the terminal, and their entries in the report."""

    def __init__(
        self,
        options: RunOptions,
        chosen: Sequence[Plan],
        head: dict[str, Any],
        files: clashes.RunFiles,
        meter: Meter,
    ):
        """As in `run`. Raises BakeError if the report cannot be written."""
        self.options, self.chosen, self.head, self.files, self.meter = options, chosen, head, files, meter
        self._out = terminal.out(options)
        self._width = max((len(plan.name) for plan in chosen), default=0)
        self._path = report_file.report_path(options.report)
        self._file = ReportFile(self._path, head) if self._path else None
        self._sheet = SheetFile(Path(options.sheet).absolute(), head) if options.sheet else None
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
        """Print the result of a bake, and add it to the report."""
        entry = done.entry
        if entry.state == State.FAILED:
            self._say(entry, entry.error)
        for warning in done.warnings:
            if not self.meter.is_quiet:
                self._say(entry, f"warning: {warning}")
        for text in entry.gate:
            self._say(entry, text)
        for line in terminal.saved(entry.maps):
            print(line, file=self._out, flush=True)
        self.meter.ended(entry)
        self.tally.add(entry)
        run_report.count(self._counted, entry)
        self._lines.append((entry.number, terminal.line(entry, self._width)))
        picture = self._keep(done) if self.options.pictures else done.picture
        if self.files.is_harmful:
            return
        if done.is_listed and self._sheet:
            self._sheet.add(entry, picture)
        if done.is_listed and self._file:
            self._file.add(entry)
        elif done.is_listed and self.options.report:
            self._entries.append(entry)

    def _keep(self, done: Done) -> bytes:
        try:
            return sheet.keep_picture(self.options.pictures, done)
        except BakeError as error:
            self._say(done.entry, f"warning: {error}")
            return done.picture

    def _say(self, entry: Entry, text: str) -> None:
        print(printable(f"{self.options.program}: {entry.name}: {text}"), file=sys.stderr)

    def finish(self) -> None:
        """Print the table, and write the report. Raises BakeError."""
        finished = len(self._lines) - int(self._counted[State.STOPPED])
        wanted, program = len(self.chosen), self.options.program
        if finished < wanted:
            print(f"{program}: stopped, {finished} of {wanted} were finished.", file=sys.stderr)
        lines = [line for _, line in sorted(self._lines)]
        print("\n".join([*lines, terminal.total(self._counted, wanted)]), file=self._out)
        if self.files.is_harmful:
            print(f"{program}: no report and no page was written over a file that a bake reads.", file=sys.stderr)
            return
        if self._file:
            self._file.finish()
            print(f"Wrote {self._path}", file=self._out)
        elif self.options.report == STDOUT:
            entries = sorted(self._entries, key=lambda entry: entry.number)
            print(report_file.as_text(run_report.document(entries, self.head)))
        if self._sheet:
            self._sheet.finish()
            print(f"Wrote {self._sheet.path}", file=self._out)
