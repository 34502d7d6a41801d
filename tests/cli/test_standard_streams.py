# SPDX-License-Identifier: GPL-3.0-or-later
"""Standard output and what may be on its other end."""

import os
import threading

import pytest

from addon.cli import standard_streams


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
def test_a_pipe_that_does_not_wait_gets_all():
    """As some parents make them, for all who have them open."""
    source, sink = os.pipe()
    os.set_blocking(sink, False)
    got = []
    reader = threading.Thread(target=lambda: got.extend(iter(lambda: os.read(source, 4096), b"")))
    said = "word " * 100_000
    with standard_streams._text(standard_streams._Patient(sink, "wb")) as stream:
        threading.Timer(0.05, reader.start).start()
        stream.write(said)
    while not reader.ident:
        pass
    reader.join()
    os.close(source)
    assert b"".join(got).decode() == said
