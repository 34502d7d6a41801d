# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes bakes fail as no input does on demand. Python imports this module at its start where PYTHONPATH has its folder.

What happens is in the name of the low mesh's file.
"""

import contextlib
import ctypes
import json
import os
import socket
import subprocess
import sys
import time
from importlib.machinery import PathFinder
from multiprocessing import connection
from multiprocessing.connection import Connection
from pathlib import Path

TARGET, HASHES = "addon.cli.batch", "addon.cli.done.contents"
IS_WORKER = "IMPRINT_WORKER" in os.environ


def crash():
    print("crashes", flush=True)
    ctypes.string_at(0)


def crash_in_silence():
    """As in a block in which Blender's messages are discarded."""
    from addon.cli import standard_streams

    with standard_streams.silence():
        crash()


def fill_memory():
    blocks = []
    while True:
        blocks.append(bytearray(b"x") * (1 << 24))
        time.sleep(0.005)


def hang():
    print("hangs", flush=True)
    time.sleep(1000)


def leave():
    os._exit(7)


def be_killed():
    os.kill(os.getpid(), 9)


def steal():
    """Try what a file that has taken over the process would try. Prints what the system says of each."""
    here = Path.cwd()  # the input folder
    outside = here.parent / "outside"
    parent = os.getppid()
    tries = {
        "read": (outside / "secret.txt").read_text,
        "read over a link": (here / "link" / "secret.txt").read_text,
        "list": lambda: os.listdir(outside),
        "write": lambda: (outside / "new.txt").write_text("x"),
        "write to the input folder": lambda: (here / "new.txt").write_text("x"),
        "write to Imprint": lambda: Path(__file__).with_name("new.txt").write_text("x"),
        "write over a link": lambda: (here / "out" / "link" / "new.txt").write_text("x"),
        "truncate": lambda: os.truncate(outside / "secret.txt", 0),
        "remove": (outside / "secret.txt").unlink,
        "rename": lambda: os.rename(outside / "secret.txt", here / "out" / "secret.txt"),
        "hard link": lambda: os.link(outside / "secret.txt", here / "out" / "secret.txt"),
        "symbolic link": lambda: os.symlink(outside, here / "out" / "way"),
        "make a folder": lambda: os.mkdir(outside / "new"),
        "make a pipe": lambda: os.mkfifo(here / "out" / "pipe"),
        "run a program": lambda: subprocess.run(["/bin/sh", "-c", "true"], check=True),
        "fork": os.fork,
        "replace itself by a file of its own": lambda: os.execv(*_own_program(here / "out" / "program")),
        "internet": lambda: socket.create_connection(("127.0.0.1", 9), 1),
        "datagrams": lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM),
        "sockets of this machine": lambda: socket.socket(socket.AF_UNIX).connect("/run/x"),
        "kill its parent": lambda: os.kill(parent, 0),
        "read its parent's variables": Path(f"/proc/{parent}/environ").read_bytes,
        "read its parent's memory": Path(f"/proc/{parent}/mem").read_bytes,
        "read passwords": Path("/etc/shadow").read_text,
        "read the disk": Path(_disk()).read_bytes,
        "leave a core": lambda: _raise_limit("RLIMIT_CORE"),
        **{name: lambda call=call: _call(*call) for name, call in calls(parent).items()},
        "send to sockets of this machine": lambda: socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM),
    }
    said = {}
    for name, act in tries.items():
        try:
            act()
            said[name] = "done"
        except (OSError, ValueError) as error:
            said[name] = type(error).__name__
    os.chmod(outside / "secret.txt", 0o777)  # succeeds and does nothing
    os.utime(outside / "secret.txt", (1, 1))
    print("STEAL " + json.dumps(said), flush=True)


