# SPDX-License-Identifier: GPL-3.0-or-later
"""The bakes of a run in their order: which still need to run, by their records, and which of them this process has claimed."""

import argparse
import os
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..core import versions
from ..core.errors import BakeError, shorten_list
from . import interruption, limits, plans, records, sheet
from .claims import Claims
from .plans import Plan
from .records import Assignment, Content, Contents, Record
from .run_report import STDOUT, Entry, State
from .untrusted import Bounds


class Chains:
    """The chains of a run in which a bake has failed. Its scene is opened again, without the maps of the bakes before."""

    def __init__(self):
        self._broken: set[int] = set()

    def ended(self, plan: Plan, entry: Entry) -> None:
        """A bake has ended."""
        if plan.chain and entry.state == State.FAILED:
            self._broken.add(plan.chain)

    def refusal(self, plan: Plan) -> Entry | None:
        """The entry of a bake that would save a scene without the maps of earlier ones; None for one that can be done."""
        if plan.chain not in self._broken or not plan.options.save_blend:
            return None
        error = BakeError("An earlier bake of the same scene has failed, so that it would be saved without all maps.")
        return Entry.failed(plan.number, plan.name, error)


def resumed(plan: Plan, before: Entry) -> Entry:
    """The entry of a bake that need not run. before: that of the run that did it, perhaps with other limits."""
    over = limits.over(plan.options.strict, before.reports)
    state = State.GATE if over else State.RESUMED
    return replace(before, number=plan.number, name=plan.name, state=state, gate=over, seconds=0.0, log="")


class WorkQueue:
    """All bakes of a run in their order, without records. Use it in a `with` block.

    This process works off what `next` returns:

        with queue:
            for entry in queue.done: ...
            while queue.count:
                item = queue.next()
                if item is None: wait a moment, since other processes have those that are left
                elif isinstance(item, Entry): ...  # another process has done it
                else: bake, records.finish_record(...) in any process, and queue.release(item.plan.number)
    """

    def __init__(self, planned: Sequence[Plan]):
        self.done: list[Entry] = []
        """The bakes that were done before."""
        self._left = [Assignment(plan, plan.problem) for plan in planned]

    def __enter__(self) -> "WorkQueue":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    @property
    def count(self) -> int:
        """The bakes that `next` has to return, now or later."""
        return len(self._left)

    @property
    def left(self) -> list[Assignment]:
        """These bakes, without their records."""
        return list(self._left)

    def next(self, taken: Collection[int] = ()) -> Assignment | Entry | None:
        """The next bake, which this process has from now on, or one that another process has done.

        taken: chains that wait for another worker of this process. None while others do all that are left.
        """
        for item in self._left:
            if item.plan.chain not in taken:
                self._left.remove(item)
                return item
        return None

    def release(self, number: int) -> None:
        """Let other processes have a bake that was done, or failed. number: of its plan."""

    def stop(self) -> None:
        """Return no more bakes."""
        self._left.clear()

    def close(self) -> None:
        """Let other processes have all bakes. Can be called more than once."""


POLL = 1.0
"""Seconds before claims are looked at again while other processes have all bakes that are left."""
MOST_NAMED = 3
"""Settings that a message names."""


