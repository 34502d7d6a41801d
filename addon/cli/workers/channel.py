# SPDX-License-Identifier: GPL-3.0-or-later
"""The parent's end of the connection to a worker. It never waits for the worker, which may stop in the middle of a message."""

import math
import os
import pickle
import socket
import struct
import time
from multiprocessing.connection import Pipe
from typing import Any

STALLED = 20.0
"""Seconds that a message may take, in either direction, before its worker counts as gone."""
_MOST_AT_ONCE = 1 << 20
"""Bytes that are read or written in one call of the system."""
_LENGTH, _LONG = struct.Struct("!i"), struct.Struct("!Q")
"""What comes before a message of multiprocessing.connection: its bytes, or -1 and its bytes."""


class Channel:
    """A connection whose messages are those of multiprocessing.connection."""

    def __init__(self):
        self.connection, self.other = Pipe()
        """`connection` is for multiprocessing.connection.wait, and `other` the worker's end."""
        self._end = None if os.name == "nt" else socket.socket(fileno=os.dup(self.connection.fileno()))
        self._found, self._needed = bytearray(), _LENGTH.size
        """What has arrived of a message or of its length, and how many bytes that will have."""
        self._has_length = False
        self._unsent = bytearray()
        self._reading_since = self._writing_since = math.inf

    def close(self) -> None:
        """Close both ends, as far as this process has them. Can be called more than once."""
        for each in filter(None, (self.connection, self.other, self._end)):
            each.close()

    @property
    def has_unsent(self) -> bool:
        """Whether `flush` has something to do."""
        return bool(self._unsent)

    @property
    def is_stalled(self) -> bool:
        """Whether a message takes too long."""
        return time.monotonic() - min(self._reading_since, self._writing_since) > STALLED

    def receive(self, most: int | None = None) -> bytes | None:
        """The next message, or None as long as some of it has not arrived. most: the bytes that it may have.

        Raises EOFError if the worker is gone, and OSError for a message with more bytes.
        """
        if self._end is None:  # a pipe of Windows, which has whole messages
            return self.connection.recv_bytes(most)
        while len(self._found) < self._needed:
            try:
                part = self._end.recv(min(self._needed - len(self._found), _MOST_AT_ONCE), socket.MSG_DONTWAIT)
            except BlockingIOError:
                return None
            if not part:
                raise EOFError
            self._reading_since = min(self._reading_since, time.monotonic())
            self._found += part
            if len(self._found) == self._needed and not self._has_length:
                self._begin(most)
        message, self._found, self._needed = bytes(self._found), bytearray(), _LENGTH.size
        self._has_length, self._reading_since = False, math.inf
        return message

    def _begin(self, most: int | None) -> None:
        """The length of a message has arrived."""
        if self._needed == _LONG.size:
            (length,) = _LONG.unpack(self._found)
        else:
            (length,) = _LENGTH.unpack(self._found)
        self._found.clear()
        if length == -1 and self._needed == _LENGTH.size:
            self._needed = _LONG.size
            return
        if length < 0 or (most is not None and length > most):
            raise OSError("the message is too long")
        self._needed, self._has_length = length, True

    def send(self, message: Any) -> None:
        """Send a message as a pickle. What the worker does not take at once is left to `flush`."""
        content = pickle.dumps(message)
        if self._end is None:
            self.connection.send_bytes(content)
            return
        is_long = len(content) > 0x7FFFFFFF
        self._unsent += _LENGTH.pack(-1) + _LONG.pack(len(content)) if is_long else _LENGTH.pack(len(content))
        self._unsent += content
        self._writing_since = min(self._writing_since, time.monotonic())
        self.flush()

    def flush(self) -> None:
        """Send what the worker takes now. Raises OSError if it is gone."""
        while self._unsent:
            try:
                sent = self._end.send(self._unsent[:_MOST_AT_ONCE], socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            del self._unsent[:sent]
        self._writing_since = math.inf
