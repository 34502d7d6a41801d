# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests turns in a thread: their caller goes on while files are read."""

import threading
import time
from types import SimpleNamespace

import pytest

from addon.cli import interruption, work_queue
from addon.cli.work_queue import ThreadedQueue, WorkQueue
from addon.core.contents import BLOCK, Contents


def plans(*chains):
    return [SimpleNamespace(number=number, chain=chain, problem="") for number, chain in enumerate(chains, 1)]


class Slow(WorkQueue):
    """WorkQueue of which each waits for `go`."""

    def __init__(self, planned, check=lambda: None):
        super().__init__(planned)
        self.go, self.calls, self._check = threading.Event(), [], check

    def next(self, taken=()):
        while not self.go.wait(0.01):
            self._check()
        self.calls.append("next")
        return super().next(taken)

    def release(self, number):
        self.calls.append(number)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(work_queue, "ANSWER_WAIT", 0.02)


def aside(*chains):
    """WorkQueue in a thread, and those that it has."""
    made = []
    found = ThreadedQueue(lambda check: made.append(Slow(plans(*chains), check)) or made[0], lambda: None)
    return found, made[0]


def got(turns, taken=()):
    """The next turn, once it is known."""
    for _ in range(500):
        if (turn := turns.next(taken)) is not None:
            return turn.plan.number
        time.sleep(0.01)
    raise AssertionError


def test_the_caller_goes_on_until_a_turn_is_known():
    turns, slow = aside(0, 0)
    with turns:
        assert [turns.next(), turns.next(), turns.count] == [None, None, 2]
        slow.go.set()
        assert [got(turns), turns.count, got(turns), turns.count, turns.next()] == [1, 1, 2, 0, None]
        turns.release(1)
    assert slow.calls == ["next", "next", 1]


def test_a_turn_waits_for_the_worker_that_has_its_chain():
    """It may be asked for by one, and known when another asks."""
    turns, slow = aside(7, 0)
    with turns:
        assert turns.next() is None
        slow.go.set()
        time.sleep(0.1)
        assert [turns.next({7}), turns.next({7}), turns.count] == [None, None, 2]
        assert [got(turns), got(turns, {7})] == [1, 2]


def test_after_a_signal_there_are_no_turns(monkeypatch):
    turns, _ = aside(0, 0)
    with turns:
        assert turns.next() is None
        monkeypatch.setattr(interruption, "code", lambda: 130)
        time.sleep(0.1)
        assert [turns.next(), turns.count] == [None, 0]


def test_an_early_end_waits_for_no_file():
    before = threading.active_count()
    turns, _ = aside(0)
    with turns:
        assert turns.next() is None
    assert threading.active_count() == before


@pytest.mark.parametrize("is_stopped", [True, False])
def test_progress_and_signals_are_served_while_turns_are_made(monkeypatch, is_stopped):
    seen, go = [], threading.Event()

    def make(check):
        while not go.wait(0.01):
            check()
        return WorkQueue(plans(0))

    def meanwhile():
        seen.append(1)
        if len(seen) == 3:
            monkeypatch.setattr(interruption, "code", lambda: 130) if is_stopped else go.set()

    with ThreadedQueue(make, meanwhile) as turns:
        assert (len(seen) >= 3, turns.count) == (True, 0 if is_stopped else 1)


def test_an_error_while_turns_are_made_is_raised():
    def make(_):
        raise OSError("no folder")

    before = threading.active_count()
    with pytest.raises(OSError, match="no folder"):
        ThreadedQueue(make, lambda: None)
    assert threading.active_count() == before


def test_reading_a_file_ends_where_its_check_raises(tmp_path):
    (tmp_path / "a").write_bytes(bytes(3 * BLOCK + 1))
    count = []

    def check():
        count.append(1)
        if len(count) == 2:
            raise interruption.Stopped

    whole = Contents()
    with pytest.raises(interruption.Stopped):
        whole.checking(check).of(str(tmp_path / "a"))
    assert len(count) == 2
    assert whole.of(str(tmp_path / "a")).size == 3 * BLOCK + 1
    assert whole.checking(check).of(str(tmp_path / "a")).sha256  # it is known by now
    assert len(count) == 2
