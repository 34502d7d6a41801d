# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs many bakes, in processes of their own or in this one, and reports the result of each."""

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..core.errors import BakeError, WrongPlace, reason
from ..core.naming import printable
from ..core.progress import Progress, startup
from ..output.atomic_file import check_folder, make_folder
from . import clashes, plans, sheet, terminal
from .blender_process import load_blender
from .claims import Claims
from .options import RunOptions
from .plans import Plan
from .run_report import STDOUT, Entry, ReportFile, State, Totals, as_text, document, report_path
from .sheet import SheetFile
from .terminal import Meter
from .untrusted import MOST_SECONDS, Bounds, Sandbox, most_memory
from .work_queue import ResumeQueue, ThreadedQueue, WorkQueue
from .worker_pool import WorkerPool


def run(
    options: RunOptions,
    chosen: Sequence[Plan],
    head: dict[str, Any],
    files: clashes.RunFiles,
    meter: Meter,
    *,
    may_start_processes: bool,
) -> int:
    """Do bakes, print a table, and write the report of all bakes. Returns the exit code.

    Raises BakeError, and WrongPlace if no logs or pictures can be written, and if untrusted files have no sandbox.

    Args:
        chosen: The bakes of this call.
        head: What the report has before its bakes, as run_report.head returns it.
        files: Must have all plans of the job.
        may_start_processes: Whether bakes may have processes of their own.
    """
    _prepare_folder("--log", options.log)
    _prepare_folder("--pictures", options.pictures)
    if options.untrusted:
        limits = {"timeout": options.timeout or MOST_SECONDS, "max_memory": options.max_memory or most_memory()}
        options = replace(options, **limits)
    box = closing(Sandbox(files.bounds, options.max_memory, options.log)) if files.bounds else nullcontext()
    with box as sandbox:
        meter.planned(head["planned"], len(chosen), options.part)
        results = _Results(options, chosen, head, meter)
        return _run(results, files, sandbox, has_workers=bool(sandbox) or (may_start_processes and options.has_workers))


def _run(results: "_Results", files: clashes.RunFiles, sandbox: Sandbox | None, *, has_workers: bool) -> int:
    """As `run`, once the folders are made. Raises BakeError."""
    options, meter = results.options, results.meter
    with (
        results,
        _queue(options, results.chosen, files.bounds, meter, is_here=not has_workers) as queue,
        ExitStack() as held,
    ):
        meter.clear()
        for entry in queue.done:
            results.add(entry)
        source: Iterable[Entry] = ()
        if queue.count and has_workers:
            source = held.enter_context(WorkerPool(options, sandbox)).bake_all(queue, files, meter)
        elif queue.count:
            source = _bake_here(queue, files, meter, options)
        for entry in source:
            meter.clear()
            queue.release(entry.number)
            results.add(entry)
        meter.clear()
        results.finish()
        return results.totals.exit_code


def _prepare_folder(option: str, folder: str | None) -> None:
    """Make the folder that `option` names, if it does. Raises WrongPlace unless files can be written there."""
    if not folder:
        return
    try:
        make_folder(Path(folder).absolute())
        check_folder(Path(folder))
    except OSError as error:
        raise WrongPlace(f"{option}: no files can be written to {folder!r}: {reason(error)}.") from error


def _queue(
    options: RunOptions, chosen: Sequence[Plan], bounds: Bounds | None, meter: Meter, *, is_here: bool
) -> WorkQueue | ThreadedQueue:
    """The bakes, without those that are done if the options say so. bounds: the folders of files that are not trusted.
    is_here: whether this process does them."""
    if not options.has_records:
        return WorkQueue(chosen)
    of_run = {"is_forced": options.force, "records": options.records, "bounds": bounds}
    of_run |= {"pictures": options.pictures, "open_file": plans.open_file()}
    shares, name = [0.0], options.jobs or options.folder or options.program

    def make(check: Callable[[], None]) -> WorkQueue:
        claims = Claims(is_busy=is_here)
        return ResumeQueue(chosen, claims=claims, check=check, on_share=shares.append, **of_run)

    return ThreadedQueue(make, lambda: meter.show(name, Progress("Comparing with records", shares[-1])))


