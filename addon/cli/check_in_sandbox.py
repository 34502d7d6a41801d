# SPDX-License-Identifier: GPL-3.0-or-later
"""The command `check` for files that are not trusted: the same call in the sandbox, which leaves no file."""

import argparse
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace

from ..core.errors import BakeError
from ..core.naming import printable
from . import interruption, plans, standard_streams, untrusted, worker_process
from .commands import CHECK
from .options import RunOptions
from .run_report import DONE, FAILED, WRONG_USAGE
from .untrusted import MOST_SECONDS, Sandbox, most_memory

MOST_PRINTED = 1 << 20
"""Bytes that are read of what it prints."""


def run(words: Sequence[str], run_options: RunOptions, options: argparse.Namespace) -> int:
    """Print what a `check` of `words` prints in the sandbox. Returns the exit code. Raises BakeError, WrongPlace."""
    with tempfile.TemporaryDirectory(prefix="imprint-check-") as nothing:
        bounds = untrusted.bounds_of(replace(run_options, output_folder=nothing), options)
        for path, what in plans.input_paths(options):
            bounds.check_read(path, what)
        with closing(Sandbox(bounds, run_options.max_memory or most_memory())) as sandbox:
            own = [*worker_process.command(is_untrusted=True)[:-1], CHECK.name, *_without_folders(words)]
            code, printed = _printed(sandbox, own, run_options.timeout or MOST_SECONDS)
    if code not in (DONE, FAILED, WRONG_USAGE):
        raise BakeError(
            "The process that opened the files ended before they were looked at: they may be meant to do harm."
        )
    text = standard_streams.without_egl(printed.decode(errors="replace"))
    print(
        "\n".join(map(printable, text.split("\n"))),
        file=sys.stderr if code else sys.stdout,
    )
    return code


def _without_folders(words: Sequence[str]) -> Iterator[str]:
    """The words without --untrusted and the folders."""
    rest, folders = iter(words), ("--input-folder", "--output-folder")
    for word in rest:
        if word in folders:
            next(rest, None)
        elif word != "--untrusted" and word.partition("=")[0] not in folders:
            yield word


def _printed(sandbox: Sandbox, words: Sequence[str], seconds: float) -> tuple[int, bytes]:
    """Run a command in the sandbox. Returns its exit code, and the first bytes that it prints."""
    variables = {name: value for name, value in sandbox.environment().items() if name not in interruption.OF_LAUNCHER}
    with subprocess.Popen(
        sandbox.command(words),
        env=variables,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    ) as process:
        ending = threading.Timer(seconds, process.kill)  # bubblewrap takes all that it started with it
        ending.start()
        try:
            printed = process.stdout.read(MOST_PRINTED)
            if len(printed) == MOST_PRINTED:
                process.kill()
            return process.wait(), printed
        finally:
            ending.cancel()
