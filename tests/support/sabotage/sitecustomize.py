# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes bakes fail as no input does on demand. Python imports this module at its start where PYTHONPATH has its folder.

What happens is in the name of the low mesh's file.
"""

import contextlib
import ctypes
import json
import os
import socket
import sys
import time
from importlib.machinery import PathFinder
from multiprocessing import connection
from multiprocessing.connection import Connection
from pathlib import Path

TARGET, HASHES = "addon.cli.baker", "addon.cli.records"
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
    import resource

    here = Path.cwd()  # the input folder
    outside = here.parent / "outside"
    victim, port, name, key = json.loads((here / "victim.json").read_text())
    own = Path(__file__)
    tries = {
        "read": (outside / "secret.txt").read_text,
        "read over a link": (here / "link" / "secret.txt").read_text,
        "list": lambda: os.listdir(outside),
        "write": lambda: (outside / "new.txt").write_text("x"),
        "write to the input folder": lambda: (here / "new.txt").write_text("x"),
        "write to Imprint": lambda: own.with_name("new.txt").write_text("x"),
        "change Imprint's rights": lambda: own.chmod(own.stat().st_mode),
        "write over a link": lambda: (here / "out" / "link" / "new.txt").write_text("x"),
        "truncate": lambda: os.truncate(here / "high.obj", 0),
        "remove": (here / "high.obj").unlink,
        "rename": lambda: os.rename(here / "high.obj", here / "out" / "high.obj"),
        "hard link": lambda: os.link(here / "high.obj", here / "out" / "high.obj"),
        "make a folder": lambda: os.mkdir(outside / "new"),
        **{f"write to {path}": lambda path=path: Path(path, "new").write_text("x") for path in FOLDERS},
        "mount": lambda: _check(ctypes.CDLL(None).mount(b"none", b"/sys", b"tmpfs", 0, None)),
        "internet": lambda: socket.create_connection(("127.0.0.1", port), 1),
        "sockets of this machine": lambda: socket.socket(socket.AF_UNIX).connect(name),
        "signal another process": lambda: os.kill(victim, 0),
        "limit another process": lambda: resource.prlimit(victim, resource.RLIMIT_CPU),
        "slow another process": lambda: os.setpriority(os.PRIO_PROCESS, victim, 19),
        "see other processes": lambda: _check(sum(map(str.isdecimal, os.listdir("/proc"))) - 9),
        "read a process's variables": Path(f"/proc/{victim}/environ").read_bytes,
        "find shared memory": lambda: _check(ctypes.CDLL(None).shmget(key, 0, 0)),
        "read passwords": Path("/etc/shadow").read_text,
        "read the disk": Path(_disk()).read_bytes,
        "read the user's variables": lambda: os.environ["PASSWORD"] or None,
        "leave a core": lambda: resource.setrlimit(resource.RLIMIT_CORE, (1, 1)),
        "take more memory": lambda: resource.setrlimit(resource.RLIMIT_DATA, (1 << 60, 1 << 60)),
        "take all memory": lambda: bytearray(1 << 36),
        "write a large file": lambda: os.truncate(_new(here / "out" / "large"), 33 << 30),
        "open many files": _open_many,
    }
    said = {}
    for name, act in tries.items():
        try:
            act()
            said[name] = "done"
        except (OSError, ValueError, KeyError, MemoryError) as error:
            said[name] = type(error).__name__
    print("STEAL " + json.dumps(said), flush=True)


FOLDERS = "/", "/tmp", "/dev", "/dev/shm", "/usr", "/proc/sys/kernel", "/sys/kernel"
"""Those that programs may write to elsewhere."""


def _check(result):
    """Raises OSError if the system refuses a call."""
    if result < 0:
        raise OSError("refused")


def _open_many():
    found = []
    try:
        while len(found) < 5000:
            found.append(os.dup(0))
    finally:
        for each in found:
            os.close(each)


def _new(path):
    path.touch()
    return path


def _disk():
    """The first disk of this machine that is there."""
    return next((path for path in ("/dev/vda", "/dev/sda", "/dev/nvme0n1") if os.path.exists(path)), "/dev/mem")


def write():
    print("more than Python holds back " * 1000)


def lie():
    """Say that the bake wrote a file of the system, which is its picture as well."""
    from addon.cli import worker

    true = worker.packed

    def packed(message):
        if type(message).__name__ == "Entry":
            message.files[0]["path"] = message.picture = "/etc/passwd"
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
        name = message[1].plan.name if isinstance(message, tuple) else ""
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
    open_files = module.Baker._open

    def sabotaged(baker, plan, **named):
        for word, deed in DEEDS.items():
            if word in Path(plan.options.low_file or "").stem:
                deed()
        return open_files(baker, plan, **named)

    module.Baker._open = sabotaged


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
