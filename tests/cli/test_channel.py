# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the connection of a parent to its workers: no message makes the parent wait."""

import os
import pickle
import struct

import pytest

from addon.cli import worker_process
from addon.cli.worker_process import Channel

pytestmark = pytest.mark.skipif(os.name == "nt", reason="pipes of Windows have whole messages")


@pytest.fixture
def ours():
    found = Channel()
    yield found
    found.close()


class Clock:
    """In seconds."""

    now = 1000.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    found = Clock()
    monkeypatch.setattr(worker_process.time, "monotonic", found)
    return found


@pytest.mark.parametrize("size", [0, 1, 100_000])
def test_messages_arrive_one_by_one(ours, size):
    contents = [bytes([number]) * size for number in range(2)]
    for content in contents:
        ours.other.send_bytes(content)
    assert [ours.receive(), ours.receive(), ours.receive()] == [*contents, None]
    ours.send(contents)
    assert (ours.other.recv(), ours.has_unsent) == (contents, False)


def test_a_long_message_arrives_in_parts(ours):
    """Its length is in eight bytes, as multiprocessing writes it from 2 GiB on."""
    content = os.urandom(1000)
    whole = struct.pack("!iQ", -1, len(content)) + content
    for at in range(len(whole)):
        assert ours.receive() is None
        os.write(ours.other.fileno(), whole[at : at + 1])
    assert ours.receive() == content


def test_a_message_that_comes_byte_by_byte_has_one_deadline(ours, clock):
    """Each byte is in time."""
    os.write(ours.other.fileno(), struct.pack("!i", 100))
    for _ in range(20):
        os.write(ours.other.fileno(), b"x")
        assert (ours.receive(), ours.is_stalled) == (None, False)
        clock.now += 1.0
    clock.now += 1.0
    assert ours.is_stalled


def test_a_worker_that_sends_nothing_is_not_stalled(ours, clock):
    for _ in range(2):
        ours.other.send_bytes(b"abc")
        clock.now += 100.0
        assert ours.receive() == b"abc"
        clock.now += 100.0
        assert (ours.receive(), ours.is_stalled) == (None, False)


def test_a_worker_that_takes_nothing_has_a_deadline(ours, clock):
    ours.send(b"x" * 4_000_000)
    clock.now += 19.0
    ours.send(b"y")
    assert (ours.has_unsent, ours.is_stalled) == (True, False)
    clock.now += 2.0
    assert ours.is_stalled


def test_what_a_worker_does_not_take_at_once_is_sent_later(ours):
    message = b"x" * 4_000_000
    ours.send(message)
    found = bytearray()
    while ours.has_unsent:
        found += os.read(ours.other.fileno(), 1 << 20)
        ours.flush()
    while len(found) < 4 + len(pickle.dumps(message)):
        found += os.read(ours.other.fileno(), 1 << 20)
    assert pickle.loads(found[4:]) == message
    assert not ours.is_stalled


@pytest.mark.parametrize("length", [struct.pack("!i", 1001), struct.pack("!iQ", -1, 1001), struct.pack("!i", -2)])
def test_a_message_has_a_largest_size(ours, length):
    os.write(ours.other.fileno(), length)
    with pytest.raises(OSError, match="too long"):
        ours.receive(1000)


def test_a_worker_that_is_gone_has_closed_the_connection(ours):
    ours.other.send_bytes(b"last")
    ours.other.close()
    assert ours.receive() == b"last"
    with pytest.raises(EOFError):
        ours.receive()
    with pytest.raises(OSError, match="pipe"):
        ours.send(b"x")
