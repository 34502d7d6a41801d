# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests output to a pipe, and to a terminal that names must not control."""

import ast
import contextlib
import os
import re
import subprocess
import sys
import tempfile
import threading

import bpy
import pytest

from addon.cli import standard_streams
from scripts import imprint
from scripts.imprint import ROOT
from tests.support import scenes, zoo

try:
    import pty
except ImportError:  # Windows
    pty = None


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
def test_a_pipe_that_does_not_block_gets_all_text():
    """Some parent processes set their pipes to non-blocking, which changes them for all processes."""
    source, sink = os.pipe()
    os.set_blocking(sink, False)
    received = []
    reader = threading.Thread(target=lambda: received.extend(iter(lambda: os.read(source, 4096), b"")))
    text = "word " * 100_000
    with standard_streams._text(standard_streams._ErrorTolerantStream(sink, "wb")) as stream:
        threading.Timer(0.05, reader.start).start()
        stream.write(text)
    while not reader.ident:
        pass
    reader.join()
    os.close(source)
    assert b"".join(received).decode() == text


HOSTILE = "a\x1b]0;title\x07\x1b]52;c;eA==\x07\x9b2J\u202e\r\b\nimprint: fake"
PRINTS = """
import sys
from addon.cli import standard_streams
from addon.cli.terminal import Meter
from addon.core.progress import Progress
name = sys.argv[1]
with standard_streams.redirect_blender(), Meter(sys.stderr) as meter:
    assert meter.is_on
    meter.show(name, Progress(f"Reading {name}", 0.5))
    meter.report(f"imprint: warning: {name}")
    meter.show(name, Progress("Rays", 0.6))
    line = name.replace("\\n", "")
    print(f"imprint: {line}", file=sys.stderr)
    print(f"Saved: '{line}'")
"""


def on_terminal(program, *words, **options):
    """All that a process writes to its terminal, and its exit code."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen([*program, *words], stdin=theirs, stdout=theirs, stderr=theirs, **options)
    os.close(theirs)
    parts = []
    with contextlib.suppress(OSError):  # the end, on Linux
        while part := os.read(ours, 1 << 16):
            parts.append(part)
    os.close(ours)
    return b"".join(parts).decode(), process.wait()


def controls(text):
    """The control characters of a text, without the ends of lines, and returns before the line that shows progress."""
    return {each for each in text if not each.isprintable()} - {"\r", "\n"}


@pytest.mark.skipif(pty is None, reason="terminals of POSIX")
def test_a_name_cannot_control_the_terminal():
    said, code = on_terminal([sys.executable, "-c", PRINTS], HOSTILE, cwd=ROOT)
    assert code == 0, said
    assert controls(said) == set()
    assert "\b" not in said
    assert "a?]0;title??]52;c;eA==??2J????imprint: fake" in said
    assert not [line for line in re.split("[\r\n]+", said) if line.startswith("imprint: fake")]


@pytest.mark.slow
@pytest.mark.skipif(pty is None, reason="terminals of POSIX")
@pytest.mark.usefixtures("gpu_context")
def test_an_object_s_name_cannot_control_the_terminal(tmp_path):
    for name in ("low", "high"):
        zoo.plane("low").name = f"a\x1b]0;OWNED\x07\x1b]52;c;eA==\x07_{name}"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "s.blend"))
    words = ["s.blend", "--pairs", "--size", "16", "--untrusted", "--output", "out/{low}.png"]
    said, code = on_terminal([sys.executable, str(ROOT / "scripts" / "bake.py")], *words, cwd=tmp_path)
    assert code == 0, said
    assert "]0;OWNED" in said
    assert controls(said) == set()


SAYS = """
import ctypes, os, sys
from addon.cli import standard_streams
said = int(sys.argv[1])
with standard_streams.redirect_blender(said) as lines:
    os.write(2, b"a warning of a library\\n\\n")
    ctypes.CDLL(None).printf(b"ERROR in C\\n")
    print("ours")
    for number in range(30):
        os.write(1, b"a warning of a library\\nline %d\\n" % number)
    print(lines(), file=sys.stderr)
os.write(2, b"after it\\n")
"""


@pytest.mark.skipif(os.name == "nt", reason="descriptors of POSIX")
def test_what_libraries_print_is_kept_for_the_end():
    with tempfile.TemporaryFile() as said:
        program = [sys.executable, "-c", SAYS, str(said.fileno())]
        done = subprocess.run(program, capture_output=True, text=True, check=True, cwd=ROOT, pass_fds=[said.fileno()])
    assert done.stdout == "ours\n"
    lines, after = done.stderr.splitlines()
    assert after == "after it"
    found = ast.literal_eval(lines)
    assert found[0] == "a warning of a library"
    assert {*found[1:-1]} <= {"ERROR in C", *(f"line {number}" for number in range(30))}
    assert (len(found), found[-1]) == (standard_streams.MOST_LINES + 1, "and 12 more lines")


ENDS = """
import os, signal
os.write(int(os.environ["IMPRINT_OUTPUT"]), b"x" * 9000 + b"\\nlast words\\n\\n")
os.kill(os.getpid(), signal.SIGSEGV)
"""


@pytest.mark.skipif(os.name == "nt", reason="descriptors of POSIX")
def test_the_launcher_shows_what_blender_printed_last_before_a_crash(tmp_path, monkeypatch, capsys):
    (tmp_path / "bake.py").write_text(ENDS)
    monkeypatch.setattr(imprint, "SCRIPTS", tmp_path)
    monkeypatch.setattr(imprint, "environment", lambda: sys.executable)
    monkeypatch.setattr(imprint, "require_gpu", lambda *_, **__: None)
    monkeypatch.setattr(imprint, "probe", lambda _python: (0, ""))
    assert imprint.main(["bake"]) == 1
    first, second, third = capsys.readouterr().err.splitlines()
    assert len(first) < 5000
    assert second == "imprint: Blender: last words"
    assert third.startswith("imprint: Blender crashed with signal 11")


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="descriptors of POSIX")
@pytest.mark.usefixtures("gpu_context")
def test_all_lines_of_a_bake_are_of_imprint(tmp_path):
    scenes.plane_files(tmp_path, low=0.0, high=0.0)
    (tmp_path / "page.png").write_text("<html>")
    (tmp_path / "high.mtl").write_text("newmtl m\nmap_Kd page.png\n")
    mesh = (tmp_path / "high.obj").read_text()
    (tmp_path / "high.obj").write_text(re.sub("^f ", "usemtl m\nf ", mesh, count=1, flags=re.MULTILINE))
    words = "--low-file low.obj --high-file high.obj --size 16 --limit 9 --maps base-color --output m_normal.png"
    program = [sys.executable, imprint.__file__, "bake", *words.split(), "--allow-missing-files"]
    done = subprocess.run(program, capture_output=True, text=True, check=True, cwd=tmp_path)
    lines = done.stderr.splitlines()
    assert all(line.startswith("imprint: ") for line in lines), lines
    assert any(line.startswith("imprint: Blender: ") and "page.png" in line for line in lines)


def test_the_launcher_writes_no_name_as_it_is(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["imprint.py", "bake"])
    imprint.print_message("Blender crashed while baking a\x1b]0;OWNED\x07\x9b2J:\nMemory was low.")
    assert capsys.readouterr().err == "imprint: Blender crashed while baking a?]0;OWNED??2J:\nMemory was low.\n"
