# SPDX-License-Identifier: GPL-3.0-or-later
"""The bakes of a run in their order: which still need to run, by their records, and which of them this process has claimed."""

import argparse
import os
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..core import versions
from ..core.errors import BakeError, shorten_list
from . import bake_result, gates, interruption, plans, records, report_file, sheet
from .bake_result import Done, Result
from .claims import Claims
from .options import STDOUT
from .plans import Plan
from .records import Content, Contents, Draft, Record
from .run_report import State
from .untrusted import Bounds


class Chains:
    """The chains of a run in which a bake has failed. Its scene is opened again, without the maps of the bakes before."""

    def __init__(self):
        self._broken: set[int] = set()

    def ended(self, plan: Plan, done: Done) -> None:
        """A bake has ended."""
        if plan.chain and done.entry.state == State.FAILED:
            self._broken.add(plan.chain)

    def refusal(self, plan: Plan) -> Result | None:
        """The result of a bake that would save a scene without the maps of earlier ones; None for one that can be done."""
        if plan.chain not in self._broken or not plan.options.save_blend:
            return None
        error = BakeError("An earlier bake of the same scene has failed, so that it would be saved without all maps.")
        return bake_result.failure(plan.name, error)


@dataclass(frozen=True)
class Resumed:
    """A bake that need not be done."""

    plan: Plan
    result: dict[str, Any]
    """Its entry of the report of the run that did it."""
    is_elsewhere: bool = False
    """Whether another process did it while this run waited."""


@dataclass(frozen=True)
class ToDo:
    """A bake that this process has to do."""

    plan: Plan
    draft: Draft | None = None
    """For the record; None for a bake without one, or that cannot be done."""
    why: str = ""
    """A sentence."""


class Turns:
    """All bakes of a run in their order, without records. Use it in a `with` block.

    This process works off what `next` returns:

        with turns:
            for done in turns.done: ...
            while turns.count:
                turn = turns.next()
                if turn is None: wait a moment, since other processes have those that are left
                elif isinstance(turn, Resumed): ...
                else: bake, recording.finish(...) in any process, and turns.release(turn.plan.number)
    """

    def __init__(self, planned: Sequence[Plan]):
        self.done: list[Resumed] = []
        """The bakes that were done before."""
        self._left = [ToDo(plan, why=plan.problem) for plan in planned]

    def __enter__(self) -> "Turns":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    @property
    def count(self) -> int:
        """The bakes that `next` has to return, now or later."""
        return len(self._left)

    @property
    def left(self) -> list[ToDo]:
        """These bakes. They have no drafts yet."""
        return list(self._left)

    def next(self, taken: Collection[int] = ()) -> ToDo | Resumed | None:
        """The next bake, which this process has from now on, or one that another process has done.

        taken: chains that wait for another worker of this process. None while others do all that are left.
        """
        for turn in self._left:
            if turn.plan.chain not in taken:
                self._left.remove(turn)
                return turn
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