class ResumeQueue(WorkQueue):
    """The bakes of a run that are not done, each as soon as no other process has it."""

    def __init__(
        self,
        planned: Sequence[Plan],
        *,
        is_forced: bool = False,
        open_file: str = "",
        records: str | None = None,
        pictures: str | None = None,
        bounds: Bounds | None = None,
        claims: Claims | None = None,
        clock: Callable[[], float] = time.monotonic,
        check: Callable[[], None] = lambda: None,
        on_share: Callable[[float], None] = lambda _: None,
    ):
        """Compare all bakes with their records. is_forced: all still have to run. open_file: as in plans.plans_of. records:
        as in records.record_path. pictures: the folder of pictures. bounds: the folders of files that are not trusted.
        check: as in Contents. on_share: called with the share of the bakes that are compared.
        """
        super().__init__(())
        self._is_forced, self._open_file, self._records, self._bounds = is_forced, open_file, records, bounds
        self._pictures, self._contents, self._claims = pictures, Contents(check), claims or Claims()
        self._clock, self._ask_at = clock, 0.0
        self._claimed: dict[int, tuple[Path, int]] = {}
        """The claims of this process, by the numbers of plans, and their chains."""
        self._before: dict[str, bytes] = {}
        """The records at the start, by the bakes' names, of a run that does all."""
        self._chains: dict[int, list[Plan]] = {}
        """The plans of each chain, which are done together or not at all."""
        for plan in planned:
            if plan.chain:
                self._chains.setdefault(plan.chain, []).append(plan)
        self._are_done: dict[int, bool] = {}
        """Whether another process has done a chain that this process has claimed."""
        reasons: dict[int, Entry | str] = {}
        for place, plan in enumerate(planned):
            on_share(place / len(planned))
            reasons[plan.number] = plan.problem or self._reason(plan)
        for plan in planned:
            why = reasons[plan.number]
            if any(isinstance(reasons[each.number], str) for each in self._chains.get(plan.chain, ())):
                why = (
                    why if isinstance(why, str) else "Another bake of this scene has to run before the scene is saved."
                )
            if isinstance(why, Entry):
                self.done.append(why)
                self._clear(self._claim_of(plan))
            else:
                self._left.append(Assignment(plan, why))

    def next(self, taken: Collection[int] = ()) -> Assignment | Entry | None:
        if self._clock() < self._ask_at:
            return None
        claimed, others = set(), {*taken}
        for each in self._left:
            if each.plan.chain in others:
                continue
            item = self._item(each.plan, each.why)
            if item is not None:
                self._left.remove(each)
                return item
            claimed.add(each.plan.number)
            others |= {each.plan.chain} - {0}
        if claimed:
            self._ask_at = self._clock() + POLL
        return None

    def release(self, number: int) -> None:
        claim, chain = self._claimed.pop(number, (None, 0))
        others = {each.plan.chain for each in self._left if each.plan.number != number}
        others |= {each for _, each in self._claimed.values()}  # the next one may have begun
        has_more = bool(chain) and chain in others
        if claim is not None and not has_more:
            self._claims.release(claim)

    def close(self) -> None:
        self._claims.close()

    def _clear(self, claim: Path) -> None:
        """Remove the claim of a process that was killed after it had written the record."""
        if claim.exists():
            with suppress(OSError):
                self._claims.take(claim)
            self._claims.release(claim)

    def _item(self, plan: Plan, why: str) -> Assignment | Entry | None:
        if plan.problem:
            return Assignment(plan, why)
        path, claim = self._record_of(plan), self._claim_of(plan)
        if plan.chain not in self._are_done:
            try:
                if not self._claims.take(claim):
                    return None
            except OSError:  # the bake will report that the folder cannot be written to
                return Assignment(plan, why)
        # Another process may have done it between the start of this run and now.
        now = self._reason(plan, is_started=True)
        if plan.chain and plan.chain not in self._are_done:
            members = (self._reason(each, is_started=True) for each in self._chains[plan.chain])
            self._are_done[plan.chain] = all(isinstance(each, Entry) for each in members)
        self._claimed[plan.number] = claim, plan.chain
        if isinstance(now, Entry) and self._are_done.get(plan.chain, True):
            self.release(plan.number)
            return now
        key = records.key_of(plan.options, self._contents, self._open_file)
        return Assignment(plan, why, path, key)

    def _record_of(self, plan: Plan) -> Path:
        return records.record_path(plan.options, self._records)

    def _claim_of(self, plan: Plan) -> Path:
        """The path of the claim on a bake. All bakes of a chain have that of the first one."""
        first = self._chains[plan.chain][0] if plan.chain else plan
        return records.claim_of(self._record_of(first))

    def _reason(self, plan: Plan, *, is_started: bool = False) -> Entry | str:
        """Why a bake still has to run, in a sentence, or its entry if it is done."""
        path = self._record_of(plan)
        if self._is_forced:
            before = self._before.setdefault(plan.name, _bytes(path))
            if not is_started or _bytes(path) == before:
                return "All bakes are done again."
        record = records.read_record(path)
        if record is None:
            return "Its record cannot be read." if path.exists() else "It has not been baked."
        for name in (limits.DEVIATION, limits.APPEARANCE):
            if name in limits.needs(plan.options.strict) and not all(each.get(name) for each in record.result.reports):
                return f"--strict now limits {name}, which that bake did not measure."
        change = next(self._changes(plan, record), "")
        return change or resumed(plan, record.result)

    def _changes(self, plan: Plan, record: Record) -> Iterator[str]:
        """What is no longer as it was for the bake, in sentences. What takes long comes last."""
        options, old = plan.options, record.key
        if (old.imprint, old.blender) != (versions.imprint(), versions.blender()):
            yield f"It was baked by Imprint {old.imprint} in Blender {old.blender}."
        if old.code != versions.code():
            yield f"It was baked by other code of Imprint {old.imprint}."
        now = records.deciding_settings(options)
        if now != old.settings:
            changed = [name for name in {**old.settings, **now} if _lacks(old.settings, now, name)]
            yield f"Settings have changed: {shorten_list(changed, MOST_NAMED)}."
        yield from self._changes_of_written(options, record)
        files = list(plans.input_paths(options, self._open_file))
        if [(_name(path), what) for path, what in files] != [(_name(each.path), each.what) for each in old.inputs]:
            yield "It was baked from other files."
        pairs = [(before, before.path) for before in record.others]
        pairs += [(before, path) for before, (path, _) in zip(old.inputs, files, strict=False)]
        for before, path in pairs:
            is_elsewhere = self._bounds is not None and not self._bounds.may_read(path)
            if is_elsewhere or records.size_of(path) != before.size:
                yield _has_changed(before)
        for before, path in pairs:
            if not self._contents.of(path).is_same(before):
                yield _has_changed(before)
        if record.key_value != replace(old, settings=now).value:  # all else was found to be the same
            yield "Its record was changed."

    def _changes_of_written(self, options: argparse.Namespace, record: Record) -> Iterator[str]:
        """As `_changes`, of the files that the bake wrote."""
        for file in record.files:
            is_trusted = self._bounds is None
            is_elsewhere = not is_trusted and not self._bounds.may_write(file.path)
            if is_elsewhere or not records.is_unchanged(file, self._contents, is_trusted=is_trusted):
                is_there = os.path.exists(file.path)
                yield f"{file.path!r} {'has changed since it was baked' if is_there else 'is missing'}."
        if options.report and options.report != STDOUT and not os.path.exists(options.report):
            yield f"{options.report!r} is missing."
        if self._pictures and record.picture and record.result.files:
            picture = sheet.picture_path(self._pictures, record.result.files, record.result.inputs)
            if self._contents.of(str(picture)).sha256 != record.picture:
                yield f"Its picture {'has changed' if picture.exists() else 'is missing'}."


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""


