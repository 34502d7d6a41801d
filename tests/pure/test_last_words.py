# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what an error has of the text that a process printed before it crashed."""

import random
import subprocess
import sys

import pytest

from addon.core import processes
from tests.support import random_cases

DUMP = """Fatal Python error: Segmentation fault

Current thread 0x00007f1c (most recent call first):
  File "/home/me/addon/mesh/uv.py", line 7 in read
  File "/home/me/scripts/bake.py", line 22 in <module>

Extension modules: numpy.core (total: 1)
"""
STACK = """Current thread's C stack trace (most recent call first):
  Binary file "/usr/lib/libpython3.14.so", at _Py_DumpStack+0x48 [0x7f70120340d7]
  <truncated rest of calls>
"""
"""That of Python 3.14."""
PLACE = ", in read, line 7 of mesh/uv.py"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ""),
        ("\n  \n", ""),
        ("Opening\n", ", after it printed 'Opening'"),
        ("Opening\nReading\n\n", ", after it printed 'Reading'"),
        (DUMP, PLACE),
        (f"Opening\n{DUMP}", f"{PLACE}, after it printed 'Opening'"),
        (f"{DUMP}Writing: /tmp/s.crash.txt\n", f"{PLACE}, after it printed 'Writing: /tmp/s.crash.txt'"),
        (f"Opening\n{DUMP}{STACK}", f"{PLACE}, after it printed 'Opening'"),
        (DUMP.replace("/", "\\"), PLACE),
        ("\x1b[31mred\x07\n", ", after it printed '?[31mred?'"),
        ('  File "/a/b.py", line 3, in f\n', ""),
    ],
)
def test_the_clause_has_the_place_and_the_last_line(text, expected):
    assert processes.crash_output(text) == expected


def test_the_dump_of_this_python_is_understood():
    program = """
import faulthandler, os
faulthandler.enable(all_threads=False)
print("hi", flush=True)
def fall(): os.abort()
fall()"""
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    assert processes.crash_output(done.stdout) == ", in fall, line 5 of <string>, after it printed 'hi'"


@random_cases.seeds(20, fast=2)
def test_a_sentence_stays_one_short_line(seed):
    chance = random.Random(seed)
    letters = 'ab "\n\r\t\x00\x1b\u2028\\/'
    text = "".join(chance.choice(letters) for _ in range(chance.randrange(5000)))
    found = processes.crash_output(f'  File "{text}", line 7 in f{text}\n{text}x{"y" * chance.randrange(500)}')
    assert len(found) < 6 * processes.LONGEST
    assert found.isprintable()


def test_the_tail_begins_after_what_was_printed_before(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(b"before" + b"x" * 10 + "\xff".encode("latin-1"))
    with path.open("rb") as file:
        assert processes.printed_tail(file.fileno(), 6) == "x" * 10 + "\ufffd"
        assert processes.printed_tail(file.fileno(), 1000) == ""
    path.write_bytes(b"y" * 2 * processes.TAIL)
    with path.open("rb") as file:
        assert len(processes.printed_tail(file.fileno())) == processes.TAIL


def test_the_last_line_is_short():
    assert len(processes.last_line("a\n" + "b" * 20_000 + "\n\n")) == processes.LONGEST
