# SPDX-License-Identifier: GPL-3.0-or-later
"""A program for the inside of a sandbox: prints as JSON what can be opened for writing there, and what the kernel lets it do.

Arguments: the folders that may be written to. It imports nothing of Imprint, and runs on any Python from 3.9.
"""

import ctypes
import json
import os
import socket
import stat
import sys

HARMLESS = {"/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom"}
"""Devices that every user of a machine may write to, and that keep nothing."""
PLACES = ("/proc", "/sys", "/dev", "/run", "/etc", "/tmp")
"""Where files are that do more than hold bytes. Of other mounts, the rights are looked at."""


def writable_mounts(allowed):
    """The mounts where files could be made: those that are not read-only, without single devices."""
    with open("/proc/self/mountinfo", encoding="utf-8") as file:
        for line in file:
            place, rights = line.split()[4:6]
            if "ro" not in rights.split(",") and os.path.isdir(place) and place not in allowed:
                yield place


def opened(place, allowed):
    """The files, pipes, devices and sockets below a folder that open for writing, and folders that take new files."""
    try:
        found = list(os.scandir(place))
    except OSError:
        return
    for entry in found:
        path = entry.path
        if path in allowed or entry.is_symlink():
            continue
        if entry.is_dir(follow_symlinks=False):
            if os.access(path, os.W_OK | os.X_OK):
                yield path
            yield from opened(path, allowed)
        elif _is_socket(path):
            yield from connected(path)
        else:
            try:
                os.close(os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY))
            except OSError:
                continue
            if path not in HARMLESS:
                yield path


def _is_socket(path):
    try:
        return stat.S_ISSOCK(os.lstat(path).st_mode)
    except OSError:  # it has gone
        return False


def connected(path):
    for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM, socket.SOCK_SEQPACKET):
        try:
            with socket.socket(socket.AF_UNIX, kind) as end:
                end.settimeout(1.0)
                end.connect(path)
        except OSError:
            continue
        yield path


def calls(inputs):
    """The calls that the kernel did not refuse, by name."""
    libc = ctypes.CDLL(None, use_errno=True)
    vsock, local = 40, socket.AF_UNIX
    tries = {
        "socket of virtual machines": lambda: libc.socket(vsock, socket.SOCK_STREAM, 0),
        "local socket": lambda: libc.socket(local, socket.SOCK_STREAM, 0),
        "network socket": lambda: libc.socket(socket.AF_INET, socket.SOCK_DGRAM, 0),
        "user namespace": lambda: libc.unshare(0x10000000),
        "process in a user namespace": lambda: _end(libc.syscall(_CLONE, 0x10000000 | 17, 0, 0, 0, 0)),
        "shared memory": lambda: libc.shmget(0, 4096, 0o1600),
        "keyring": lambda: libc.syscall(_KEYCTL, 0, -3, 1),
        "ring": lambda: libc.syscall(425, 4, ctypes.create_string_buffer(512)),
        "less likely to end": lambda: _write("/proc/self/oom_score_adj", "0"),
    }
    return [name for name, act in tries.items() if act() >= 0]


_CLONE, _KEYCTL = {"x86_64": (56, 250)}.get(os.uname().machine, (220, 219))


def _end(number):
    if number == 0:
        os._exit(0)
    return number


def _write(path, text):
    try:
        with open(path, "w", encoding="ascii") as file:
            return file.write(text)
    except OSError:
        return -1


if __name__ == "__main__":
    *allowed, inputs = sys.argv[1:]
    files = [path for place in (*PLACES, inputs) for path in opened(place, {*allowed})]
    with open("/proc/self/status", encoding="ascii") as file:
        rights = {line.split()[1] for line in file if line.startswith("Cap")}
    print(
        json.dumps(
            {
                "user": os.getuid(),
                "files": sorted(set(files)),
                "mounts": [*writable_mounts({*allowed})],
                "calls": calls(inputs),
                "rights": sorted(rights - {"0" * 16}),
            }
        )
    )
