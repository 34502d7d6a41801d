# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the sandbox of untrusted files from inside, as root and as a user, without a Blender."""

import json
import os
import shutil
import socket
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from addon.cli import system_calls, untrusted
from addon.cli.untrusted import Bounds, Sandbox
from addon.core import processes
from addon.core.errors import WrongPlace
from tests.support import sandbox_probe
from tests.support import untrusted as support

NOBODY = 65534
PYTHON = "/usr/bin/python3"
"""One that every user may run."""


@pytest.fixture
def places():
    """The folders in/ and out/, which every user may enter, with a socket and a pipe of another program in the first one."""
    root = Path("/tmp") / f"imprint-test-{os.getpid()}"
    for name in ("in", "out", "logs"):
        (root / name).mkdir(parents=True)
    os.mkfifo(root / "in/pipe")
    shutil.copy(sandbox_probe.__file__, root / "in/probe.py")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(root / "in/socket"))
        server.listen()
        for path in (root, *root.rglob("*")):
            path.chmod(0o777)
        yield root
    shutil.rmtree(root)


@pytest.fixture
def box(places, monkeypatch):
    """A sandbox for PYTHON, which another user can start, too."""
    if not os.path.exists(PYTHON):
        pytest.skip(f"no {PYTHON}")
    for name in ("prefix", "base_prefix", "exec_prefix"):
        monkeypatch.setattr(sys, name, "/usr")
    monkeypatch.setattr(sys, "executable", PYTHON)
    monkeypatch.setattr(untrusted, "ROOT", "/usr")
    monkeypatch.chdir(places)
    sandbox = Sandbox(Bounds(str(places / "in"), str(places / "out")), 1 << 30, str(places / "logs"))
    for path in (sandbox._folder.name, sandbox._shared):
        os.chmod(path, 0o777)
    yield sandbox
    sandbox.close()


def looked(box, places, user):
    allowed = [str(places / "out"), str(places / "logs"), box._shared]
    words = box.command([PYTHON, "-I", "-S", str(places / "in/probe.py"), *allowed, str(places / "in")])
    of_user = {"user": user, "group": user, "extra_groups": []} if user != os.getuid() else {}
    done = subprocess.run(words, env=box.environment(), capture_output=True, text=True, check=False, **of_user)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@support.needs_sandbox
@pytest.mark.parametrize("is_nobody", [False, True], ids=["this user", "nobody"])
def test_nothing_outside_the_output_opens_for_writing(box, places, is_nobody):
    """Root may write to files of the kernel without any rights, as their owner; every user may use sockets of others."""
    if is_nobody and os.getuid() != 0:
        pytest.skip("only root can be another user")
    user = NOBODY if is_nobody else os.getuid()
    assert looked(box, places, user) == {"user": user, "files": [], "mounts": [], "calls": [], "rights": []}


@support.needs_sandbox
def test_a_sandbox_that_holds_nothing_back_is_refused(box, places, monkeypatch):
    """As with a bubblewrap that leaves out what it does not know."""
    whole = Sandbox.command

    def without(*left_out):
        def command(self, words, taken=-1):
            found = whole(self, words, taken)
            for pair in left_out:
                at = next(at for at in range(len(found)) if found[at : at + 2] == [*pair])
                del found[at : at + 2]
            return found

        return command

    for left_out, error in (
        (("--remount-ro", "/proc"), "/proc can be written to"),
        (("--remount-ro", "/"), "/ can be written to"),
        (("--seccomp", "9"), "it lets sockets through"),
    ):
        monkeypatch.setattr(Sandbox, "command", without(left_out))
        with pytest.raises(WrongPlace, match=f"bubblewrap, which may not run here \\({error}"):
            Sandbox(box.bounds, 1 << 30)


@support.needs_sandbox
def test_a_worker_cannot_change_what_the_next_one_is_refused(box):
    """The filter is outside of the folders that they write to."""
    words = box.command([PYTHON])
    bound = [words[at + 1] for at, word in enumerate(words) if word in {"--bind", "--ro-bind-try"}]
    assert not [path for path in bound if untrusted.is_below(box._calls, path)]
    assert "8" in box.command([PYTHON], taken=9)[2]  # the descriptor that the command inherits stays


@pytest.fixture
def systemd(places, monkeypatch):
    """A function that puts a systemd-run with this text on the path, as where systemd runs."""
    is_folder = os.path.isdir
    monkeypatch.setattr(untrusted.os.path, "isdir", lambda path: path == "/run/systemd/system" or is_folder(path))
    monkeypatch.setenv("PATH", f"{places / 'bin'}:{os.environ['PATH']}")
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/user/7")

    def write(text):
        (places / "bin").mkdir(exist_ok=True)
        (places / "bin/systemd-run").write_text(f"#!/bin/sh\n{text}\n")
        (places / "bin/systemd-run").chmod(0o755)

    return write