def _lacks(old: dict[str, Any], new: dict[str, Any], name: str) -> bool:
    """Whether a setting differs."""
    return name not in old or name not in new or old[name] != new[name]


def _name(path: str) -> str:
    return os.path.basename(os.path.abspath(path))


def _has_changed(content: Content) -> str:
    return f"{content.what[:1].upper()}{content.what[1:]} has changed: {_name(content.path)!r}."


ANSWER_WAIT = 0.1
"""Seconds that the caller waits for what is asked for, before it goes on and asks again."""


class ThreadedQueue(WorkQueue):
    """A queue whose calls return soon, since a thread reads the files. After a signal it is empty."""

    def __init__(self, make: Callable[[Callable[[], None]], WorkQueue], meanwhile: Callable[[], None]):
        """Make the queue in the thread.

        Args:
            make: Gets a function that it calls while it reads files, and that raises Stopped.
            meanwhile: Called while the queue is made.
        """
        self._thread = ThreadPoolExecutor(1, "imprint-queue")
        self._is_closed = threading.Event()
        self._next: Future[Assignment | Entry | None] | None = None
        """What `next` will return."""
        self._wait_until = 0.0
        made = self._thread.submit(make, self._check)
        with ExitStack() as undo:
            undo.callback(self._end_thread)
            try:
                while not wait([made], ANSWER_WAIT).done:
                    meanwhile()
                self._queue = made.result()
            except interruption.Stopped:
                self._queue = WorkQueue(())
            undo.pop_all()
        self.done, self._count = self._queue.done, self._queue.count

    @property
    def count(self) -> int:
        return self._count

    @property
    def left(self) -> list[Assignment]:
        return self._queue.left

    def next(self, taken: Collection[int] = ()) -> Assignment | Entry | None:
        if not self._count:
            return None
        if self._next is None:
            self._next = self._thread.submit(self._queue.next, frozenset(taken))
            self._wait_until = time.monotonic() + ANSWER_WAIT
        if not wait([self._next], max(0.0, self._wait_until - time.monotonic())).done:
            return None
        try:
            item = self._next.result()
        except interruption.Stopped:
            self.stop()
            return None
        if (
            isinstance(item, Assignment) and item.plan.chain in taken
        ):  # it was asked for by the worker that has the chain
            return None
        self._next = None
        self._count -= item is not None
        return item

    def release(self, number: int) -> None:
        self._thread.submit(self._queue.release, number)

    def stop(self) -> None:
        self._count = 0
        self._thread.submit(self._queue.stop)

    def close(self) -> None:
        self._end_thread()
        self._queue.close()

    def _check(self) -> None:
        if self._is_closed.is_set():
            raise interruption.Stopped
        interruption.check()

    def _end_thread(self) -> None:
        self._is_closed.set()
        self._thread.shutdown()
