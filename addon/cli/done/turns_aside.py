# SPDX-License-Identifier: GPL-3.0-or-later
"""Turns in a thread of their own: files are hashed while the caller goes on with signals, limits and messages."""

import threading
import time
from collections.abc import Callable, Collection
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack

from .. import interruption
from .turns import Resumed, ToDo, Turns

WAIT = 0.1
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
                while not wait([made], WAIT).done:
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
            self._wait_until = time.monotonic() + WAIT
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
