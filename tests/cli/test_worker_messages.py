# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what a parent and its workers send each other: no process makes its parent wait, and each waits for its answer."""

import os
import struct
from multiprocessing.connection import Connection
from queue import Empty, SimpleQueue
from types import SimpleNamespace

import pytest

from addon.cli import worker_process
from addon.cli.worker_messages import Accepted, Answer, Line, Ready, packed
from addon.cli.worker_process import Worker
from addon.core.processes import Gone

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the ends of pipes of Windows are no file descriptors")


@pytest.fixture
def made(monkeypatch):
    """A function that makes a worker without a process. Returns the worker, its own end of the connection, and the queue."""
    workers, messages = [], SimpleQueue()

    def make(sandbox=None):
        ends = []
        monkeypatch.setattr(Worker, "_start", lambda _, other: ends.append(Connection(os.dup(other.fileno()))))
        workers.append(Worker(messages, sandbox))
        return workers[-1], ends[0], messages

    yield make
    for worker in workers:
        worker.dismiss()


def test_a_message_waits_until_the_one_before_is_answered(made):
    worker, end, messages = made()
    for message in (Ready(), Accepted(), Line("a")):
        end.send_bytes(packed(message))
    assert messages.get(timeout=9) == (worker, Ready())
    with pytest.raises(Empty):
        messages.get(timeout=0.1)
    worker.answer(Answer("no"))
    assert messages.get(timeout=9) == (worker, Accepted())
    worker.answer()
    assert messages.get(timeout=9) == (worker, Line("a"))
    assert (end.recv(), end.poll()) == (Answer("no"), False)


@pytest.mark.parametrize("content", [b"", b"\0\0\1\0half"], ids=["nothing", "half a message"])
def test_a_process_that_stops_in_a_message_or_reads_none_delays_no_other(made, content):
    slow, end, messages = made()
    os.write(end.fileno(), content)
    slow.answer(b"x" * 4_000_000)
    other, its_end, _ = made()
    its_end.send_bytes(packed(Ready()))
    assert messages.get(timeout=9) == (other, Ready())


@pytest.mark.parametrize("is_trusted", [True, False])
def test_a_message_of_a_process_that_is_not_trusted_has_a_largest_size(made, monkeypatch, is_trusted):
    monkeypatch.setattr(worker_process, "LONGEST_MESSAGE", 1000)
    worker, end, messages = made(None if is_trusted else SimpleNamespace())
    message = Line("x" * 2000)
    end.send_bytes(packed(message))
    wrong = Gone("Its process sent what is not a message.")
    assert messages.get(timeout=9) == (worker, message if is_trusted else wrong)


@pytest.mark.parametrize("content", [b"garbage", b'["Ended", {}]'])
def test_what_is_not_a_message_ends_the_connection(made, content):
    worker, end, messages = made()
    end.send_bytes(content)
    assert messages.get(timeout=9) == (worker, Gone("Its process sent what is not a message."))
    with pytest.raises((EOFError, ConnectionError)):
        end.recv()


def test_a_length_that_is_none_is_not_a_message(made):
    worker, end, messages = made(SimpleNamespace())
    os.write(end.fileno(), struct.pack("!i", -2))
    assert messages.get(timeout=9) == (worker, Gone("Its process sent what is not a message."))


def test_a_process_that_has_closed_its_end_is_gone(made):
    worker, end, messages = made()
    end.send_bytes(packed(Ready()))
    end.close()
    assert messages.get(timeout=9) == (worker, Ready())
    worker.answer(Answer())
    assert messages.get(timeout=9) == (worker, Gone())


def test_a_process_that_is_dismissed_finds_its_connection_closed(made):
    worker, end, messages = made()
    end.send_bytes(packed(Ready()))
    assert messages.get(timeout=9) == (worker, Ready())
    worker.dismiss()
    with pytest.raises(EOFError):
        end.recv()
