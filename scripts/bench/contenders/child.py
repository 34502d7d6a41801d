# SPDX-License-Identifier: GPL-3.0-or-later
"""A process that answers requests: a line of JSON each, on its standard input and output."""

import contextlib
import json
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path


class ChildError(RuntimeError):
    """The error message of a process, in one line."""


class Child:
    """A process that answers requests. Its standard error goes to the file `log`. Use it in a `with` block."""

    def __init__(self, command: Sequence[str], log: Path, environment: Mapping[str, str] | None = None):
        self.log = log
        with open(log, "w", encoding="utf-8") as errors:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment
            )

    def __enter__(self) -> "Child":
        return self

    def __exit__(self, *_) -> None:
        with contextlib.suppress(BrokenPipeError):  # it has died
            self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()

    def ask(self, **request) -> dict:
        """The answer to a request. Raises ChildError if it has an "error", or if the process has died."""
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            raise ChildError(f"the process died: {self._last_words()}")
        answer = json.loads(line)
        if "error" in answer:
            raise ChildError(answer["error"])
        return answer

    def _last_words(self) -> str:
        """The last line that the process wrote to its standard error."""
        lines = self.log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1] if lines else "it said nothing"