class Resuming(Turns):
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
        """Compare all bakes with their records. is_forced: all are to do. open_file: as in plans.plans. records: as in
        records.record_path. pictures: the folder of pictures. bounds: the folders of files that are not trusted. check: as in
        Contents. on_share: called with the share of the bakes that are compared.
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
        reasons: dict[int, Resumed | str] = {}
        for place, plan in enumerate(planned):
            on_share(place / len(planned))
            reasons[plan.number] = plan.problem or self._reason(plan)
        for plan in planned:
            why = reasons[plan.number]
            if any(not isinstance(reasons[each.number], Resumed) for each in self._chains.get(plan.chain, ())):
                why = why if isinstance(why, str) else "Another bake of the same scene, which is saved, is to do."
            if isinstance(why, Resumed):
                self.done.append(why)
                self._clear(self._claim_of(plan))
            else:
                self._left.append(ToDo(plan, why=why))

    def next(self, taken: Collection[int] = ()) -> ToDo | Resumed | None:
        if self._clock() < self._ask_at:
            return None
        claimed, others = set(), {*taken}
        for todo in self._left:
            if todo.plan.chain in others:
                continue
            turn = self._turn(todo.plan, todo.why)
            if turn is not None:
                self._left.remove(todo)
                return turn
            claimed.add(todo.plan.number)
            others |= {todo.plan.chain} - {0}
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

    def _turn(self, plan: Plan, why: str) -> ToDo | Resumed | None:
        if plan.problem:
            return ToDo(plan, why=why)
        path, claim = self._record_of(plan), self._claim_of(plan)
        if plan.chain not in self._are_done:
            try:
                if not self._claims.take(claim):
                    return None
            except OSError:  # the bake will report that the folder cannot be written to
                return ToDo(plan, why=why)
        # Another process may have done it between the start of this run and now.
        now = self._reason(plan, is_started=True)
        if plan.chain and plan.chain not in self._are_done:
            members = (self._reason(each, is_started=True) for each in self._chains[plan.chain])
            self._are_done[plan.chain] = all(isinstance(each, Resumed) for each in members)
        self._claimed[plan.number] = claim, plan.chain
        if isinstance(now, Resumed) and self._are_done.get(plan.chain, True):
            self.release(plan.number)
            return now
        key = records.key_of(plan.options, self._contents, self._open_file)
        report = report_file.report_path(plan.options.report)
        return ToDo(plan, Draft(path, plan.name, key, report and str(report), bool(self._pictures)), why)

    def _record_of(self, plan: Plan) -> Path:
        return records.record_path(plan.options, self._records)

    def _claim_of(self, plan: Plan) -> Path:
        """The path of the claim on a bake. All bakes of a chain have that of the first one."""
        first = self._chains[plan.chain][0] if plan.chain else plan
        return records.claim_of(self._record_of(first))

    def _reason(self, plan: Plan, *, is_started: bool = False) -> Resumed | str:
        """Why a bake is to do, in a sentence, or that it is done."""
        path = self._record_of(plan)
        if self._is_forced:
            before = self._before.setdefault(plan.name, _bytes(path))
            if not is_started or _bytes(path) == before:
                return "All bakes are done again."
        record = records.read_record(path)
        if record is None:
            return "Its record cannot be read." if path.exists() else "It has not been baked."
        if gates.DEVIATION in gates.needs(plan.options.strict) and not all(
            map(_has_deviation, record.result["reports"])
        ):
            return "Its deviation, which has a limit now, was not measured."
        found = next(self._changes(plan, record), "")
        return found or Resumed(plan, record.result, is_started)

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
        pairs = [(before, before.path) for before in record.found]
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
            is_elsewhere = not is_trusted and not self._bounds.may_write(file.content.path)
            if is_elsewhere or not records.is_unchanged(file, self._contents, is_trusted=is_trusted):
                is_there = os.path.exists(file.content.path)
                yield f"{file.content.path!r} {'has changed since it was baked' if is_there else 'is missing'}."
        if options.report and options.report != STDOUT and not os.path.exists(options.report):
            yield f"{options.report!r} is missing."
        if self._pictures and record.picture and record.result["files"]:
            picture = sheet.picture_path(self._pictures, record.result["files"], record.result["inputs"])
            if self._contents.of(str(picture)).sha256 != record.picture:
                yield f"Its picture {'has changed' if picture.exists() else 'is missing'}."


def _has_deviation(report: dict[str, Any]) -> bool:
    return bool(report.get("deviation"))


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


ASIDE_WAIT = 0.1
"""Seconds that the caller waits for what is asked for, before it goes on and asks again."""


class TurnsAside(Turns):
    """Turns of which each call returns soon. After a signal they stop by themselves."""

    def __init__(self, make: Callable[[Callable[[], None]], Turns], meanwhile: Callable[[], None]):
        """Make the turns. make: gets a function that it calls while it reads files, and that raises Stopped. meanwhile: called
        while they are made."""
        self._thread = ThreadPoolExecutor(1, "imprint-turns")
        self._is_closed = threading.Event()
        self._next: Future[ToDo | Resumed | None] | None = None
        """What `next` will return."""
        self._wait_until = 0.0
        made = self._thread.submit(make, self._check)
        with ExitStack() as undo:
            undo.callback(self._end_thread)
            try:
                while not wait([made], ASIDE_WAIT).done:
                    meanwhile()
                self._turns = made.result()
            except interruption.Stopped:
                self._turns = Turns(())
            undo.pop_all()
        self.done, self._count = self._turns.done, self._turns.count

    @property
    def count(self) -> int:
        return self._count

    @property
    def left(self) -> list[ToDo]:
        return self._turns.left

    def next(self, taken: Collection[int] = ()) -> ToDo | Resumed | None:
        if not self._count:
            return None
        if self._next is None:
            self._next = self._thread.submit(self._turns.next, frozenset(taken))
            self._wait_until = time.monotonic() + ASIDE_WAIT
        if not wait([self._next], max(0.0, self._wait_until - time.monotonic())).done:
            return None
        try:
            turn = self._next.result()
        except interruption.Stopped:
            self.stop()
            return None
        if turn is not None and turn.plan.chain in taken:  # it was asked for by the worker that has the chain
            return None
        self._next = None
        self._count -= turn is not None
        return turn

    def release(self, number: int) -> None:
        self._thread.submit(self._turns.release, number)

    def stop(self) -> None:
        self._count = 0
        self._thread.submit(self._turns.stop)

    def close(self) -> None:
        self._end_thread()
        self._turns.close()

    def _check(self) -> None:
        if self._is_closed.is_set():
            raise interruption.Stopped
        interruption.check()

    def _end_thread(self) -> None:
        self._is_closed.set()
        self._thread.shutdown()
