# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs bakes in a pool of worker processes, and replaces workers that fail."""

import math
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any

from ..core import processes
from ..core.errors import BakeError, NoGpu, WrongPlace, reason
from ..core.processes import Gone
from ..core.progress import Progress
from . import clashes, interruption, records
from .options import RunOptions
from .plans import Plan
from .records import Assignment
from .run_report import Cause, Entry, State
from .terminal import Meter
from .untrusted import Sandbox
from .work_queue import Chains, WorkQueue
from .worker_messages import Accepted, Answer, FilesFound, Line, Percent, Ready, Setup
from .worker_process import Worker

LOOK_EVERY = 0.1
"""Seconds between two checks of signals and limits."""
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


class WorkerPool:
    """Starts workers, gives them bakes, and ends them. Use it in a `with` block."""

    def __init__(self, options: RunOptions, sandbox: Sandbox | None = None):
        """options: of the run. sandbox: of the workers for files that are not trusted."""
        self._options, self._count, self._sandbox = options, options.workers, sandbox
        self._workers: list[Worker] = []
        self._messages: SimpleQueue[tuple[Worker, Any]] = SimpleQueue()
        """What workers have sent."""
        self._chains = Chains()
        self._has_crashed = False
        """Whether a bake has ended its worker."""
        self._starts = 0
        """How many starts have failed in a row, or since a worker that was well has ended."""
        self._returned: list[Assignment] = []
        """Those whose workers have ended before they began."""
        self._sent = 0
        """How many workers have ended so in a row."""
        self._thread, self._gives_up = ThreadPoolExecutor(1, "imprint-checks"), threading.Event()
        self._checks: list[tuple[Plan, str, Future[Entry]]] = []
        """Bakes of untrusted files that have ended, with their logs, while their entries are compared with the disk."""

    def __enter__(self) -> "WorkerPool":
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
            worker.dismiss()  # they end together
        deadline = time.monotonic() + CLOSING
        for worker in self._workers:
            worker.close(max(0.0, deadline - time.monotonic()))

    def _end_all(self) -> None:
        for worker in self._workers:
            worker.ask_to_stop(at_once=True)
        deadline = time.monotonic() + PATIENCE
        for worker in self._workers:
            worker.kill(max(0.0, deadline - time.monotonic()))

    def bake_all(self, queue: WorkQueue, files: clashes.RunFiles, meter: Meter) -> Iterator[Entry]:
        """Do all bakes of the queue, in their order as workers are free. files: must have all plans.

        After a signal, bakes that have begun are asked to stop, and ended if they do not; the last results may be of such.
        Raises NoGpu if Blender does not start.
        """
        count = queue.count
        needs_all = any(item.plan.options.save_blend or item.plan.options.export for item in queue.left)
        setup = Setup(self._options, needs_all, meter.is_on, self._sandbox.folders if self._sandbox else ())
        started, stop_by = 0, math.inf
        ended: list[Entry] = []
        """Results that the caller gets once workers have their next bakes."""
        while queue.count or self._returned or self._checks or any(worker.plan for worker in self._workers):
            if interruption.code() and stop_by == math.inf:
                stop_by = time.monotonic() + LONGEST_STOP
                queue.stop()
                self._returned.clear()
                for worker in self._workers:
                    worker.ask_to_stop()
                continue
            if time.monotonic() > stop_by:
                ended += self._give_up()
                break
            left = queue.count + len(self._returned)
            self._fill(left)
            for worker in self._free():
                if self._returned:
                    worker.begin(setup, self._returned.pop())
                    continue
                if not queue.count:
                    continue
                taken = {each.chain for each in self._workers if each is not worker and each.chain}
                taken |= {plan.chain for plan, _, _ in self._checks if plan.chain}
                item = queue.next(taken)
                if item is None:  # others do what is left, or files are still read
                    continue
                started += 1
                if isinstance(item, Entry):
                    ended.append(item)
                    continue
                if refusal := self._chains.refusal(item.plan):
                    ended.append(refusal)
                    continue
                meter.begin(item.plan, f"{started}/{count} ")
                worker.begin(setup, item)
            while ended:
                yield ended.pop(0)
            try:
                ended += self._checked()
                ended += self._receive(files, meter)
                ended += self._check_limits()
            except NoGpu:
                yield from ended
                raise
        yield from ended

    def _give_up(self) -> Iterator[Entry]:
        """End all workers, and their bakes, which did not stop."""
        self._end_all()
        error = f"It was stopped: its process was killed because it did not stop within {LONGEST_STOP:g} s."
        for worker in [worker for worker in self._workers if worker.plan]:
            yield self._end(worker, error, state=State.STOPPED)
        for plan, log, _ in self._checks:
            yield Entry(plan.number, plan.name, State.STOPPED, "It was stopped.", log=log)

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
        if not all(worker.plan and worker.is_ready for worker in self._workers):
            return False
        late = time.monotonic() - (self._options.timeout or math.inf) / 2
        return self._has_crashed or any(worker.assigned_at < late for worker in self._workers)

    def _free(self) -> list[Worker]:
        """Workers that can begin a bake, so that no more than `count` bake at once. Those that began others come first."""
        free = [worker for worker in self._workers if worker.plan is None and worker.is_ready]
        return free[: self._count - sum(1 for worker in self._workers if worker.plan)]

    def _start(self) -> None:
        try:
            self._workers.append(Worker(self._messages, self._sandbox))
        except OSError as error:
            self._starts += 1
            if not self._workers:
                raise BakeError(f"A process to bake in could not be started: {reason(error)}.") from error

    def _receive(self, files: clashes.RunFiles, meter: Meter) -> Iterator[Entry]:
        """Handle the messages that have arrived, waiting a moment for one."""
        timeout = LOOK_EVERY
        with suppress(Empty):
            for _ in range(len(self._workers)):  # so that signals and limits are checked, however much is sent
                worker, message = self._messages.get(timeout=timeout)
                timeout = 0.0
                if worker in self._workers:
                    yield from self._handle(worker, message, files, meter)

    def _handle(self, worker: Worker, message: Any, files: clashes.RunFiles, meter: Meter) -> Iterator[Entry]:
        answer = None
        match message:
            case Gone():
                yield from self._handle_exit(worker, message.why)
            case Ready() if not worker.is_ready:
                worker.is_ready, worker.bakes_left = True, message.most_bakes or -1
                return  # a bake is the answer
            case Accepted():
                worker.has_accepted = worker.is_well = True
                self._sent = self._starts = 0
            case Percent():
                if meter.is_on:
                    meter.show(message.subject, Progress(message.what, message.done), worker.plan)
            case Line():
                meter.report(message.line)
            case _ if worker.plan is None:
                pass  # a file that took the worker over may send what it likes
            case FilesFound():
                answer = Answer(_problem(files, worker.plan, message))
            case Entry():
                yield from self._finish(worker, message, files)
                return  # the next bake is the answer
        worker.answer(answer)

    def _finish(self, worker: Worker, entry: Entry, files: clashes.RunFiles) -> Iterator[Entry]:
        """A bake has ended. Its worker goes on unless it has grown too large, or has done all that it may do."""
        assigned, log = worker.assigned, worker.log
        worker.assigned = None
        worker.bakes_left -= 1
        is_large = self._options.max_memory and worker.memory > self._options.max_memory
        if is_large or entry.cause == Cause.MEMORY:
            self._has_crashed = True
            self._remove(worker)
        elif worker.bakes_left == 0:
            self._remove(worker)
        plan = assigned.plan
        if self._sandbox is None:
            yield self._ended(plan, entry, log)
            return
        check = partial(
            records.check_untrusted,
            assigned,
            entry,
            self._sandbox.bounds,
            partial(files.unplanned, plan.name, plan.options),
            is_pictured=bool(self._options.pictures),
            check=self._check_reading,
        )
        self._checks.append((plan, log, self._thread.submit(check)))

    def _check_reading(self) -> None:
        if self._gives_up.is_set():
            raise interruption.Stopped

    def _checked(self) -> Iterator[Entry]:
        """The entries that were compared with the disk, in a thread."""
        for each in [each for each in self._checks if each[2].done()]:
            self._checks.remove(each)
            plan, log, entry = each
            yield self._ended(plan, entry.result(), log)

    def _ended(self, plan: Plan, entry: Entry, log: str) -> Entry:
        entry.log = log
        self._chains.ended(plan, entry)
        return entry

    def _handle_exit(self, worker: Worker, why: str = "") -> Iterator[Entry]:
        """A worker has ended by itself, or its messages are wrong. why: a sentence for that, else empty."""
        if why:
            worker.kill()
        ending = worker.end()
        printed, where = worker.last_printed(), worker.crash_output()
        self._remove(worker)
        if worker.plan is None:
            if not worker.is_well:
                line = processes.last_line(printed)
                what = "ends here before it bakes" if worker.is_ready else "does not start here"
                self._count_start(f"{why or ending.text}{f', {line!r}' if line else ''}", what)
            return
        if not worker.has_accepted and self._sent < MOST_SENT - 1:
            self._sent += 1
            if not interruption.code():
                self._returned.append(worker.assigned)
            return
        if why:
            error, cause = why, Cause.CRASH
        elif ending.lacked_memory:
            error, cause = "Memory ran out, and the system ended the bake.", Cause.MEMORY
        else:
            error, cause = f"Blender crashed with {ending.text}{where}.", Cause.CRASH
        yield self._crashed(worker, error, cause, ending.signal)

    def _count_start(self, end: str, what: str = "does not start here") -> None:
        """A worker has ended before it received a bake. Raises NoGpu if too many have, and Blender has started in no other."""
        self._starts += 1
        if self._starts >= MOST_STARTS and not any(worker.is_ready for worker in self._workers):
            raise NoGpu(f"Blender {what}: {end}.")

    def _check_limits(self) -> Iterator[Entry]:
        late = time.monotonic() - LONGEST_START
        for worker in [each for each in self._workers if not each.is_ready and each.started < late]:
            worker.kill()
            self._remove(worker)
            self._count_start(f"it did not start within {LONGEST_START:g} s")
        for worker in [each for each in self._workers if each.is_ready and not each.plan and each.has_ended]:
            yield from self._handle_exit(worker)
        for worker in [each for each in self._workers if each.is_stuck]:
            yield from self._handle_exit(worker, processes.NO_MESSAGE)
        for worker in [worker for worker in self._workers if worker.plan]:
            seconds, memory = self._options.timeout, self._options.max_memory
            if seconds and time.monotonic() - worker.assigned_at > seconds:
                yield self._end(worker, f"It took more than {seconds:g} s, the limit.", Cause.TIMEOUT)
            elif memory and (used := worker.memory) > memory:
                text = f"It took {used / 2**20:,.0f} MiB of memory, more than the limit of {memory / 2**20:,.0f} MiB."
                yield self._end(worker, text, Cause.MEMORY)

    def _remove(self, worker: Worker) -> None:
        self._workers.remove(worker)
        if worker.is_well:  # it is needed again that others start
            self._starts = 0
        worker.close()

    def _end(self, worker: Worker, error: str, cause: Cause = Cause.NONE, state: State = State.FAILED) -> Entry:
        worker.kill()
        self._remove(worker)
        return self._crashed(worker, error, cause, state=state)

    def _crashed(self, worker: Worker, error: str, cause: Cause, by: str = "", *, state: State = State.FAILED) -> Entry:
        """A bake has ended its worker, or with it."""
        self._has_crashed = True
        plan, seconds = worker.plan, time.monotonic() - worker.assigned_at
        entry = Entry(plan.number, plan.name, state, error, cause, by, seconds=seconds)
        return self._ended(plan, entry, worker.log)


def _problem(files: clashes.RunFiles, plan: Plan, message: FilesFound) -> str:
    try:
        if message.export:
            files.exported(plan.name, message.export)
        else:
            files.opened(plan.name, plan.options, message.lows, message.used)
    except WrongPlace as problem:
        return str(problem)
    return ""
