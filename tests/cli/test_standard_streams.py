# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests output to a pipe."""

import os
import threading

import pytest

from addon.cli import standard_streams


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
def test_a_pipe_that_does_not_block_gets_all_text():
    """Some parent processes set their pipes to non-blocking, which changes them for all processes."""
    source, sink = os.pipe()
    os.set_blocking(sink, False)
    received = []
    reader = threading.Thread(target=lambda: received.extend(iter(lambda: os.read(source, 4096), b"")))
    text = "word " * 100_000
    with standard_streams._text(standard_streams._Patient(sink, "wb")) as stream:
        threading.Timer(0.05, reader.start).start()
        stream.write(text)
    while not reader.ident:
        pass
    reader.join()
    os.close(source)
    assert b"".join(received).decode() == text
