# SPDX-License-Identifier: GPL-3.0-or-later
"""A program that changes claims while the process that has them cannot: Blender keeps Python from running for minutes in it.

It reads messages, a line of JSON each: the path of a claim and its values, or the path alone once it is given up. It ends with
the process that started it.
"""

import json
import os
import select
import subprocess
import sys
import time
from contextlib import suppress


class Heartbeat:
    """This program, as the process sees it that starts it. Where it cannot be started, nothing happens."""

    def __init__(self, every: float):
        """every: seconds between two changes."""
        words = [sys.executable, "-I", "-S", "-B", __file__, str(every)]
        self._process = None
        if os.name != "nt":  # which renames and removes no file that another process has open
            with suppress(OSError):
                self._process = subprocess.Popen(
                    words, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, process_group=0
                )

    @property
    def is_running(self) -> bool:
        """Whether it changes the claims: it may have been killed."""
        return self._process is not None and self._process.poll() is None

    def send(self, path: str, values: dict | None = None) -> None:
        """Change the claim at `path` from now on, or no longer without `values`."""
        if self._process is not None:
            with suppress(OSError):  # it was killed
                self._process.stdin.write(json.dumps([path, values]).encode() + b"\n")
                self._process.stdin.flush()

    def close(self) -> None:
        """End it. Can be called more than once."""
        if self._process is not None:
            with suppress(OSError):
                self._process.stdin.close()
            self._process.wait()


def text(values: dict, count: int) -> bytes:
    """The content of a claim. Its length does not depend on `count`, how often it was changed."""
    return json.dumps({**values, "counter": f"{count:012}"}).encode()


def write(descriptor: int, content: bytes) -> None:
    """Change a claim in place: if another process has taken it over, only a removed file changes. Raises OSError."""
    os.lseek(descriptor, 0, os.SEEK_SET)
    os.write(descriptor, content)
    os.fsync(descriptor)  # so that other machines see it


def run(every: float) -> None:
    """The program."""
    held: dict[str, tuple[int, dict]] = {}
    due, count, rest = time.monotonic() + every, 1, b""
    while True:
        if select.select([0], [], [], max(0.0, due - time.monotonic()))[0]:
            part = os.read(0, 1 << 16)
            if not part:
                return
            *lines, rest = (rest + part).split(b"\n")
            for line in lines:
                _take(held, *json.loads(line))
        if time.monotonic() >= due:
            due, count = time.monotonic() + every, count + 1
            for descriptor, values in held.values():
                with suppress(OSError):  # a share that is gone for a moment
                    write(descriptor, text(values, count))


def _take(held: dict[str, tuple[int, dict]], path: str, values: dict | None) -> None:
    if path in held:
        os.close(held.pop(path)[0])
    if values is None:
        return
    with suppress(OSError, ValueError, KeyError):  # it was given up, or is another's by now
        descriptor = os.open(path, os.O_RDWR)
        if json.loads(os.read(descriptor, 1 << 16))["token"] == values["token"]:
            held[path] = descriptor, values
        else:
            os.close(descriptor)


if __name__ == "__main__":
    run(float(sys.argv[1]))