def calls(victim):
    """System calls against other processes of the user, of which `victim` is one: their numbers on x86_64 and aarch64, and
    arguments. None leaves something where it succeeds, but at the victim."""
    limit = (ctypes.c_ulong * 2)(1, 1)  # the process gets SIGKILL after a second
    processors, priority = ctypes.c_ulong(1), (ctypes.c_int * 12)(48, 3)
    ends = os.pipe()
    owner = (ctypes.c_int * 2)(1, victim)
    return {
        "limit another process": ((302, 261), victim, 0, ctypes.byref(limit), None),
        "slow another process": ((141, 140), 0, victim, 19),
        "move another process": ((203, 122), victim, 8, ctypes.byref(processors)),
        "schedule another process": ((144, 119), victim, 3, ctypes.byref(ctypes.c_int(0))),
        "schedule another process by attributes": ((314, 274), victim, ctypes.byref(priority), 0),
        "slow its files": ((251, 30), 1, victim, 3 << 13),
        "move its memory": ((256, 238), victim, 8, ctypes.byref(ctypes.c_ulong(1)), ctypes.byref(ctypes.c_ulong(1))),
        "compare its files": ((312, 272), victim, victim, 0, 0, 0),
        "signal a thread of another process": ((234, 131), victim, victim, 0),
        "have the kernel signal it": ((72, 25), ends[0], 8, victim),
        "have the kernel signal it by another call": ((72, 25), ends[0], 15, ctypes.byref(owner)),
        "have the kernel send any signal": ((72, 25), ends[0], 10, 9),
        "have the kernel signal it by ioctl": ((16, 29), ends[0], 0x8901, ctypes.byref(ctypes.c_int(victim))),
        "see all shared memory": ((31, 195), 0, 14, ctypes.byref(ctypes.create_string_buffer(512))),
        "see all semaphores": ((66, 191), 0, 0, 19, ctypes.byref(ctypes.create_string_buffer(512))),
        "see all queues": ((71, 187), 0, 12, ctypes.byref(ctypes.create_string_buffer(512))),
        "open a named queue": ((240, 180), b"imprint", 0, 0, None),
        "watch folders": ((294, 26), 0),
        "watch all files": ((300, 262), 0, 0),
        "read the kernel's log": ((103, 116), 3, ctypes.byref(ctypes.create_string_buffer(512)), 512),
    }


def _call(numbers, *arguments):
    """Raises OSError if the system refuses a system call."""
    call = ctypes.CDLL(None, use_errno=True).syscall
    call.restype = ctypes.c_long
    words = [each if not isinstance(each, int) else ctypes.c_long(each) for each in arguments]
    if call(ctypes.c_long(numbers[os.uname().machine == "aarch64"]), *words) < 0:
        raise OSError(ctypes.get_errno(), "refused")


def _disk():
    """The first disk of this machine that is there."""
    return next((path for path in ("/dev/vda", "/dev/sda", "/dev/nvme0n1") if os.path.exists(path)), "/dev/mem")


def _own_program(path):
    path.write_text("#!/bin/sh\nexit 9\n")
    path.chmod(0o755)
    return str(path), [str(path)]


def _raise_limit(name):
    import resource

    resource.setrlimit(getattr(resource, name), (1, 1))


def write():
    print("more than Python holds back " * 1000)


def lie():
    """Say that the bake wrote a file of the system, which is its picture as well."""
    from addon.cli.workers import worker

    true = worker.packed

    def packed(message):
        if type(message).__name__ == "Done":
            message.entry.files[0]["path"] = message.entry.picture = "/etc/passwd"
        return true(message)

    worker.packed = packed


def drip():
    """From now on, send a byte of a message every half second."""
    Early.drips = True


def garble():
    """From now on, send what is no message."""
    Early.is_garbled = True


DEEDS = {
    "lie": lie,
    "drip": drip,
    "garble": garble,
    "steal": steal,
    "crash": crash,
    "mute": crash_in_silence,
    "fill": fill_memory,
    "hang": hang,
    "leave": leave,
    "killed": be_killed,
    "write": write,
}


class Early(Connection):
    """A worker's end of its connection. The first process that receives a bake with "early" in its name is killed."""

    drips = is_garbled = False

    def send_bytes(self, content):
        super().send_bytes(b"garbage" if self.is_garbled else content) if not self.drips else self._drip(content)

    def _drip(self, content):
        for byte in len(content).to_bytes(4, "big") + content:
            os.write(self.fileno(), bytes([byte]))
            time.sleep(0.5)

    def recv(self):
        message = super().recv()
        name = getattr(getattr(message, "plan", None), "name", "")
        with contextlib.suppress(OSError):
            if "early" in name:
                os.close(os.open("early", os.O_CREAT | os.O_EXCL))
                be_killed()
        return message


class Finder:
    """Finds the modules whose functions are replaced."""

    def find_spec(self, name, path=None, target=None):
        change = {TARGET: with_deeds, HASHES: with_slow_files}.get(name)
        if change is None:
            return None
        spec = PathFinder.find_spec(name, path, target)
        load = spec.loader.exec_module

        def exec_module(module):
            load(module)
            change(module)

        spec.loader.exec_module = exec_module
        return spec


def with_deeds(module):
    open_files = module.open_files

    def sabotaged(plan, *more, **named):
        for word, deed in DEEDS.items():
            if word in Path(plan.options.low_file or "").stem:
                deed()
        return open_files(plan, *more, **named)

    module.open_files = sabotaged


def with_slow_files(module):
    """Files with "slow" in their names are read as if they were large, by the parent of all workers."""
    read = module.Contents._hash

    def _hash(self, file):
        for _ in range(600 if "slow" in os.path.basename(file.name) and not IS_WORKER else 0):
            time.sleep(0.1)
            self._check()
        return read(self, file)

    module.Contents._hash = _hash


sys.meta_path.insert(0, Finder())
connection.Connection = Early