def _bake_here(queue: WorkQueue, files: clashes.RunFiles, meter: Meter, options: RunOptions) -> Iterator[Entry]:
    load_blender()
    with startup.spent("imprint"):
        from . import baker  # needs Blender

    yield from baker.bake_all(queue, files, meter, options)


class _Results:
    """The results so far: their lines on the terminal, and their entries in the report."""

    def __init__(
        self,
        options: RunOptions,
        chosen: Sequence[Plan],
        head: dict[str, Any],
        meter: Meter,
    ):
        """As in `run`. Raises BakeError if the report cannot be written."""
        self.options, self.chosen, self.head, self.meter = options, chosen, head, meter
        self._out = terminal.out(options)
        self._width = max((len(plan.name) for plan in chosen), default=0)
        path = report_path(options.report)
        self._file = ReportFile(path, head) if path else None
        self._sheet = SheetFile(Path(options.sheet).absolute(), head) if options.sheet else None
        self._entries: list[Entry] = []
        """Those for a report on standard output."""
        self._lines: list[tuple[int, str]] = []
        """The number of each bake, and its line of the table."""
        self.totals = Totals()
        self._is_written = False

    def __enter__(self) -> "_Results":
        return self

    def __exit__(self, _type: object, error: BaseException | None, _traceback: object) -> None:
        """Close the files. If Blender does not start, they tell of the bakes before, and what an earlier call wrote is gone."""
        if isinstance(error, BakeError) and not self._is_written:
            with suppress(BakeError):
                self._write()
        for file in filter(None, (self._file, self._sheet)):
            file.close()

    def add(self, entry: Entry) -> None:
        """Print the result of a bake, and add it to the report."""
        if entry.state == State.FAILED:
            self._print(entry, entry.error)
        if self.options.pictures:
            self._keep_picture(entry)
        for warning in () if self.meter.is_quiet else entry.warnings:
            self._print(entry, f"warning: {warning}")
        for text in entry.gate:
            self._print(entry, text)
        for line in terminal.saved(entry):
            print(line, file=self._out, flush=True)
        self.meter.ended(entry)
        self.totals.add(entry)
        self._lines.append((entry.number, terminal.line(entry, self._width)))
        if not entry.is_listed:
            return
        if self._sheet:
            self._sheet.add(entry)
        if self._file:
            self._file.add(entry)
        elif self.options.report:
            self._entries.append(replace(entry, image=b""))

    def _keep_picture(self, entry: Entry) -> None:
        try:
            sheet.keep_picture(self.options.pictures, entry)
        except BakeError as error:
            entry.warnings.append(str(error))

    def _print(self, entry: Entry, text: str) -> None:
        print(printable(f"{self.options.program}: {entry.name}: {text}"), file=sys.stderr)

    def finish(self) -> None:
        """Print the table, and write the report. Raises BakeError."""
        counted = self.totals.to_dict()
        finished = len(self._lines) - counted[State.STOPPED]
        wanted, program = len(self.chosen), self.options.program
        if finished < wanted:
            print(f"{program}: stopped, {finished} of {wanted} were finished.", file=sys.stderr)
        lines = [line for _, line in sorted(self._lines)]
        print("\n".join([*lines, terminal.total(counted, wanted)]), file=self._out)
        if not self._file and self.options.report == STDOUT:
            entries = sorted(self._entries, key=lambda entry: entry.number)
            print(as_text(document(entries, self.head)))
        self._write()

    def _write(self) -> None:
        """Write the report and the page to their files. Raises BakeError."""
        self._is_written = True
        for file in filter(None, (self._file, self._sheet)):
            file.finish()
            print(f"Wrote {file.path}", file=self._out)
