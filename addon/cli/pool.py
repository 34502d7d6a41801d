# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs bakes in a pool of worker processes, and replaces workers that fail."""

import math
import os
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

from ..core.errors import BakeError, NoGpu, WrongPlace
from ..core.progress import Progress
from ..output.atomic_file import reason
from . import clashes, interruption, records, report_file, worker_process
from .bake_result import Done
from .options import RunOptions
from .plans import Plan
from .run_report import Cause, Entry, State
from .terminal import Meter
from .turns import Chains, Resumed, Turns
from .untrusted import Sandbox
from .worker_process import (
    LONGEST_MESSAGE,
    STALLED,
    Answer,
    Assignment,
    Begun,
    FilesFound,
    Line,
    Percent,
    Ready,
    WorkerProcess,
    unpacked,
)


class BusyWorker:
    """A worker process, and the bake that it has. Raises OSError if the process cannot be started."""

    def __init__(self, sandbox: Sandbox | None = None):
        """sandbox: as in WorkerProcess."""
        self.process = WorkerProcess(sandbox)
        self.started = time.monotonic()
        self.assigned: Assignment | None = None
        """Its bake."""
        self.has_begun = False
        """Whether it has received that."""
        self.is_well = False
        """Whether it has received any bake: one may end after Blender has started, and before that."""
        self.chain = 0
        """The chain of its last bake, whose scene is open in it."""
        self.begun = 0.0
        """When its bake began, by time.monotonic."""
        self._printed = 0
        """The bytes that it had printed by then."""

    @property
    def plan(self) -> Plan | None:
        return self.assigned and self.assigned.plan

    @property
    def log(self) -> str:
        """The file that has what its bake prints, or ""."""
        return self.assigned.log if self.assigned and os.path.exists(self.assigned.log) else ""

    def begin(self, assigned: Assignment) -> None:
        """Send it a bake. One whose files are not trusted writes no record."""
        self.assigned, self.has_begun, self.chain = assigned, False, assigned.plan.chain
        self._printed = self.process.printed
        self.begun = time.monotonic()
        self.process.send(replace(assigned, draft=None) if assigned.folders else assigned)

    def last_words(self) -> str:
        """The clause of last_words about its bake."""
        if self.log:
            return worker_process.crash_output_of_log(self.log)
        return worker_process.crash_output(self.process.last_printed(self._printed))


def log_path(folder: str | None, plan: Plan) -> str:
    """The absolute path of a bake's log; empty without a folder."""
    return str(Path(folder).absolute() / f"{plan.number:06}_{report_file.plain_name(plan.name)}.log") if folder else ""


LOOK_EVERY = 0.1
"""Seconds between two checks of signals and limits."""
SEND_EVERY = 0.01
"""Seconds between two tries to send what a worker has not taken."""
LONGEST_STOP = 5.0
"""Seconds for bakes to stop after a signal, before their processes are ended as by a second one."""
PATIENCE = 2.0
"""Seconds for workers to end after a second signal, before they are killed. The launcher waits longer, and so do farms after
the first one: containers 10 seconds, Slurm and Kubernetes 30."""
CLOSING = 5.0
"""Seconds for workers without a bake to end when all is done."""
MOST_STARTS = 3
"""So many workers may end one after the other before they received a bake, as where Blender does not start."""
LONGEST_START = 300.0
"""Seconds after which a worker counts as one that has ended before Blender has started."""
MOST_SENT = 3
"""So many workers may end one after the other before they begin the same bake."""