@support.needs_sandbox
@pytest.mark.parametrize("works", [True, False])
def test_a_scope_of_systemd_limits_memory_and_processes_where_it_can(box, places, systemd, works):
    """Without one, as where systemd has no session for the user, the sandbox is the same without it."""
    start = f'echo "$XDG_RUNTIME_DIR $@" > {places}/said; while [ "$1" != -- ]; do shift; done; shift; exec "$@"'
    systemd(start if works else "echo No session >&2; exit 1")
    sandbox = Sandbox(box.bounds, 1 << 30)
    words = sandbox.command([PYTHON, "-I", "-S", "-c", "import os; print(os.environ.get('XDG_RUNTIME_DIR'))"])
    done = subprocess.run(words, env=sandbox.environment(), capture_output=True, text=True, check=True)
    sandbox.close()
    assert (words[0] == "systemd-run", done.stdout) == (works, "None\n")
    if works:
        said = (places / "said").read_text()
        assert said.startswith("/run/user/7 ") and " --scope " in said
        assert (
            f"-p MemoryMax={(1 << 30) * 9 // 8} -p MemorySwapMax=0 -p TasksMax={untrusted.MOST_PROCESSES} -- " in said
        )


@support.needs_sandbox
def test_a_user_has_a_limit_of_processes_in_the_sandbox(box, places, monkeypatch):
    """Those outside do not count. The kernel counts none of root's."""
    monkeypatch.setattr(untrusted, "MOST_PROCESSES", 20)
    program = (
        "import os, time\nfor n in range(40):\n  try:\n    if not os.fork(): time.sleep(9)\n"
        "  except OSError: break\nprint(n, flush=True)\nos.kill(-1, 9)"
    )
    of_user = {"user": NOBODY, "group": NOBODY, "extra_groups": []} if os.getuid() == 0 else {}
    words = box.command([PYTHON, "-I", "-S", "-c", program])
    done = subprocess.run(words, env=box.environment(), stdout=subprocess.PIPE, text=True, check=False, **of_user)
    assert 10 < int(done.stdout) < 20


def test_memory_of_files_without_a_name_counts(tmp_path):
    """As of memfd_create, which maps nothing. A file that has a name takes none."""
    size, own = 1 << 22, os.getpid()
    before = processes.unnamed_memory_of([own])
    descriptor = os.memfd_create("hidden")
    again = os.dup(descriptor)
    try:
        os.write(descriptor, bytes(size))
        with open(tmp_path / "named", "wb") as file:
            file.write(bytes(size))
            file.flush()
            assert size <= processes.unnamed_memory_of([own, own]) - before < 2 * size
    finally:
        os.close(descriptor)
        os.close(again)


def test_devices_that_set_screens_or_divide_gpus_are_not_among_them(monkeypatch):
    there = ["/dev/dri/card0", "/dev/dri/renderD128", "/dev/nvidia0", "/dev/nvidia-caps/nvidia-cap1"]
    there += ["/dev/nvidia-caps/nvidia-cap12", "/dev/nvidia-caps/nvidia-cap30", "/dev/nvidia-nvswitchctl"]
    monkeypatch.setattr(untrusted.glob, "glob", lambda pattern: [p for p in there if Path(p).match(pattern)])
    assert set(untrusted._gpus()) == {there[1], there[2], there[4], there[5]}


def allowed(program, machine, number, argument=0, kind=None):
    """What a filter says of a call, by the rules of Linux's seccomp: None for one that it lets through, or the error."""
    data = struct.pack("<iIQ6Q", number, kind or system_calls._KINDS[machine], 0, argument, 0, 0, 0, 0, 0)
    at = value = 0
    while True:
        code, if_true, if_false, wanted = struct.unpack_from("=HBBI", program, at * 8)
        at += 1
        if code == 0x20:
            value = struct.unpack_from("<I", data, wanted)[0]
        elif code == 0x06:
            return None if wanted == 0x7FFF0000 else wanted - 0x00050000
        else:
            is_true = {0x15: value == wanted, 0x35: value >= wanted, 0x45: bool(value & wanted)}[code]
            at += if_true if is_true else if_false


@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_the_filter_refuses_what_it_names_and_lets_all_else_through(machine):
    program, numbers = system_calls.program(machine), system_calls._NUMBERS[machine]
    refused = {number for number in range(700) if allowed(program, machine, number) is not None}
    assert refused == {number for name, number in numbers.items() if name != "clone"}
    clone = numbers["clone"]
    assert allowed(program, machine, clone, 0x3D0F00) is None  # a thread
    for flag in (0x80, *(1 << bit for bit in (17, 25, 26, 27, 28, 29, 30))):
        assert allowed(program, machine, clone, flag | 17) == 1
    assert allowed(program, machine, 0, kind=0x40000003) == 38  # a program of 32 bits
    assert allowed(program, machine, 0x40000029) == 38