class Supervisor:
    """Starts workers, gives them bakes, and ends them. Use it in a `with` block."""

    def __init__(self, options: RunOptions, sandbox: Sandbox | None = None):
        """options: of the run. sandbox: of the workers for files that are not trusted."""
        self._options, self._count, self._sandbox = options, options.workers, sandbox
        self._workers: list[BusyWorker] = []
        self._chains = Chains()
        self._has_lost = False
        """Whether a bake has ended its worker."""
        self._starts = 0
        """How many starts have failed in a row, or since a worker that was well has ended."""
        self._returned: list[Assignment] = []
        """Those whose workers have ended before they began."""
        self._sent = 0
        """How many workers have ended so in a row."""
        self._thread, self._gives_up = ThreadPoolExecutor(1, "imprint-compares"), threading.Event()
        self._compared: list[tuple[Plan, str, Future[Done]]] = []
        """Bakes of untrusted files that have ended, with their logs, while what their processes said is compared."""

    def __enter__(self) -> "Supervisor":
        with ExitStack() as held:
            held.enter_context(interruption.before_end(self._end_all))
            self._start()  # Blender starts while this process reads and checks
            self._held = held.pop_all()
        return self

    def __exit__(self, *_) -> None:
        self._held.close()
        self._gives_up.set()
        self._thread.shutdown()
        for worker in self._workers:
            worker.process.channel.close()  # they end at once, together
        deadline = time.monotonic() + CLOSING
        for worker in self._workers:
            worker.process.close(max(0.0, deadline - time.monotonic()))

    def _end_all(self) -> None:
        for worker in self._workers:
            worker.process.ask_to_stop(at_once=True)
        deadline = time.monotonic() + PATIENCE
        for worker in self._workers:
            worker.process.kill(max(0.0, deadline - time.monotonic()))

    def bake_all(self, turns: Turns, files: clashes.RunFiles, meter: Meter) -> Iterator[Done]:
        """Do all that is left of `turns`, in their order as workers are free. files: must have all plans.

        After a signal, bakes that have begun are asked to stop, and ended if they do not; the last results may be of such.
        Raises NoGpu if Blender does not start.
        """
        count = turns.count
        needs_all = any(turn.plan.options.save_blend or turn.plan.options.export for turn in turns.left)
        folders = self._sandbox.folders if self._sandbox else ()
        begun, stop_by = 0, math.inf
        ended: list[Done] = []
        """Results that the caller gets once workers have their next bakes."""
        while turns.count or self._returned or self._compared or any(worker.plan for worker in self._workers):
            if interruption.code() and stop_by == math.inf:
                stop_by = time.monotonic() + LONGEST_STOP
                turns.stop()
                self._returned.clear()
                for worker in self._workers:
                    worker.process.ask_to_stop()
                continue
            if time.monotonic() > stop_by:
                ended += self._give_up()
                break
            left = turns.count + len(self._returned)
            self._fill(left)
            for worker in self._free():
                if self._returned:
                    worker.begin(self._returned.pop())
                    continue
                if not turns.count:
                    continue
                taken = {each.chain for each in self._workers if each is not worker and each.chain}
                taken |= {plan.chain for plan, _, _ in self._compared if plan.chain}
                turn = turns.next(taken)
                if turn is None:  # others do what is left, or files are still read
                    continue
                begun += 1
                if isinstance(turn, Resumed):
                    ended.append(Done.resumed(turn.plan, turn.result))
                    continue
                if refusal := self._chains.refusal(turn.plan):
                    ended.append(Done.of(refusal, turn.plan.number))
                    continue
                meter.begin(turn.plan, f"{begun}/{count} ")
                log = log_path(self._options.log, turn.plan)
                worker.begin(Assignment(turn.plan, self._options, needs_all, meter.is_on, folders, log, turn.draft))
            while ended:
                yield ended.pop(0)
            try:
                ended += self._take_compared()
                ended += self._hear(files, meter)
                ended += self._check_limits()
            except NoGpu:
                yield from ended
                raise
        yield from ended

    def _give_up(self) -> Iterator[Done]:
        """End all workers, and their bakes, which did not stop."""
        self._end_all()
        error = f"It was stopped. Its process was ended since it went on for {LONGEST_STOP:g} s."
        for worker in [worker for worker in self._workers if worker.plan]:
            yield self._end(worker, error, state=State.STOPPED)
        for plan, log, _ in self._compared:
            yield Done(Entry(plan.number, plan.name, State.STOPPED, "It was stopped.", log=log))

    def _fill(self, left: int) -> None:
        """Start workers for the bakes that are left, and a spare one if it may be needed."""
        busy = sum(1 for each in self._workers if each.plan)
        while len(self._workers) < min(self._count, left + busy) and (self._starts < MOST_STARTS or not self._workers):
            self._start()
        if left and not self._starts and self._needs_spare():
            self._start()

    def _needs_spare(self) -> bool:
        """Whether a worker may end soon: a crash is often not the only one, and a bake may hang. Meanwhile Blender starts in
        the next one.
        """
        if not all(worker.plan and worker.process.is_ready for worker in self._workers):
            return False
        late = time.monotonic() - (self._options.timeout or math.inf) / 2
        return self._has_lost or any(worker.begun < late for worker in self._workers)

    def _free(self) -> list[BusyWorker]:
        """Workers that can begin a bake, so that no more than `count` bake at once. Those that began others come first."""
        free = [worker for worker in self._workers if worker.plan is None and worker.process.is_ready]
        return free[: self._count - sum(1 for worker in self._workers if worker.plan)]

    def _start(self) -> None:
        try:
            self._workers.append(BusyWorker(self._sandbox))
        except OSError as error:
            self._starts += 1
            if not self._workers:
                raise BakeError(f"A process to bake in could not be started: {reason(error)}.") from error

    def _hear(self, files: clashes.RunFiles, meter: Meter) -> Iterator[Done]:
        """Take the messages of all workers, waiting a moment for one."""
        workers = list(self._workers)
        channels = [worker.process.channel for worker in workers]
        is_sending = any(channel.has_unsent for channel in channels)
        heard = wait([channel.connection for channel in channels], SEND_EVERY if is_sending else LOOK_EVERY)
        for worker in workers:
            try:
                message = self._read(worker, has_more=worker.process.channel.connection in heard)
            except (EOFError, BakeError) as error:
                yield from self._bury(worker, str(error))
                continue
            match message:
                case None:
                    pass  # it has not arrived yet
                case Ready():
                    worker.process.is_ready = True
                case Begun():
                    worker.has_begun = worker.is_well = True
                    self._sent = self._starts = 0
                case Percent():
                    if meter.is_on:
                        meter.show(message.subject, Progress(message.what, message.done), worker.plan)
                case Line():
                    meter.report(message.line)
                case _ if worker.plan is None:
                    pass  # a file that took the worker over may send what it likes
                case FilesFound():
                    worker.process.send(Answer(_problem(files, worker.plan, message)))
                case Done():
                    yield from self._take(worker, message, files)

    def _read(self, worker: BusyWorker, *, has_more: bool) -> Any:
        """The next message of a worker; None as long as it has not arrived. has_more: whether there is something to read.

        Raises EOFError if the worker is gone, and BakeError if its messages are wrong.
        """
        channel, is_trusted = worker.process.channel, self._sandbox is None
        try:
            channel.flush()
            content = channel.receive(None if is_trusted else LONGEST_MESSAGE) if has_more else None
            message = None if content is None else unpacked(content, is_trusted=is_trusted)
        except ConnectionError as error:
            raise EOFError from error
        except OSError as error:
            raise BakeError("Its process sent what is no message.") from error
        if channel.is_stalled:
            raise BakeError(f"Its process stopped for {STALLED:g} s in a message.")
        return message

    def _take(self, worker: BusyWorker, done: Done, files: clashes.RunFiles) -> Iterator[Done]:
        """A bake has ended. Its worker goes on unless it has grown too large."""
        assigned, log, has_failed = worker.assigned, worker.log, done.entry.cause == Cause.MEMORY
        worker.assigned = None
        if has_failed or (self._options.max_memory and worker.process.memory > self._options.max_memory):
            self._has_lost = True
            self._remove(worker)
        if self._sandbox is None:
            yield self._ended(assigned.plan, done, log)
            return
        plan, bounds = assigned.plan, self._sandbox.bounds
        unplanned = partial(files.unplanned, plan.name, plan.options)
        compare = partial(records.finish_untrusted, assigned.draft, plan, done, bounds, unplanned)
        self._compared.append((plan, log, self._thread.submit(compare, check=self._check_reading)))

    def _check_reading(self) -> None:
        if self._gives_up.is_set():
            raise interruption.Stopped

    def _take_compared(self) -> Iterator[Done]:
        """The results that were compared with the disk, in a thread."""
        for each in [each for each in self._compared if each[2].done()]:
            self._compared.remove(each)
            plan, log, done = each
            yield self._ended(plan, done.result(), log)

    def _ended(self, plan: Plan, done: Done, log: str) -> Done:
        done.entry.log = log
        self._chains.ended(plan, done)
        return done

    def _bury(self, worker: BusyWorker, why: str = "") -> Iterator[Done]:
        """A worker has ended by itself, or its messages are wrong. why: a sentence for that, else empty."""
        if why:
            worker.process.kill()
        ending = worker.process.end()
        printed, words = worker.process.last_printed(), worker.last_words()
        self._remove(worker)
        if worker.plan is None:
            if not worker.is_well:
                line = worker_process.last_line(printed)
                what = "ends here before it bakes" if worker.process.is_ready else "does not start here"
                self._count_start(f"{why or ending.text}{f', {line!r}' if line else ''}", what)
            return
        if not worker.has_begun and self._sent < MOST_SENT - 1:
            self._sent += 1
            if not interruption.code():
                self._returned.append(worker.assigned)
            return
        if why:
            error, cause = why, Cause.CRASH
        elif ending.lacked_memory:
            error, cause = "Memory ran out, and the system ended the bake.", Cause.MEMORY
        else:
            error, cause = f"Blender crashed with {ending.text}{words}.", Cause.CRASH
        yield self._lost(worker, error, cause, ending.signal)

    def _count_start(self, end: str, what: str = "does not start here") -> None:
        """A worker has ended before it received a bake. Raises NoGpu if too many have, and Blender has started in no other."""
        self._starts += 1
        if self._starts >= MOST_STARTS and not any(worker.process.is_ready for worker in self._workers):
            raise NoGpu(f"Blender {what}: {end}.")

    def _check_limits(self) -> Iterator[Done]:
        late = time.monotonic() - LONGEST_START
        for worker in [each for each in self._workers if not each.process.is_ready and each.started < late]:
            worker.process.kill()
            self._remove(worker)
            self._count_start(f"it has not begun after {LONGEST_START:g} s")
        for worker in [worker for worker in self._workers if worker.plan]:
            seconds, memory = self._options.timeout, self._options.max_memory
            if seconds and time.monotonic() - worker.begun > seconds:
                yield self._end(worker, f"It took more than {seconds:g} s, the limit.", Cause.TIMEOUT)
            elif memory and (used := worker.process.memory) > memory:
                text = f"It took {used / 2**20:,.0f} MiB of memory, more than the limit of {memory / 2**20:,.0f} MiB."
                yield self._end(worker, text, Cause.MEMORY)

    def _remove(self, worker: BusyWorker) -> None:
        self._workers.remove(worker)
        if worker.is_well:  # it is needed again that others start
            self._starts = 0
        worker.process.close()

    def _end(self, worker: BusyWorker, error: str, cause: Cause = Cause.NONE, state: State = State.FAILED) -> Done:
        worker.process.kill()
        self._remove(worker)
        return self._lost(worker, error, cause, state=state)

    def _lost(self, worker: BusyWorker, error: str, cause: Cause, by: str = "", *, state: State = State.FAILED) -> Done:
        """A bake has ended its worker, or with it."""
        self._has_lost = True
        plan, seconds = worker.plan, time.monotonic() - worker.begun
        done = Done(Entry(plan.number, plan.name, state, error, cause, by, seconds=seconds, log=worker.log))
        self._chains.ended(plan, done)
        return done


def _problem(files: clashes.RunFiles, plan: Plan, found: FilesFound) -> str:
    try:
        if found.export:
            files.exported(plan.name, found.export)
        else:
            files.opened(plan.name, plan.options, found.lows, found.used)
    except WrongPlace as problem:
        return str(problem)
    return ""
